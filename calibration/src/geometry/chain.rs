//! The chain of the thesis (3.5.2): base, station, plate, station, and so on.
//!
//! The first station is tied to the base by Kabsch's algorithm. A plate carries a frame of its own:
//! origin in hole 1, x to hole 2, z normal to the three holes, y = z x x. Seen from a station that
//! is placed and from one that is not, it places the second. Further plates between the same
//! stations are not used; that is what the joint estimate gains. Each point is taken from the first
//! station, in the order they are placed, that has measured it.

use super::network::{Items, Network};
use super::points::Label;
use super::units::{self, UnitGeometry};
use super::GeometryError;
use crate::kabsch;
use crate::se3::Pose;
use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};
use std::collections::BTreeMap;

/// The frame of a plate from its three holes (thesis 3.5.2): the motion from plate coordinates to
/// those of the holes. `None` where the holes lie on a line.
#[must_use]
pub fn plate_frame(
    hole_1_m: &Vector3<f64>,
    hole_2_m: &Vector3<f64>,
    hole_3_m: &Vector3<f64>,
) -> Option<Pose> {
    let (z, _) = units::normal(hole_1_m, hole_2_m, hole_3_m)?;
    let x = (hole_2_m - hole_1_m).normalize();
    let y = z.cross(&x);
    Some(Pose {
        rotation: Matrix3::from_columns(&[x, y, z]),
        translation_m: *hole_1_m,
    })
}

/// Means of the repeats, digitizer frame, m, by station and point.
type Means = BTreeMap<(usize, usize), Vector3<f64>>;

/// Positions of all points that the chain reaches, base frame, m, by number.
fn positions(items: &Items, means: &Means) -> Result<BTreeMap<usize, Vector3<f64>>, GeometryError> {
    let stations = items.stations.len();
    // Digitizer frame to base frame.
    let mut poses: Vec<Option<Pose>> = vec![None; stations];
    let mut order = Vec::new();
    for (s, pose) in poses.iter_mut().enumerate() {
        let (mut from, mut to) = (Vec::new(), Vec::new());
        for ((_, l), mean) in means.range((s, 0)..(s + 1, 0)) {
            if let Some(known) = items.known_m[*l] {
                from.push(*mean);
                to.push(known);
            }
        }
        if let Some(found) = kabsch::align(&from, &to, &vec![1.0; from.len()]) {
            *pose = Some(found.pose);
            order.push(s);
        }
    }
    if order.is_empty() {
        return Err(GeometryError::NoBase);
    }
    let mut plates: BTreeMap<u8, [Option<usize>; 3]> = BTreeMap::new();
    for (l, label) in items.landmarks.iter().enumerate() {
        if let Label::Plate {
            plate,
            hole: hole @ 1..=3,
        } = label
        {
            plates.entry(*plate).or_default()[usize::from(*hole) - 1] = Some(l);
        }
    }
    let frame = |plate: &[Option<usize>; 3], s: usize| -> Option<Pose> {
        let hole = |k: usize| plate[k].and_then(|l| means.get(&(s, l)));
        plate_frame(hole(0)?, hole(1)?, hole(2)?)
    };
    let mut next = 0;
    while next < order.len() {
        let from = order[next];
        next += 1;
        let Some(placed) = poses[from] else { continue };
        for (to, pose) in poses.iter_mut().enumerate() {
            if pose.is_some() {
                continue;
            }
            let link = plates
                .values()
                .find_map(|plate| Some((frame(plate, from)?, frame(plate, to)?)));
            if let Some((here, there)) = link {
                *pose = Some(placed.compose(&here).compose(&there.inverse()));
                order.push(to);
            }
        }
    }
    if let Some(lost) = (0..stations).find(|&s| poses[s].is_none()) {
        return Err(GeometryError::NoCommonPlate {
            at: items.station_at[lost].clone(),
            station: items.stations[lost].clone(),
        });
    }
    let mut out = BTreeMap::new();
    for &s in &order {
        if let Some(pose) = poses[s] {
            for ((_, l), mean) in means.range((s, 0)..(s + 1, 0)) {
                out.entry(*l).or_insert_with(|| pose.apply(mean));
            }
        }
    }
    Ok(out)
}

fn units_of(
    items: &Items,
    means: &Means,
    center_m: Option<Vector3<f64>>,
) -> Result<Vec<UnitGeometry>, GeometryError> {
    let at = positions(items, means)?;
    let number = |label: &Label| items.landmarks.iter().position(|l| l == label);
    let position = |label: &Label| number(label).and_then(|l| at.get(&l).copied());
    let (units, _) = units::assemble(
        &items.landmarks,
        position,
        |_, _| Matrix3::zeros(),
        center_m,
    )?;
    Ok(units)
}

/// Units by the chain, with covariances from the digitizer's standard deviation (central
/// differences over all measured means). `with_covariance: false` leaves them 0 and saves the time.
pub(super) fn solve(
    network: &Network<'_>,
    sd_m: f64,
    center_m: Option<Vector3<f64>>,
    with_covariance: bool,
) -> Result<Vec<UnitGeometry>, GeometryError> {
    let items = network.data;
    let mut means: Means = network
        .groups
        .iter()
        .map(|g| ((g.station, g.landmark), g.mean_m))
        .collect();
    let mut units = units_of(items, &means, center_m)?;
    if !with_covariance {
        return Ok(units);
    }
    let vector = |units: &[UnitGeometry]| -> Vec<f64> {
        units
            .iter()
            .flat_map(|u| {
                u.exit_m
                    .iter()
                    .chain(u.axis.iter())
                    .copied()
                    .collect::<Vec<_>>()
            })
            .collect()
    };
    let size = 6 * units.len();
    let mut covariance = DMatrix::zeros(size, size);
    let step = 1e-6;
    for group in &network.groups {
        let key = (group.station, group.landmark);
        for k in 0..3 {
            let mut at = |offset: f64| -> Result<Vec<f64>, GeometryError> {
                let mean = means.entry(key).or_insert(group.mean_m);
                mean[k] = group.mean_m[k] + offset;
                let found = units_of(items, &means, center_m);
                means.insert(key, group.mean_m);
                Ok(vector(&found?))
            };
            let (high, low) = (at(step)?, at(-step)?);
            let slope = nalgebra::DVector::from_iterator(
                size,
                high.iter().zip(&low).map(|(a, b)| (a - b) / (2.0 * step)),
            );
            covariance += &slope * slope.transpose() * (sd_m * sd_m / group.count as f64);
        }
    }
    for (i, unit) in units.iter_mut().enumerate() {
        unit.covariance = SMatrix::from_fn(|r, c| covariance[(6 * i + r, 6 * i + c)]);
    }
    Ok(units)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_plate_frame_is_that_of_the_thesis() {
        let (a, b, c) = (
            Vector3::new(1.0, 2.0, 3.0),
            Vector3::new(1.0, 4.0, 3.0),
            Vector3::new(0.0, 2.5, 3.0),
        );
        let frame = plate_frame(&a, &b, &c).unwrap();
        assert!((frame.apply(&Vector3::zeros()) - a).norm() < 1e-15);
        assert!((frame.apply(&Vector3::new(2.0, 0.0, 0.0)) - b).norm() < 1e-15);
        // z = x x (hole 3 - hole 1): up here; hole 3 has positive y.
        assert!((frame.rotation.column(2) - Vector3::z()).norm() < 1e-15);
        let third = frame.inverse().apply(&c);
        assert!(third.y > 0.0 && third.z.abs() < 1e-15);
        assert!(plate_frame(&a, &b, &(2.0 * b - a)).is_none());
    }
}
