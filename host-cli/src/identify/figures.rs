//! The figures by which a correction is judged: tension errors and the error at the tip, before and after.

use crate::run::Outcome;
use serde::Serialize;
use wire::UNITS;

/// The figures that a correction is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// RMS of tension less setpoint, each cable, N.
    pub tension_rms_n: [f64; UNITS],
    /// The worst cable's.
    pub worst_tension_rms_n: f64,
    /// RMS of the length of the force error at the tip, N.
    pub tip_rms_n: f64,
    /// Whether they are the plant's truth (embedded rig) or the load cells'.
    pub from_truth: bool,
}

impl Figures {
    /// Of a run; `None` where it was too short.
    #[must_use]
    pub fn of(outcome: &Outcome) -> Option<Self> {
        let metrics = outcome.metrics.as_ref()?;
        Some(Self {
            tension_rms_n: metrics.tension_rms_n,
            worst_tension_rms_n: metrics.tension_rms_n.into_iter().fold(0.0, f64::max),
            tip_rms_n: metrics.tip_force_rms_n,
            from_truth: metrics.from_truth,
        })
    }

    /// Whether these are better than those of before: the worst cable by 2 % at least, the tip no worse than 5 %.
    #[must_use]
    pub fn better_than(&self, before: &Self) -> bool {
        self.worst_tension_rms_n <= 0.98 * before.worst_tension_rms_n
            && self.tip_rms_n <= 1.05 * before.tip_rms_n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn better_is_two_percent_on_the_worst_cable_and_no_loss_at_the_tip() {
        let figures = |worst: f64, tip: f64| Figures {
            tension_rms_n: [worst; UNITS],
            worst_tension_rms_n: worst,
            tip_rms_n: tip,
            from_truth: true,
        };
        let before = figures(0.1, 0.1);
        for (worst, tip, better) in [
            (0.097, 0.1, true),
            (0.099, 0.05, false),
            (0.05, 0.104, true),
            (0.05, 0.106, false),
            (f64::NAN, 0.05, false),
        ] {
            assert_eq!(
                figures(worst, tip).better_than(&before),
                better,
                "{worst} {tip}"
            );
        }
    }
}
