//! The physics, as regressors of a linear model, row by row: nothing older than 250 ms but the
//! place of the last reversal.
//!
//! The drive's current holds the load's torque through the cables, friction, and the inertia of
//! motor and gear. So the torque is linear in the current, the factor depends on the angle of the
//! spindle (the jaw's lever), and what has to be taken off depends on speed, acceleration, ripple
//! of the motor and the distance since the reversal (slack and elastic turn of the cables).
//!
//! * *Bilinear*: mean current and mean speed of the motor in eight bins of the last 250 ms, times a
//!   polynomial of the angle. Differences of bins are accelerations; the motor's encoder has 17.5
//!   times the resolution of the spindle's, so no filter is needed.
//! * *Profile*: a polynomial of the angle.
//! * *Reversal*: exponentials of the distance since the last reversal, times currents, speed and
//!   angle.
//! * *Friction*: root, square and two exponentials (Stribeck) of the speed, times 1 and the
//!   current.
//! * *Ripple*: harmonics of the motor's turn, times 1 and the current.
//! * *Load*: squares of the current: friction grows with the load.

use crate::data::Row;

/// Rows of memory: 250 ms.
pub const MEMORY: usize = 250;
/// Regressors of a row.
pub const FEATURES: usize = 120;

/// Groups of regressors, in order: words of the page and how many.
pub const GROUPS: [(&str, usize); 7] = [
    ("current in the memory", 24),
    ("speed in the memory", 24),
    ("profile", 11),
    ("reversal", 28),
    ("friction", 8),
    ("ripple", 16),
    ("squares of the current", 9),
];

/// Bins of the memory, rows back: from, to.
const BINS: [(usize, usize); 8] = [
    (0, 3),
    (3, 6),
    (6, 10),
    (10, 20),
    (20, 40),
    (40, 80),
    (80, 160),
    (160, 250),
];
/// Wider bins of the current where it meets the reversal and its own square.
const WIDE: [(usize, usize); 3] = [(0, 20), (0, 80), (80, 250)];
/// Bin of the speed in the friction terms.
const SPEED_BIN: (usize, usize) = (0, 40);
/// Bin of the current in the friction and ripple terms.
const CURRENT_BIN: (usize, usize) = (0, 80);
/// Travel of the spindle in the data is 0 to 1.05 rad.
const MIDDLE_RAD: f64 = 0.525;
/// The polynomials end a little beyond the travel; outside they stay at their value there.
const EDGE: f64 = 1.1;
/// Orders of the polynomials.
const LEVER_ORDER: usize = 2;
const PROFILE_ORDER: usize = 10;
/// Lengths of the turn after a reversal, rad.
const TURN_RAD: [f64; 4] = [0.01, 0.03, 0.1, 0.3];
/// A reversal is a way back of this much: five steps of the spindle's encoder, rad.
const REVERSAL_RAD: f64 = 0.004;
/// Speeds of the exponentials, rad/s.
const STRIBECK_RAD_S: [f64; 2] = [0.3, 0.1];
const HARMONICS: usize = 4;
/// Turns of the motor in a turn of the spindle.
const GEAR: f64 = 35.0;
/// Makes a usual current of 0.1 A a number of order 1.
const PER_AMPERE: f64 = 10.0;

/// Legendre polynomials of order 0 to `N` - 1 of the spindle's angle.
#[must_use]
pub fn legendre<const N: usize>(spindle_rad: f64) -> [f64; N] {
    let q = (spindle_rad / MIDDLE_RAD - 1.0).clamp(-EDGE, EDGE);
    let mut p = [1.0; N];
    if N > 1 {
        p[1] = q;
    }
    for k in 2..N {
        let n = k as f64;
        p[k] = ((2.0 * n - 1.0) * q * p[k - 1] - (n - 1.0) * p[k - 2]) / n;
    }
    p
}

/// Distance since the last reversal of the spindle.
#[derive(Debug, Clone, Copy, Default)]
struct Travel {
    /// Sign of the way: -1 closes.
    direction: f64,
    /// Furthest angle on this way, rad.
    furthest: f64,
    /// Angle at the last reversal, rad.
    reversal: f64,
}

impl Travel {
    fn begin(&mut self, at: f64) {
        *self = Self {
            direction: 0.0,
            furthest: at,
            reversal: at,
        };
    }

    fn push(&mut self, at: f64) {
        if self.direction == 0.0 {
            let way = at - self.reversal;
            if way.abs() > REVERSAL_RAD {
                self.direction = way.signum();
                self.furthest = at;
            }
        } else if (at - self.furthest) * self.direction >= 0.0 {
            self.furthest = at;
        } else if (at - self.furthest).abs() > REVERSAL_RAD {
            self.reversal = self.furthest;
            self.furthest = at;
            self.direction = -self.direction;
        }
    }

    /// Distance on the closing way, rad; 0 on the opening one.
    fn closing(&self, at: f64) -> f64 {
        if self.direction < 0.0 {
            (self.reversal - at).max(0.0)
        } else {
            0.0
        }
    }
}

/// What is kept of the past, and the regressors of the present.
#[derive(Debug, Clone)]
pub struct Features {
    /// Sums of the current up to a row, and the motor's angle, in a ring of one more than the
    /// memory.
    ring: Vec<(f64, f64)>,
    /// Place of the present row in the ring; `None` before the first.
    now: Option<usize>,
    last: Row,
    travel: Travel,
}

impl Default for Features {
    fn default() -> Self {
        Self::new()
    }
}

impl Features {
    /// Without a past.
    #[must_use]
    pub fn new() -> Self {
        Self {
            ring: vec![(0.0, 0.0); MEMORY + 1],
            now: None,
            last: Row {
                current_a: 0.0,
                spindle_rad: 0.0,
                motor_rad: 0.0,
            },
            travel: Travel::default(),
        }
    }

    /// Takes the next row, 1 ms later. Before the first row all was as in the first.
    pub fn push(&mut self, row: Row) {
        let length = self.ring.len();
        match self.now {
            None => {
                for (n, slot) in self.ring.iter_mut().enumerate() {
                    let back = (length - 1 - n) as f64;
                    *slot = (-back * row.current_a, row.motor_rad);
                }
                self.now = Some(length - 1);
                self.travel.begin(row.spindle_rad);
            }
            Some(now) => {
                let next = (now + 1) % length;
                self.ring[next] = (self.ring[now].0 + row.current_a, row.motor_rad);
                self.now = Some(next);
                self.travel.push(row.spindle_rad);
            }
        }
        self.last = row;
    }

    fn back(&self, rows: usize) -> (f64, f64) {
        let length = self.ring.len();
        self.ring[(self.now.unwrap_or(0) + length - rows) % length]
    }

    /// Mean current of a bin, in tenths of an ampere.
    fn current(&self, bin: (usize, usize)) -> f64 {
        let (from, to) = (self.back(bin.0).0, self.back(bin.1).0);
        (from - to) / (bin.1 - bin.0) as f64 * PER_AMPERE
    }

    /// Mean speed of the motor in a bin, seen from the spindle, rad/s.
    fn speed(&self, bin: (usize, usize)) -> f64 {
        let (from, to) = (self.back(bin.0).1, self.back(bin.1).1);
        (from - to) / (bin.1 - bin.0) as f64 * crate::data::RATE_HZ
    }

    /// Angle of the spindle in the present row, rad.
    #[must_use]
    pub const fn spindle_rad(&self) -> f64 {
        self.last.spindle_rad
    }

    /// What the correction for another tool reads: speed (rad/s), and the exponentials of the
    /// distance since the reversal, longest last.
    #[must_use]
    pub fn motion(&self) -> (f64, [f64; 4]) {
        (self.speed(CURRENT_BIN), self.turn())
    }

    fn turn(&self) -> [f64; 4] {
        let distance = self.travel.closing(self.last.spindle_rad);
        TURN_RAD.map(|length| (-distance / length).exp())
    }

    /// The regressors of the present row.
    #[must_use]
    pub fn row(&self) -> [f64; FEATURES] {
        let mut out = Writer {
            values: [0.0; FEATURES],
            at: 0,
        };
        let profile = legendre::<{ PROFILE_ORDER + 1 }>(self.last.spindle_rad);
        let lever = &profile[..=LEVER_ORDER];
        for bin in BINS {
            out.products(self.current(bin), lever);
        }
        for bin in BINS {
            out.products(self.speed(bin), lever);
        }
        out.products(1.0, &profile);
        let turn = self.turn();
        let speed = self.speed(SPEED_BIN);
        let currents = WIDE.map(|bin| self.current(bin));
        for factor in [
            1.0,
            currents[0],
            currents[1],
            currents[2],
            speed,
            lever[1],
            lever[2],
        ] {
            out.products(factor, &turn);
        }
        let current = self.current(CURRENT_BIN);
        let fast = speed.abs();
        let [slow, slower] = STRIBECK_RAD_S.map(|v| (-fast / v).exp());
        for factor in [1.0, current] {
            out.products(factor, &[fast.sqrt(), fast * fast, slow, slower]);
        }
        let turn_of_motor = GEAR * self.last.spindle_rad;
        for factor in [1.0, current] {
            for harmonic in 1..=HARMONICS {
                let (sin, cos) = (harmonic as f64 * turn_of_motor).sin_cos();
                out.products(factor, &[cos, sin]);
            }
        }
        for current in currents {
            out.products(current * current, lever);
        }
        debug_assert_eq!(out.at, FEATURES);
        out.values
    }
}

/// Fills a row from the left.
struct Writer {
    values: [f64; FEATURES],
    at: usize,
}

impl Writer {
    fn products(&mut self, factor: f64, of: &[f64]) {
        for value in of {
            self.values[self.at] = factor * value;
            self.at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(n: usize) -> Row {
        let t = n as f64 * 1e-3;
        Row {
            current_a: 0.1 + 0.05 * (7.0 * t).sin(),
            spindle_rad: 0.5 + 0.5 * (2.0 * t).cos(),
            motor_rad: 0.5 * (2.0 * t).cos(),
        }
    }

    #[test]
    fn the_groups_cover_all_regressors() {
        assert_eq!(GROUPS.iter().map(|(_, n)| n).sum::<usize>(), FEATURES);
    }

    #[test]
    fn every_regressor_is_written_and_bins_are_means() {
        let mut features = Features::new();
        for n in 0..1000 {
            features.push(row(n));
        }
        let values = features.row();
        assert!(values.iter().all(|v| v.is_finite() && *v != 0.0));
        let mean: f64 = (0..3).map(|back| row(999 - back).current_a).sum::<f64>() / 3.0;
        assert!((values[0] - mean * PER_AMPERE).abs() < 1e-9);
        let oldest: f64 = (160..250)
            .map(|back| row(999 - back).current_a)
            .sum::<f64>()
            / 90.0;
        assert!((values[21] - oldest * PER_AMPERE).abs() < 1e-9);
        let speed = (row(999).motor_rad - row(996).motor_rad) / 3e-3;
        assert!((values[24] - speed).abs() < 1e-9);
    }

    #[test]
    fn rows_older_than_the_memory_leave_no_trace_but_the_place_of_the_reversal() {
        // Two pasts with other currents and another motor angle, with one path of the spindle.
        let (mut a, mut b) = (Features::new(), Features::new());
        for n in 0..2000 {
            let mut other = row(n);
            if n < 2000 - MEMORY - 1 {
                other.current_a = -0.3;
                other.motor_rad = 0.2;
            }
            a.push(row(n));
            b.push(other);
        }
        for (x, y) in a.row().iter().zip(b.row()) {
            assert!((x - y).abs() < 1e-9, "{x} {y}");
        }
    }

    #[test]
    fn the_distance_counts_from_the_reversal_and_noise_is_none() {
        let mut travel = Travel::default();
        travel.begin(0.0);
        for n in 0..100 {
            travel.push(0.01 * f64::from(n));
        }
        // One step of the encoder back is no reversal.
        travel.push(0.99 - 0.000_8);
        assert_eq!(travel.closing(0.989), 0.0);
        travel.push(0.9);
        assert!((travel.closing(0.9) - 0.09).abs() < 1e-12);
    }
}
