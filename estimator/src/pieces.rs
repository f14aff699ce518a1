//! What changes between pieces of a training, so that it does not go into the balances.
//!
//! A robot that changes is another one in each trial: other zeros and gains of amplifiers, more or
//! less friction, a torque of a tool's cable that comes and goes. A fit that does not know this
//! takes their mean for the robot, and the rest for noise. Here each piece of the training has
//! changes of its own, those of [`crate::recalibration`], and a torque that goes from one value to
//! the next within [`wander::TIME_S`]. How large they usually are is found with them (expectation
//! maximisation). On a robot that is the same in all pieces they are zero, and the fit is that of
//! all rows together.

use crate::recalibration::{Effects, ALIKE_S, CHANGES, SPREAD};
use crate::ridge::{Ridge, Sums};
use crate::wander;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Longest piece, s.
const PIECE_S: f64 = 300.0;
/// Values of the torque in a piece, at even times, linear between them.
const KNOTS: usize = 13;
/// Regressors that a piece has for itself.
pub const OWN: usize = CHANGES + KNOTS;
/// Steps of the search for the usual sizes.
const STEPS: usize = 20;
/// Standard deviation of the torque at the start of the search, per Coulomb friction. Estimate.
const TORQUE: f64 = 0.05;
/// Changes that all pieces can have: the other regressors do not have the ripple and the asymmetry.
const COMMON: core::ops::Range<usize> = 3..CHANGES;
/// Largest standard deviation of a change, per that of a recalibration.
const LARGEST: f64 = 2.0;
/// Least variance of a change: one of zero has no inverse.
const LEAST: f64 = 1e-8;

/// Piece of a settled row, and its time in the piece, s.
#[must_use]
pub fn place(row: usize, step_s: f64) -> (usize, f64) {
    let rows = ((PIECE_S / step_s).round() as usize).max(1);
    (row / rows, (row % rows) as f64 * step_s)
}

/// Shares that the torque's values have at a time in the piece.
fn shares(time_s: f64) -> impl Iterator<Item = f64> {
    let at = (time_s / PIECE_S).clamp(0.0, 1.0) * (KNOTS - 1) as f64;
    (0..KNOTS).map(move |k| (1.0 - (at - k as f64).abs()).max(0.0))
}

/// Regressors that a piece has for itself, behind those in `row`. What they add to a balance is not
/// in the torque.
pub fn push(effects: &Effects, time_s: f64, row: &mut Vec<f64>) {
    row.extend(effects.map(|effect| -effect));
    row.extend(shares(time_s).map(|share| -share * effects[0]));
}

/// Coefficients of these regressors, of one motor.
#[derive(Debug, Clone)]
pub struct Own(DVector<f64>);

impl Own {
    /// What they add to what the balance lacks.
    #[must_use]
    pub fn adds(&self, effects: &Effects, time_s: f64) -> f64 {
        let changes = effects.iter().zip(self.0.iter());
        let torque = shares(time_s).zip(self.0.iter().skip(CHANGES));
        changes.map(|(effect, c)| effect * c).sum::<f64>()
            + effects[0] * torque.map(|(share, c)| share * c).sum::<f64>()
    }
}

/// What pieces of a sequence have for themselves.
#[derive(Debug, Clone, Default)]
pub struct Told {
    /// By piece, of each motor.
    pub own: Vec<[Own; 3]>,
    /// Rows that were taken.
    pub rows: usize,
}

impl Told {
    /// What it adds to what the balance of motor `i` lacks at a settled row.
    #[must_use]
    pub fn adds(&self, i: usize, row: usize, step_s: f64, effects: &Effects) -> f64 {
        let (piece, time_s) = place(row, step_s);
        let own = self.own.get(piece).or(self.own.last());
        own.map_or(0.0, |own| own[i].adds(effects, time_s))
    }
}

/// How much the pieces of a motor usually differ: variances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Usual {
    changes: [f64; CHANGES],
    /// Of the torque, per Coulomb friction.
    torque: f64,
    /// Of a row's noise.
    noise: f64,
}

/// A balance whose pieces have changes of their own.
pub struct Fitted {
    /// What holds in all pieces.
    pub common: Ridge,
    /// Changes that all pieces have.
    pub mean: Effects,
    /// What each piece has for itself.
    pub own: Vec<Own>,
    /// How much the pieces differ.
    pub usual: Usual,
}

/// Inverse of the covariance of the torque's values per its variance.
fn inverse_of_torque() -> Option<DMatrix<f64>> {
    let apart = PIECE_S / (KNOTS - 1) as f64 / wander::TIME_S;
    DMatrix::from_fn(KNOTS, KNOTS, |i, j| {
        let x = i.abs_diff(j) as f64 * apart;
        (1.0 + x) * (-x).exp()
    })
    .try_inverse()
}

impl Usual {
    /// Standard deviation of the torque that comes and goes, per Coulomb friction.
    #[must_use]
    pub fn torque(&self) -> f64 {
        self.torque.sqrt()
    }

    /// Variance that usual changes give a balance.
    #[must_use]
    pub fn variance(&self, effects: &Effects) -> f64 {
        let changes = self.changes.iter().zip(effects);
        changes.map(|(v, effect)| v * effect * effect).sum::<f64>()
            + self.torque * effects[0] * effects[0]
    }

    /// Inverse of the covariance of a piece's own coefficients, per noise of a row. Rows within
    /// [`ALIKE_S`] have the same error.
    fn inverse(&self, of_torque: &DMatrix<f64>, row_s: f64) -> DMatrix<f64> {
        let per_noise = self.per_noise(row_s);
        let mut inverse = DMatrix::zeros(OWN, OWN);
        for (k, variance) in self.changes.into_iter().enumerate() {
            inverse[(k, k)] = per_noise / variance;
        }
        inverse
            .view_mut((CHANGES, CHANGES), (KNOTS, KNOTS))
            .copy_from(&(of_torque * (per_noise / self.torque)));
        inverse
    }

    fn per_noise(&self, row_s: f64) -> f64 {
        self.noise * (ALIKE_S / row_s).max(1.0)
    }

    /// What a piece has for itself, of sums of what a balance of `keep` regressors leaves.
    #[must_use]
    pub fn own(&self, piece: &mut Sums, keep: usize, row_s: f64) -> Option<Own> {
        let inverse = self.inverse(&inverse_of_torque()?, row_s);
        let found = piece.own(&Ridge::zero(keep), &inverse);
        found.map(|(own, ..)| Own(own))
    }
}

/// Fits a balance. `pieces`: sums of rows of regressors and [`OWN`], and what `plain` leaves of the
/// balance; `noise`: variance of a row's noise at the start of the search; `row_s`: time between
/// rows, s.
pub fn fit(pieces: &mut [Sums], plain: &Ridge, noise: f64, row_s: f64) -> Option<Fitted> {
    let keep = plain.regressors();
    let of_torque = inverse_of_torque()?;
    let count = pieces.len() as f64;
    let mut usual = Usual {
        changes: SPREAD.map(|sd| sd * sd),
        torque: TORQUE * TORQUE,
        noise,
    };
    let mut mean = [0.0; CHANGES];
    let mut last = None;
    for _ in 0..STEPS {
        let inverse = usual.inverse(&of_torque, row_s);
        let per_noise = usual.per_noise(row_s);
        let mut total = Sums::new(keep, 1);
        for piece in pieces.iter_mut() {
            total.merge(piece.without_own(keep, &inverse)?);
        }
        let common = total.solve()?;
        let (mut squares, mut rows) = (0.0, 0.0);
        let mut next = Usual {
            changes: [0.0; CHANGES],
            torque: 0.0,
            noise: 0.0,
        };
        let mut own = Vec::with_capacity(pieces.len());
        let mut more = [0.0; CHANGES];
        for piece in pieces.iter_mut() {
            let (values, covariance, left) = piece.own(&common, &inverse)?;
            for k in COMMON {
                more[k] += values[k] / count;
            }
            squares += left;
            rows += piece.rows() as f64;
            for (k, change) in next.changes.iter_mut().enumerate() {
                *change += values[k] * values[k] + per_noise * covariance[(k, k)];
            }
            let torques = values.rows(CHANGES, KNOTS);
            let unsure = covariance.view((CHANGES, CHANGES), (KNOTS, KNOTS));
            next.torque +=
                torques.dot(&(&of_torque * torques)) + per_noise * (&of_torque * unsure).trace();
            own.push(Own(values));
        }
        last = Some(Fitted {
            common: common.plus(plain),
            mean,
            own,
            usual,
        });
        for piece in pieces.iter_mut() {
            piece.take_out(keep, &more);
        }
        for (mean, more) in mean.iter_mut().zip(more) {
            *mean += more;
        }
        usual = Usual {
            changes: core::array::from_fn(|k| {
                (next.changes[k] / count).clamp(LEAST, (LARGEST * SPREAD[k]).powi(2))
            }),
            torque: (next.torque / (count * KNOTS as f64)).max(LEAST),
            noise: squares / rows,
        };
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot::random::Random;

    const COULOMB: f64 = 1.1;
    const ROW_S: f64 = 0.1;

    /// Effects at a time: all but the gain of another course.
    fn effects(t: f64) -> Effects {
        let way = (0.4 * t).cos().signum();
        let angle = 5.0 * (0.4 * t).sin();
        let torque = COULOMB * (way + 0.8 * (0.13 * t).sin());
        [
            COULOMB,
            COULOMB * way,
            torque,
            COULOMB * way * angle.sin(),
            COULOMB * way * angle.cos(),
            COULOMB * (1.0 + 0.3 * (0.07 * t).sin()),
        ]
    }

    /// Sums of six pieces of a robot with offsets and a ripple, and a drag of this size.
    fn pieces(offset: f64, drag: f64) -> Vec<Sums> {
        let mut noise = Random::stream(4, "pieces", 0);
        (0..6)
            .map(|piece| {
                let mut sums = Sums::new(2 + OWN, 1);
                let (shift, phase) = (f64::from(piece) - 2.5, f64::from(piece) * 1.3);
                for n in 0..3_000 {
                    let t = f64::from(n) * ROW_S;
                    let of = effects(t);
                    let x = (0.23 * t + phase).sin();
                    let mut row = vec![x, of[1]];
                    push(&of, t, &mut row);
                    let changed = offset * shift * of[0]
                        + 0.1 * of[3]
                        + drag * COULOMB * (t / wander::TIME_S + phase).sin();
                    let torque = 0.5 * x + 1.02 * of[1] - changed + 0.02 * noise.normal();
                    // Less what the first fit has of it.
                    sums.push(&row, &[torque - of[1]]);
                }
                sums
            })
            .collect()
    }

    fn fitted(pieces: &mut [Sums]) -> Fitted {
        let plain = Ridge::zero(1).placed(&[1], 2);
        fit(pieces, &plain, 1e-3, ROW_S).expect("enough rows")
    }

    #[test]
    fn changes_between_pieces_do_not_go_into_what_they_share() {
        let mut sums = pieces(0.05, 0.1);
        let found = fitted(&mut sums);
        assert!((found.common.weights(0)[0] - 0.5).abs() < 0.01);
        assert!((found.mean[3] - 0.1).abs() < 0.01, "{:?}", found.mean);
        // A sinusoid's standard deviation, and that of -0.125 to 0.125.
        let usual = found.usual;
        assert!((0.05..0.1).contains(&usual.torque()), "{usual:?}");
        let offset = usual.changes[0].sqrt();
        assert!((0.05..0.15).contains(&offset), "{usual:?}");
        assert!(usual.changes[3] < 1e-4 && usual.changes[4] < 1e-4);
        assert!((usual.noise - 4e-4).abs() < 2e-4, "{usual:?}");
        // The torque of a piece at a time: offset and drag.
        let at = |t: f64| found.own[1].adds(&[COULOMB, 0.0, 0.0, 0.0, 0.0, 0.0], t) / COULOMB;
        for t in [40.0, 120.0, 250.0] {
            let made = -0.075 + 0.1 * (t / wander::TIME_S + 1.3).sin();
            assert!((at(t) - made).abs() < 0.03, "{t}: {} {made}", at(t));
        }
    }

    #[test]
    fn a_robot_that_is_the_same_in_all_pieces_has_no_usual_changes() {
        let found = fitted(&mut pieces(0.0, 0.0));
        let usual = found.usual;
        assert!(usual.torque() < 0.01, "{usual:?}");
        let most = usual.changes.into_iter().fold(0.0, f64::max);
        assert!(most.sqrt() < 0.02, "{usual:?}");
    }

    #[test]
    fn rows_have_their_places_in_pieces() {
        assert_eq!(place(0, 0.02), (0, 0.0));
        assert_eq!(place(14_999, 0.02).0, 0);
        assert_eq!(place(15_050, 0.02), (1, 1.0));
        let sum: f64 = shares(137.0).sum();
        assert!((sum - 1.0).abs() < 1e-12);
    }
}
