//! The clocks of a recording as they are known afterwards: each time from the readings before and
//! after it.

use super::error::RecordError;
use super::read::{metadata_pairs, Entry, Reader};
use super::rows::ClockRow;
use super::table::{Row, Times, Utc};
use session::clock::{Bin, BoardClock, Bound, Estimate};
use std::collections::BTreeMap;
use std::path::Path;

/// Distance of the points between which the clocks are interpolated, us of board time.
const GRID_US: u64 = 1_000_000;
/// A change of UTC against the host by more than this between two rows is a clock that was set, s.
const SET_S: f64 = 0.05;

/// Clocks of a recording.
#[derive(Debug, Default)]
pub struct Clocks {
    /// Estimates on a grid of board time, in order; empty without a reading.
    grid: Vec<Estimate>,
    /// Host time and UTC minus host time, s, in order.
    utc: Vec<(f64, f64)>,
}

impl Clocks {
    /// Reads the clocks of an MCAP file, and its metadata.
    ///
    /// # Errors
    /// The file can't be opened.
    pub fn read(path: &Path) -> Result<(Self, BTreeMap<String, String>), RecordError> {
        let mut rows = Vec::new();
        let mut pairs = BTreeMap::new();
        for entry in Reader::open(path)? {
            match &entry {
                Entry::Message { topic, data, .. } if topic == ClockRow::TABLE.topic => {
                    rows.extend(serde_json::from_slice::<ClockRow>(data));
                }
                Entry::Message { .. } => {}
                other => metadata_pairs(other, &mut pairs),
            }
        }
        Ok((Self::of(&rows), pairs))
    }

    /// From the rows of `clock`.
    #[must_use]
    pub fn of(rows: &[ClockRow]) -> Self {
        let mut clock = BoardClock::complete();
        let mut first_us = u64::MAX;
        let mut last_us = 0;
        for row in rows {
            let bin = bin_of(row);
            for bound in bin.lower.iter().chain(&bin.upper) {
                first_us = first_us.min(bound.board_us);
                last_us = last_us.max(bound.board_us);
            }
            clock.push_bin(bin);
        }
        let mut grid = Vec::new();
        let mut at_us = first_us;
        while at_us < last_us + GRID_US {
            grid.extend(clock.at(at_us));
            at_us += GRID_US;
        }
        let utc = rows
            .iter()
            .map(|row| (row.host_s, row.utc_offset_s))
            .collect();
        Self { grid, utc }
    }

    /// Offset and drift at a board time, us; `None` without a reading.
    #[must_use]
    pub fn at(&self, board_us: f64) -> Option<Estimate> {
        let after = self
            .grid
            .partition_point(|estimate| (estimate.board_us as f64) <= board_us);
        let (Some(before), Some(after)) =
            (self.grid.get(after.saturating_sub(1)), self.grid.get(after))
        else {
            return self.grid.last().or(self.grid.first()).copied();
        };
        if after.board_us <= before.board_us || (before.board_us as f64) > board_us {
            return Some(*before);
        }
        // A line between two estimates: no step where one ends.
        let span_us = (after.board_us - before.board_us) as f64;
        let share = (board_us - before.board_us as f64) / span_us;
        let slope = (after.offset_ns - before.offset_ns) / (span_us * 1e3);
        Some(Estimate {
            drift: slope,
            uncertainty_ns: before.uncertainty_ns
                + share * (after.uncertainty_ns - before.uncertainty_ns),
            ..*before
        })
    }

    /// The three clocks at a board time, s.
    #[must_use]
    pub fn of_board(&self, board_s: f64) -> Times {
        let board_us = (board_s * 1e6).round();
        let host_s = self
            .at(board_us)
            .map_or(board_s, |estimate| estimate.host_ns(board_us as u64) * 1e-9);
        self.times(host_s, board_s)
    }

    /// The three clocks at a host time, s.
    #[must_use]
    pub fn of_host(&self, host_s: f64) -> Times {
        let host_ns = host_s * 1e9;
        // The offset changes by little within a grid cell: the second look is in the right one.
        let guess = self
            .grid
            .first()
            .map_or(host_ns * 1e-3, |first| first.board_us(host_ns));
        let look = |board_us: f64| {
            self.at(board_us)
                .map_or(board_us, |estimate| estimate.board_us(host_ns))
        };
        let board_us = look(look(guess));
        self.times(host_s, board_us * 1e-6)
    }

    /// The three clocks at a UTC, ns since 1970.
    #[must_use]
    pub fn of_utc(&self, utc_ns: u64) -> Times {
        let host_of = |offset_s: f64| {
            // A double holds a UTC in ns to 256 ns only: whole seconds apart.
            let whole = offset_s.floor();
            let since_ns = utc_ns as i64 - whole as i64 * 1_000_000_000;
            since_ns as f64 * 1e-9 - (offset_s - whole)
        };
        let first_s = self.utc.first().map_or(0.0, |(_, offset_s)| *offset_s);
        let guess_s = host_of(first_s);
        let host_s = host_of(self.utc_offset_s(guess_s));
        self.of_host(host_s)
    }

    fn times(&self, host_s: f64, board_s: f64) -> Times {
        // A double holds a UTC in ns to 256 ns only: whole seconds and the rest apart.
        let offset_s = self.utc_offset_s(host_s);
        let whole = offset_s.floor();
        let rest_ns = (host_s + (offset_s - whole)) * 1e9;
        let ns = whole as i64 * 1_000_000_000 + rest_ns.round() as i64;
        Times {
            utc: Utc::from_ns(u64::try_from(ns).unwrap_or(0)),
            host_s,
            board_s,
        }
    }

    /// UTC minus host time at a host time, s.
    fn utc_offset_s(&self, host_s: f64) -> f64 {
        let after = self.utc.partition_point(|(at_s, _)| *at_s <= host_s);
        match (self.utc.get(after.wrapping_sub(1)), self.utc.get(after)) {
            (Some((t0, o0)), Some((t1, o1))) if (o1 - o0).abs() < SET_S && t1 > t0 => {
                o0 + (host_s - t0) / (t1 - t0) * (o1 - o0)
            }
            (Some((_, offset_s)), _) | (None, Some((_, offset_s))) => *offset_s,
            (None, None) => 0.0,
        }
    }

    /// Puts what is known afterwards into a row of `clock`.
    pub fn refine(&self, row: &mut ClockRow) {
        let Some(estimate) = self.at(row.board_s * 1e6) else {
            return;
        };
        row.set_times(self.of_board(row.board_s));
        row.offset_s = row.host_s - row.board_s;
        row.offset_uncertainty_s = estimate
            .uncertainty_ns
            .is_finite()
            .then_some(estimate.uncertainty_ns * 1e-9);
        row.drift_ppm = estimate.drift * 1e6;
        row.drift_uncertainty_ppm = estimate.drift_uncertainty * 1e6;
        row.contradiction_s = estimate.contradiction_ns * 1e-9;
    }
}

/// The bounds of a row.
fn bin_of(row: &ClockRow) -> Bin {
    let bound = |board_us: Option<u64>, host_ns: Option<u64>| {
        let (board_us, host_ns) = (board_us?, host_ns?);
        Some(Bound {
            board_us,
            offset_ns: host_ns as i64 - board_us as i64 * 1000,
        })
    };
    Bin {
        lower: bound(row.request_board_us, row.request_host_ns),
        upper: bound(row.arrival_board_us, row.arrival_host_ns),
    }
}
