//! Findings on one unit as its new settings, each within bounds.

use super::ripples::add_ripple;
use super::{bounded, KEYS};
use crate::rigfile::UnitSettings;
use residual::Board;
use std::f64::consts::TAU;

/// Largest change of `coulomb_n`, N. More is a reel that rubs and needs repair.
const MAX_COULOMB_CHANGE_N: f64 = 2.0;
/// Dry friction is declared this much below what was found, N. On the plant (`tension_loop` example of `control`,
/// `seconds=20 seeds=2 coulomb=...`) tensions are 0.030 N off with 0.1 N less than there is, 0.032 N with just that, and
/// 0.042 N with 0.1 N more: too much of it drives the reel past the reversal.
pub const FRICTION_MARGIN_N: f64 = 0.1;
/// Largest change of `coulomb_per_n`.
const MAX_COULOMB_PER_N_CHANGE: f64 = 0.25;
/// Largest change of `friction_offset_n`, N.
const MAX_OFFSET_CHANGE_N: f64 = 1.5;
/// Largest factor on a gain, either way. More is a wrong strap or amplifier, to be repaired and not compensated.
const MAX_GAIN_FACTOR: f64 = 1.6;
/// Delays up to this are within what the gains allow for, s.
const NEGLIGIBLE_DELAY_S: f64 = 0.0015;
/// Longer delays are a broken drive, s.
const MAX_DELAY_S: f64 = 0.030;
/// Largest viscous friction that the board takes, N per m/s; also its largest change.
const MAX_VISCOUS_N_S_PER_M: f64 = 100.0;

/// How a log's columns relate to the rig.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Frame {
    /// The model declares what the rig file says, so findings come on top; else they take its place.
    pub increment: bool,
    /// The command column is the DAC's, through `dac_codes_per_n`: a wrong gain is the drive's.
    pub gain_of_drive: bool,
    /// m/s of cable for one unit of the velocity column, where that is known.
    pub velocity_m_per_s: Option<f64>,
    /// Cable travel for one radian of the angle column, m, where the angle is that of the board's own encoder.
    pub travel_m_per_rad: Option<f64>,
}

/// New settings of a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Corrected {
    /// The settings.
    pub unit: UnitSettings,
    /// What was found and isn't in them, and why.
    pub not_used: Vec<String>,
}

/// Largest kp, ki and damping that a loop with this additional delay of the command allows.
///
/// The built-in gains hold for 10 ms between command and tension (converter 6.25 ms, low pass 2.2 ms, hold 1.6 ms)
/// and 1.7 ms between command and encoder. Reel and cable swing at 34 Hz at the most (24 N/mm, 0.51 kg). The
/// damping works on that swing by the cosine of the phase that its delay makes: it fades to nothing at 5.7 ms more,
/// past which it would feed the swing. The proportional gain needs the damping, so it fades with it. An integral
/// alone is stable while ki / (2 pi 34 Hz) times the swing's sharpness (5.6, from the cable's own damping) is well
/// below one: 10 leave a factor of four, and are slow enough for 30 ms.
#[must_use]
pub fn gains_for_delay(delay_s: f64) -> [f64; 3] {
    const SWING_HZ: f64 = 34.0;
    const ENCODER_S: f64 = 0.0017;
    let phase = |delay: f64| (TAU * SWING_HZ * (ENCODER_S + delay)).min(TAU / 4.0);
    let left = phase(delay_s.max(0.0)).cos().max(0.0) / phase(0.0).cos();
    [0.3 * left, 10.0 + 15.0 * left, 110.0 * left]
}

/// The settings of a unit with the findings in them. Where one of them is out of its bounds the settings are the
/// old ones, and `not_used` says why.
#[must_use]
pub fn correct(unit: &UnitSettings, compensation: &Board, frame: &Frame) -> Corrected {
    let mut not_used: Vec<String> = compensation
        .left_out
        .iter()
        .map(|name| format!("{name}: the board has no term for it"))
        .collect();
    let unit = match corrected(unit, compensation, frame, &mut not_used) {
        Ok(unit) => unit,
        Err(why) => {
            not_used.push(format!("all of it: {why}"));
            *unit
        }
    };
    Corrected { unit, not_used }
}

fn corrected(
    unit: &UnitSettings,
    compensation: &Board,
    frame: &Frame,
    not_used: &mut Vec<String>,
) -> Result<UnitSettings, String> {
    let declared = Declared::of(unit, frame);
    let mut new = *unit;
    correct_offset_and_friction(&mut new, &declared, compensation, frame)?;
    correct_gain_and_share(&mut new, &declared, compensation, frame)?;
    if compensation.viscous != 0.0 {
        match frame.velocity_m_per_s {
            Some(scale) => {
                let old = declared.viscous;
                // Negative friction would be feedback that drives.
                let found = (old - compensation.viscous / scale).max(0.0);
                new.viscous_n_s_per_m = bounded(
                    "viscous_n_s_per_m",
                    old,
                    found,
                    MAX_VISCOUS_N_S_PER_M,
                    0.0..=MAX_VISCOUS_N_S_PER_M,
                )?;
            }
            None => not_used.push(format!(
                "viscous, {:.4} N per unit of velocity: what that unit is in cable travel is not known",
                compensation.viscous
            )),
        }
    }
    for ripple in &compensation.ripples {
        match frame.travel_m_per_rad {
            Some(radius) => add_ripple(&mut new.ripples, ripple, radius)?,
            None => not_used.push(format!(
                "periodic_angle of order {:.3}: the log's angle is not the board's own, so the phase is not known",
                ripple.order
            )),
        }
    }
    correct_for_delay(&mut new, compensation.delay_s, not_used)?;
    if new != *unit && !unit.friction_feedforward && unit.enabled {
        not_used.push("friction, ripples and offset, until friction_feedforward = true".to_owned());
    }
    let rounded = rounded(&new);
    control::Config::from_wire(&rounded.to_wire())
        .map_err(|error| format!("the board would refuse it: {error}"))?;
    Ok(rounded)
}

/// What the log's model declares: bounds are on the difference to it.
struct Declared {
    gain: f64,
    share: f64,
    coulomb: f64,
    offset: f64,
    viscous: f64,
}

impl Declared {
    fn of(unit: &UnitSettings, frame: &Frame) -> Self {
        if frame.increment {
            Self {
                gain: unit.friction_gain,
                share: unit.coulomb_per_n,
                coulomb: unit.coulomb_n,
                offset: unit.friction_offset_n,
                viscous: unit.viscous_n_s_per_m,
            }
        } else {
            Self {
                gain: 1.0,
                share: 0.0,
                coulomb: 0.0,
                offset: 0.0,
                viscous: 0.0,
            }
        }
    }
}

fn correct_offset_and_friction(
    new: &mut UnitSettings,
    declared: &Declared,
    compensation: &Board,
    frame: &Frame,
) -> Result<(), String> {
    if compensation.offset != 0.0 {
        new.friction_offset_n = bounded(
            "friction_offset_n",
            declared.offset,
            declared.offset + compensation.offset,
            MAX_OFFSET_CHANGE_N,
            -3.0..=3.0,
        )?;
    }
    if compensation.friction != 0.0 || compensation.friction_per_load != 0.0 {
        // Friction that takes from the tension while winding in is a negative coefficient of sign(v).
        let found = bounded(
            "coulomb_n",
            declared.coulomb,
            declared.coulomb - compensation.friction,
            MAX_COULOMB_CHANGE_N,
            0.0..=5.0,
        )?;
        if frame.increment || compensation.friction != 0.0 {
            new.coulomb_n = (found - FRICTION_MARGIN_N).max(0.0);
        }
    }
    Ok(())
}

/// Gain of the drive and friction per load, which one fit gives together.
fn correct_gain_and_share(
    new: &mut UnitSettings,
    declared: &Declared,
    compensation: &Board,
    frame: &Frame,
) -> Result<(), String> {
    if compensation.gain_error == 0.0 && compensation.friction_per_load == 0.0 {
        return Ok(());
    }
    // The load is L = (gain - share s) cmd with s the sign of the velocity. Found: F = (1 + g) L + p s |L|, so
    // per command (1 + g) gain - p share, and times s: p gain - (1 + g) share.
    let (gain, share) = (declared.gain, declared.share);
    let factor = 1.0 + compensation.gain_error;
    if !(1.0 / MAX_GAIN_FACTOR..=MAX_GAIN_FACTOR).contains(&factor) {
        return Err(format!(
            "a gain of {factor:.3} times the declared one is not a small error: check strap, amplifier and scale"
        ));
    }
    let drive = if frame.gain_of_drive { factor } else { 1.0 };
    let new_gain = (factor * gain - compensation.friction_per_load * share) / drive;
    let new_share = (factor * share - compensation.friction_per_load * gain) / drive;
    if drive != 1.0 {
        new.dac_codes_per_n /= drive;
        if !(10.0..=1000.0).contains(&new.dac_codes_per_n.abs()) {
            return Err(format!(
                "dac_codes_per_n would be {:.2}: the board takes 10 to 1000 in size",
                new.dac_codes_per_n
            ));
        }
    }
    // Without increments a value without a finding keeps the rig file's.
    if frame.increment || compensation.gain_error != 0.0 {
        new.friction_gain = bounded(
            "friction_gain",
            gain,
            new_gain,
            MAX_GAIN_FACTOR - 1.0,
            0.5..=2.0,
        )?;
    }
    if frame.increment || compensation.friction_per_load != 0.0 {
        let max = 0.4f64.min(0.5 * new.friction_gain);
        new.coulomb_per_n = bounded(
            "coulomb_per_n",
            share,
            new_share,
            MAX_COULOMB_PER_N_CHANGE,
            0.0..=max,
        )?;
    }
    Ok(())
}

/// Reduces the gains to what a delay of the drive allows.
fn correct_for_delay(
    new: &mut UnitSettings,
    delay_s: f64,
    not_used: &mut Vec<String>,
) -> Result<(), String> {
    if delay_s > MAX_DELAY_S {
        return Err(format!(
            "a delay of {:.1} ms is longer than any drive's: check cabling and amplifier",
            delay_s * 1e3
        ));
    }
    if delay_s > NEGLIGIBLE_DELAY_S {
        let [kp, ki, damping] = gains_for_delay(delay_s);
        new.kp = new.kp.min(kp);
        new.ki_per_s = new.ki_per_s.min(ki);
        new.damping_n_s_per_m = new.damping_n_s_per_m.min(damping);
    } else if delay_s != 0.0 {
        not_used.push(format!(
            "delay, {:.1} ms: the gains allow for it",
            delay_s * 1e3
        ));
    }
    Ok(())
}

/// The settings with as many digits as are written.
fn rounded(unit: &UnitSettings) -> UnitSettings {
    let mut unit = *unit;
    for key in &KEYS {
        let value = (key.get)(&unit);
        (key.set)(&mut unit, (value * key.digits).round() / key.digits);
    }
    unit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigfile::RigFile;
    use residual::Ripple;

    fn frame() -> Frame {
        Frame {
            increment: true,
            gain_of_drive: true,
            velocity_m_per_s: Some(1.0),
            travel_m_per_rad: Some(0.010),
        }
    }

    fn rig() -> RigFile {
        RigFile::built_in().expect("the built-in rig is good")
    }

    fn ripple(order: f64, amplitude: f64, phase: f64, of_load: bool) -> Ripple {
        Ripple {
            order,
            amplitude,
            phase,
            of_load,
        }
    }

    /// Force of a unit by its settings, as the board's documentation has it, with this much more dry friction.
    fn force(u: &UnitSettings, more: f64, dac: f64, speed: f64, travel: f64) -> f64 {
        let command = dac / u.dac_codes_per_n;
        let ripples: f64 = u
            .ripples
            .iter()
            .filter(|r| !r.is_none())
            .map(|r| r.amplitude_n * (TAU * travel / r.period_m + r.phase_rad).sin())
            .sum();
        u.friction_offset_n + u.friction_gain * command
            - speed.signum() * (u.coulomb_n + more + u.coulomb_per_n * command)
            - u.viscous_n_s_per_m * speed
            + ripples
    }

    #[test]
    fn new_settings_say_what_old_ones_and_findings_said() {
        let old = rig().units[0];
        let board = Board {
            friction: -0.4,
            friction_per_load: -0.05,
            viscous: -12.0,
            gain_error: -0.2,
            offset: 0.1,
            ripples: vec![ripple(26.0 / 7.0, 0.5, 1.2, false)],
            ..Board::default()
        };
        let new = correct(&old, &board, &frame());
        assert!(new.not_used.is_empty(), "{new:?}");
        for (dac, speed, travel) in [
            (600.0, 0.02, 0.01),
            (1500.0, -0.01, -0.02),
            (1000.0, 0.001, 0.5),
        ] {
            let command = dac / old.dac_codes_per_n;
            let sign = f64::signum(speed);
            let load = (old.friction_gain - old.coulomb_per_n * sign) * command;
            let found = board.offset
                + board.gain_error * load
                + sign * (board.friction + board.friction_per_load * load)
                + board.viscous * speed
                + 0.5 * f64::sin(26.0 / 7.0 * travel / 0.010 + 1.2);
            let expected = force(&old, 0.0, dac, speed, travel) + found;
            let made = force(&new.unit, FRICTION_MARGIN_N, dac, speed, travel);
            // Rounded to four digits.
            assert!((made - expected).abs() < 2e-3, "{made} {expected}");
        }
    }

    #[test]
    fn corrections_are_bounded_and_all_or_nothing() {
        let old = rig().units[0];
        let refused = [
            Board {
                friction: -2.5,
                ..Board::default()
            },
            Board {
                friction: 2.0,
                ..Board::default()
            },
            Board {
                gain_error: -0.6,
                ..Board::default()
            },
            Board {
                gain_error: f64::NAN,
                ..Board::default()
            },
            Board {
                friction_per_load: -0.3,
                ..Board::default()
            },
            Board {
                offset: f64::INFINITY,
                ..Board::default()
            },
            Board {
                viscous: -150.0,
                ..Board::default()
            },
            Board {
                delay_s: 0.05,
                ..Board::default()
            },
            Board {
                ripples: vec![ripple(1e4, 0.5, 0.0, false)],
                ..Board::default()
            },
            Board {
                ripples: vec![ripple(1.0, 2.5, 0.0, false)],
                ..Board::default()
            },
            Board {
                ripples: (1..4)
                    .map(|n| ripple(f64::from(n), 0.1, 0.0, false))
                    .collect(),
                ..Board::default()
            },
        ];
        for mut board in refused {
            // A good finding beside the bad one is not used either.
            board.left_out = vec!["creep".into()];
            if board.offset == 0.0 {
                board.offset = 0.1;
            }
            let new = correct(&old, &board, &frame());
            assert_eq!(new.unit, old, "{board:?}");
            assert!(
                new.not_used.iter().any(|why| why.starts_with("all of it")),
                "{new:?}"
            );
            assert!(new.not_used.iter().any(|why| why.contains("creep")));
        }
    }

    #[test]
    fn a_delay_brings_gains_down_once() {
        let old = rig().units[0];
        let board = |delay_s| Board {
            delay_s,
            ..Board::default()
        };
        let short = correct(&old, &board(0.001), &frame());
        assert_eq!(short.unit, old);
        assert!(short.not_used[0].contains("1.0 ms"));
        let mut last = old;
        for ms in [2.0, 4.0, 8.0, 30.0] {
            let new = correct(&old, &board(ms * 1e-3), &frame()).unit;
            assert!(new.kp < last.kp || last.kp == 0.0, "{ms} ms: {}", new.kp);
            assert!(new.ki_per_s <= last.ki_per_s && new.ki_per_s >= 10.0);
            assert!(new.damping_n_s_per_m <= last.damping_n_s_per_m);
            // The delay is still there the next time; the gains allow for it by then.
            assert_eq!(correct(&new, &board(ms * 1e-3), &frame()).unit, new);
            last = new;
        }
        assert_eq!((last.kp, last.damping_n_s_per_m), (0.0, 0.0));
    }

    #[test]
    fn ripples_of_one_period_add_up_and_others_take_the_next_place() {
        let board = |ripples| Board {
            ripples,
            ..Board::default()
        };
        let old = rig().units[0];
        let one = correct(&old, &board(vec![ripple(3.7, 0.4, 0.5, false)]), &frame()).unit;
        // The same again with its sign turned: gone.
        let half_turn = 0.5 + std::f64::consts::PI;
        let none = correct(
            &one,
            &board(vec![ripple(3.71, 0.4, half_turn, false)]),
            &frame(),
        )
        .unit;
        assert!(none.ripples[0].amplitude_n < 1e-3, "{none:?}");
        let two = correct(&one, &board(vec![ripple(1.0, 0.03, 0.0, true)]), &frame()).unit;
        assert_eq!(two.ripples[0], one.ripples[0]);
        assert!((two.ripples[1].amplitude_per_n - 0.03).abs() < 1e-9);
        assert!((two.ripples[1].period_m - 0.0628319).abs() < 1e-6);
        // Without the board's own angle a ripple has no phase.
        let stranger = Frame {
            travel_m_per_rad: None,
            ..frame()
        };
        let new = correct(&old, &board(vec![ripple(3.7, 0.4, 0.5, false)]), &stranger);
        assert_eq!(new.unit, old);
        assert!(new.not_used[0].contains("phase"));
    }
}
