//! One case: an armed rig, one injection or two, and a watch on the truth.

use crate::injection::{Injection, Plan};
use crate::outcome::{Hazard, Outcome, MOTION_M, PULL_MS, PULL_N, SLACK_MS, SLACK_N, TENSION_N};
use crate::rig::Rig;
use control::{MotorState, SystemState};
use wire::UNITS;

/// Armed rigs that cases begin from, each with its own plant and tensions.
pub const BASES: u64 = 8;

/// How long a case is watched after its last injection, in milliseconds.
const WATCH_MS: u32 = 700;
/// How much longer where a hazard came and no fault yet: a sensor that drifts is noticed when its error is large enough.
const AFTER_HAZARD_MS: u32 = 500;

/// The armed rigs, from which each case takes a copy.
pub struct Bases(Vec<Rig>);

impl Bases {
    /// Prepares them; takes some seconds.
    #[must_use]
    pub fn new(seed: u64, current_limit_a: f64) -> Self {
        let rigs = (0..BASES).map(|n| {
            // 3 to 8 N, pairs alike, so that the tip is in balance.
            let pair = |k: u64| 3.0 + ((n * 3 + k * 5) % 11) as f64 * 0.5;
            let hold_n = std::array::from_fn(|unit| pair(unit as u64 / 2));
            let plant = seed.wrapping_mul(1_000).wrapping_add(n + 1);
            Rig::armed(plant, hold_n, current_limit_a)
        });
        Self(rigs.collect())
    }
}

/// What the watch remembers.
#[derive(Default)]
struct Watch {
    slack_ms: [u32; UNITS],
    pull_ms: [u32; UNITS],
    began_m: [f64; UNITS],
    hazards: Vec<(Hazard, u32)>,
    fault: u16,
    detected_ms: Option<u32>,
    safe_ms: Option<u32>,
    tension_n: f64,
}

impl Watch {
    fn hazard(&mut self, hazard: Hazard, ms: u32) {
        if self.hazards.iter().all(|(known, _)| *known != hazard) {
            self.hazards.push((hazard, ms));
        }
    }

    /// A hazard came, and no fault yet.
    fn awaits_a_fault(&self) -> bool {
        self.fault == 0 && !self.hazards.is_empty()
    }

    /// A millisecond of the rig.
    fn look(&mut self, rig: &Rig, ms: u32) {
        let status = rig.status();
        let armed = SystemState::from_u8(status.state).is_some_and(SystemState::drives);
        let mut safe = true;
        for unit in 0..UNITS {
            let state = &status.units[unit];
            let running = armed && state.state == MotorState::Running as u8;
            let tension_n = rig.tension_n(unit);
            self.tension_n = self.tension_n.max(tension_n);
            if tension_n > TENSION_N {
                self.hazard(Hazard::Tension, ms);
            }
            self.slack_ms[unit] = if running && rig.power() && tension_n < SLACK_N {
                self.slack_ms[unit] + 1
            } else {
                0
            };
            if self.slack_ms[unit] > SLACK_MS {
                self.hazard(Hazard::Slack, ms);
            }
            let may_pull = armed
                && (running || state.state == MotorState::Stopping as u8)
                && status.fault == 0;
            let pulls = rig.pull_n(unit) > PULL_N;
            self.pull_ms[unit] = if pulls && !may_pull {
                self.pull_ms[unit] + 1
            } else {
                0
            };
            if self.pull_ms[unit] > PULL_MS {
                self.hazard(Hazard::Pull, ms);
            }
            if rig.wound_m(unit) - self.began_m[unit] > MOTION_M {
                self.hazard(Hazard::Motion, ms);
            }
            safe &= may_pull || !pulls;
        }
        let first = status.units.iter().map(|unit| unit.fault).find(|f| *f != 0);
        if self.fault == 0 {
            self.fault = if status.fault != 0 {
                status.fault
            } else {
                first.unwrap_or(0)
            };
            self.detected_ms = (self.fault != 0).then_some(ms);
        }
        if self.fault != 0 && self.safe_ms.is_none() && safe {
            self.safe_ms = Some(ms);
        }
    }
}

impl Bases {
    /// A copy of the rig that a plan begins from.
    #[must_use]
    pub fn rig(&self, plan: &Plan) -> Rig {
        self.0[(plan.base % BASES) as usize].clone()
    }
}

/// Runs a case.
#[must_use]
pub fn run(bases: &Bases, number: u64, plan: Plan) -> Outcome {
    run_on(bases.rig(&plan), number, plan)
}

/// Runs a case on an armed rig.
#[must_use]
pub fn run_on(mut rig: Rig, number: u64, plan: Plan) -> Outcome {
    let mut watch = Watch {
        began_m: std::array::from_fn(|unit| rig.wound_m(unit)),
        ..Watch::default()
    };
    rig.inject(plan.first);
    let second_at = plan.second.map_or(0, |(_, ms)| ms);
    // Two different things of one kind would fight over one place; the second is what counts then.
    let second = plan.second.map(|(what, _)| what);
    let end = second_at + WATCH_MS;
    for ms in 0.. {
        if ms >= end + AFTER_HAZARD_MS || ms >= end && !watch.awaits_a_fault() {
            break;
        }
        if let Some(what) = second.filter(|_| ms == second_at) {
            rig.inject(what);
        }
        rig.run_ms(1);
        watch.look(&rig, ms + 1);
    }
    Outcome {
        number,
        plan,
        fault: watch.fault,
        detected_ms: watch.detected_ms,
        safe_ms: watch.safe_ms,
        hazards: watch.hazards,
        tension_n: (watch.tension_n * 1_000.0).round() * 1e-3,
        armed: rig.status().state == SystemState::Running as u8,
        powered: rig.power(),
    }
}

/// A case with one injection at the first base.
#[must_use]
pub fn single(bases: &Bases, first: Injection) -> Outcome {
    let plan = Plan {
        base: 0,
        first,
        second: None,
    };
    run(bases, 0, plan)
}
