//! The test of a cable under tension: it is taken up at limited speed, loaded slowly, and loaded by
//! a chirp. Friction, gain and delay of the drive follow from it.
//!
//! # What bounds the force
//!
//! | bound | who holds it |
//! | --- | --- |
//! | a setpoint is valid for [`VALID_MS`]; without a newer one all outputs go to 0 V | the board |
//! | the command is at most [`LOADED_N`], and no other unit is driven | the board: limits of the configuration in force |
//! | a load cell that reads more than [`OVER_TENSION_N`] takes the unit to 0 V | the board |
//! | the reel takes up slack at [`TAKE_UP_M_PER_S`] | this module, by the encoder: it lowers the command, and friction stops the reel. The board brakes from 30 mm/s on |
//! | the command rises while the load cell reads less than [`TOP_N`] | this module |
//!
//! The loop is open: command is setpoint. A reel of the rig holds 1.2 N against pulling out without
//! a command, so the test winds in only, and the tension stays when it is over.

use crate::figures::{LoadLine, TensionFigures};
use crate::pulse::{self, Drive};
use crate::window::{mean, Rest, Window, REST};
use crate::BringUpError;
use control::Fault;
use rig::{Rig, UnitSettings};
use session::{TimedSample, PERIOD};
use std::f64::consts::TAU;
use std::sync::atomic::Ordering;
use std::time::Duration;
use wire::message::UnitConfig;
use wire::{Command, UNITS};

/// Largest command, N: 1.2 N of tension at the friction of the example rig, 2.0 N at half of it.
pub const LOADED_N: f64 = 2.3;
/// Largest command while the cable reads less than [`TIGHTENED_N`], N. At 2.1 N the board takes a
/// cable that stays slack, below that reading, for a fault (45).
const SLACK_N: f64 = 2.0;
const TIGHTENED_N: f64 = 0.5;
/// Reading at which the board takes the unit to 0 V, N.
pub const OVER_TENSION_N: f64 = 1.8;
/// Reading at which the command rises no more, N.
pub const TOP_N: f64 = 1.1;
/// Reading at which the cable is tight, N: a hundred times the noise.
const TIGHT_N: f64 = 0.15;
/// Speed at which slack is taken up, m/s. A cable that closes with it rises by v sqrt(k m) = 0.3 N
/// (24 N/mm, 0.51 kg).
pub const TAKE_UP_M_PER_S: f64 = 3.0e-3;
/// First command, N: less than friction holds that is far below the rig file's.
const FIRST_N: f64 = 0.05;
/// Rise of the command while the reel is slower than that speed, and its fall while it is faster,
/// N/s.
const SEEK_N_PER_S: f64 = 0.5;
/// What is taken off the command while it is faster, N per m/s: 0.3 N at 10 mm/s, by which it stops
/// within some milliseconds.
const BRAKE_N_S_PER_M: f64 = 50.0;
/// Rise of the command while the cable is loaded, N/s.
const LOAD_N_PER_S: f64 = 0.4;
/// Cable from which it counts as loose at first, m; and from which on the command of the idle reel
/// is taken.
const LOOSE_M: f64 = 2.0e-4;
/// Fewest periods for that command: 0.5 mm of slack.
const IDLE_PERIODS: usize = 16;
/// Command above that of the idle reel that is needed for a gain, N.
const LOAD_N: f64 = 0.4;
/// Longest cable that is wound in, m: twice the slack that is asked for, and more.
const LONGEST_M: f64 = 0.06;
/// Longest time for taking up and for loading, s.
const LONGEST_S: f64 = 20.0;
/// Chirp: its length, s, its first and last frequency, Hz, and its amplitude, N. The cable stays
/// tight: presliding lets the tension follow by a seventh.
const CHIRP_S: f64 = 4.0;
const CHIRP_HZ: (f64, f64) = (1.0, 12.0);
const CHIRP_N: f64 = 0.5;
/// Time within which a delay is looked for, and its steps, s.
const DELAYS_S: (f64, f64) = (-0.005, 0.08);
const DELAY_STEP_S: f64 = 1e-4;
/// Periods of the setpoint that closes the loop.
const CLOSE_PERIODS: u32 = 5;
/// For how long a setpoint is valid, ms: five periods of this program.
pub const VALID_MS: u16 = 60;

/// Configurations for `unit` (from 0).
#[must_use]
pub fn configs(
    rig: &Rig,
    works: [bool; UNITS],
    zero_code: [i32; UNITS],
    unit: usize,
) -> [UnitConfig; UNITS] {
    let mut configs = pulse::configs(rig, works, zero_code, unit, LOADED_N);
    configs[unit].over_tension_un = control::config::field::OVER_TENSION.to_wire(OVER_TENSION_N);
    configs
}

/// Takes a cable up, loads it, and gives it a chirp. Everything is at 0 V before and after; the
/// cable stays tight.
pub(crate) fn test(drive: &mut Drive<'_, '_>, unit: usize) -> Result<TensionFigures, BringUpError> {
    let configs = configs(drive.rig, drive.works, drive.zero_code, unit);
    drive.session.configure(&configs)?;
    let rest = Rest::of(&Window::over(drive.session, REST)?);
    let mut run = Run {
        unit,
        rest,
        figures: TensionFigures::default(),
        command_n: 0.0,
        recent: Vec::new(),
        idle: Vec::new(),
        drive,
    };
    run.figures.refused = crate::refused(run.drive.session, &Command::Arm)?;
    if run.figures.refused.is_some() {
        return Ok(run.figures);
    }
    let ended = run.take_up().and_then(|tight| {
        if tight && run.load()? {
            run.chirp()?;
        }
        Ok(())
    });
    run.end(ended)
}

/// A unit under way.
struct Run<'r, 'a, 's> {
    drive: &'r mut Drive<'a, 's>,
    unit: usize,
    rest: Rest,
    figures: TensionFigures,
    command_n: f64,
    /// The newest samples of the unit.
    recent: Vec<TimedSample>,
    /// Commands of the idle reel, N.
    idle: Vec<f64>,
}

/// Samples over which speed and reading are taken, 12.5 ms: what the converter's filter takes.
const MEAN_OF: usize = 4;

impl Run<'_, '_, '_> {
    /// Sends the command and lets one period pass. `false`: a fault has ended it.
    fn step(&mut self) -> Result<bool, BringUpError> {
        if self.drive.stop.load(Ordering::Relaxed) {
            return Err(BringUpError::Stopped);
        }
        let setpoints = pulse::setpoints(self.unit, self.command_n);
        self.drive.session.pulse(setpoints, VALID_MS, PERIOD)?;
        let received = self.drive.session.drain();
        let unit = self.unit as u8;
        let of_unit = (received.samples.iter()).filter(|timed| timed.sample.unit == unit);
        self.recent.extend(of_unit.copied());
        let most = self.figures.most_n.max(self.reading_n());
        self.figures.most_n = most;
        let faults = received.faults.iter().map(|fault| fault.code);
        let fault = faults.into_iter().find(|code| *code != 0);
        self.figures.fault = fault.unwrap_or(self.figures.fault);
        Ok(self.figures.fault == 0)
    }

    fn last(&self) -> &[TimedSample] {
        &self.recent[self.recent.len().saturating_sub(MEAN_OF)..]
    }

    /// Reading of the load cell over its rest, N.
    fn reading_n(&self) -> f64 {
        let codes: Vec<f64> = (self.last().iter())
            .map(|timed| f64::from(timed.sample.adc_code))
            .collect();
        let scale = self.drive.rig.units[self.unit].scale_n_per_count;
        mean(&codes).map_or(0.0, |code| (code - self.rest.code[self.unit]) * scale)
    }

    fn wound_m(&self, timed: &TimedSample) -> f64 {
        let counts = timed.sample.encoder_counts;
        let moved = counts.wrapping_sub(self.rest.counts[self.unit]);
        f64::from(moved) * self.drive.rig.units[self.unit].travel_m_per_count
    }

    fn speed_m_per_s(&self) -> f64 {
        match self.last() {
            [first, .., last] if last.t_us > first.t_us => {
                let seconds = (last.t_us - first.t_us) as f64 * 1e-6;
                (self.wound_m(last) - self.wound_m(first)) / seconds
            }
            _ => 0.0,
        }
    }

    /// Command of the newest samples, as the DAC got it, N.
    fn given_n(&self) -> f64 {
        let unit = &self.drive.rig.units[self.unit];
        let given: Vec<f64> = (self.last().iter())
            .map(|timed| command_n(timed, unit))
            .collect();
        mean(&given).unwrap_or(0.0)
    }

    fn periods(seconds: f64) -> u32 {
        (seconds / PERIOD.as_secs_f64()) as u32
    }

    /// Winds the cable in at limited speed until it is tight.
    fn take_up(&mut self) -> Result<bool, BringUpError> {
        let rise_n = SEEK_N_PER_S * PERIOD.as_secs_f64();
        let mut seek_n = FIRST_N;
        // The loop closes with the first setpoint, whose force is then no part of the command.
        self.command_n = pulse::CLOSE_N;
        for _ in 0..CLOSE_PERIODS {
            if !self.step()? {
                return Ok(false);
            }
        }
        self.command_n = seek_n;
        for _ in 0..Self::periods(LONGEST_S) {
            if !self.step()? {
                return Ok(false);
            }
            let speed = self.speed_m_per_s();
            self.figures.fastest_m_per_s = self.figures.fastest_m_per_s.max(speed);
            self.figures.wound_m = self.last().last().map_or(0.0, |timed| self.wound_m(timed));
            if self.reading_n() >= TIGHT_N {
                self.figures.tight = true;
                self.figures.loose = self.figures.wound_m >= LOOSE_M;
                return Ok(self.figures.loose);
            }
            if self.figures.wound_m >= LOOSE_M {
                self.idle.push(self.given_n());
            }
            if self.figures.wound_m > LONGEST_M {
                return Ok(false);
            }
            // What friction leaves is unknown: sought while the reel is slow, and braked by a
            // command that falls with the speed.
            let change_n = if speed < TAKE_UP_M_PER_S {
                rise_n
            } else {
                -rise_n
            };
            seek_n = (seek_n + change_n).max(0.0);
            if seek_n >= SLACK_N {
                return Ok(false);
            }
            let fast = (speed - TAKE_UP_M_PER_S).max(0.0);
            self.command_n = (seek_n - BRAKE_N_S_PER_M * fast).clamp(0.0, SLACK_N);
        }
        Ok(false)
    }

    /// Lets the command rise until the cable reads [`TOP_N`]. Whether it is loaded: a cable that
    /// hardly is has no chirp in its noise.
    fn load(&mut self) -> Result<bool, BringUpError> {
        let rise_n = LOAD_N_PER_S * PERIOD.as_secs_f64();
        for _ in 0..Self::periods(LONGEST_S) {
            let reading_n = self.reading_n();
            let most_n = if reading_n < TIGHTENED_N {
                SLACK_N
            } else {
                LOADED_N
            };
            if reading_n >= TOP_N || self.command_n + rise_n > most_n {
                break;
            }
            self.command_n += rise_n;
            if !self.step()? {
                return Ok(false);
            }
        }
        let reading_n = self.reading_n();
        // The last periods may be of a tight cable already.
        let idle = &self.idle[..self.idle.len().saturating_sub(MEAN_OF)];
        if let Some(idle_n) = mean(idle).filter(|_| idle.len() >= IDLE_PERIODS) {
            self.figures.idle_n = Some(idle_n);
            let command_n = self.given_n();
            self.figures.line = (command_n >= idle_n + LOAD_N).then_some(LoadLine {
                idle_n,
                command_n,
                reading_n,
            });
        }
        Ok(self.figures.line.is_some())
    }

    /// The chirp, about a command that keeps the tension below what it is.
    fn chirp(&mut self) -> Result<(), BringUpError> {
        let middle_n = self.command_n - CHIRP_N;
        if middle_n < CHIRP_N {
            return Ok(());
        }
        let from = self.recent.len();
        let begun_us = self.recent.last().map_or(0, |timed| timed.t_us);
        for n in 0..Self::periods(CHIRP_S) {
            let at_s = f64::from(n) * PERIOD.as_secs_f64();
            self.command_n = middle_n + CHIRP_N * chirp_rad(at_s).cos();
            if !self.step()? {
                return Ok(());
            }
        }
        let unit = &self.drive.rig.units[self.unit];
        let samples = &self.recent[from..];
        let series = |value: &dyn Fn(&TimedSample) -> f64| -> Vec<(f64, f64)> {
            let at = |timed: &TimedSample| (timed.t_us - begun_us) as f64 * 1e-6;
            samples
                .iter()
                .map(|timed| (at(timed), value(timed)))
                .collect()
        };
        let commands = series(&|timed| command_n(timed, unit));
        let codes = series(&|timed| f64::from(timed.sample.adc_code) * unit.scale_n_per_count);
        self.figures.delay_s = match (delay_s(&commands), delay_s(&codes)) {
            (Some(command_s), Some(code_s)) => Some(code_s - command_s),
            _ => None,
        };
        Ok(())
    }

    /// 0 V, whatever came before, and the figures. The limit of the reading is the rig file's
    /// again: what follows is a hand at the reel.
    fn end(self, ended: Result<(), BringUpError>) -> Result<TensionFigures, BringUpError> {
        let session = &mut *self.drive.session;
        if let Err(error) = ended {
            session.make_safe();
            return Err(error);
        }
        // The last setpoint expires: 0 V by the board's own clock.
        session.exchange(Duration::from_millis(2 * u64::from(VALID_MS)))?;
        let mut figures = self.figures;
        let status = session.get_status()?;
        let mut latched = std::iter::once(status.fault)
            .chain([status.units[self.unit].fault])
            .filter(|fault| *fault != 0 && *fault != Fault::SetpointsExpired.code());
        figures.fault = latched.next().unwrap_or(figures.fault);
        let drive = &*self.drive;
        let mut loose = pulse::configs(drive.rig, drive.works, drive.zero_code, 0, 0.0);
        for (config, unit) in loose.iter_mut().zip(&drive.rig.units) {
            config.over_tension_un = unit.to_wire().over_tension_un;
        }
        let session = &mut *self.drive.session;
        session.configure(&loose)?;
        crate::clear(session)?;
        Ok(figures)
    }
}

/// Force that the DAC's word asks for, N.
fn command_n(timed: &TimedSample, unit: &UnitSettings) -> f64 {
    (f64::from(timed.sample.dac_code) - 32_768.0) / unit.dac_codes_per_n
}

/// Phase of the chirp, rad, `at_s` after its begin. Its frequency rises with time.
fn chirp_rad(at_s: f64) -> f64 {
    let (first, last) = CHIRP_HZ;
    TAU * (first * at_s + (last - first) / (2.0 * CHIRP_S) * at_s * at_s)
}

/// Delay of a chirp in a series of times and values, s: that of the chirp in any phase that leaves
/// least of the series.
fn delay_s(series: &[(f64, f64)]) -> Option<f64> {
    let (first_s, last_s) = DELAYS_S;
    // Only where all delays have a chirp.
    let whole = |at_s: f64| (last_s..CHIRP_S + first_s).contains(&at_s);
    let of = |delay_s: f64| {
        let rows = (series.iter()).filter(|(at_s, _)| whole(*at_s));
        let rows = rows.map(|(at_s, value)| {
            let (sine, cosine) = chirp_rad(at_s - delay_s).sin_cos();
            ([sine, cosine, 1.0], *value)
        });
        left(rows)
    };
    let steps = ((last_s - first_s) / DELAY_STEP_S) as u32;
    let delays = (0..=steps).map(|n| first_s + f64::from(n) * DELAY_STEP_S);
    let found = delays.filter_map(|delay_s| Some((delay_s, of(delay_s)?)));
    found
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(delay_s, _)| delay_s)
}

/// Least squares with three columns: the sum of the squares that are left. `None`: the columns
/// depend on each other.
fn left(rows: impl Iterator<Item = ([f64; 3], f64)>) -> Option<f64> {
    // The normal equations with the right side as a fourth column.
    let mut equations = [[0.0; 4]; 3];
    let mut squares = 0.0;
    for (columns, value) in rows {
        for (equation, column) in equations.iter_mut().zip(columns) {
            for (sum, other) in equation.iter_mut().zip(columns.iter().chain([&value])) {
                *sum += column * other;
            }
        }
        squares += value * value;
    }
    let right = equations.map(|equation| equation[3]);
    for i in 0..3 {
        let pivot = equations[i];
        if pivot[i].abs() < 1e-9 {
            return None;
        }
        for row in (0..3).filter(|row| *row != i) {
            let factor = equations[row][i] / pivot[i];
            for (value, pivot) in equations[row].iter_mut().zip(pivot) {
                *value -= factor * pivot;
            }
        }
    }
    let explained: f64 = (0..3)
        .map(|i| right[i] * equations[i][3] / equations[i][i])
        .sum();
    Some((squares - explained).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bounds that the board holds, whatever this program sends.
    #[test]
    fn the_boards_own_limits_are_those_of_the_test() {
        let rig = Rig::built_in().unwrap();
        for unit in 0..UNITS {
            let configs = configs(&rig, [true; UNITS], [7; UNITS], unit);
            for (i, config) in configs.iter().enumerate() {
                let most_un = if i == unit { 2_300_000 } else { 0 };
                assert_eq!(
                    (config.force_limit_un, config.tension_max_un),
                    (most_un, most_un)
                );
            }
            assert_eq!(configs[unit].over_tension_un, 1_800_000);
        }
    }

    #[test]
    fn the_delay_of_a_chirp_is_found_whatever_its_phase_and_size() {
        for late_s in [0.0, 0.0111, 0.05] {
            for phase_rad in [0.0, 1.0, -2.5] {
                let series: Vec<(f64, f64)> = (0..1_280)
                    .map(|n| f64::from(n) / 320.0)
                    .map(|at_s| {
                        (
                            at_s,
                            5.0 + 0.1 * (chirp_rad(at_s - late_s) + phase_rad).cos(),
                        )
                    })
                    .collect();
                let found_s = delay_s(&series).unwrap();
                assert!((found_s - late_s).abs() < 2e-4, "{late_s} s: {found_s} s");
            }
        }
        assert_eq!(delay_s(&[]), None);
    }
}
