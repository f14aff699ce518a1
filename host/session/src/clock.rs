//! The board's clock against the host's, from the times of requests, replies and telemetry.
//!
//! Each [`Reading`] bounds the offset (host time minus board time) from one or both sides:
//!
//! * a request was sent before the board read its clock for the reply: offset >= sent - board time,
//! * a frame arrived after the board read its clock: offset <= received - board time.
//!
//! The two clocks are taken as linear to each other within a window. All lines (offset, drift) that
//! respect every bound of the window form a convex set; the estimate is the middle of the offsets
//! that it allows at a time, and the uncertainty is half their range. So the error does not depend
//! on a symmetric delay: it is within the uncertainty as long as the bounds are true and the drift
//! changes by no more than [`DRIFT_CHANGE_PER_S`]. The shortest delays of the window decide, as in
//! the minimum filter of PTP and NTP; the two-sided form is the convex-hull method (Duda et al.
//! 1987).

mod one_way;

pub use one_way::OneWayClock;

use std::collections::VecDeque;

/// Largest drift of the board's clock against the host's. A board without its HSE input runs on the
/// HSI: 1 % (docs/wiring.md).
pub const DRIFT_MAX: f64 = 0.02;
/// Fastest change of the drift that the uncertainty covers, 1/s: 0.01 ppm a second, a crystal of
/// 0.5 ppm per kelvin that warms by a kelvin in 50 s.
pub const DRIFT_CHANGE_PER_S: f64 = 1e-8;
/// Time of the board in which only the tightest bound of each side is kept, us.
pub const BIN_US: u64 = 250_000;
/// Half the width of the window, s: readings that are further away from the time of interest are
/// left out.
pub const WINDOW_S: f64 = 30.0;

/// Steps of a search over a unimodal function or a boundary: 0.04 times (2/3)^60 is 1e-12.
const SEARCH_STEPS: usize = 60;

/// A reading of the board's clock, and the times of the host around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reading {
    /// Board time without its wrap, us.
    pub board_us: u64,
    /// Host time at which the request was sent, ns; `None` where the board sent by itself.
    pub sent_ns: Option<u64>,
    /// Host time at which it had arrived, ns.
    pub received_ns: u64,
}

/// One side's bound: board time, and host time minus board time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bound {
    /// Board time, us.
    pub board_us: u64,
    /// Host time minus board time, ns.
    pub offset_ns: i64,
}

/// The tightest bounds of a quarter of a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Bin {
    /// From a request: the offset is at least this.
    pub lower: Option<Bound>,
    /// From an arrival: the offset is at most this.
    pub upper: Option<Bound>,
}

/// Offset and drift of the board's clock at one board time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Board time that it holds for, us.
    pub board_us: u64,
    /// Host time minus board time, ns.
    pub offset_ns: f64,
    /// Largest error of the offset, ns. Infinite where one side has no bound.
    pub uncertainty_ns: f64,
    /// Change of the offset per board time (0.000001 is 1 ppm; positive: the board's clock is
    /// slow).
    pub drift: f64,
    /// Largest error of the drift.
    pub drift_uncertainty: f64,
    /// By how much the bounds contradict each other, ns; 0 where they do not. A clock that jumped,
    /// or a wrong reading. The uncertainty contains it.
    pub contradiction_ns: f64,
}

impl Estimate {
    /// Host time of a board time, ns.
    #[must_use]
    pub fn host_ns(&self, board_us: u64) -> f64 {
        let after_ns = (board_us as f64 - self.board_us as f64) * 1e3;
        board_us as f64 * 1e3 + self.offset_ns + self.drift * after_ns
    }

    /// Board time of a host time, us.
    #[must_use]
    pub fn board_us(&self, host_ns: f64) -> f64 {
        let at_ns = self.board_us as f64 * 1e3;
        let after_ns = (host_ns - at_ns - self.offset_ns) / (1.0 + self.drift);
        (at_ns + after_ns) * 1e-3
    }
}

/// Collects readings and estimates offset and drift.
#[derive(Debug, Clone)]
pub struct BoardClock {
    bins: VecDeque<Bin>,
    open: Bin,
    open_until_us: u64,
    /// Bins older than this before the newest are dropped, us; `None`: all are kept.
    memory_us: Option<u64>,
    /// Largest drift that is looked at.
    drift_max: f64,
}

impl Default for BoardClock {
    fn default() -> Self {
        Self {
            bins: VecDeque::new(),
            open: Bin::default(),
            open_until_us: 0,
            memory_us: None,
            drift_max: DRIFT_MAX,
        }
    }
}

impl BoardClock {
    /// For clocks that drift by less against each other than a board's without its crystal.
    #[must_use]
    pub fn with_drift_max(mut self, drift_max: f64) -> Self {
        self.drift_max = drift_max;
        self
    }

    /// For use while readings come: keeps the last window.
    #[must_use]
    pub fn live() -> Self {
        Self {
            memory_us: Some((2.0 * WINDOW_S * 1e6) as u64),
            ..Self::default()
        }
    }

    /// For use afterwards: keeps everything.
    #[must_use]
    pub fn complete() -> Self {
        Self::default()
    }

    /// Takes a reading; returns the bin that it completes, if any.
    pub fn push(&mut self, reading: &Reading) -> Option<Bin> {
        let completed = (reading.board_us >= self.open_until_us && !self.open.is_empty())
            .then(|| std::mem::take(&mut self.open));
        if let Some(bin) = completed {
            self.push_bin(bin);
        }
        if self.open.is_empty() {
            self.open_until_us = reading.board_us + BIN_US;
        }
        let bound = |host_ns: u64| Bound {
            board_us: reading.board_us,
            offset_ns: host_ns as i64 - (reading.board_us as i64).saturating_mul(1000),
        };
        self.open.raise(reading.sent_ns.map(bound));
        self.open.lower(Some(bound(reading.received_ns)));
        completed
    }

    /// Takes a bin of an earlier clock.
    pub fn push_bin(&mut self, bin: Bin) {
        self.bins.push_back(bin);
        if let (Some(memory_us), Some(newest)) = (self.memory_us, bin.newest_us()) {
            let old = |bin: &Bin| bin.newest_us().is_none_or(|at| at + memory_us < newest);
            while self.bins.front().is_some_and(old) {
                self.bins.pop_front();
            }
        }
    }

    /// The bin that is not complete yet; `None` without a reading in it.
    #[must_use]
    pub fn open_bin(&self) -> Option<Bin> {
        (!self.open.is_empty()).then_some(self.open)
    }

    /// Offset and drift at a board time; `None` before the first reading. A live clock has no
    /// readings after the newest, and extends the line.
    #[must_use]
    pub fn at(&self, board_us: u64) -> Option<Estimate> {
        let window = self.window(board_us);
        window.fit()
    }

    /// The bounds of a window around a board time.
    fn window(&self, board_us: u64) -> Window {
        // A live clock keeps what its window may hold. A complete one has long memory: only what is
        // near counts.
        let half_us = if self.memory_us.is_some() {
            u64::MAX
        } else {
            (WINDOW_S * 1e6) as u64
        };
        let reference = self.reference();
        let mut window = Window {
            board_us,
            reference_ns: reference,
            lower: Vec::new(),
            upper: Vec::new(),
            reach_s: 0.0,
            drift_max: self.drift_max,
        };
        // Bins are in order of time.
        let first = self.bins.partition_point(|bin| {
            bin.newest_us()
                .is_some_and(|at| at < board_us.saturating_sub(half_us))
        });
        let open = self.open_bin();
        for bin in self.bins.iter().skip(first).chain(&open) {
            if bin
                .newest_us()
                .is_some_and(|at| at > board_us.saturating_add(half_us))
            {
                break;
            }
            window.add(bin);
        }
        if window.upper.is_empty() && window.lower.is_empty() {
            // Outside of all readings: the nearest ones have to do.
            for bin in self.bins.back().into_iter().chain(&self.open_bin()) {
                window.add(bin);
            }
        }
        window
    }

    /// Any offset of the readings: differences to it are small enough for a double.
    fn reference(&self) -> i64 {
        let bins = self.bins.iter().chain([&self.open]);
        bins.filter_map(|bin| bin.upper.or(bin.lower))
            .map(|bound| bound.offset_ns)
            .next()
            .unwrap_or(0)
    }
}

impl Bin {
    fn is_empty(&self) -> bool {
        self.lower.is_none() && self.upper.is_none()
    }

    fn newest_us(&self) -> Option<u64> {
        self.lower
            .iter()
            .chain(&self.upper)
            .map(|bound| bound.board_us)
            .max()
    }

    fn raise(&mut self, bound: Option<Bound>) {
        let tighter = |new: &Bound| self.lower.is_none_or(|old| new.offset_ns >= old.offset_ns);
        self.lower = bound.filter(tighter).or(self.lower);
    }

    fn lower(&mut self, bound: Option<Bound>) {
        let tighter = |new: &Bound| self.upper.is_none_or(|old| new.offset_ns <= old.offset_ns);
        self.upper = bound.filter(tighter).or(self.upper);
    }
}

/// Bounds around one board time: (time from there in s, offset from the reference in ns).
struct Window {
    board_us: u64,
    reference_ns: i64,
    lower: Vec<(f64, f64)>,
    upper: Vec<(f64, f64)>,
    /// Largest distance in time, s.
    reach_s: f64,
    /// Largest drift that is looked at.
    drift_max: f64,
}

impl Window {
    fn add(&mut self, bin: &Bin) {
        let point = |bound: Bound| {
            (
                (bound.board_us as f64 - self.board_us as f64) * 1e-6,
                (bound.offset_ns - self.reference_ns) as f64,
            )
        };
        let (lower, upper) = (bin.lower.map(point), bin.upper.map(point));
        for (t_s, _) in lower.iter().chain(&upper) {
            self.reach_s = self.reach_s.max(t_s.abs());
        }
        self.lower.extend(lower);
        self.upper.extend(upper);
    }

    /// Largest offset at the time of interest with this drift, ns.
    fn highest(&self, drift: f64) -> f64 {
        let below = |(t_s, offset): &(f64, f64)| offset - drift * t_s * 1e9;
        self.upper.iter().map(below).fold(f64::INFINITY, f64::min)
    }

    /// Smallest one.
    fn lowest(&self, drift: f64) -> f64 {
        let above = |(t_s, offset): &(f64, f64)| offset - drift * t_s * 1e9;
        self.lower
            .iter()
            .map(above)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// Room between the bounds with this drift, ns: concave in the drift.
    fn room(&self, drift: f64) -> f64 {
        self.highest(drift) - self.lowest(drift)
    }

    fn fit(&self) -> Option<Estimate> {
        if self.upper.is_empty() {
            return None;
        }
        if self.lower.is_empty() {
            return Some(self.one_sided());
        }
        let best = largest(-self.drift_max, self.drift_max, |drift| self.room(drift));
        let room = self.room(best);
        let contradiction_ns = (-room).max(0.0);
        // With a contradiction the set is one line; what it violates goes into the uncertainty.
        let (first, last) = if room > 0.0 {
            let possible = |drift: f64| self.room(drift) >= 0.0;
            (
                boundary(best, -self.drift_max, possible),
                boundary(best, self.drift_max, possible),
            )
        } else {
            (best, best)
        };
        let high = self.highest(largest(first, last, |drift| self.highest(drift)));
        let low = self.lowest(largest(first, last, |drift| -self.lowest(drift)));
        let curvature_ns = 0.5 * DRIFT_CHANGE_PER_S * self.reach_s * self.reach_s * 1e9;
        Some(Estimate {
            board_us: self.board_us,
            offset_ns: self.reference_ns as f64 + 0.5 * (high + low),
            uncertainty_ns: 0.5 * (high - low).abs() + curvature_ns + contradiction_ns,
            drift: 0.5 * (first + last),
            drift_uncertainty: 0.5 * (last - first) + DRIFT_CHANGE_PER_S * self.reach_s,
            contradiction_ns,
        })
    }

    /// No request was answered yet: the shortest way here is all that is known.
    fn one_sided(&self) -> Estimate {
        Estimate {
            board_us: self.board_us,
            offset_ns: self.reference_ns as f64 + self.highest(0.0),
            uncertainty_ns: f64::INFINITY,
            drift: 0.0,
            drift_uncertainty: self.drift_max,
            contradiction_ns: 0.0,
        }
    }
}

/// Where a concave function is largest.
fn largest(mut from: f64, mut to: f64, f: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..SEARCH_STEPS {
        let third = (to - from) / 3.0;
        if f(from + third) < f(to - third) {
            from += third;
        } else {
            to -= third;
        }
    }
    0.5 * (from + to)
}

/// The last place on the way from `inside` to `outside` where a property holds.
fn boundary(mut inside: f64, mut outside: f64, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(outside) {
        return outside;
    }
    for _ in 0..SEARCH_STEPS {
        let middle = 0.5 * (inside + outside);
        if holds(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    inside
}

#[cfg(test)]
mod tests;
