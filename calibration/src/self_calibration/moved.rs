//! Whether the rig has moved since its calibration.

use super::ExitEstimate;
use crate::geometry::UnitGeometry;
use crate::stats;
use nalgebra::{Matrix3, Vector3};

/// Whether the rig stands where its calibration says.
#[derive(Debug, Clone, PartialEq)]
pub struct Moved {
    /// p-value that all units stand where they stood: small means moved.
    pub p: f64,
    /// Unit, displacement (m) and p-value, in the order given.
    pub units: Vec<(u8, Vector3<f64>, f64)>,
    /// What moved.
    pub verdict: MovedVerdict,
}

/// What moved since the calibration.
#[derive(Debug, Clone, PartialEq)]
pub enum MovedVerdict {
    /// Nothing that this run shows.
    Unmoved,
    /// These units.
    Units(Vec<u8>),
    /// All units as one body against the robot (or the robot against them): translation of their
    /// centre, m, and rotation, rad.
    Body {
        /// Translation of the units' centre, m.
        translation_m: Vector3<f64>,
        /// Rotation vector, rad.
        rotation_rad: Vector3<f64>,
    },
}

/// A unit's displacement and how well it is known.
struct Displacement {
    unit: u8,
    from_m: Vector3<f64>,
    by_m: Vector3<f64>,
    /// Inverse covariance of `by_m`, 1/m^2.
    information: Matrix3<f64>,
}

impl Displacement {
    fn chi_square(&self) -> f64 {
        (self.by_m.transpose() * self.information * self.by_m)[0]
    }
}

/// Compares exit points from a run with the stored ones by chi-square, at the level `alpha` (0.001:
/// one false alarm in 1,000 runs). Units that moved one by one and a rig that moved as a body are
/// told apart by the Bayesian information criterion. `found` is matched to `stored` by unit number;
/// units without a partner are left out. Correlations between units are not used.
#[must_use]
pub fn moved(stored: &[UnitGeometry], found: &[(u8, ExitEstimate)], alpha: f64) -> Moved {
    let mut pairs: Vec<Displacement> = Vec::new();
    for (unit, estimate) in found {
        let Some(old) = stored.iter().find(|s| s.unit == *unit) else {
            continue;
        };
        let covariance = old.exit_covariance_m2() + estimate.covariance_m2;
        if let Some(information) = covariance.try_inverse() {
            pairs.push(Displacement {
                unit: *unit,
                from_m: old.exit_m,
                by_m: estimate.exit_m - old.exit_m,
                information,
            });
        }
    }
    let total: f64 = pairs.iter().map(Displacement::chi_square).sum();
    let units: Vec<(u8, Vector3<f64>, f64)> = pairs
        .iter()
        .map(|d| {
            (
                d.unit,
                d.by_m,
                stats::chi_square_survival(d.chi_square(), 3),
            )
        })
        .collect();
    let p = stats::chi_square_survival(total, 3 * pairs.len());
    // One unit that moved is diluted among six: look at the worst as well, Bonferroni over both
    // looks.
    let worst = units.iter().map(|u| u.2).fold(1.0, f64::min) * pairs.len() as f64;
    if p.min(worst) >= 0.5 * alpha {
        return Moved {
            p,
            units,
            verdict: MovedVerdict::Unmoved,
        };
    }
    let observations = (3 * pairs.len()) as f64;
    let movers: Vec<usize> = (0..pairs.len())
        .filter(|&i| units[i].2 * (pairs.len() as f64) < 0.5 * alpha.max(0.01))
        .collect();
    let left: f64 = (0..pairs.len())
        .filter(|i| !movers.contains(i))
        .map(|i| pairs[i].chi_square())
        .sum();
    let single = left + 3.0 * movers.len() as f64 * observations.ln();
    let body = rigid(&pairs);
    let verdict = match body {
        Some((translation_m, rotation_rad, left)) if left + 6.0 * observations.ln() < single => {
            MovedVerdict::Body {
                translation_m,
                rotation_rad,
            }
        }
        _ => MovedVerdict::Units(movers.iter().map(|&i| pairs[i].unit).collect()),
    };
    Moved { p, units, verdict }
}

/// Small rigid motion of all units about their centre that explains the displacements best, and the
/// chi-square it leaves.
fn rigid(pairs: &[Displacement]) -> Option<(Vector3<f64>, Vector3<f64>, f64)> {
    if pairs.len() < 3 {
        return None;
    }
    let center = pairs.iter().map(|p| p.from_m).sum::<Vector3<f64>>() / pairs.len() as f64;
    let mut normal = nalgebra::Matrix6::zeros();
    let mut right = nalgebra::Vector6::zeros();
    let jacobian = |at: &Vector3<f64>| {
        let mut j = nalgebra::Matrix3x6::zeros();
        j.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&Matrix3::identity());
        j.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-crate::se3::skew(&(at - center)));
        j
    };
    for d in pairs {
        let j = jacobian(&d.from_m);
        normal += j.transpose() * d.information * j;
        right += j.transpose() * d.information * d.by_m;
    }
    let step = normal.cholesky()?.solve(&right);
    let left = pairs
        .iter()
        .map(|d| {
            let r = d.by_m - jacobian(&d.from_m) * step;
            (r.transpose() * d.information * r)[0]
        })
        .sum();
    Some((
        Vector3::new(step[0], step[1], step[2]),
        Vector3::new(step[3], step[4], step[5]),
        left,
    ))
}
