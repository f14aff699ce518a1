//! From what an analysis found to a rig file that makes up for it.
//!
//! [`correct`] turns the findings on one unit into its new settings, within bounds; [`rewrite`] puts new settings
//! into the text of a rig file, comments and layout kept. What the board can use:
//!
//! | finding | setting |
//! | --- | --- |
//! | dry friction, with its share of load | `coulomb_n`, `coulomb_per_n` |
//! | viscous friction | `viscous_n_s_per_m` |
//! | offset | `friction_offset_n` |
//! | gain | `dac_codes_per_n` where the log's command is the DAC's, else `friction_gain` |
//! | ripple over the angle | `ripple_...`, where the log's angle is the board's own |
//! | delay of the drive | `kp`, `ki_per_s`, `damping_n_s_per_m`, brought down: see [`gains_for_delay`] |
//!
//! Dry friction is declared [`UNDER_N`] below what was found: what is overdone at a reversal costs more than what is
//! missing.
//!
//! One finding out of its bounds leaves the unit as it is: numbers of one fit belong together, and half of them
//! may be worse than none.

use crate::rigfile::{RigFile, RippleSettings, UnitSettings};
use residual::Compensation as Board;
use std::f64::consts::TAU;
use wire::UNITS;

/// Largest change of `coulomb_n`, N. More is a reel that rubs: mend it.
const MOST_COULOMB_N: f64 = 2.0;
/// Dry friction is declared this much below what was found, N. On the plant (`tension_loop` example of `control`,
/// `seconds=20 seeds=2 coulomb=...`) tensions are 0.030 N off with 0.1 N less than there is, 0.032 N with just that, and
/// 0.042 N with 0.1 N more: too much of it drives the reel past the reversal.
pub const UNDER_N: f64 = 0.1;
/// Largest change of `coulomb_per_n`.
const MOST_COULOMB_PER_N: f64 = 0.25;
/// Largest change of `friction_offset_n`, N.
const MOST_OFFSET_N: f64 = 1.5;
/// Largest factor on a gain, either way. More is a wrong strap or amplifier, to be looked at and not compensated.
const MOST_GAIN: f64 = 1.6;
/// Delays up to this are within what the gains allow for, s.
const SHORT_DELAY_S: f64 = 0.0015;
/// Longer delays are a broken drive, s.
const LONG_DELAY_S: f64 = 0.030;
/// Ripples whose periods differ by less than this part are the same one.
const SAME_PERIOD: f64 = 0.03;

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

/// kp, ki and damping that a loop with this additional delay of the command still bears, at most.
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

fn bounded(
    name: &str,
    old: f64,
    new: f64,
    most: f64,
    range: std::ops::RangeInclusive<f64>,
) -> Result<f64, String> {
    // NaN is in no range.
    if range.contains(&new) && (new - old).abs() <= most {
        return Ok(new);
    }
    Err(format!(
        "{name} would go from {old:.4} to {new:.4}: the board takes {} to {}, and a finding may change it by {most} at most{}",
        range.start(),
        range.end(),
        if name.starts_with("coulomb") && new < *range.start() {
            ". Friction of the wrong sign: let the velocity be positive while winding in (`scale = -1` in the model file)"
        } else {
            ""
        }
    ))
}

/// The settings of a unit with the findings in them. Where one of them is out of its bounds the settings are the
/// old ones, and `not_used` says why.
#[must_use]
pub fn correct(unit: &UnitSettings, board: &Board, frame: &Frame) -> Corrected {
    let mut not_used: Vec<String> = board
        .left_out
        .iter()
        .map(|name| format!("{name}: the board has no term for it"))
        .collect();
    let unit = match corrected(unit, board, frame, &mut not_used) {
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
    board: &Board,
    frame: &Frame,
    not_used: &mut Vec<String>,
) -> Result<UnitSettings, String> {
    let mut new = *unit;
    let (gain, share, coulomb, offset) = if frame.increment {
        (
            unit.friction_gain,
            unit.coulomb_per_n,
            unit.coulomb_n,
            unit.friction_offset_n,
        )
    } else {
        (1.0, 0.0, 0.0, 0.0)
    };
    // Bounds are about what was found, so without increments they are about the declared neutral values.
    if board.offset != 0.0 {
        let range = -3.0..=3.0;
        let found = bounded(
            "friction_offset_n",
            offset,
            offset + board.offset,
            MOST_OFFSET_N,
            range,
        )?;
        new.friction_offset_n = found;
    }
    if board.friction != 0.0 || board.friction_per_load != 0.0 {
        // Friction that takes from the tension while winding in is a negative coefficient of sign(v).
        let found = bounded(
            "coulomb_n",
            coulomb,
            coulomb - board.friction,
            MOST_COULOMB_N,
            0.0..=5.0,
        )?;
        if frame.increment || board.friction != 0.0 {
            new.coulomb_n = (found - UNDER_N).max(0.0);
        }
    }
    if board.gain_error != 0.0 || board.friction_per_load != 0.0 {
        // The load is L = (gain - share s) cmd with s the sign of the velocity. Found: F = (1 + g) L + p s |L|, so
        // per command (1 + g) gain - p share, and times s: p gain - (1 + g) share.
        let factor = 1.0 + board.gain_error;
        if !(1.0 / MOST_GAIN..=MOST_GAIN).contains(&factor) {
            return Err(format!(
                "a gain of {factor:.3} times the declared one is no small error: look for a wrong strap, amplifier or scale"
            ));
        }
        let drive = if frame.gain_of_drive { factor } else { 1.0 };
        let new_gain = (factor * gain - board.friction_per_load * share) / drive;
        let new_share = (factor * share - board.friction_per_load * gain) / drive;
        if drive != 1.0 {
            new.dac_codes_per_n = unit.dac_codes_per_n / drive;
            if !(10.0..=1000.0).contains(&new.dac_codes_per_n.abs()) {
                return Err(format!(
                    "dac_codes_per_n would be {:.2}: the board takes 10 to 1000 in size",
                    new.dac_codes_per_n
                ));
            }
        }
        // Without increments a value that nothing was found about keeps the rig file's.
        if frame.increment || board.gain_error != 0.0 {
            new.friction_gain =
                bounded("friction_gain", gain, new_gain, MOST_GAIN - 1.0, 0.5..=2.0)?;
        }
        if frame.increment || board.friction_per_load != 0.0 {
            let most = 0.4f64.min(0.5 * new.friction_gain);
            new.coulomb_per_n = bounded(
                "coulomb_per_n",
                share,
                new_share,
                MOST_COULOMB_PER_N,
                0.0..=most,
            )?;
        }
    }
    if board.viscous != 0.0 {
        match frame.velocity_m_per_s {
            Some(scale) => {
                let old = if frame.increment {
                    unit.viscous_n_s_per_m
                } else {
                    0.0
                };
                // Less friction than none would be feedback that drives.
                let found = (old - board.viscous / scale).max(0.0);
                new.viscous_n_s_per_m =
                    bounded("viscous_n_s_per_m", old, found, 100.0, 0.0..=100.0)?;
            }
            None => not_used.push(format!(
                "viscous, {:.4} N per unit of velocity: what that unit is in cable travel is not known",
                board.viscous
            )),
        }
    }
    for ripple in &board.ripples {
        match frame.travel_m_per_rad {
            Some(radius) => add_ripple(&mut new.ripples, ripple, radius)?,
            None => not_used.push(format!(
                "periodic_angle of order {:.3}: the log's angle is not the board's own, so the phase is not known",
                ripple.order
            )),
        }
    }
    if board.delay_s > LONG_DELAY_S {
        return Err(format!(
            "a delay of {:.1} ms is no drive's: look at cabling and amplifier",
            board.delay_s * 1e3
        ));
    }
    if board.delay_s > SHORT_DELAY_S {
        let [kp, ki, damping] = gains_for_delay(board.delay_s);
        new.kp = new.kp.min(kp);
        new.ki_per_s = new.ki_per_s.min(ki);
        new.damping_n_s_per_m = new.damping_n_s_per_m.min(damping);
    } else if board.delay_s != 0.0 {
        not_used.push(format!(
            "delay, {:.1} ms: the gains allow for it",
            board.delay_s * 1e3
        ));
    }
    if new != *unit && !unit.friction_feedforward && unit.enabled {
        not_used.push("friction, ripples and offset, until friction_feedforward = true".to_owned());
    }
    let rounded = rounded(&new);
    control::Config::from_wire(&rounded.to_wire())
        .map_err(|error| format!("the board would refuse it: {error}"))?;
    Ok(rounded)
}

/// Adds a ripple to those that are there: to one of the same period, or in a free place.
fn add_ripple(
    ripples: &mut [RippleSettings],
    found: &residual::Ripple,
    travel_m_per_rad: f64,
) -> Result<(), String> {
    let period_m = TAU * travel_m_per_rad / found.order;
    if !(5e-4..=1.0).contains(&period_m) {
        return Err(format!(
            "a ripple with a period of {:.4} mm of cable is out of the board's range",
            period_m * 1e3
        ));
    }
    let same =
        |r: &RippleSettings| !r.is_none() && (r.period_m / period_m - 1.0).abs() < SAME_PERIOD;
    let place = ripples
        .iter()
        .position(same)
        .or_else(|| ripples.iter().position(RippleSettings::is_none))
        .ok_or("there is no place for another ripple")?;
    let slot = &mut ripples[place];
    let was_there = !slot.is_none();
    // As vectors: one part that is constant and one that grows with the load have one phase in the board.
    let (sin, cos) = found.phase.sin_cos();
    let (old, old_sin, old_cos) = if was_there {
        let amplitude = if found.of_load {
            slot.amplitude_per_n
        } else {
            slot.amplitude_n
        };
        let (s, c) = slot.phase_rad.sin_cos();
        (amplitude, s, c)
    } else {
        (0.0, 0.0, 0.0)
    };
    if was_there && (slot.amplitude_n != 0.0) == found.of_load {
        return Err("a ripple of that period is declared in another form (with load, without): look at both".into());
    }
    let x = old * old_cos + found.amplitude * cos;
    let y = old * old_sin + found.amplitude * sin;
    slot.phase_rad = y.atan2(x);
    if found.of_load {
        slot.amplitude_per_n = bounded("ripple_amplitude_per_n", old, x.hypot(y), 0.2, 0.0..=0.2)?;
    } else {
        slot.amplitude_n = bounded("ripple_amplitude_n", old, x.hypot(y), 2.0, 0.0..=3.0)?;
    }
    if !was_there {
        slot.period_m = period_m;
    }
    Ok(())
}

/// Ripples whose orders the travel can't tell apart become one.
///
/// Over `turns` of the angle two orders are apart where they differ by 0.6 / turns; closer ones are one ripple that the
/// fit has split. The one in their place has their mean order by amplitude, and their sum in the middle of the travel.
pub fn merge_ripples(ripples: &mut Vec<residual::Ripple>, angles_rad: &[f64]) {
    let low = angles_rad.iter().copied().fold(f64::INFINITY, f64::min);
    let high = angles_rad.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (middle, turns) = (0.5 * (low + high), (high - low) / TAU);
    if !(turns > 0.0 && turns.is_finite()) {
        return;
    }
    let mut merged: Vec<residual::Ripple> = Vec::new();
    for found in ripples.drain(..) {
        let near = merged
            .iter_mut()
            .find(|r| r.of_load == found.of_load && (r.order - found.order).abs() < 0.6 / turns);
        let Some(r) = near else {
            merged.push(found);
            continue;
        };
        let (y1, x1) = (r.order * middle + r.phase).sin_cos();
        let (y2, x2) = (found.order * middle + found.phase).sin_cos();
        let x = r.amplitude * x1 + found.amplitude * x2;
        let y = r.amplitude * y1 + found.amplitude * y2;
        let weight = r.amplitude / (r.amplitude + found.amplitude);
        r.order = weight * r.order + (1.0 - weight) * found.order;
        r.amplitude = x.hypot(y);
        let phase = y.atan2(x) - r.order * middle;
        r.phase = phase - TAU * (phase / TAU).round();
    }
    *ripples = merged;
}

/// Four digits after the point are finer than anything measured; lengths and codes have their own.
fn rounded(unit: &UnitSettings) -> UnitSettings {
    let mut unit = *unit;
    for key in &KEYS {
        let value = (key.get)(&unit);
        (key.set)(&mut unit, (value * key.digits).round() / key.digits);
    }
    unit
}

struct Key {
    name: &'static str,
    digits: f64,
    get: fn(&UnitSettings) -> f64,
    set: fn(&mut UnitSettings, f64),
}

macro_rules! keys {
    ($($name:literal, $digits:literal, $($field:tt).+ $([$n:literal] . $part:ident)?;)*) => {
        [$(Key {
            name: $name,
            digits: $digits,
            get: |u| u.$($field).+$([$n].$part)?,
            set: |u, x| u.$($field).+$([$n].$part)? = x,
        },)*]
    };
}

/// Every key that a finding may change.
const KEYS: [Key; 17] = keys! {
    "kp", 1e4, kp;
    "ki_per_s", 1e4, ki_per_s;
    "damping_n_s_per_m", 1e3, damping_n_s_per_m;
    "friction_offset_n", 1e4, friction_offset_n;
    "friction_gain", 1e4, friction_gain;
    "coulomb_n", 1e4, coulomb_n;
    "coulomb_per_n", 1e4, coulomb_per_n;
    "dac_codes_per_n", 1e3, dac_codes_per_n;
    "viscous_n_s_per_m", 1e3, viscous_n_s_per_m;
    "ripple_period_m", 1e7, ripples[0].period_m;
    "ripple_amplitude_n", 1e4, ripples[0].amplitude_n;
    "ripple_amplitude_per_n", 1e5, ripples[0].amplitude_per_n;
    "ripple_phase_rad", 1e4, ripples[0].phase_rad;
    "ripple2_period_m", 1e7, ripples[1].period_m;
    "ripple2_amplitude_n", 1e4, ripples[1].amplitude_n;
    "ripple2_amplitude_per_n", 1e5, ripples[1].amplitude_per_n;
    "ripple2_phase_rad", 1e4, ripples[1].phase_rad;
};

/// What a line of a rig file's text says about a key.
fn value_at(line: &str, key: &str) -> Option<usize> {
    line.trim_start()
        .strip_prefix(key)
        .and_then(|rest| rest.trim_start().strip_prefix('='))
        .map(|rest| line.len() - rest.trim_start().len())
}

/// The line with another value; what follows the value stays.
fn with_value(line: &str, at: usize, value: f64) -> String {
    let (head, rest) = line.split_at(at);
    let end = rest
        .find(|c: char| c.is_whitespace() || c == '#')
        .unwrap_or(rest.len());
    format!("{head}{value:?}{}", &rest[end..])
}

/// The header of the table that a line opens.
fn header(line: &str) -> Option<&str> {
    let line = line.trim();
    line.starts_with('[').then(|| {
        let end = line.find('#').unwrap_or(line.len());
        line[..end].trim()
    })
}

/// A rig file's text and what is different in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Rewritten {
    /// The text.
    pub text: String,
    /// Each change in a line, as in `units 1, 2: coulomb_n 0.909 -> 1.3`.
    pub changed: Vec<String>,
}

/// Puts new settings into the text of a rig file. A value that all units have from `[defaults]` is changed there,
/// one of a single unit in that unit's table.
///
/// # Errors
/// The text is not the rig's, or a key stands where it can't be changed (quoted, or in an inline table); the message
/// says which and to what value to set it by hand.
pub fn rewrite(
    name: &str,
    text: &str,
    rig: &RigFile,
    units: &[UnitSettings; UNITS],
) -> Result<Rewritten, String> {
    let mut lines: Vec<String> = text.split_inclusive('\n').map(str::to_owned).collect();
    let mut changed = Vec::new();
    for key in &KEYS {
        let old = rig.units.each_ref().map(key.get);
        let new = units.each_ref().map(key.get);
        if old == new {
            continue;
        }
        set_key(&mut lines, key.name, &old, &new);
        let mut groups: Vec<(String, Vec<String>)> = Vec::new();
        for i in (0..UNITS).filter(|&i| old[i] != new[i]) {
            let what = format!("{} {:?} -> {:?}", key.name, old[i], new[i]);
            let number = (i + 1).to_string();
            match groups.iter_mut().find(|(w, _)| *w == what) {
                Some((_, numbers)) => numbers.push(number),
                None => groups.push((what, vec![number])),
            }
        }
        changed.extend(groups.into_iter().map(|(what, numbers)| {
            let s = if numbers.len() > 1 { "s" } else { "" };
            format!("unit{s} {}: {what}", numbers.join(", "))
        }));
    }
    let text: String = lines.concat();
    let by_hand = || changed.join("; ");
    let parsed = RigFile::parse(name, &text).map_err(|error| {
        format!(
            "{name} can't be changed line by line ({error}); make these changes by hand: {}",
            by_hand()
        )
    })?;
    // Nothing but what was meant.
    let mut wanted = rig.clone();
    wanted.units = *units;
    if parsed != wanted {
        return Err(format!(
            "{name} can't be changed line by line (a key may stand in an inline table); make these changes by hand: {}",
            by_hand()
        ));
    }
    Ok(Rewritten { text, changed })
}

fn set_key(lines: &mut Vec<String>, key: &str, old: &[f64; UNITS], new: &[f64; UNITS]) {
    // Where each unit's own line is, and where its number and the defaults stand.
    let mut own: [Option<usize>; UNITS] = [None; UNITS];
    let mut number_line: [Option<usize>; UNITS] = [None; UNITS];
    let (mut default_line, mut default_header) = (None, None);
    let mut at_header = String::new();
    let mut pending: Option<usize> = None;
    let mut unit: Option<usize> = None;
    for (i, line) in lines.iter().enumerate() {
        if let Some(header) = header(line) {
            at_header = header.to_owned();
            (pending, unit) = (None, None);
            if at_header == "[defaults]" {
                default_header = Some(i);
            }
        } else if at_header == "[defaults]" && value_at(line, key).is_some() {
            default_line = Some(i);
        } else if at_header == "[[unit]]" {
            if let Some(at) = value_at(line, "number") {
                let number = line[at..]
                    .split(|c: char| !c.is_ascii_digit())
                    .next()
                    .and_then(|digits| digits.parse::<usize>().ok());
                unit = number.map(|n| n.wrapping_sub(1)).filter(|n| *n < UNITS);
                if let Some(unit) = unit {
                    number_line[unit] = Some(i);
                    own[unit] = own[unit].or(pending);
                }
            } else if value_at(line, key).is_some() {
                // A key may stand above the number.
                match unit {
                    Some(unit) => own[unit] = Some(i),
                    None => pending = Some(i),
                }
            }
        }
    }
    let mut inserts: Vec<(usize, String)> = Vec::new();
    let replace = |lines: &mut Vec<String>, i: usize, value: f64| {
        if let Some(at) = value_at(&lines[i], key) {
            lines[i] = with_value(&lines[i], at, value);
        }
    };
    for unit in 0..UNITS {
        if let Some(i) = own[unit].filter(|_| old[unit] != new[unit]) {
            replace(lines, i, new[unit]);
        }
    }
    let shared: Vec<usize> = (0..UNITS).filter(|&u| own[u].is_none()).collect();
    let Some(&first) = shared.first() else {
        return;
    };
    if shared.iter().all(|&u| new[u] == new[first]) {
        if old[first] != new[first] {
            match (default_line, default_header) {
                (Some(i), _) => replace(lines, i, new[first]),
                (None, Some(i)) => inserts.push((i + 1, format!("{key} = {:?}\n", new[first]))),
                (None, None) => {}
            }
        }
    } else {
        for &unit in shared.iter().filter(|&&u| old[u] != new[u]) {
            if let Some(i) = number_line[unit] {
                inserts.push((i + 1, format!("{key} = {:?}\n", new[unit])));
            }
        }
    }
    inserts.sort_by_key(|(i, _)| std::cmp::Reverse(*i));
    for (i, line) in inserts {
        // A file's last line may lack its end.
        if i > 0 && !lines[i - 1].ends_with('\n') {
            lines[i - 1].push('\n');
        }
        lines.insert(i.min(lines.len()), line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigfile::DEFAULT_TEXT;
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
            let wanted = force(&old, 0.0, dac, speed, travel) + found;
            let made = force(&new.unit, UNDER_N, dac, speed, travel);
            // Rounded to four digits.
            assert!((made - wanted).abs() < 2e-3, "{made} {wanted}");
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

    #[test]
    fn a_ripple_that_a_fit_has_split_becomes_one_again() {
        // 0.3 and 0.2 N of orders 3.66 and 3.80 that are in step at 0.5 rad, in the middle of one turn.
        let angles: Vec<f64> = (0..100).map(|n| 0.5 + 0.06 * f64::from(n - 50)).collect();
        let middle = 0.5 * (angles[0] + angles[99]);
        let at = |order: f64| 1.0 - order * middle;
        let mut ripples = vec![
            ripple(3.66, 0.3, at(3.66), false),
            ripple(9.0, 0.1, 0.0, false),
            ripple(3.80, 0.2, at(3.80), false),
        ];
        merge_ripples(&mut ripples, &angles);
        assert_eq!(ripples.len(), 2, "{ripples:?}");
        assert!((ripples[0].order - 3.716).abs() < 1e-9);
        assert!((ripples[0].amplitude - 0.5).abs() < 1e-9);
        let phase = (ripples[0].order * middle + ripples[0].phase - 1.0).sin();
        assert!(phase.abs() < 1e-9, "{ripples:?}");
        // Nothing to go by, nothing done.
        let mut two = vec![ripple(3.7, 0.3, 0.0, false), ripple(3.8, 0.3, 0.0, false)];
        merge_ripples(&mut two, &[]);
        assert_eq!(two.len(), 2);
    }

    #[test]
    fn a_rig_file_is_changed_where_its_values_stand() {
        let rig = rig();
        let mut units = rig.units;
        for unit in &mut units {
            unit.coulomb_n = 1.3;
            unit.viscous_n_s_per_m = 4.0;
        }
        units[2].ripples[0] = RippleSettings {
            period_m: 0.0169,
            amplitude_n: 0.4,
            amplitude_per_n: 0.0,
            phase_rad: -0.7,
        };
        units[4].kp = 0.1;
        let new = rewrite("rig", DEFAULT_TEXT, &rig, &units).expect("changes");
        let parsed = RigFile::parse("rig", &new.text).expect("still a rig file");
        assert_eq!(parsed.units, units);
        // Comments are all there; new keys got lines of their own.
        let comments = |text: &str| text.matches('#').count();
        assert_eq!(comments(&new.text), comments(DEFAULT_TEXT));
        assert_eq!(
            new.text.lines().count(),
            DEFAULT_TEXT.lines().count() + 1 + 3 + 1
        );
        assert!(new
            .changed
            .contains(&"units 1, 2, 3, 4, 5, 6: coulomb_n 0.909 -> 1.3".to_owned()));
        assert!(new.changed.contains(&"unit 5: kp 0.3 -> 0.1".to_owned()));
        // Once more: a unit's own line is changed, not doubled.
        let mut again = units;
        again[4].kp = 0.2;
        again[2].ripples[0].phase_rad = 0.0;
        let newer = rewrite("rig", &new.text, &parsed, &again).expect("changes");
        assert_eq!(newer.text.lines().count(), new.text.lines().count());
        assert_eq!(
            RigFile::parse("rig", &newer.text).expect("good").units,
            again
        );
        // Nothing to do leaves every byte.
        let same = rewrite("rig", &new.text, &parsed, &units).expect("nothing");
        assert_eq!((same.text, same.changed.len()), (new.text, 0));
    }

    #[test]
    fn a_file_that_cannot_be_changed_by_lines_is_left_with_the_changes_named() {
        let text = DEFAULT_TEXT.replacen("kp = 0.3", "\"kp\" = 0.3", 1);
        let rig = RigFile::parse("mine.toml", &text).expect("quoted keys are TOML");
        let mut units = rig.units;
        units.iter_mut().for_each(|unit| unit.kp = 0.2);
        let error = rewrite("mine.toml", &text, &rig, &units).expect_err("is not found on a line");
        assert!(
            error.contains("mine.toml") && error.contains("kp 0.3 -> 0.2"),
            "{error}"
        );
    }
}
