//! Scenarios with the real firmware image in the embedded rig; see `tests/`. What they share is
//! here, and the campaign that flips bits of the running image.

/// Bytes of stack that the image's machine code can take, as `cargo xtask inspect` computes them.
/// `cargo xtask test emulated` sets `FORCE_STACK_BOUND`.
///
/// # Panics
/// Where the variable is missing: there is nothing to compare with then.
#[must_use]
pub fn stack_bound() -> u32 {
    let text = std::env::var("FORCE_STACK_BOUND").unwrap_or_default();
    text.parse().unwrap_or_else(|_| {
        panic!(
            "FORCE_STACK_BOUND is `{text}`: run through `cargo xtask test emulated`, which sets it"
        )
    })
}

pub mod descriptors;
pub mod image_faults;
pub mod usb;
