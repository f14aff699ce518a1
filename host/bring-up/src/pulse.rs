//! The motor test: short pulses that rise until an encoder or a load cell answers.
//!
//! # What bounds the force
//!
//! | bound | who holds it |
//! | --- | --- |
//! | a pulse lasts [`PULSE_MS`] | the board: its setpoint is valid for that time, then all outputs go to 0 V and fault 2 is latched |
//! | at most [`BLIND_N`] until an encoder or a load cell has answered twice, [`SEEN_N`] after that | the board: `force_limit` and `tension_max` of the unit's configuration in force, checked by the firmware with each setpoint and each sample |
//! | no other unit is driven | the board: their `force_limit` is 0 N |
//! | a load cell that reads more than [`OVER_TENSION_N`] | the board: over-tension of each unit |
//! | the pulses rise by [`STEP_N`] and end at the first answer | this module |
//!
//! The loops are open: command is setpoint. A host that dies, a link that breaks, a program that
//! hangs: the pulse that is under way ends by the board's clock, and no other follows.

use crate::figures::{MotorFigures, PulseFigures};
use crate::window::{scales, Rest, Window};
use crate::BringUpError;
use control::Fault;
use rig::Rig;
use session::Session;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use wire::message::{Ripple, UnitConfig, UnitSetpoint, RIPPLES};
use wire::{Command, UNITS};

/// Length of a pulse, ms: four samples. Shorter ones move too little to be told from presliding.
pub const PULSE_MS: u16 = 12;
/// First pulse, N: less than friction holds.
pub const FIRST_N: f64 = 0.3;
/// How much the next one is stronger, N.
pub const STEP_N: f64 = 0.1;
/// Strongest pulse while nothing answers, N: half again what a reel of the rig breaks away with
/// (0.9 N). Tuned on the plant: with an amplifier of twice the gain it pulls a taut cable with 1.6
/// N.
pub const BLIND_N: f64 = 1.3;
/// Strongest pulse at all, N: what an amplifier of half the gain needs to turn a reel.
pub const SEEN_N: f64 = 2.3;
/// Tension at which the board takes a unit to 0 V during the test, N.
pub const OVER_TENSION_N: f64 = 3.0;
/// Travel that counts as an answer, m: two counts of the rig's encoder; one may be the edge at
/// which it stands.
pub const ANSWER_M: f64 = 8.0e-6;
/// Change of a load cell that counts as an answer, N: thirty times its noise.
pub const ANSWER_N: f64 = 0.05;
/// Travel at which a reel has turned, m: above what its contact gives way by (30 um at 6 N of pull,
/// 15 um at the test's).
pub const TURNED_M: f64 = 2.5e-5;
/// Change of a load cell that ends the pulses, N: the cable is tight.
pub const TIGHT_N: f64 = 0.5;
/// Change of a cell below this many standard deviations of its codes at rest is none: the furthest
/// of 15 means of four codes is within 3.2 of theirs, 1.6 of these, in 98 % of the pulses.
const NOISE_SDS: f64 = 3.0;
/// Setpoint that closes the loop before the pulse, N: its start is then not part of the pulse.
pub(crate) const CLOSE_N: f64 = 1e-3;
/// For how long that is valid, ms: longer than the samples that it waits for, so that the pulse
/// follows in time.
const CLOSE_MS: u16 = 60;
/// Samples are waited for before the pulse and after it, ms: three periods; and the load cell's
/// filter with a swing of the cable.
const BEFORE: Duration = Duration::from_millis(10);
const AFTER: Duration = Duration::from_millis(50);
/// Rest between two pulses: a reel comes to rest in 15 ms, its cable in 30.
const REST: Duration = Duration::from_millis(60);

/// Configurations for the pulses of `unit` (from 0): open loop, at most `limit_n`; all others can't
/// be driven. `zero_code`: codes of the slack cables.
#[must_use]
pub fn configs(
    rig: &Rig,
    works: [bool; UNITS],
    zero_code: [i32; UNITS],
    unit: usize,
    limit_n: f64,
) -> [UnitConfig; UNITS] {
    std::array::from_fn(|i| {
        let limit_un = if i == unit {
            (limit_n.min(SEEN_N) * 1e6).round() as i32
        } else {
            0
        };
        let of_file = rig.units[i].to_wire();
        UnitConfig {
            enabled: of_file.enabled && works[i],
            zero_code: zero_code[i],
            kp_q16: 0,
            ki_q16: 0,
            leaky_ki_q16: 0,
            kd_q16: 0,
            damping_q16: 0,
            friction_feedforward: false,
            ripples: [Ripple::default(); RIPPLES],
            slew_un_per_s: control::config::field::SLEW.max,
            force_limit_un: limit_un,
            tension_max_un: limit_un,
            over_tension_un: control::config::field::OVER_TENSION.to_wire(OVER_TENSION_N),
            ..of_file
        }
    })
}

/// A board whose units are driven one at a time.
pub(crate) struct Drive<'a, 's> {
    pub session: &'a mut Session<'s>,
    pub rig: &'a Rig,
    /// Units that measure.
    pub works: [bool; UNITS],
    /// Codes of the slack cables.
    pub zero_code: [i32; UNITS],
    /// Ends the test.
    pub stop: &'a AtomicBool,
}

/// Gives a motor pulses of at most `most_n` N, which is [`BLIND_N`] or [`SEEN_N`]. Everything is at
/// 0 V before and after.
pub(crate) fn test(
    drive: &mut Drive<'_, '_>,
    unit: usize,
    most_n: f64,
) -> Result<MotorFigures, BringUpError> {
    let Drive {
        session,
        rig,
        works,
        zero_code,
        stop,
    } = drive;
    let (rig, works, zero_code) = (*rig, *works, *zero_code);
    let mut figures = MotorFigures {
        pulses: Vec::new(),
        refused: None,
        fault: 0,
    };
    session.configure(&configs(rig, works, zero_code, unit, BLIND_N))?;
    let mut seen = false;
    for n in 0.. {
        let command_n = FIRST_N + STEP_N * f64::from(n);
        if stop.load(Ordering::Relaxed) {
            return Err(BringUpError::Stopped);
        }
        let answers = |pulse: &&PulseFigures| travel(pulse) >= ANSWER_M || force(pulse) >= ANSWER_N;
        let answered = figures.pulses.iter().rev().take(2).filter(answers);
        if !seen && command_n > BLIND_N + 1e-9 && most_n > BLIND_N {
            // One answer may be a hand at the reel.
            if answered.count() < 2 {
                break;
            }
            seen = true;
            session.configure(&configs(rig, works, zero_code, unit, SEEN_N))?;
        }
        if command_n > most_n + 1e-9 {
            break;
        }
        let quiet = Window::over(session, REST)?;
        figures.refused = crate::refused(session, &Command::Arm)?;
        if figures.refused.is_some() {
            break;
        }
        let (pulse, fault) = one(session, rig, works, unit, command_n, &quiet)?;
        figures.pulses.push(pulse);
        if fault != 0 {
            figures.fault = fault;
            break;
        }
        if travel(&pulse) >= TURNED_M || force(&pulse) >= TIGHT_N {
            break;
        }
    }
    Ok(figures)
}

/// Furthest travel of any encoder, m.
fn travel(pulse: &PulseFigures) -> f64 {
    pulse.travel_m.iter().fold(0.0, |most, m| m.abs().max(most))
}

/// Strongest change of any load cell, N.
fn force(pulse: &PulseFigures) -> f64 {
    pulse.cell_n.iter().fold(0.0, |most, n| n.abs().max(most))
}

pub(crate) fn setpoints(unit: usize, command_n: f64) -> [UnitSetpoint; UNITS] {
    std::array::from_fn(|i| UnitSetpoint {
        tension_un: if i == unit {
            (command_n * 1e6).round() as i32
        } else {
            0
        },
        inv_cos_q16: 1 << 16,
        // Not known: the board counts each tension in full against its limit of the force at the
        // tip.
        direction_q14: [0; 3],
        reel_um_per_s: None,
    })
}

/// One pulse of an armed board, which ends it by itself; and a fault beside that.
fn one(
    session: &mut Session<'_>,
    rig: &Rig,
    works: [bool; UNITS],
    unit: usize,
    command_n: f64,
    quiet: &Window,
) -> Result<(PulseFigures, u16), BringUpError> {
    let rest = Rest::of(quiet);
    session.drain();
    session.pulse(setpoints(unit, CLOSE_N), CLOSE_MS, BEFORE)?;
    let pulse = Duration::from_millis(PULSE_MS.into());
    session.pulse(setpoints(unit, command_n), PULSE_MS, pulse)?;
    session.exchange(AFTER)?;
    let status = session.get_status()?;
    let window = Window::of(&session.drain().samples);
    let scale = scales(rig);
    let figures = PulseFigures {
        command_n,
        travel_m: std::array::from_fn(|i| {
            let counts = window.furthest_counts(i, rest.counts[i]);
            f64::from(counts) * rig.units[i].travel_m_per_count
        }),
        cell_n: std::array::from_fn(|i| {
            let change = window.furthest_code(i, rest.code[i]);
            // A cell that is disturbed answers nothing.
            let noise = NOISE_SDS * quiet.code_sd(i);
            if change.abs() > noise {
                change * scale[i]
            } else {
                0.0
            }
        }),
    };
    let units = (0..UNITS)
        .filter(|i| works[*i])
        .map(|i| status.units[i].fault);
    let fault = std::iter::once(status.fault)
        .chain(units)
        .find(|fault| !matches!(*fault, 0) && *fault != Fault::SetpointsExpired.code())
        .unwrap_or(0);
    // A fault that stays keeps the board from being armed again; the next unit's test says so.
    crate::clear(session)?;
    Ok((figures, fault))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bounds that the board holds, whatever this program sends.
    #[test]
    fn the_boards_own_limits_are_those_of_the_test() {
        let rig = Rig::built_in().unwrap();
        for (asked_n, limit_un) in [(BLIND_N, 1_300_000), (SEEN_N, 2_300_000), (16.0, 2_300_000)] {
            let configs = configs(&rig, [true; UNITS], [7; UNITS], 2, asked_n);
            for (i, config) in configs.iter().enumerate() {
                let most = if i == 2 { limit_un } else { 0 };
                assert_eq!((config.force_limit_un, config.tension_max_un), (most, most));
                assert_eq!(
                    (
                        config.kp_q16,
                        config.ki_q16,
                        config.leaky_ki_q16,
                        config.kd_q16,
                        config.damping_q16
                    ),
                    (0, 0, 0, 0, 0)
                );
                assert!(!config.friction_feedforward && config.over_tension_un == 3_000_000);
                assert_eq!(config.zero_code, 7);
                // The firmware refuses a setpoint above it.
                let config = control::Config::from_wire(config).unwrap();
                let at = |tension_un| {
                    control::unit::Setpoint::from_wire(
                        &config,
                        &UnitSetpoint {
                            tension_un,
                            inv_cos_q16: 1 << 16,
                            direction_q14: [0; 3],
                            reel_um_per_s: None,
                        },
                    )
                };
                assert!(at(most).is_ok() && at(most + 1).is_err());
            }
        }
    }
}
