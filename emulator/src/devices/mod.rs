//! The chips around the controller, written from their datasheets' facts and from nothing in the
//! firmware: the model then does not share a driver's misreading.
//!
//! Models know no engine and no wiring. They get virtual time in nanoseconds with every call and
//! hand back levels and bytes; [`crate::board`] connects them.

pub mod dac7731;
pub mod ls7266r1;
pub mod nau7802;
pub mod plc;
pub mod sinc;
pub mod tca9548a;

use std::collections::BTreeMap;

/// Misuse of a chip that a real one would not report, but work wrongly. Each kind once, with
/// a count.
#[derive(Debug, Clone, Default)]
pub struct Complaints(BTreeMap<(String, String), u64>);

impl Complaints {
    /// Notes that `what` happened at `place`.
    pub fn add(&mut self, place: impl Into<String>, what: impl Into<String>) {
        *self.0.entry((place.into(), what.into())).or_default() += 1;
    }

    /// Every complaint: place, what, how often.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str, u64)> {
        (self.0.iter()).map(|((place, what), count)| (place.as_str(), what.as_str(), *count))
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
