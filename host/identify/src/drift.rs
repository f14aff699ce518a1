//! Friction that changes while a session is recorded.

use super::recording::Row;
use nalgebra::{SMatrix, SVector};
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};
use wire::UNITS;

/// Speed below which a row is left out, m/s; that of the analysis.
const SLIDING_M_S: f64 = 0.003;
/// Blocks of time that are left out in turn: 4 s of the usual recording of 40 s.
const BLOCKS: usize = 10;
/// Part of all recordings in which one of the units shows a change by chance.
const ALPHA: f64 = 0.05;
/// Change that counts, N: the standard deviation of friction between units, 5 % of 0.909 N.
const MATERIAL_N: f64 = 0.045;
/// What a row is explained by: command, offset, drift of the offset, friction, friction per
/// command, viscous friction, and friction in proportion to the time.
const TERMS: usize = 7;

/// How much a unit's friction changed from the begin of a recording to its end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrictionChange {
    /// The change, N.
    pub change_n: f64,
    /// Interval, 95 % over all units.
    pub interval_n: [f64; 2],
}

impl FrictionChange {
    /// Of a unit's rows: a straight line over time, which a change that fades is close to. The
    /// interval is from the fits without one block of time each, so that ripples and whatever else
    /// the fit does not have widen it. `None` where the rows do not determine it.
    #[must_use]
    pub fn of(rows: &[Row]) -> Option<Self> {
        let (first, last) = (rows.first()?.time_s, rows.last()?.time_s);
        let slides = |row: &&Row| row.speed_m_s.abs() > SLIDING_M_S;
        let winds_in = |row: &Row| row.speed_m_s > 0.0;
        if rows.iter().filter(slides).all(winds_in) || !rows.iter().filter(slides).any(winds_in) {
            return None;
        }
        let mut blocks = [Sums::default(); BLOCKS];
        for row in rows.iter().filter(slides) {
            let part = (row.time_s - first) / (last - first);
            let block = blocks.get_mut(((part * BLOCKS as f64) as usize).min(BLOCKS - 1))?;
            block.add(row, part - 0.5);
        }
        let all = blocks
            .iter()
            .fold(Sums::default(), |sum, block| sum.plus(block, 1.0));
        let without: Vec<f64> = blocks
            .iter()
            .map(|block| all.plus(block, -1.0).change_n())
            .collect::<Option<_>>()?;
        let n = BLOCKS as f64;
        let mean = without.iter().sum::<f64>() / n;
        let squares = without.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
        let student = StudentsT::new(0.0, 1.0, n - 1.0).ok()?;
        let half = student.inverse_cdf(1.0 - 0.5 * ALPHA / UNITS as f64)
            * ((n - 1.0) / n * squares).sqrt();
        let change_n = all.change_n()?;
        Some(Self {
            change_n,
            interval_n: [change_n - half, change_n + half],
        })
    }

    /// Whether the interval excludes zero.
    #[must_use]
    pub fn is_sure(&self) -> bool {
        self.interval_n[0] > 0.0 || self.interval_n[1] < 0.0
    }

    /// Whether that matters: more than units differ by themselves.
    #[must_use]
    pub fn counts(&self) -> bool {
        self.is_sure() && self.change_n.abs() > MATERIAL_N
    }
}

/// Sums of a least-squares fit.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    of_products: SMatrix<f64, TERMS, TERMS>,
    with_target: SVector<f64, TERMS>,
}

impl Sums {
    fn add(&mut self, row: &Row, part: f64) {
        let (side, command) = (row.speed_m_s.signum(), row.command_n);
        let terms = SVector::from([
            command,
            1.0,
            part,
            side,
            side * command,
            row.speed_m_s,
            side * part,
        ]);
        self.of_products += terms * terms.transpose();
        self.with_target += terms * row.tension_n;
    }

    fn plus(&self, other: &Self, factor: f64) -> Self {
        Self {
            of_products: self.of_products + other.of_products * factor,
            with_target: self.with_target + other.with_target * factor,
        }
    }

    /// Growth of friction over the whole time: friction takes from the tension while winding in.
    fn change_n(&self) -> Option<f64> {
        let fit = self.of_products.cholesky()?.solve(&self.with_target);
        Some(-fit[TERMS - 1]).filter(|x| x.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use random::SplitMix64;

    /// Rows of a reel that turns both ways, with friction that grows by so much over 40 s and a
    /// ripple that nobody knows of.
    fn rows(growth_n: f64, ripple_n: f64, random: &mut SplitMix64) -> Vec<Row> {
        let row = |i: u32| {
            let time_s = f64::from(i) * 0.01;
            let speed_m_s = 0.02 * (0.9 * time_s).sin() + 0.01 * (2.3 * time_s).cos();
            let command_n = 4.5 + (1.7 * time_s).sin() + 0.5 * (7.1 * time_s).cos();
            let friction_n = 0.9 + 0.15 * command_n + growth_n * time_s / 40.0;
            Row {
                time_s,
                tension_n: 1.02 * command_n - friction_n * speed_m_s.signum()
                    + ripple_n * (5.0 * (0.9 * time_s).cos()).sin()
                    + 0.02 * random.normal(),
                command_n,
                speed_m_s,
                angle_rad: 0.0,
                neighbours_n: [0.0; UNITS],
            }
        };
        (0..4000).map(row).collect()
    }

    #[test]
    fn a_change_of_friction_is_found_within_its_interval_and_none_where_there_is_none() {
        let mut random = SplitMix64::new(5);
        for growth_n in [-0.4, 0.3] {
            let found = FrictionChange::of(&rows(growth_n, 0.0, &mut random)).unwrap();
            let [low, high] = found.interval_n;
            assert!(
                found.is_sure() && low < growth_n && growth_n < high,
                "{found:?}"
            );
            assert!(high - low < 0.1, "{found:?}");
        }
        let wrong = (0..60)
            .filter(|n| {
                let ripple_n = if n % 2 == 0 { 0.0 } else { 0.5 };
                FrictionChange::of(&rows(0.0, ripple_n, &mut random))
                    .unwrap()
                    .is_sure()
            })
            .count();
        assert!(wrong <= 3, "{wrong} of 60");
        // A reel that rests, or turns one way, shows nothing.
        let mut still = rows(0.3, 0.0, &mut random);
        still
            .iter_mut()
            .for_each(|row| row.speed_m_s = row.speed_m_s.abs() + 0.01);
        assert_eq!(FrictionChange::of(&still), None);
        assert_eq!(FrictionChange::of(&[]), None);
    }
}
