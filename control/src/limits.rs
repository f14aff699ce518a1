//! How fast and how far a command may go.

use crate::units::Newton;

/// Moves `from` towards `to` by at most `step` (not negative); says whether it was held back.
#[must_use]
pub fn approach(from: Newton, to: Newton, step: Newton) -> (Newton, bool) {
    let low = from.saturating_sub(step);
    let high = from.saturating_add(step);
    let next = to.clamp_to(low, high);
    (next, next != to)
}

/// What a rate (force steps a microsecond, times 65,536) comes to in `dt_us`.
#[must_use]
pub fn slew_step(rate_us_q16: i32, dt_us: u32) -> Newton {
    Newton::from_wide_shifted(i64::from(rate_us_q16) * i64::from(dt_us), 16)
}
