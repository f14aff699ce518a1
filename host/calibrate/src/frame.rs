//! What would make cable lengths agree with the encoders: exit points of other units, a mirrored or
//! turned frame, a shift.
//!
//! The load cells can't show a wrong geometry: force and cell axes are wrong together. The lengths
//! do ([`crate::moving::judge_length`]), and here every exchange of exit points (720) and every
//! motion of all of them as one body, with and without a reflection, is tried on the same samples.

use crate::moving::length_limit_m;
use calibration::self_calibration::Sample;
use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};
use wire::UNITS;

/// Samples of each unit that are compared: 0.1 mm of pose noise is a hundredth of that in their
/// mean.
const SAMPLES: usize = 200;
/// Steps of the fit; it converges in less than ten from 45 degrees.
const STEPS: usize = 40;
/// A motion as one body that turns by less is none, degrees; the fit's own error is 0.1 with 1 mm
/// of pose noise.
const TURNED_DEG: f64 = 1.0;
/// An axis of rotation so near to x, y or z is called that, degrees.
const AXIS_DEG: f64 = 5.0;
/// A shift that is named, m.
const SHIFT_M: f64 = 5e-3;
/// An explanation is another one's rival where its squares are at most this share larger: six more
/// parameters make 1 %.
const RIVAL: f64 = 1.2;
/// Square that every sample may have without telling rivals apart, m^2: 0.1 mm of stretch.
const ALIKE_M2: f64 = 1e-8;

/// Something that makes all lengths agree.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// In words, of the exit points in the rig file.
    pub words: String,
    /// Root mean square difference of the lengths with it, m.
    pub rms_m: f64,
}

/// Cable of a unit: its exit point in the rig file, and its samples.
struct Cable<'s> {
    unit: usize,
    exit_m: Vector3<f64>,
    samples: Vec<&'s Sample>,
}

impl Cable<'_> {
    /// Mean square difference with an exit point, m^2; the unknown length at zero travel is taken
    /// off.
    fn square_m2(&self, exit_m: &Vector3<f64>) -> f64 {
        let difference = |s: &&Sample| (exit_m - s.tip_m).norm() - s.travel_m;
        let count = self.samples.len() as f64;
        let mean = self.samples.iter().map(difference).sum::<f64>() / count;
        let squares = self.samples.iter().map(|s| (difference(s) - mean).powi(2));
        squares.sum::<f64>() / count
    }
}

/// What makes all lengths agree, the best first; empty where they agree already, or nothing that is
/// tried does. `exits_m`: exit points of the rig file; `pose_sd_m`: standard deviation of a
/// coordinate of the tip.
#[must_use]
pub fn explain(
    samples: &[Vec<Sample>; UNITS],
    exits_m: &[Vector3<f64>; UNITS],
    pose_sd_m: f64,
) -> Vec<Explanation> {
    let cables: Vec<Cable<'_>> = (0..UNITS)
        .filter(|unit| !samples[*unit].is_empty())
        .map(|unit| Cable {
            unit,
            exit_m: exits_m[unit],
            samples: (samples[unit].iter())
                .step_by(samples[unit].len().div_ceil(SAMPLES))
                .collect(),
        })
        .collect();
    let most_m2 = length_limit_m(pose_sd_m).powi(2);
    let agrees = |squares: &[f64]| squares.iter().all(|square| *square <= most_m2);
    let as_it_is: Vec<f64> = cables.iter().map(|c| c.square_m2(&c.exit_m)).collect();
    // Three cables leave a motion as one body open.
    if cables.len() < 4 || agrees(&as_it_is) {
        return Vec::new();
    }
    let exchanged = exchanged(&cables, &agrees);
    let moved = moved(&cables, &agrees);
    let best_m2 = (exchanged.iter().chain(&moved))
        .fold(f64::INFINITY, |best, found| best.min(found.rms_m.powi(2)));
    let mut found: Vec<Explanation> = exchanged.into_iter().chain(moved).collect();
    found.retain(|found| found.rms_m.powi(2) <= RIVAL * best_m2 + ALIKE_M2);
    found
}

fn mean(squares: &[f64]) -> f64 {
    squares.iter().sum::<f64>() / squares.len() as f64
}

/// The best exchange of exit points that makes all lengths agree.
fn exchanged(cables: &[Cable<'_>], agrees: &dyn Fn(&[f64]) -> bool) -> Option<Explanation> {
    let squares: Vec<Vec<f64>> = (cables.iter())
        .map(|cable| {
            let exits = cables.iter();
            exits.map(|of| cable.square_m2(&of.exit_m)).collect()
        })
        .collect();
    let mut best: Option<(f64, Vec<usize>)> = None;
    permutations(cables.len(), &mut Vec::new(), &mut |order| {
        let of: Vec<f64> = order
            .iter()
            .zip(&squares)
            .map(|(at, row)| row[*at])
            .collect();
        let square = mean(&of);
        if agrees(&of) && best.as_ref().is_none_or(|(least, _)| square < *least) {
            best = Some((square, order.to_vec()));
        }
    });
    let (square, order) = best?;
    let mut seen = vec![false; order.len()];
    let mut words = Vec::new();
    for start in 0..order.len() {
        let mut ring = Vec::new();
        let mut at = start;
        while !std::mem::replace(&mut seen[at], true) {
            ring.push((cables[at].unit + 1).to_string());
            at = order[at];
        }
        match ring.as_slice() {
            [] | [_] => {}
            [a, b] => words.push(format!("exits {a} and {b} exchanged")),
            ring => words.push(format!(
                "exits {} exchanged: each has to be the next one's, the last the first one's",
                ring.join(", ")
            )),
        }
    }
    Some(Explanation {
        words: words.join("; "),
        rms_m: square.sqrt(),
    })
}

/// Calls `with` for each order of `0..count`.
fn permutations(count: usize, order: &mut Vec<usize>, with: &mut dyn FnMut(&[usize])) {
    if order.len() == count {
        with(order);
        return;
    }
    for next in 0..count {
        if !order.contains(&next) {
            order.push(next);
            permutations(count, order, with);
            order.pop();
        }
    }
}

/// The best motion of all exit points as one body that makes all lengths agree, with a reflection
/// or without.
fn moved(cables: &[Cable<'_>], agrees: &dyn Fn(&[f64]) -> bool) -> Option<Explanation> {
    let mut best: Option<(f64, Matrix3<f64>, Vector3<f64>)> = None;
    for start in turns() {
        for mirror in [Matrix3::identity(), mirrored(0)] {
            let (linear, shift_m) = fit(cables, start * mirror);
            let of: Vec<f64> = (cables.iter())
                .map(|c| c.square_m2(&(linear * c.exit_m + shift_m)))
                .collect();
            let square = mean(&of);
            if agrees(&of) && best.as_ref().is_none_or(|(least, ..)| square < *least) {
                best = Some((square, linear, shift_m));
            }
        }
    }
    let (square, linear, shift_m) = best?;
    Some(Explanation {
        words: words(&linear, &shift_m),
        rms_m: square.sqrt(),
    })
}

fn mirrored(axis: usize) -> Matrix3<f64> {
    let mut matrix = Matrix3::identity();
    matrix[(axis, axis)] = -1.0;
    matrix
}

/// The 24 rotations of a cube: any rotation is within 63 degrees of one.
fn turns() -> Vec<Matrix3<f64>> {
    let mut found = Vec::new();
    permutations(3, &mut Vec::new(), &mut |order| {
        for signs in 0..8 {
            let mut matrix = Matrix3::zeros();
            for (row, column) in order.iter().enumerate() {
                matrix[(row, *column)] = if signs >> row & 1 == 0 { 1.0 } else { -1.0 };
            }
            if matrix.determinant() > 0.0 {
                found.push(matrix);
            }
        }
    });
    found
}

/// The least squares of the lengths over rotation and shift, from a start: Levenberg and
/// Marquardt's method.
fn fit(cables: &[Cable<'_>], start: Matrix3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
    let total = |linear: &Matrix3<f64>, shift_m: &Vector3<f64>| -> f64 {
        let squares = cables.iter();
        squares
            .map(|c| c.square_m2(&(linear * c.exit_m + shift_m)))
            .sum()
    };
    let (mut linear, mut shift_m) = (start, Vector3::zeros());
    let mut left = total(&linear, &shift_m);
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for cable in cables {
            let turned = linear * cable.exit_m;
            let count = cable.samples.len() as f64;
            let rows: Vec<(f64, Vector6<f64>)> = (cable.samples.iter())
                .map(|s| {
                    let way = turned + shift_m - s.tip_m;
                    let toward = way.normalize();
                    let arm = turned.cross(&toward);
                    let row = Vector6::new(arm.x, arm.y, arm.z, toward.x, toward.y, toward.z);
                    (way.norm() - s.travel_m, row)
                })
                .collect();
            let middle = rows.iter().map(|(r, _)| r).sum::<f64>() / count;
            let mean_row = rows.iter().map(|(_, row)| row).sum::<Vector6<f64>>() / count;
            for (residual, row) in rows {
                let row = row - mean_row;
                normal += row * row.transpose() / count;
                right -= row * (residual - middle) / count;
            }
        }
        let damped = normal + Matrix6::from_diagonal(&normal.diagonal()) * damping;
        let Some(step) = damped.cholesky().map(|c| c.solve(&right)) else {
            break;
        };
        let by = Rotation3::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        let next = by.matrix() * linear;
        let next_m = shift_m + Vector3::new(step[3], step[4], step[5]);
        let square = total(&next, &next_m);
        if square < left {
            let done = left - square < 1e-9 * left;
            (linear, shift_m, left) = (next, next_m, square);
            damping = (damping * 0.2).max(1e-9);
            if done {
                break;
            }
        } else {
            damping *= 5.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    (linear, shift_m)
}

/// A motion in words.
fn words(linear: &Matrix3<f64>, shift_m: &Vector3<f64>) -> String {
    let turn = |matrix: Matrix3<f64>| Rotation3::from_matrix_unchecked(matrix);
    let mut parts = Vec::new();
    let rotation = if linear.determinant() < 0.0 {
        let axes = (0..3).map(|axis| (axis, turn(linear * mirrored(axis))));
        let (axis, rotation) = axes
            .min_by(|a, b| a.1.angle().total_cmp(&b.1.angle()))
            .unwrap_or((0, Rotation3::identity()));
        parts.push(format!("mirrored in {}", ["x", "y", "z"][axis]));
        rotation
    } else {
        turn(*linear)
    };
    if let Some((axis, angle)) = rotation.axis_angle() {
        if angle.to_degrees() >= TURNED_DEG {
            let most = axis.iamax();
            let near = axis[most].abs() >= AXIS_DEG.to_radians().cos();
            let signed = if near {
                angle * axis[most].signum()
            } else {
                angle
            };
            let about = if near {
                ["x", "y", "z"][most].to_owned()
            } else {
                format!("({:.2} {:.2} {:.2})", axis.x, axis.y, axis.z)
            };
            parts.push(format!(
                "turned by {:.0} degrees about {about}",
                signed.to_degrees()
            ));
        }
    }
    if shift_m.norm() >= SHIFT_M || parts.is_empty() {
        let mm = shift_m * 1e3;
        parts.push(format!(
            "shifted by ({:.0} {:.0} {:.0}) mm",
            mm.x, mm.y, mm.z
        ));
    }
    format!("frame {}", parts.join(" and "))
}
