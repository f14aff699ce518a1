//! Whole analyses: of a small simulated rig, and of columns that a test makes.

mod between_logs;
mod catalogue;
mod changes;
mod effects;
mod intervals;
mod left_over;
mod load;
mod nameless;
mod noise;
mod other_laws;
mod page;
mod per_sequence;
mod pictures;
mod rig;
mod slow_noise;
mod together;
