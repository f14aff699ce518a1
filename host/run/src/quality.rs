//! Whether a run did what was commanded; if not, which part failed and why.
//!
//! A force counts as held where all of this is true:
//!
//! * it was within reach in every cycle;
//! * its error settled ([`metrics`](force::metrics)) and was within the band for
//!   [`LEAST_WITHIN_BAND`] of the time from then on, and its root mean square while steady, not
//!   averaged, is below [`MOST_RMS_N`];
//! * neither the controller nor a unit was at a limit for more than [`MOST_SATURATED`] of the
//!   steady time;
//! * no unit dropped out, and the amplifiers had power;
//! * every injection that was asked for happened.

use crate::fault::RunFault;
use emulator_link::Injection;
use force::controller::{Output, Reach};
use force::metrics::{Metrics, Step, SETTLED_FOR_S, SETTLED_WITHIN_N, STEADY_AFTER_S};
use rig::Rig;
use serde::Serialize;
use session::inject;
use session::TimedSample;
use wire::message::flags;
use wire::UNITS;

/// Part of the time after settling for which the error has to be within the band. A friction
/// reversal takes it out for some 0.1 s.
pub const LEAST_WITHIN_BAND: f64 = 0.9;
/// Largest root mean square of the error while steady, N: twice the band. An oscillation faster
/// than the 100 ms over which the band is averaged shows here. The embedded rig's is up to 0.14 N.
pub const MOST_RMS_N: f64 = 2.0 * SETTLED_WITHIN_N;
/// Part of the steady time for which controller or units may be at a limit.
pub const MOST_SATURATED: f64 = 0.05;
/// Difference between a cable's true and its measured tension that is named as a cause, N.
const MEASURED_WRONG_N: f64 = 0.3;
/// Part of the force error that a cable's own error has to be to be named as its cause: less of it
/// can't make up the rest, since no cable acts on the tip with more than its tension.
const CAUSES: f64 = 0.5;
/// Distance from the largest setpoint at which a setpoint counts as being there, N.
const AT_LIMIT_N: f64 = 1e-3;

/// What was not as commanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ShortfallKind {
    /// The run ended early.
    Stopped,
    /// A unit dropped out or was left out.
    UnitLost,
    /// The amplifiers lost power.
    AmplifiersOff,
    /// The commanded force was out of reach.
    OutOfReach,
    /// The run was too short to tell.
    TooShort,
    /// The error never settled.
    NeverSettled,
    /// The error settled and left its band again.
    OutsideBand,
    /// Controller or units were at a limit.
    Saturated,
    /// An injection did not happen.
    NotInjected,
}

/// One thing that was not as commanded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Shortfall {
    /// Which.
    pub kind: ShortfallKind,
    /// Which and why, in a sentence without its full stop.
    pub text: String,
}

impl Shortfall {
    pub(super) fn new(kind: ShortfallKind, text: impl Into<String>) -> Self {
        Self {
            kind,
            text: text.into(),
        }
    }
}

/// How often controller and units were at a limit while the force was steady.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Saturation {
    cycles: u64,
    /// Cycles with the controller's integral at its limit.
    integral: u64,
    /// Cycles with a compensated force out of reach and this cable at its largest setpoint.
    cable: [u64; UNITS],
    samples: [u64; UNITS],
    /// Samples with the unit's command at its upper limit.
    command: [u64; UNITS],
    /// Samples with it at its lower limit.
    at_zero: [u64; UNITS],
}

impl Saturation {
    /// Counts a cycle at a time after the command, s.
    pub(super) fn note_cycle(&mut self, t_s: f64, output: &Output, rig: &Rig) {
        if t_s < STEADY_AFTER_S {
            return;
        }
        self.cycles += 1;
        self.integral += u64::from(output.integral_limited);
        if !output.allocation.feasible {
            for (i, unit) in rig.units.iter().enumerate() {
                let at_limit = output.allocation.tension_n[i] >= unit.tension_max_n - AT_LIMIT_N;
                self.cable[i] += u64::from(at_limit);
            }
        }
    }

    /// Counts samples that arrived at a time after the command, s.
    pub(super) fn note_samples(&mut self, t_s: f64, samples: &[TimedSample]) {
        if t_s < STEADY_AFTER_S {
            return;
        }
        for sample in samples.iter().map(|timed| &timed.sample) {
            let i = usize::from(sample.unit);
            if i < UNITS {
                self.samples[i] += 1;
                self.command[i] += u64::from(sample.flags & flags::LIMITED != 0);
                self.at_zero[i] += u64::from(sample.flags & flags::AT_ZERO != 0);
            }
        }
    }

    /// The limit that was reached most, where that was too often.
    fn describe(&self, rig: &Rig) -> Option<String> {
        let part = |count: u64, of: u64| count as f64 / of.max(1) as f64;
        let too_often = |part: f64| part > MOST_SATURATED;
        let worst = |counts: [u64; UNITS], of: [u64; UNITS]| {
            (0..UNITS)
                .map(|i| (part(counts[i], of[i]), i))
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|(part, _)| too_often(*part))
        };
        if let Some((part, i)) = worst(self.command, self.samples) {
            return Some(format!(
                "unit {}'s command was at its limit of {} N (`force_limit_n`), or of `authority_n` over the friction model, for \
                 {:.0} % of the time: amplifier, motor or cable gives less than the rig file says",
                i + 1,
                rig.units[i].force_limit_n,
                100.0 * part
            ));
        }
        if let Some((part, i)) = worst(self.at_zero, self.samples) {
            return Some(format!(
                "unit {}'s command was at its limit of 0 N for {:.0} % of the time: amplifier or motor gives more than the rig \
                 file says, the load cell reads too much, or something else pulls the cable",
                i + 1,
                100.0 * part
            ));
        }
        if let Some((part, i)) = worst(self.cable, [self.cycles; UNITS]) {
            return Some(format!(
                "the setpoint of cable {} was at its limit of {} N (`tension_max_n`) for {:.0} % of the time and the force \
                 needed more",
                i + 1,
                rig.units[i].tension_max_n,
                100.0 * part
            ));
        }
        let integral = part(self.integral, self.cycles);
        too_often(integral).then(|| {
            format!(
                "the force controller's integral was at its limit of {} N (`integral_limit_n`) for {:.0} % of the time",
                rig.controller.integral_limit_n,
                100.0 * integral
            )
        })
    }
}

/// What a run has shown, to be judged.
pub(super) struct Evidence<'a> {
    pub(super) rig: &'a Rig,
    /// Whether it was ended from outside.
    pub(super) interrupted: bool,
    pub(super) steps: &'a [Step],
    /// Where the steps begin that follow each other without a gap.
    pub(super) whole_from: usize,
    pub(super) metrics: Option<&'a Metrics>,
    pub(super) faults: &'a [RunFault],
    pub(super) reach: Option<&'a Reach>,
    pub(super) amplifiers_off_s: f64,
    pub(super) saturation: &'a Saturation,
    /// Injections that did not happen, with their times in s.
    pub(super) not_injected: &'a [(f64, Injection)],
    /// Why the run ended early.
    pub(super) stopped: Option<&'a str>,
}

impl Evidence<'_> {
    /// Everything that was not as commanded, the most important first.
    pub(super) fn judge(&self) -> Vec<Shortfall> {
        use ShortfallKind as Kind;
        let mut found = Vec::new();
        let mut add = |kind, text: String| found.push(Shortfall::new(kind, text));
        if let Some(why) = self.stopped {
            add(Kind::Stopped, format!("the run was stopped: {why}"));
        }
        for fault in self.faults {
            if let Some(unit) = fault.unit {
                let when = if fault.t_s < -2.0 {
                    "was left out from the start".to_owned()
                } else {
                    format!("dropped out at {:.2} s", fault.t_s)
                };
                add(
                    Kind::UnitLost,
                    format!("unit {unit} {when} (fault {})", fault.code),
                );
            }
        }
        if self.amplifiers_off_s > 0.0 {
            add(
                Kind::AmplifiersOff,
                format!(
                    "the amplifiers were without power for {:.3} s",
                    self.amplifiers_off_s
                ),
            );
        }
        if let Some(reach) = self.reach.filter(|reach| !reach.feasible) {
            add(Kind::OutOfReach, reach.describe());
        }
        let limit = self.saturation.describe(self.rig);
        let unsteady = self.unsteady(limit.as_deref());
        match (unsteady, limit) {
            (Some(unsteady), _) => found.push(unsteady),
            (None, Some(limit)) => add(Kind::Saturated, limit),
            (None, None) => {}
        }
        for (at_s, injection) in self.not_injected {
            found.push(Shortfall::new(
                Kind::NotInjected,
                format!(
                    "{} was not injected: the run ended before",
                    inject::describe_at(*at_s, injection)
                ),
            ));
        }
        found
    }

    /// An error that did not settle or stay within the band, with its cause.
    fn unsteady(&self, limit: Option<&str>) -> Option<Shortfall> {
        use ShortfallKind as Kind;
        if self.stopped.is_some() || self.interrupted {
            return None;
        }
        let settled = self.metrics.is_some_and(|m| m.settling_s.is_some());
        let held_s = self.steps.last().map_or(0.0, |step| step.t_s);
        if !settled && held_s < STEADY_AFTER_S + SETTLED_FOR_S {
            let text = format!(
                "the force was held for {held_s:.2} s, too short to tell whether it settles; give --duration 2 or more"
            );
            return Some(Shortfall::new(Kind::TooShort, text));
        }
        let (kind, what) = match self.metrics {
            None => return None,
            Some(m) if m.settling_s.is_none() => (
                Kind::NeverSettled,
                format!(
                    "the force never settled: its error was at no time within {SETTLED_WITHIN_N} N for {SETTLED_FOR_S} s, \
                     {:.2} N RMS",
                    m.tip_force_rms_n
                ),
            ),
            Some(m) if m.within_band < LEAST_WITHIN_BAND || m.tip_force_rms_n > MOST_RMS_N => (
                Kind::OutsideBand,
                format!(
                    "the force left its band: its error was within {SETTLED_WITHIN_N} N for {:.0} % of the time after it \
                     had settled, {:.2} N RMS",
                    100.0 * m.within_band,
                    m.tip_force_rms_n
                ),
            ),
            Some(_) => return None,
        };
        // A loop that swings reaches limits as well: they are no cause then.
        let why = self
            .swing()
            .or_else(|| limit.map(str::to_owned))
            .or_else(|| self.furthest_cable());
        Some(Shortfall::new(
            kind,
            why.map_or_else(|| what.clone(), |why| format!("{what}; {why}")),
        ))
    }

    /// What was recorded while the force was steady.
    fn steady(&self) -> Vec<&Step> {
        let steps = self.steps.iter();
        steps.filter(|step| step.t_s >= STEADY_AFTER_S).collect()
    }

    /// What swings and makes a good part of the error: the furthest cable, else the force, to
    /// which several cables add.
    fn swing(&self) -> Option<String> {
        let metrics = self.metrics?;
        let mut steady = self.steady();
        // Rows of which some are missing would swing at another rate.
        let from_s = self.steps.get(self.whole_from)?.t_s;
        steady.retain(|step| step.t_s >= from_s);
        let rate = |rms_n: f64, error_n: &dyn Fn(&Step) -> f64| {
            let errors = steady.iter().map(|step| (step.t_s, error_n(step)));
            swing_hz(errors).filter(|_| rms_n > CAUSES * metrics.tip_force_rms_n)
        };
        let i = largest(metrics.tension_rms_n)?;
        let cable = rate(metrics.tension_rms_n[i], &|step| {
            step.measured_tension_n[i] - step.tension_setpoint_n[i]
        });
        let what = match cable {
            Some(hz) => format!(
                "cable {} is furthest from its setpoint, {:.2} N RMS, and swings {hz:.1} times a second",
                i + 1,
                metrics.tension_rms_n[i]
            ),
            None => {
                let hz = (0..3).find_map(|k| {
                    let error_n = |step: &Step| step.estimated_n[k] - step.commanded_n[k];
                    let square: f64 = steady.iter().map(|step| error_n(step).powi(2)).sum();
                    rate((square / steady.len() as f64).sqrt(), &error_n)
                })?;
                format!("it swings {hz:.1} times a second")
            }
        };
        Some(format!(
            "{what}, as loops do on a robot that gives way under its cables, with a late drive, or with gains that are too high \
             (docs/architecture.md, `A robot that gives way`)"
        ))
    }

    /// The cable that explains an error best, or that none does.
    fn furthest_cable(&self) -> Option<String> {
        let metrics = self.metrics?;
        let steady = self.steady();
        // How much more tension a cable has than its unit measures.
        let hidden_n: Option<[f64; UNITS]> = steady
            .iter()
            .map(|step| step.true_tension_n.map(|truth| (truth, step)))
            .collect::<Option<Vec<_>>>()
            .map(|pairs| {
                core::array::from_fn(|i| {
                    let sum: f64 = pairs
                        .iter()
                        .map(|(truth, step)| truth[i] - step.measured_tension_n[i])
                        .sum();
                    sum / pairs.len().max(1) as f64
                })
            });
        let causes = |error_n: f64| error_n.abs() > CAUSES * metrics.tip_force_rms_n;
        if let Some((i, n)) = hidden_n.and_then(|n| largest(n).map(|i| (i, n[i]))) {
            if n.abs() > MEASURED_WRONG_N && causes(n) {
                return Some(format!(
                    "cable {} has {:.2} N {} than unit {} measures, so the unit's zero or scale is wrong",
                    i + 1,
                    n.abs(),
                    if n > 0.0 { "more" } else { "less" },
                    i + 1
                ));
            }
        }
        let i = largest(metrics.tension_rms_n)?;
        let (number, error_n) = (i + 1, metrics.tension_rms_n[i]);
        Some(if causes(error_n) {
            format!("cable {number} is furthest from its setpoint, {error_n:.2} N RMS")
        } else {
            format!(
                "the cables follow their setpoints (cable {number} is furthest, {error_n:.2} N RMS), so it is not in one cable: \
                 the command may change slowly (`slew_n_per_s` of the controller), units may not stand where the rig file says, \
                 or something else loads the tip"
            )
        })
    }
}

/// Which of the values is largest in size.
fn largest(values: [f64; UNITS]) -> Option<usize> {
    (0..UNITS).max_by(|a, b| values[*a].abs().total_cmp(&values[*b].abs()))
}

/// Slowest swing of a tension loop, Hz: below it the robot's own motion may repeat.
const SLOWEST_SWING_HZ: f64 = 0.8;
/// Periods in a row that make a swing, and the largest part by which they may scatter.
const SWING_PERIODS: usize = 4;
const SWING_SCATTER: f64 = 0.25;

/// How often a second an error swings; `None`: not regularly. Of errors over time, s. Half the RMS
/// on either side of the mean is hysteresis against noise.
fn swing_hz(errors: impl Iterator<Item = (f64, f64)> + Clone) -> Option<f64> {
    let count = errors.clone().count() as f64;
    let mean = errors.clone().map(|(_, e)| e).sum::<f64>() / count;
    let rms = (errors.clone().map(|(_, e)| (e - mean).powi(2)).sum::<f64>() / count).sqrt();
    let mut ups: Vec<f64> = Vec::new();
    let mut low = false;
    for (t, e) in errors {
        if e - mean < -0.5 * rms {
            low = true;
        } else if low && e - mean > 0.5 * rms {
            low = false;
            ups.push(t);
        }
    }
    let periods: Vec<f64> = ups.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if periods.len() < SWING_PERIODS {
        return None;
    }
    let period = periods.iter().sum::<f64>() / periods.len() as f64;
    let variance = periods.iter().map(|p| (p - period).powi(2)).sum::<f64>() / periods.len() as f64;
    let regular = variance.sqrt() < SWING_SCATTER * period;
    (regular && period * SLOWEST_SWING_HZ < 1.0).then(|| 1.0 / period)
}

#[cfg(test)]
mod tests {
    use super::*;
    use force::metrics;
    use nalgebra::Vector3;

    /// A run of 5 s whose force is off by `error_n` and whose cable 4 is off by as much.
    fn steps(error_n: impl Fn(f64) -> f64) -> Vec<Step> {
        (0..500)
            .map(|n| {
                let t_s = f64::from(n) * 0.01;
                let mut tension_n = [2.0; UNITS];
                tension_n[3] += error_n(t_s);
                Step {
                    t_s,
                    tip_m: Vector3::zeros(),
                    commanded_n: Vector3::new(0.0, 2.5, 0.0),
                    estimated_n: Vector3::new(0.0, 2.5 + error_n(t_s), 0.0),
                    applied_n: None,
                    tension_setpoint_n: [2.0; UNITS],
                    measured_tension_n: tension_n,
                    true_tension_n: None,
                    available: [true; UNITS],
                }
            })
            .collect()
    }

    fn judge(steps: &[Step], saturation: &Saturation) -> Vec<Shortfall> {
        let metrics = metrics::of_run(Vector3::new(0.0, 2.5, 0.0), steps);
        Evidence {
            rig: &Rig::built_in().unwrap(),
            interrupted: false,
            steps,
            whole_from: 0,
            metrics: metrics.as_ref(),
            faults: &[],
            reach: None,
            amplifiers_off_s: 0.0,
            saturation,
            not_injected: &[],
            stopped: None,
        }
        .judge()
    }

    fn kinds(found: &[Shortfall]) -> Vec<ShortfallKind> {
        found.iter().map(|shortfall| shortfall.kind).collect()
    }

    #[test]
    fn an_error_that_never_settles_or_comes_back_is_told_with_its_cable() {
        let none = Saturation::default();
        assert_eq!(judge(&steps(|_| 0.05), &none), []);
        // A reversal of 0.1 s now and then is part of a moving rig.
        let reversals = steps(|t| if t.fract() < 0.05 { 0.3 } else { 0.02 });
        assert_eq!(judge(&reversals, &none), []);
        let never = judge(&steps(|_| 0.5), &none);
        assert_eq!(kinds(&never), [ShortfallKind::NeverSettled]);
        assert!(
            never[0].text.contains("0.50 N RMS") && never[0].text.contains("cable 4"),
            "{never:?}"
        );
        let later = judge(&steps(|t| if t > 2.0 { 0.9 } else { 0.0 }), &none);
        assert_eq!(kinds(&later), [ShortfallKind::OutsideBand]);
        assert!(later[0].text.contains("cable 4"), "{later:?}");
        // Oscillation whose average over 100 ms is good.
        let fast = judge(
            &steps(|t| {
                if (t * 100.0) as i64 % 2 == 0 {
                    0.6
                } else {
                    -0.6
                }
            }),
            &none,
        );
        assert_eq!(kinds(&fast), [ShortfallKind::OutsideBand], "{fast:?}");
        for cycles in [40, 120] {
            let short = judge(&steps(|_| 0.5)[..cycles], &none);
            assert_eq!(kinds(&short), [ShortfallKind::TooShort]);
        }
        // One that has settled is long enough.
        assert_eq!(judge(&steps(|_| 0.0)[..120], &none), []);
    }

    #[test]
    fn a_swing_is_told_with_its_rate() {
        let told = |error_n: &dyn Fn(f64) -> f64| {
            let found = judge(&steps(error_n), &Saturation::default());
            found
                .first()
                .map_or(String::new(), |first| first.text.clone())
        };
        let swing = |hz: f64| move |t: f64| 0.6 * (std::f64::consts::TAU * hz * t).sin();
        let text = told(&swing(2.0));
        assert!(text.contains("swings 2.0 times a second"), "{text}");
        // Reversals of a robot that moves slowly back and forth, and errors without a period.
        for error_n in [&swing(0.5) as &dyn Fn(f64) -> f64, &|t: f64| {
            0.6 * (4.0 * t * t).sin()
        }] {
            let text = told(error_n);
            assert!(
                text.contains("furthest") && !text.contains("swings"),
                "{text}"
            );
        }
    }

    /// Six cables that are off by little each, and a load that no cable makes.
    #[test]
    fn an_error_that_is_in_no_cable_is_told_as_that() {
        let told = |error_n: &dyn Fn(f64) -> f64| {
            let mut steps = steps(error_n);
            for step in &mut steps {
                step.measured_tension_n = step.tension_setpoint_n.map(|tension_n| tension_n + 0.01);
            }
            judge(&steps, &Saturation::default())[0].text.clone()
        };
        let text = told(&|t: f64| 0.6 * (std::f64::consts::TAU * 2.0 * t).sin());
        assert!(text.contains("it swings 2.0 times a second"), "{text}");
        let text = told(&|_| 0.5);
        assert!(
            text.contains("the cables follow their setpoints") && !text.contains("swings"),
            "{text}"
        );
    }

    #[test]
    fn a_unit_that_measures_too_little_is_named() {
        let mut wrong = steps(|_| 0.0);
        for step in &mut wrong {
            step.applied_n = Some(Vector3::new(0.0, 2.5, 3.0));
            let mut tension_n = step.measured_tension_n;
            tension_n[1] += 3.0;
            step.true_tension_n = Some(tension_n);
        }
        let found = judge(&wrong, &Saturation::default());
        assert_eq!(kinds(&found), [ShortfallKind::NeverSettled]);
        assert!(
            found[0]
                .text
                .contains("cable 2 has 3.00 N more than unit 2 measures"),
            "{found:?}"
        );
    }

    #[test]
    fn a_limit_is_told_alone_and_as_the_cause() {
        let mut saturation = Saturation {
            cycles: 400,
            samples: [1280; UNITS],
            ..Saturation::default()
        };
        // Below the allowed part.
        saturation.integral = 20;
        assert_eq!(judge(&steps(|_| 0.0), &saturation), []);
        for (change, words) in [
            (
                Saturation {
                    integral: 100,
                    ..saturation.clone()
                },
                "integral_limit_n",
            ),
            (
                Saturation {
                    cable: [0, 0, 300, 0, 0, 0],
                    ..saturation.clone()
                },
                "cable 3 was at its limit of 12 N",
            ),
            (
                Saturation {
                    command: [0, 0, 1200, 0, 0, 0],
                    ..saturation.clone()
                },
                "unit 3's command was at its limit of 16 N",
            ),
            (
                Saturation {
                    at_zero: [0, 1200, 0, 0, 0, 0],
                    ..saturation.clone()
                },
                "unit 2's command was at its limit of 0 N",
            ),
        ] {
            let found = judge(&steps(|_| 0.0), &change);
            assert_eq!(kinds(&found), [ShortfallKind::Saturated]);
            assert!(found[0].text.contains(words), "{found:?}");
            let found = judge(&steps(|_| 2.0), &change);
            assert_eq!(kinds(&found), [ShortfallKind::NeverSettled]);
            assert!(found[0].text.contains(words), "{found:?}");
        }
    }
}
