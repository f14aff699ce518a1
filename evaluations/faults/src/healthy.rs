//! Rigs in which nothing is broken: a fault here is a false alarm, which costs a lab its run. Each
//! is armed a few times, and then holds one set of tensions after the other while its robot moves.

use crate::case::HELD_N;
use crate::random::Random;
use crate::rig::Rig;
use crate::table::upper_bound;
use control::{Fault, MotorState, SystemState};
use plant::config::{PathConfig, PlantConfig, RandomPath};
use std::fmt::Write;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Mutex;
use wire::message::UnitStatus;
use wire::UNITS;

/// Armings of each rig: the first takes up the drawn slack, the others what a cable has after a
/// disarm, half of the rigs with a robot that moves.
pub const ARMINGS: u32 = 4;
/// Sets of tensions that each rig holds after its last arming, with a step from one to the next.
pub const SETS: u32 = 20;
/// How long each is held, in milliseconds.
const SET_MS: u64 = 1_000;
/// Largest slack at power-on, m.
const SLACK_M: f64 = 20e-3;
/// Largest force at the tip while not all cables pull, N: well below the limit of the board, 20 N.
const TIP_N: f64 = 12.0;
/// Rigs of a seed; more would repeat those of the next seed.
const RIGS: u64 = 1_000_000;

/// A fault, or an end without one, of a rig in which nothing is broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Alarm {
    /// The rig's number, from 0.
    pub rig: u64,
    /// Which arming, from 0; [`ARMINGS`]: while it held sets of tensions.
    pub arming: u32,
    /// The first unit with a fault, from 0; `None`: the board alone has one, or none.
    pub unit: Option<usize>,
    /// The fault's number; 0: the board did not run and latched nothing.
    pub fault: u16,
    /// The fault's detail.
    pub detail: u32,
}

/// What a number of rigs did.
#[derive(Debug, Default)]
pub struct Healthy {
    /// Armings that were tried.
    pub armings: u64,
    /// Those that ended in a fault, in order.
    pub alarms: Vec<Alarm>,
}

/// How far a rig's friction may be from what is declared, as a factor: docs/architecture.md
/// compares controllers over 0.8 to 1.2.
const FRICTION: (f64, f64) = (0.8, 1.2);
/// Breakaway over kinetic friction: to twice the excess of the declared one and more.
const BREAKAWAY: (f64, f64) = (1.0, 1.15);
/// Presliding distance, m: half to twice the declared one.
const PRESLIDING_M: (f64, f64) = (15e-6, 60e-6);
/// Stiffness of a cable, N: half the declared braid to twice it, as stranded steel has.
const STIFFNESS_N: (f64, f64) = (5e3, 2e4);
/// Speed of the robot's tip, m/s (RMS): the thesis's slowest motion to twice the declared one.
const SPEED_M_PER_S: (f64, f64) = (2e-3, 25e-3);

/// How far the robot's tip gives, m/N: a quarter more than what the stiffness of a Raven's shoulder
/// and elbow makes. With twice as much 20 of 2,789 armings of the seeds 22 and 23 end in
/// over-tension.
const GIVES_M_PER_N: (f64, f64) = (0.0, 0.5e-3);

/// Tensions of six units by pairs, N, within what the board lets the tip bear.
fn tensions_n(mut within: impl FnMut((f64, f64)) -> f64) -> [f64; UNITS] {
    let pairs: [f64; 3] = std::array::from_fn(|_| within(HELD_N));
    // While some are taken up and others hold, the tip bears the others' sum.
    let sum_n = pairs.iter().map(|n| n * n).sum::<f64>().sqrt();
    let pairs = pairs.map(|n| n * (TIP_N / sum_n).min(1.0));
    std::array::from_fn(|unit| pairs[unit / 2])
}

/// A rig of a seed: a plant of the ranges above, drawn slack and tensions.
///
/// # Panics
/// Where a range leads to a plant that there can't be.
#[must_use]
pub fn rig(seed: u64, number: u64, current_limit_a: f64) -> Rig {
    let plant = seed.wrapping_mul(RIGS).wrapping_add(number);
    let mut random = Random::stream(plant, 0x4EA1);
    let mut within = |(low, high)| random.between(low, high);
    let mut config = PlantConfig::default();
    config.amplifier.current_limit_a = current_limit_a;
    config.cable.initial_slack_m = within((0.0, SLACK_M));
    config.cable.axial_stiffness_n = within(STIFFNESS_N);
    config.friction.coulomb_n *= within(FRICTION);
    config.friction.per_load *= within(FRICTION);
    config.friction.breakaway_ratio = within(BREAKAWAY);
    config.friction.presliding_m = within(PRESLIDING_M);
    config.robot.path = PathConfig::Random(RandomPath {
        rms_speed_m_per_s: within(SPEED_M_PER_S),
        ..RandomPath::default()
    });
    let held_n = tensions_n(&mut within);
    config.robot.tip_compliance_m_per_n = within(GIVES_M_PER_N);
    Rig::of(config, plant, held_n)
}

/// The first fault of a rig that should run, or that it does not run.
fn alarm(number: u64, arming: u32, rig: &Rig) -> Option<Alarm> {
    let status = rig.status();
    let running = |unit: &UnitStatus| unit.state == MotorState::Running as u8;
    let runs = status.state == SystemState::Running as u8 && status.units.iter().all(running);
    (!runs || rig.is_faulted()).then(|| {
        let unit = status.units.iter().position(|unit| unit.fault != 0);
        let (fault, detail) = unit.map_or((status.fault, status.fault_detail), |unit| {
            let unit = status.units[unit];
            (unit.fault, unit.fault_detail)
        });
        Alarm {
            rig: number,
            arming,
            unit,
            fault,
            detail,
        }
    })
}

fn let_it_act(rig: &mut Rig) {
    while rig.is_busy() && !rig.is_faulted() {
        rig.run_ms(1);
    }
}

/// Arms it [`ARMINGS`] times and lets it work; how many armings began, and how the last ended, or
/// the work, where it failed.
fn use_it(seed: u64, number: u64, mut rig: Rig) -> (u32, Option<Alarm>) {
    for arming in 0..ARMINGS {
        if arming > 0 {
            // Behind the zero, which a moving robot refuses.
            rig.move_robot(number % 2 == 1);
            rig.arm_again();
        }
        let_it_act(&mut rig);
        let alarm = alarm(number, arming, &rig);
        if alarm.is_some() {
            return (arming + 1, alarm);
        }
    }
    let mut random = Random::stream(seed.wrapping_mul(RIGS).wrapping_add(number), 0x5E75);
    let sets_n: Vec<_> = (0..SETS)
        .map(|_| tensions_n(|(low, high)| random.between(low, high)))
        .collect();
    rig.move_robot(true);
    rig.work(sets_n, SET_MS);
    let_it_act(&mut rig);
    (ARMINGS, alarm(number, ARMINGS, &rig))
}

/// Uses the rigs of a seed with these numbers, on so many threads.
#[must_use]
pub fn run(seed: u64, rigs: Range<u64>, current_limit_a: f64, jobs: usize) -> Healthy {
    let next = AtomicU64::new(rigs.start);
    let all = Mutex::new(Healthy::default());
    std::thread::scope(|scope| {
        for _ in 0..jobs.max(1) {
            scope.spawn(|| loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                if number >= rigs.end {
                    return;
                }
                let (armings, alarm) = use_it(seed, number, rig(seed, number, current_limit_a));
                let mut all = all
                    .lock()
                    .unwrap_or_else(std::sync::PoisonError::into_inner);
                all.armings += u64::from(armings);
                all.alarms.extend(alarm);
                if (number + 1).is_multiple_of(100) {
                    eprintln!("faults: {} of {} rigs", number + 1, rigs.end);
                }
            });
        }
    });
    let mut all = all
        .into_inner()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    all.alarms.sort_unstable();
    all
}

/// Each false alarm, and their share with its upper bound.
#[must_use]
pub fn table(seed: u64, rigs: u64, found: &Healthy) -> String {
    let mut text = String::new();
    for alarm in &found.alarms {
        let name = Fault::from_code(alarm.fault).map_or("not running", Fault::name);
        let unit = alarm
            .unit
            .map_or_else(|| "board".to_owned(), |unit| format!("unit {}", unit + 1));
        let when = if alarm.arming < ARMINGS {
            format!("arming {}", alarm.arming + 1)
        } else {
            "holding".to_owned()
        };
        let _ = writeln!(
            text,
            "rig {seed}/{}, {when}: {unit}: {} ({name}), detail {:#x}",
            alarm.rig, alarm.fault, alarm.detail
        );
    }
    let alarms = found.alarms.len();
    let armings = found.armings.max(1) as f64;
    let _ = writeln!(
        text,
        "{alarms} false alarms in {} armings of {rigs} rigs, which then hold {SETS} sets of tensions for {SET_MS} ms each: {:.3} % of armings (at most {:.3} % with 95 % confidence)",
        found.armings,
        100.0 * alarms as f64 / armings,
        100.0 * upper_bound(alarms) / armings
    );
    text
}
