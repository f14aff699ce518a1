//! A made-up survey whose truth is known: the example rig (host/rig/rigs/raven-left.toml), a base
//! with five holes, calibration plates and stations around it.
//!
//! The stations form the chain of the thesis: the first sees the base and plate 1, the next plates
//! 1 and 2, and so on. Each unit is measured from one station.

// Each of the programs that include this file uses a part of it.
#![allow(dead_code)]

use calibration::geometry::{Label, PointReading, Reference};
use calibration::input::Location;
use calibration::se3::{self, Pose};
use nalgebra::{Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

/// Centre of the workspace, m.
pub const CENTER_M: [f64; 3] = [-0.080, 0.025, -0.140];

/// Exit points and measuring axes of the example rig.
pub const UNITS: [([f64; 3], [f64; 3]); 6] = [
    ([0.335, 0.045, -0.110], [-0.996049, -0.034022, -0.082028]),
    ([-0.480, 0.010, -0.165], [0.998327, 0.028404, 0.050373]),
    ([-0.055, 0.440, -0.120], [-0.076006, -0.995642, -0.054035]),
    ([-0.090, -0.375, -0.190], [0.037792, 0.990677, 0.130888]),
    ([-0.065, 0.055, 0.275], [-0.047014, -0.083984, -0.995357]),
    ([-0.100, -0.030, -0.520], [0.047019, 0.128225, 0.990630]),
];

/// Distance of the points on a load cell from its middle, m.
const CELL_RADIUS_M: f64 = 0.025;

/// A number from the standard normal distribution (Box and Muller).
pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let u: f64 = rng.random_range(1e-300..1.0);
    let v: f64 = rng.random_range(0.0..1.0);
    (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
}

/// Three independent ones.
pub fn normal3(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(rng))
}

/// The truth and who measures what.
#[derive(Debug, Clone)]
pub struct Scene {
    pub reference: Reference,
    /// True position of each point, base frame, m.
    pub points_m: BTreeMap<Label, Vector3<f64>>,
    /// Name, motion from base to digitizer, points measured from there.
    pub stations: Vec<(String, Pose, Vec<Label>)>,
}

/// A scene with so many plates (1 to 5), plate holes 0.1 m from the plate's middle.
pub fn scene(plates: u8) -> Scene {
    layout(plates, 0.1, 3, false)
}

/// A scene with `plates` plates of `holes` holes on a circle of `radius_m`; `closed`: the last
/// station also sees the base, and each unit is seen from two stations.
pub fn layout(plates: u8, radius_m: f64, holes: u8, closed: bool) -> Scene {
    let mut rng = ChaCha8Rng::seed_from_u64(17);
    let mut points_m = BTreeMap::new();
    let mut holes_m = BTreeMap::new();
    for (name, at) in [
        ("1", [0.02, 0.08, 0.01]),
        ("2", [-0.16, 0.09, 0.00]),
        ("3", [-0.15, -0.07, 0.02]),
        ("4", [0.03, -0.06, -0.03]),
        ("5", [-0.06, 0.01, 0.06]),
    ] {
        holes_m.insert(name.to_owned(), Vector3::from(at));
        points_m.insert(Label::Base(name.to_owned()), Vector3::from(at));
    }
    for plate in 1..=plates {
        // On a circle around the robot.
        let angle = 0.6 + 1.4 * f64::from(plate);
        let middle = Vector3::new(
            0.4 * angle.cos() - 0.08,
            0.4 * angle.sin(),
            -0.1 - 0.05 * f64::from(plate),
        );
        let frame = se3::exp(&Vector6::new(
            0.0,
            0.0,
            0.0,
            0.2 * normal(&mut rng),
            0.2 * normal(&mut rng),
            angle,
        ));
        for hole in 1..=holes {
            // Distances between the holes all differ, so that no exchange of two labels goes
            // unseen.
            let turn = 2.0 * std::f64::consts::PI * f64::from(hole - 1) / f64::from(holes)
                + 0.25 * f64::from(hole * hole % 5);
            let offset = Vector3::new(radius_m * turn.cos(), radius_m * turn.sin(), 0.0);
            points_m.insert(
                Label::Plate { plate, hole },
                middle + frame.rotation * offset,
            );
        }
    }
    for (i, (exit, axis)) in UNITS.iter().enumerate() {
        let unit = i as u8 + 1;
        let exit = Vector3::from(*exit);
        let axis = Vector3::from(*axis).normalize();
        points_m.insert(Label::Exit { unit }, exit);
        let side = axis.cross(&Vector3::new(0.3, 0.5, 0.8)).normalize();
        let other = axis.cross(&side);
        for point in 1..=3u8 {
            let turn = 2.0 * std::f64::consts::PI * f64::from(point) / 3.0;
            let at = exit - axis * 0.06 + (side * turn.cos() + other * turn.sin()) * CELL_RADIUS_M;
            points_m.insert(Label::Cell { unit, point }, at);
        }
    }
    let count = plates + 1;
    let stations = (0..count)
        .map(|s| {
            let mut labels: Vec<Label> = Vec::new();
            if s == 0 || (closed && s == count - 1) {
                labels.extend(holes_m.keys().map(|n| Label::Base(n.clone())));
            }
            for plate in [s, s + 1] {
                if (1..=plates).contains(&plate) {
                    labels.extend((1..=holes).map(|hole| Label::Plate { plate, hole }));
                }
            }
            for unit in 1..=6u8 {
                // Unit 1 at the first station, unit 6 at the last.
                let home = (u16::from(unit - 1) * u16::from(count) / 6) as u8;
                if home == s || (closed && (home + 1) % count == s) {
                    labels.push(Label::Exit { unit });
                    labels.extend((1..=3).map(|point| Label::Cell { unit, point }));
                }
            }
            let pose = se3::exp(&Vector6::new(
                0.3 * normal(&mut rng),
                0.3 * normal(&mut rng),
                0.3 * normal(&mut rng),
                0.2 * normal(&mut rng),
                0.2 * normal(&mut rng),
                2.0 * normal(&mut rng),
            ));
            (char::from(b'A' + s).to_string(), pose, labels)
        })
        .collect();
    Scene {
        reference: Reference {
            holes_m,
            hole_sd_m: 0.0,
        },
        points_m,
        stations,
    }
}

impl Scene {
    /// Readings with noise of `sd_m` in each coordinate: at each station, all points, so many times
    /// round. The first is line 2 of `points.csv`.
    pub fn measure(&self, seed: u64, repeats: usize, sd_m: f64) -> Vec<PointReading> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut out = Vec::new();
        for (station, pose, labels) in &self.stations {
            for _ in 0..repeats {
                for label in labels {
                    out.push(PointReading {
                        label: label.clone(),
                        position_m: pose.apply(&self.points_m[label]) + normal3(&mut rng) * sd_m,
                        station: station.clone(),
                        at: Location {
                            file: "points.csv".into(),
                            line: out.len() + 2,
                        },
                    });
                }
            }
        }
        out
    }

    /// True exit point (m) and axis of a unit.
    pub fn unit(&self, unit: u8) -> (Vector3<f64>, Vector3<f64>) {
        let (exit, axis) = UNITS[usize::from(unit) - 1];
        (Vector3::from(exit), Vector3::from(axis).normalize())
    }
}
