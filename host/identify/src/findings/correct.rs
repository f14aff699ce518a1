//! Findings on one unit as its new settings, each within bounds.

use super::ripples::add_ripple;
use super::{bounded, KEYS};
use residual::Compensation;
use rig::UnitSettings;
use std::f64::consts::TAU;

/// Largest change of `coulomb_n`, N. More is a reel that rubs and needs repair.
const MAX_COULOMB_CHANGE_N: f64 = 2.0;
/// Largest change of `coulomb_per_n`.
const MAX_COULOMB_PER_N_CHANGE: f64 = 0.25;
/// Largest change of `friction_offset_n`, N.
const MAX_OFFSET_CHANGE_N: f64 = 1.5;
/// Largest factor on a gain, either way. More is a wrong strap or amplifier, to be repaired and not
/// compensated.
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
    /// The model declares what the rig file says, so findings come on top; else they take its
    /// place.
    pub increment: bool,
    /// The command column is the DAC's, through `dac_codes_per_n`: a wrong gain is the drive's.
    pub gain_of_drive: bool,
    /// m/s of cable for one unit of the velocity column, where that is known.
    pub velocity_m_per_s: Option<f64>,
    /// Cable travel for one radian of the angle column, m, where the angle is that of the board's
    /// own encoder.
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

/// Largest kp, ki, leaking ki and damping that a loop with this additional delay of the command
/// allows.
///
/// The built-in gains hold for 10 ms between command and tension (converter 6.25 ms, low pass 2.2
/// ms, hold 1.6 ms) and 1.7 ms between command and encoder. Reel and cable swing at 34 Hz at the
/// most (24 N/mm, 0.51 kg). The damping works on that swing by the cosine of the phase that its
/// delay makes: it fades to nothing at 5.7 ms more, past which it would feed the swing. The
/// proportional gain and the leaking integral need the damping, so they fade with it. An integral
/// alone is stable while ki / (2 pi 34 Hz) times the swing's sharpness (5.6, from the cable's own
/// damping) is well below one: 10 leave a factor of four, and are slow enough for 30 ms.
#[must_use]
pub fn gains_for_delay(delay_s: f64) -> [f64; 4] {
    const SWING_HZ: f64 = 34.0;
    const ENCODER_S: f64 = 0.0017;
    let phase = |delay: f64| (TAU * SWING_HZ * (ENCODER_S + delay)).min(TAU / 4.0);
    let left = phase(delay_s.max(0.0)).cos().max(0.0) / phase(0.0).cos();
    [0.3 * left, 10.0 + 10.0 * left, 30.0 * left, 110.0 * left]
}

/// The settings of a unit with the findings in them. Where one of them is out of its bounds the
/// settings are the old ones, and `not_used` says why.
#[must_use]
pub fn correct(unit: &UnitSettings, compensation: &Compensation, frame: &Frame) -> Corrected {
    let mut not_used: Vec<String> = compensation
        .left_out
        .iter()
        .map(|name| match super::without_setting(name) {
            Some(advice) => {
                format!("{name}: the board has no setting for it; what helps: {advice}")
            }
            None => format!("{name}: the board cannot use it in this form"),
        })
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
    compensation: &Compensation,
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
    compensation: &Compensation,
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
        // Friction that takes from the tension while winding in is a negative coefficient of
        // sign(v).
        let found = bounded(
            "coulomb_n",
            declared.coulomb,
            declared.coulomb - compensation.friction,
            MAX_COULOMB_CHANGE_N,
            0.0..=5.0,
        )?;
        if frame.increment || compensation.friction != 0.0 {
            new.coulomb_n = found;
        }
    }
    Ok(())
}

/// Gain of the drive and friction per load, which one fit gives together.
fn correct_gain_and_share(
    new: &mut UnitSettings,
    declared: &Declared,
    compensation: &Compensation,
    frame: &Frame,
) -> Result<(), String> {
    if compensation.gain_error == 0.0 && compensation.friction_per_load == 0.0 {
        return Ok(());
    }
    // The load is L = (gain - share s) cmd with s the sign of the velocity. Found: F = (1 + g) L +
    // p s |L|, so per command (1 + g) gain - p share, and times s: p gain - (1 + g) share.
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

/// A unit with the gains that a delay of the drive allows; as it is where the delay is negligible
/// or longer than any drive's.
#[must_use]
pub fn slowed(unit: &UnitSettings, delay_s: f64) -> UnitSettings {
    let mut new = *unit;
    if delay_s <= NEGLIGIBLE_DELAY_S
        || correct_for_delay(&mut new, delay_s, &mut Vec::new()).is_err()
    {
        return *unit;
    }
    rounded(&new)
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
        let [kp, ki, leaky_ki, damping] = gains_for_delay(delay_s);
        new.kp = new.kp.min(kp);
        new.ki_per_s = new.ki_per_s.min(ki);
        new.leaky_ki_per_s = new.leaky_ki_per_s.min(leaky_ki);
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
mod tests;
