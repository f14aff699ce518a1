//! Host library of the force rig.
#![forbid(unsafe_code)]
#![deny(missing_docs)]

pub mod allocation;
pub mod rigfile;
pub mod vec3;
