//! What moves and loads the rig: synthetic motions and commands, or those of measured logs.

use crate::random::Random;
use crate::world::{interpolate, World};
use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::{Path, PathBuf};

/// Time simulated before the first row, in s.
pub const BEFORE_S: f64 = 1.0;

/// Time simulated after the last row, in s.
pub const AFTER_S: f64 = 2.0;

/// Gear between motor and reel of the measured rig: its logs hold the speed of the motor.
const MEASURED_GEAR: f64 = 26.0 / 7.0;

/// Limits of a synthetic motion.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest speed of the reel in rad/s.
    pub speed_rad_s: f64,
    /// Distance from the middle at which the motion turns back, in rad.
    pub travel_rad: f64,
    /// Largest acceleration of the reel in rad/s².
    pub acceleration_rad_s2: f64,
}

/// Kinds of pieces that a synthetic signal is put together from.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Piece {
    Plateaus,
    Sine,
    Reversals,
    StopAndGo,
    Chirp,
    RandomWalk,
}

const PIECES: [Piece; 6] = [
    Piece::Plateaus,
    Piece::Sine,
    Piece::Reversals,
    Piece::StopAndGo,
    Piece::Chirp,
    Piece::RandomWalk,
];

/// A synthetic run: `duration` s of rows at a rate, on a grid of step `dt`.
pub fn synthetic(random: &mut Random, duration: f64, dt: f64, limits: &Limits) -> World {
    let steps = steps(duration, dt);
    let from = random.uniform(-0.5, 0.5) * limits.travel_rad;
    let velocity = motion(random, steps, dt, limits, from);
    let mut world = World {
        dt,
        start: -BEFORE_S,
        velocity,
        ..World::default()
    };
    world.command = load(random, steps, dt, 1.0, 13.0);
    world.integrate_angle(from);
    surroundings(random, &mut world);
    world
}

fn steps(duration: f64, dt: f64) -> usize {
    ((duration + BEFORE_S + AFTER_S) / dt).ceil() as usize
}

/// Temperature, neighbour loads and pose of a run whose motion is known.
fn surroundings(random: &mut Random, world: &mut World) {
    let (steps, dt) = (world.command.len(), world.dt);
    let (ambient, warming) = (random.uniform(15.0, 36.0), random.uniform(0.0, 6.0));
    let (tau, swing) = (random.uniform(20.0, 80.0), random.uniform(0.0, 0.4));
    let (period, phase) = (random.uniform(20.0, 60.0), random.uniform(0.0, TAU));
    world.temperature = (0..steps)
        .map(|i| {
            let t = i as f64 * dt;
            ambient + warming * (1.0 - (-t / tau).exp()) + swing * (TAU * t / period + phase).sin()
        })
        .collect();
    for neighbour in &mut world.neighbours {
        *neighbour = load(random, steps, dt, 0.0, 13.0);
    }
    for joint in &mut world.pose {
        let waves: Vec<[f64; 3]> = (0..3)
            .map(|_| {
                [
                    random.uniform(0.1, 0.5),
                    random.log_uniform(0.02, 0.4),
                    random.uniform(0.0, TAU),
                ]
            })
            .collect();
        *joint = (0..steps)
            .map(|i| {
                waves
                    .iter()
                    .map(|[a, f, phase]| a * (TAU * f * i as f64 * dt + phase).sin())
                    .sum()
            })
            .collect();
    }
}

/// Velocity of the reel from an angle `from` on: pieces of all kinds, with limited acceleration and
/// rounded corners; exactly 0 at rest.
fn motion(random: &mut Random, steps: usize, dt: f64, limits: &Limits, from: f64) -> Vec<f64> {
    let mut reference = Vec::with_capacity(steps);
    let mut angle = from;
    let mut deck = Vec::new();
    while reference.len() < steps {
        let kind = next_piece(random, &mut deck);
        let length = (random.uniform(4.0, 12.0) / dt) as usize;
        let shape = piece(random, kind, length, dt);
        let speed = limits.speed_rad_s * random.log_uniform(0.25, 1.0);
        let mut direction = random.sign();
        for x in shape {
            // Turn back at the end of the travel; the rest of the piece is mirrored.
            let v = direction * speed * x;
            if angle.abs() > limits.travel_rad && v * angle > 0.0 {
                direction = -direction;
            }
            let v = direction * speed * x;
            angle += v * dt;
            reference.push(v);
        }
    }
    reference.truncate(steps);
    smooth(
        &slew(&reference, limits.acceleration_rad_s2 * dt),
        (0.04 / dt) as usize,
    )
}

/// A load between two limits in N: pieces of all kinds, with limited rate.
fn load(random: &mut Random, steps: usize, dt: f64, low: f64, high: f64) -> Vec<f64> {
    let mut reference = Vec::with_capacity(steps);
    let mut deck = Vec::new();
    while reference.len() < steps {
        let kind = next_piece(random, &mut deck);
        let length = (random.uniform(4.0, 12.0) / dt) as usize;
        let middle = random.uniform(low + 0.15 * (high - low), high - 0.15 * (high - low));
        let reach = (high - middle).min(middle - low) * random.uniform(0.3, 1.0);
        reference.extend(
            piece(random, kind, length, dt)
                .into_iter()
                .map(|x| middle + reach * x),
        );
    }
    reference.truncate(steps);
    smooth(&slew(&reference, 40.0 * dt), (0.04 / dt) as usize)
}

/// A piece at random from a deck that holds each kind once, so that a run of a minute has all
/// kinds.
fn next_piece(random: &mut Random, deck: &mut Vec<Piece>) -> Piece {
    if deck.is_empty() {
        deck.extend(PIECES);
    }
    deck.swap_remove(random.index(deck.len()))
}

/// One piece with values of -1 to 1.
fn piece(random: &mut Random, kind: Piece, length: usize, dt: f64) -> Vec<f64> {
    match kind {
        Piece::Plateaus => levels(random, length, dt, [0.5, 3.0], |random, _| {
            if random.chance(0.2) {
                0.0
            } else {
                random.uniform(0.1, 1.0) * random.sign()
            }
        }),
        Piece::StopAndGo => levels(random, length, dt, [0.4, 2.0], |random, n| {
            if n % 2 == 0 {
                0.0
            } else {
                random.uniform(0.2, 1.0) * random.sign()
            }
        }),
        Piece::Reversals => {
            let period = (random.log_uniform(0.5, 3.0) / dt) as usize;
            (0..length)
                .map(|i| {
                    if (i / period.max(1)).is_multiple_of(2) {
                        1.0
                    } else {
                        -1.0
                    }
                })
                .collect()
        }
        Piece::Sine => {
            let (f, phase) = (random.log_uniform(0.1, 1.2), random.uniform(0.0, TAU));
            (0..length)
                .map(|i| (TAU * f * i as f64 * dt + phase).sin())
                .collect()
        }
        Piece::Chirp => {
            let (from, to) = (random.uniform(0.1, 0.4), random.uniform(1.0, 2.5));
            let duration = length as f64 * dt;
            (0..length)
                .map(|i| {
                    let t = i as f64 * dt;
                    (TAU * (from * t + 0.5 * (to - from) * t * t / duration)).sin()
                })
                .collect()
        }
        Piece::RandomWalk => {
            let corner = random.log_uniform(0.2, 1.0);
            let keep = (-TAU * corner * dt).exp();
            let kick = (1.0 - keep * keep).sqrt();
            let (mut x, mut y) = (0.0, 0.0);
            (0..length)
                .map(|_| {
                    x = keep * x + kick * 0.7 * random.normal();
                    y += (1.0 - keep) * (x - y);
                    f64::clamp(y, -1.0, 1.0)
                })
                .collect()
        }
    }
}

fn levels(
    random: &mut Random,
    length: usize,
    dt: f64,
    [shortest, longest]: [f64; 2],
    mut level: impl FnMut(&mut Random, usize) -> f64,
) -> Vec<f64> {
    let mut values = Vec::with_capacity(length);
    for n in 0.. {
        if values.len() >= length {
            break;
        }
        let hold = (random.uniform(shortest, longest) / dt) as usize + 1;
        let value = level(random, n);
        values.resize((values.len() + hold).min(length), value);
    }
    values
}

/// Follows a reference with at most `step` of change for each step.
fn slew(reference: &[f64], step: f64) -> Vec<f64> {
    let mut x = reference.first().copied().unwrap_or(0.0);
    reference
        .iter()
        .map(|r| {
            x += (r - x).clamp(-step, step);
            x
        })
        .collect()
}

/// Mean over a window of `width` steps and then again, which rounds corners to continuous
/// acceleration. Less than 1e-9 becomes 0: at rest the running sum leaves rounding errors.
fn smooth(signal: &[f64], width: usize) -> Vec<f64> {
    let once = |signal: &[f64]| -> Vec<f64> {
        let mut sum = 0.0;
        (0..signal.len())
            .map(|i| {
                sum += signal[i];
                if i > width {
                    sum -= signal[i - width - 1];
                }
                let mean = sum / (i.min(width) + 1) as f64;
                if mean.abs() < 1e-9 {
                    0.0
                } else {
                    mean
                }
            })
            .collect()
    };
    once(&once(signal))
}

/// Motions and commands of measured logs.
#[derive(Clone, Debug)]
pub struct Measured {
    logs: Vec<MeasuredLog>,
}

#[derive(Clone, Debug)]
struct MeasuredLog {
    file: PathBuf,
    time: Vec<f64>,
    command: Vec<f64>,
    velocity: Vec<f64>,
}

/// How a column is named and what turns its values into SI units at the reel.
struct Column(&'static [(&'static str, f64)]);

const TIME: Column = Column(&[("time_s", 1.0)]);
const COMMAND: Column = Column(&[
    ("command_n", 1.0),
    ("torque_cmd_nm", 100.0),
    ("torque_cmd_mnm", 0.1),
]);
const VELOCITY: Column = Column(&[
    ("speed_rad_s", 1.0),
    ("velocity_rad_s", 1.0),
    ("motor_speed_deg_s", PI / 180.0 / MEASURED_GEAR),
]);

impl Measured {
    /// Reads each CSV file under a folder that has the columns for time, command and velocity:
    /// `time_s`; `command_n` or `torque_cmd_nm`; `speed_rad_s` or `motor_speed_deg_s` (speed of the
    /// motor, before the 26:7 gear). Files with other columns are passed over, as are logs shorter
    /// than 10 s.
    ///
    /// # Errors
    /// If the folder can't be read, a number is not a number, or no file fits.
    pub fn read(folder: &Path) -> Result<Self, String> {
        let mut files = Vec::new();
        collect_csv(folder, &mut files)?;
        files.sort();
        let mut logs = Vec::new();
        for file in &files {
            logs.extend(MeasuredLog::read(file)?);
        }
        if logs.is_empty() {
            return Err(format!(
                "{}: none of {} CSV files has the columns time_s, command_n (or torque_cmd_nm) and speed_rad_s (or \
                 motor_speed_deg_s) and lasts 10 s; give the folder with the logs of the rig",
                folder.display(),
                files.len()
            ));
        }
        Ok(Self { logs })
    }

    /// Logs that fit.
    pub fn len(&self) -> usize {
        self.logs.len()
    }

    /// True if no log fits; [`Self::read`] refuses that.
    pub fn is_empty(&self) -> bool {
        self.logs.is_empty()
    }

    /// A run with the motion and command of one log, from its start, at most `duration` s long, and
    /// the name of the log's file. Between rows of the log the signals are linear; where the log
    /// stands still, so does the run. Returns the duration that the log has.
    pub fn run(
        &self,
        index: usize,
        random: &mut Random,
        duration: f64,
        dt: f64,
    ) -> (World, f64, String) {
        let log = &self.logs[index % self.logs.len()];
        let first = log.time[0];
        let duration = duration.min(log.time[log.time.len() - 1] - first);
        let mut row = 0;
        let mut world = World {
            dt,
            start: -BEFORE_S,
            ..World::default()
        };
        for i in 0..steps(duration, dt) {
            let time = (first + world.time(i)).max(first);
            while row + 2 < log.time.len() && log.time[row + 1] < time {
                row += 1;
            }
            let at = row as f64
                + ((time - log.time[row]) / (log.time[row + 1] - log.time[row])).clamp(0.0, 1.0);
            world.velocity.push(interpolate(&log.velocity, at));
            world.command.push(interpolate(&log.command, at));
        }
        let width = (0.02 / dt) as usize;
        world.velocity = smooth(&world.velocity, width);
        world.command = smooth(&world.command, width);
        world.integrate_angle(0.0);
        surroundings(random, &mut world);
        let name = log
            .file
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        (world, duration, name)
    }
}

fn collect_csv(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), String> {
    let entries = fs::read_dir(folder)
        .map_err(|e| format!("{}: {e}; give a folder with logs", folder.display()))?;
    for entry in entries {
        let path = entry
            .map_err(|e| format!("{}: {e}", folder.display()))?
            .path();
        if path.is_dir() {
            collect_csv(&path, files)?;
        } else if path.extension().is_some_and(|e| e == "csv") {
            files.push(path);
        }
    }
    Ok(())
}

impl MeasuredLog {
    fn read(file: &Path) -> Result<Option<Self>, String> {
        let text = fs::read_to_string(file).map_err(|e| format!("{}: {e}", file.display()))?;
        let mut lines = text.lines();
        let header: Vec<&str> = lines
            .next()
            .unwrap_or("")
            .split(',')
            .map(str::trim)
            .collect();
        let find = |Column(names): &Column| {
            names.iter().find_map(|(name, factor)| {
                header
                    .iter()
                    .position(|h| h == name)
                    .map(|at| (at, *factor))
            })
        };
        let (Some(time), Some(command), Some(velocity)) =
            (find(&TIME), find(&COMMAND), find(&VELOCITY))
        else {
            return Ok(None);
        };
        let mut log = Self {
            file: file.to_path_buf(),
            time: vec![],
            command: vec![],
            velocity: vec![],
        };
        for (number, line) in lines
            .enumerate()
            .filter(|(_, line)| !line.trim().is_empty())
        {
            let cells: Vec<&str> = line.split(',').collect();
            let cell = |(at, factor): (usize, f64)| -> Result<f64, String> {
                let text = cells.get(at).map_or("", |c| c.trim());
                let value = text.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| {
                    format!(
                        "{}, line {}: `{text}` in column {} is not a number; leave the file out or repair the line",
                        file.display(),
                        number + 2,
                        header[at]
                    )
                })?;
                Ok(value * factor)
            };
            let now = cell(time)?;
            if log.time.last().is_some_and(|last| now <= *last) {
                continue;
            }
            log.time.push(now);
            log.command.push(cell(command)?);
            log.velocity.push(cell(velocity)?);
        }
        let long_enough = log.time.len() > 2 && log.time[log.time.len() - 1] - log.time[0] >= 10.0;
        Ok(long_enough.then_some(log))
    }
}
