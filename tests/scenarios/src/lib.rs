//! Scenarios with the real firmware image in the embedded rig; they are in `tests/`.
