//! One case: a rig in some phase, one injection or two, a clear or none, and a watch on the truth.

use crate::injection::{Injection, Phase, Plan, BASES};
use crate::outcome::Outcome;
use crate::rig::Rig;
use crate::watch::{View, Watch};
use control::{MotorState, SystemState, UNITS};

/// How long a case is watched after its last injection, in milliseconds.
pub const WATCH_MS: u32 = 700;
/// How much longer where the memory was hit: the board checks it once a second.
pub const MEMORY_CHECK_MS: u32 = 350;
/// How much longer where a hazard came and no fault yet: a sensor that drifts is noticed when its
/// error is large enough.
pub const AFTER_HAZARD_MS: u32 = 500;

/// Least and largest tension of a base, N. The setpoints swing by 0.6 N around it: within 2 and 12
/// N, what a rig file permits.
pub const HELD_N: (f64, f64) = (2.6, 11.4);
/// Those of the expected faults, N: their times and tensions are of these.
pub const EXPECTED_N: (f64, f64) = (3.0, 8.0);

/// Slack of every cable at power-on, mm: of the bases in turn.
pub const SLACK_MM: [f64; 4] = [0.0, 1.0, 5.0, 20.0];

/// The rigs at the beginning of each phase, from which each case takes a copy.
pub struct Bases(Vec<Vec<Rig>>);

impl Bases {
    /// Prepares them over the whole range of tension; takes some seconds.
    #[must_use]
    pub fn new(seed: u64, current_limit_a: f64) -> Self {
        let slack_mm = |base: u64| SLACK_MM[base as usize % SLACK_MM.len()];
        Self::prepared(seed, current_limit_a, HELD_N, slack_mm)
    }

    /// Prepares them with tensions of this range, N, and without slack.
    #[must_use]
    pub fn between(seed: u64, current_limit_a: f64, range_n: (f64, f64)) -> Self {
        Self::prepared(seed, current_limit_a, range_n, |_| 0.0)
    }

    fn prepared(
        seed: u64,
        current_limit_a: f64,
        range_n: (f64, f64),
        slack_mm: impl Fn(u64) -> f64,
    ) -> Self {
        let rigs = (0..BASES).map(|n| {
            let plant = seed.wrapping_mul(1_000).wrapping_add(n + 1);
            let held_n = Self::held_n(n, range_n);
            Rig::phases(plant, held_n, current_limit_a, 1e-3 * slack_mm(n))
        });
        Self(rigs.collect())
    }

    /// Tensions of a base, N: pairs alike, so that the tip is in balance.
    #[must_use]
    fn held_n(base: u64, (least, largest): (f64, f64)) -> [f64; UNITS] {
        let pair = |k: u64| least + ((base * 3 + k * 5) % 11) as f64 * 0.1 * (largest - least);
        std::array::from_fn(|unit| pair(unit as u64 / 2))
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
        let (phase, ms) = plan.phase;
        let place = Phase::ALL.iter().position(|(one, _)| *one == phase);
        let mut rig = self.0[(plan.base % BASES) as usize][place.unwrap_or(0)].clone();
        rig.run_ms(ms.into());
        rig
    }
}

/// Runs a case.
#[must_use]
pub fn run(bases: &Bases, number: u64, plan: Plan) -> Outcome {
    run_on(bases.rig(&plan), number, plan)
}

/// Runs a case on a rig at its first injection.
#[must_use]
pub fn run_on(mut rig: Rig, number: u64, plan: Plan) -> Outcome {
    let mut watch = Watch::new(std::array::from_fn(|unit| rig.wound_m(unit)));
    let slack_before = view(&rig).takes_up_slack();
    rig.inject(plan.first);
    let second_at = plan.second.map_or(0, |(_, ms)| ms);
    // Two different things of one kind would fight over one place; the second is what counts then.
    let second = plan.second.map(|(what, _)| what);
    let mut end = second_at + WATCH_MS;
    if plan.hits_memory() {
        end += MEMORY_CHECK_MS;
    }
    for ms in 0.. {
        // What began before motors had power shows once they have.
        if rig.is_busy() {
            end = end.max(ms + WATCH_MS / 2);
        }
        if ms >= end + AFTER_HAZARD_MS || ms >= end && !watch.awaits_a_fault() {
            break;
        }
        if plan.clear_ms == Some(ms) {
            rig.clear_twice();
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
        slack_before,
        armed: rig.status().state == SystemState::Running as u8,
        powered: rig.power(),
    }
}

/// A case with one injection at the first base.
#[must_use]
pub fn single(bases: &Bases, first: Injection) -> Outcome {
    run(bases, 0, Plan::holding(0, first, None))
}
