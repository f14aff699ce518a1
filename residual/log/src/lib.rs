//! Measured logs: the model file that says how to read them, the readers, what is wrong with the
//! data, and the columns that the analysis works on.

pub mod data;
pub mod finding;
pub mod hygiene;
pub mod load;
pub mod spec;
