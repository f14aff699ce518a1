//! Scenarios with the real firmware image in the embedded rig; see `tests/`. What they share is here.

pub mod descriptors;
pub mod usb;
