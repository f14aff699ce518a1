//! The figures by which a correction is judged: tension errors and the error at the tip, before and
//! after.

use run::Outcome;
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

    /// Means over runs; `None` without a run.
    #[must_use]
    pub fn mean(all: &[Self]) -> Option<Self> {
        let first = all.first()?;
        let mean = |f: &dyn Fn(&Self) -> f64| all.iter().map(f).sum::<f64>() / all.len() as f64;
        Some(Self {
            tension_rms_n: core::array::from_fn(|i| mean(&|x| x.tension_rms_n[i])),
            worst_tension_rms_n: mean(&|x| x.worst_tension_rms_n),
            tip_rms_n: mean(&|x| x.tip_rms_n),
            from_truth: first.from_truth,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_taken_figure_by_figure() {
        let figures = |worst: f64, tip: f64| Figures {
            tension_rms_n: [worst; UNITS],
            worst_tension_rms_n: worst,
            tip_rms_n: tip,
            from_truth: true,
        };
        let mean = Figures::mean(&[figures(1.0, 5.0), figures(3.0, 6.0)]);
        assert_eq!(mean, Some(figures(2.0, 5.5)));
        assert_eq!(Figures::mean(&[]), None);
    }
}
