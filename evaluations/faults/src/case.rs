//! One case: an armed rig, one injection or two, and a watch on the truth.

use crate::injection::{Injection, Plan, BASES};
use crate::outcome::Outcome;
use crate::rig::Rig;
use crate::watch::{View, Watch};
use control::{MotorState, SystemState};

/// How long a case is watched after its last injection, in milliseconds.
pub const WATCH_MS: u32 = 700;
/// How much longer where a hazard came and no fault yet: a sensor that drifts is noticed when its error is large enough.
pub const AFTER_HAZARD_MS: u32 = 500;

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

/// The rig as the watch looks at it.
fn view(rig: &Rig) -> View {
    let status = rig.status();
    let in_state = |unit: usize, state: MotorState| status.units[unit].state == state as u8;
    View {
        armed: SystemState::from_u8(status.state).is_some_and(SystemState::drives),
        running: std::array::from_fn(|unit| in_state(unit, MotorState::Running)),
        stopping: std::array::from_fn(|unit| in_state(unit, MotorState::Stopping)),
        board_fault: status.fault,
        unit_fault: std::array::from_fn(|unit| status.units[unit].fault),
        power: rig.power(),
        tension_n: std::array::from_fn(|unit| rig.tension_n(unit)),
        pull_n: std::array::from_fn(|unit| rig.pull_n(unit)),
        wound_m: std::array::from_fn(|unit| rig.wound_m(unit)),
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
    let mut watch = Watch::new(std::array::from_fn(|unit| rig.wound_m(unit)));
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
        watch.look(&view(&rig), ms + 1);
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
