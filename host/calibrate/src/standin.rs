//! Stand-ins for the people and tools of a calibration, on an emulated rig: weights that are hung,
//! a digitizer that touches points. They know the truth of the plant; what they give has the errors
//! of the real tools.

use calibration::gain::Class;
use calibration::geometry::Label;
use calibration::gravity;
use calibration::se3::{self, Pose};
use nalgebra::{Vector3, Vector6};
use plant::rng::FURTHEST;
use plant::{Plant, PlantConfig};
use random::SplitMix64;
use std::collections::BTreeMap;
use std::str::FromStr;

/// Class of the weights.
const CLASS: Class = Class::M2;
/// Standard deviation of the digitizer in one coordinate, m.
const DIGITIZER_SD_M: f64 = 2e-4;
/// Holes of the example base, m.
const BASE: [(&str, [f64; 3]); 5] = [
    ("1", [0.02, 0.08, 0.01]),
    ("2", [-0.16, 0.09, 0.00]),
    ("3", [-0.15, -0.07, 0.02]),
    ("4", [0.03, -0.06, -0.03]),
    ("5", [-0.06, 0.01, 0.06]),
];
/// Points of a station before it is bumped: within the first round of touches.
const BUMP_AFTER: usize = 8;
/// Distance of a plate's holes from its middle, m.
const PLATE_RADIUS_M: f64 = 0.15;
/// Distance of the points on a load cell from its middle, m.
const CELL_RADIUS_M: f64 = 0.025;

/// A mistake that a stand-in makes on request.
#[derive(Debug, Clone, PartialEq)]
pub enum Mistake {
    /// Where this weight is asked for (g), that one is hung once: `weight=50:500`.
    Weight(f64, f64),
    /// This station is bumped by so many mm after its first points: `bump=B:3`.
    Bump(String, f64),
    /// The cable of this unit pulls with so many N until it is paid out: `preload=3:0.8`.
    Preload(u8, f64),
    /// The loop of this unit's cell is so many mN wide: `hysteresis=3:8`. See [`Cells`].
    Hysteresis(u8, f64),
    /// The scale of this unit's cell scatters by so many percent from one mounting to the next
    /// (standard deviation): `remount=3:0.05`. See [`Cells`].
    Remount(u8, f64),
}

impl FromStr for Mistake {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!("`{text}` is no mistake of a stand-in; known are weight=ASKED:HUNG (g, as in weight=50:500), bump=STATION:MM (as in bump=B:3), preload=UNIT:N (as in preload=3:0.8), and for --iso-376 hysteresis=UNIT:MN (as in hysteresis=3:8) and remount=UNIT:PERCENT (as in remount=3:0.05)")
        };
        let (kind, rest) = text.split_once('=').ok_or_else(wrong)?;
        let (first, second) = rest.split_once(':').ok_or_else(wrong)?;
        let number = |text: &str| {
            text.parse::<f64>()
                .ok()
                .filter(|v| v.is_finite() && (0.0..=3000.0).contains(v))
                .ok_or_else(wrong)
        };
        match kind {
            "weight" => Ok(Self::Weight(number(first)?, number(second)?)),
            "preload" => match (first.parse(), number(second)?) {
                (Ok(unit @ 1..=6), n) if n <= 12.0 => Ok(Self::Preload(unit, n)),
                _ => Err(wrong()),
            },
            "hysteresis" | "remount" => match (first.parse(), number(second)?) {
                (Ok(unit @ 1..=6), n) if kind == "hysteresis" && n <= 500.0 => {
                    Ok(Self::Hysteresis(unit, n))
                }
                (Ok(unit @ 1..=6), n) if kind == "remount" && n <= 2.0 => {
                    Ok(Self::Remount(unit, n))
                }
                _ => Err(wrong()),
            },
            "bump" if !first.is_empty() => Ok(Self::Bump(first.to_owned(), number(second)?)),
            _ => Err(wrong()),
        }
    }
}

/// A set of weights, in air: each has its error, the same whenever it is hung. Half of its class's
/// limit is for an error that the set shares, half for one of its own.
#[derive(Debug, Clone)]
pub struct Weights {
    seed: u64,
    mistakes: Vec<(f64, f64)>,
}

impl Weights {
    /// The set that belongs to a rig's seed.
    #[must_use]
    pub fn new(seed: u64, mistakes: &[Mistake]) -> Self {
        Self {
            seed,
            mistakes: mistakes
                .iter()
                .filter_map(|m| match m {
                    Mistake::Weight(asked, hung) => Some((*asked, *hung)),
                    _ => None,
                })
                .collect(),
        }
    }

    /// Force of the weight that is hung where this one is asked for (g), N. A mistake is made once.
    pub fn force_n(&mut self, weight_g: f64) -> f64 {
        let at = self
            .mistakes
            .iter()
            .position(|(asked, _)| *asked == weight_g);
        let hung = at.map_or(weight_g, |at| self.mistakes.remove(at).1);
        let mut own = SplitMix64::stream(self.seed, "weights", (hung * 1000.0) as usize);
        let mut set = SplitMix64::stream(self.seed, "set of weights", 0);
        let error = 0.5 * (own.uniform(-1.0, 1.0) + set.uniform(-1.0, 1.0));
        let mass_g = hung + error * CLASS.limit_g(hung);
        1e-3 * mass_g * gravity::STANDARD_M_PER_S2 * (1.0 - gravity::AIR_BUOYANCY)
    }
}

/// Load cells that are taken out and mounted anew, with what the plant's cells don't have: a loop
/// between rising and falling loads, and a scale and a zero that are others with each mounting. A
/// cell of the plant is pulled with what such a cell would feel.
///
/// Sizes are drawn by the rig's seed: loops of up to 10 mN, scales that scatter by up to 0.03 %,
/// and zeros by up to 10 mN. These are small S-shaped cells of 0.1 % (estimates). Creep is the
/// plant's (`[[effects]]` with `kind = "creep"`).
#[derive(Debug, Clone)]
pub struct Cells {
    seed: u64,
    loop_n: [f64; 6],
    remount_sd: [f64; 6],
    mounting: u16,
    peak_n: [f64; 6],
}

impl Cells {
    /// The cells of a rig's seed.
    #[must_use]
    pub fn new(seed: u64, mistakes: &[Mistake]) -> Self {
        let mut draw = SplitMix64::stream(seed, "cells mounted anew", 0);
        let mut out = Self {
            seed,
            loop_n: std::array::from_fn(|_| draw.uniform(0.0, 0.01)),
            remount_sd: std::array::from_fn(|_| draw.uniform(0.0, 3e-4)),
            mounting: 0,
            peak_n: [0.0; 6],
        };
        for mistake in mistakes {
            match *mistake {
                Mistake::Hysteresis(unit, mn) => out.loop_n[usize::from(unit) - 1] = 1e-3 * mn,
                Mistake::Remount(unit, part) => {
                    out.remount_sd[usize::from(unit) - 1] = 0.01 * part;
                }
                _ => {}
            }
        }
        out
    }

    /// The cells are taken out and mounted in another position (degrees).
    pub fn turn(&mut self, degrees: u16) {
        self.mounting = degrees;
        self.peak_n = [0.0; 6];
    }

    /// Scale of a unit's cell in the present mounting against the mean, and its zero, N: for tests
    /// too.
    #[must_use]
    pub fn mounting(&self, unit: u8) -> (f64, f64) {
        let stream = 1000 * usize::from(unit) + usize::from(self.mounting);
        let mut draw = SplitMix64::stream(self.seed, "a mounting", stream);
        let scale = self.remount_sd[usize::from(unit) - 1] * draw.normal_within(FURTHEST);
        (scale, draw.uniform(0.0, 0.01))
    }

    /// What the cell of a unit feels under a load, N. The loop opens on the way down from the
    /// largest load since the cell was empty.
    pub fn feels_n(&mut self, unit: u8, load_n: f64) -> f64 {
        let peak = &mut self.peak_n[usize::from(unit) - 1];
        *peak = if load_n == 0.0 { 0.0 } else { peak.max(load_n) };
        let open = if *peak > 0.0 {
            4.0 * self.loop_n[usize::from(unit) - 1] * load_n * (*peak - load_n) / (*peak * *peak)
        } else {
            0.0
        };
        let (scale, zero_n) = self.mounting(unit);
        zero_n + (load_n + open) * (1.0 + scale)
    }
}

/// A digitizer in the room of an emulated rig.
#[derive(Debug)]
pub struct Digitizer {
    points_m: BTreeMap<Label, Vector3<f64>>,
    stations: BTreeMap<String, Pose>,
    units: Vec<(Vector3<f64>, Vector3<f64>)>,
    noise: SplitMix64,
    seed: u64,
    bump: Option<(String, f64)>,
    touched: BTreeMap<String, usize>,
}

impl Digitizer {
    /// The room of a rig's seed and plant (`None`: the rig of the thesis).
    ///
    /// # Errors
    /// The plant's configuration can't be.
    pub fn new(seed: u64, plant: Option<PlantConfig>) -> Result<Self, String> {
        let plant = Plant::new(plant.unwrap_or_default(), seed).map_err(|e| e.to_string())?;
        let units: Vec<(Vector3<f64>, Vector3<f64>)> = (0..plant.units())
            .map(|i| {
                let p = plant.parameters(i);
                (p.position_m.into(), p.axis.into())
            })
            .collect();
        let mut rng = SplitMix64::stream(seed, "digitizer room", 0);
        let mut points_m: BTreeMap<Label, Vector3<f64>> = BASE
            .iter()
            .map(|(name, at)| (Label::Base((*name).to_owned()), Vector3::from(*at)))
            .collect();
        for plate in 1..=3u8 {
            // On a circle around the robot.
            let angle = 0.6 + 1.4 * f64::from(plate);
            let middle = Vector3::new(
                0.4 * angle.cos() - 0.08,
                0.4 * angle.sin(),
                -0.1 - 0.05 * f64::from(plate),
            );
            let turn = se3::exp(&Vector6::new(
                0.0,
                0.0,
                0.0,
                0.2 * rng.normal_within(FURTHEST),
                0.2 * rng.normal_within(FURTHEST),
                rng.normal_within(FURTHEST),
            ));
            for hole in 1..=4u8 {
                let at = std::f64::consts::TAU * f64::from(hole) / 4.0;
                let flat = Vector3::new(at.cos(), at.sin(), 0.0) * PLATE_RADIUS_M;
                points_m.insert(Label::Plate { plate, hole }, middle + turn.apply(&flat));
            }
        }
        for (i, (exit, axis)) in units.iter().enumerate() {
            let unit = i as u8 + 1;
            points_m.insert(Label::Exit { unit }, *exit);
            // Three points on the face of the cell, counter-clockwise seen from the workspace.
            let across = axis.cross(&Vector3::new(0.3, 0.9, 0.4)).normalize();
            let other = axis.cross(&across);
            let middle = exit - axis * 0.06;
            for point in 1..=3u8 {
                let at = std::f64::consts::TAU * f64::from(point) / 3.0;
                let flat = (across * at.cos() + other * at.sin()) * CELL_RADIUS_M;
                points_m.insert(Label::Cell { unit, point }, middle + flat);
            }
        }
        let mut out = Self {
            points_m,
            stations: BTreeMap::new(),
            units,
            noise: SplitMix64::stream(seed, "digitizer noise", 0),
            seed,
            bump: None,
            touched: BTreeMap::new(),
        };
        for name in ["A", "B", "C", "D"] {
            let mut rng = SplitMix64::stream(seed, name, 1);
            let pose = se3::exp(&Vector6::from_fn(|i, _| {
                [0.3, 0.3, 0.3, 0.2, 0.2, 2.0][i] * rng.normal_within(FURTHEST)
            }));
            out.stations.insert(name.to_owned(), pose);
        }
        Ok(out)
    }

    /// Makes a mistake from now on.
    pub fn inject(&mut self, mistake: &Mistake) {
        if let Mistake::Bump(station, mm) = mistake {
            self.bump = Some((station.clone(), *mm));
        }
    }

    /// Names of the base holes that the CAD model has.
    #[must_use]
    pub fn base_holes(&self) -> Vec<String> {
        BASE.iter().map(|(name, _)| (*name).to_owned()).collect()
    }

    /// The CAD model's holes as a table.
    #[must_use]
    pub fn base_csv(&self) -> String {
        let mut out = "label,x_mm,y_mm,z_mm\n".to_owned();
        for (name, at) in BASE {
            let [x, y, z] = at.map(|v| 1e3 * v);
            out.push_str(&format!("base_{name},{x},{y},{z}\n"));
        }
        out
    }

    /// What the digitizer types when a point is touched from a station: `x y z` in mm. `None`:
    /// there is no such point or station.
    pub fn touch(&mut self, station: &str, label: &str) -> Option<String> {
        let at = *self.points_m.get(&Label::parse(label)?)?;
        let pose = *self.stations.get(station)?;
        let count = self.touched.entry(station.to_owned()).or_default();
        *count += 1;
        let mut seen = pose.apply(&at);
        if let Some((_, mm)) = self.bump.as_ref().filter(|(name, _)| name == station) {
            if *count > BUMP_AFTER {
                let mut rng = SplitMix64::stream(self.seed, "bump", 0);
                let way = Vector3::from_fn(|_, _| rng.normal_within(FURTHEST)).normalize();
                seen += way * (1e-3 * mm);
            }
        }
        seen += Vector3::from_fn(|_, _| self.noise.normal()) * DIGITIZER_SD_M;
        let mm = seen * 1e3;
        Some(format!("{:.3} {:.3} {:.3}", mm.x, mm.y, mm.z))
    }

    /// True exit point (m) and axis of a unit, from 1: for tests.
    #[must_use]
    pub fn unit(&self, number: u8) -> (Vector3<f64>, Vector3<f64>) {
        self.units[usize::from(number) - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mistakes_are_read_and_made_once() {
        assert_eq!("weight=50:500".parse(), Ok(Mistake::Weight(50.0, 500.0)));
        assert_eq!("bump=B:3".parse(), Ok(Mistake::Bump("B".into(), 3.0)));
        assert_eq!("preload=3:0.8".parse(), Ok(Mistake::Preload(3, 0.8)));
        for bad in [
            "weight=50",
            "bump=:3",
            "x=1:2",
            "weight=a:2",
            "weight=50:-1",
            "preload=7:1",
            "preload=3:40",
            "hysteresis=0:4",
            "remount=3:5",
            "",
        ] {
            let told = bad.parse::<Mistake>().unwrap_err();
            assert!(told.contains("weight=ASKED:HUNG"), "{told}");
        }
        let mut weights = Weights::new(7, &[Mistake::Weight(50.0, 500.0)]);
        let wrong = weights.force_n(50.0);
        let right = weights.force_n(50.0);
        assert!((wrong / 4.903 - 1.0).abs() < 2e-3 && (right / 0.4903 - 1.0).abs() < 2e-3);
        assert_eq!(right, weights.force_n(50.0));
        assert_eq!(weights.force_n(0.0), 0.0);
    }

    #[test]
    fn a_cell_has_a_loop_and_another_scale_in_each_mounting() {
        let given = [
            "hysteresis=3:8".parse().unwrap(),
            "remount=3:0.1".parse().unwrap(),
        ];
        let mut cells = Cells::new(7, &given);
        let (scale, zero) = cells.mounting(3);
        let up = cells.feels_n(3, 4.9);
        assert!((up - zero - 4.9 * (1.0 + scale)).abs() < 1e-12);
        let _ = cells.feels_n(3, 9.8);
        // The loop is widest in the middle.
        let down = cells.feels_n(3, 4.9);
        assert!((down - up - 8e-3 * (1.0 + scale)).abs() < 1e-12);
        assert_eq!(cells.feels_n(3, 0.0), zero);
        assert_eq!(cells.feels_n(3, 4.9), up);
        cells.turn(120);
        assert!(cells.mounting(3) != (scale, zero));
        assert_eq!(cells.feels_n(3, 0.0), cells.mounting(3).1);
        let scales: Vec<f64> = (0..300)
            .map(|degrees| {
                cells.turn(degrees);
                cells.mounting(3).0
            })
            .collect();
        let sd = (scales.iter().map(|s| s * s).sum::<f64>() / 300.0).sqrt();
        assert!((8e-4..1.2e-3).contains(&sd), "{sd}");
    }

    #[test]
    fn the_digitizer_knows_its_points_only() {
        let mut digitizer = Digitizer::new(1, None).unwrap();
        assert!(digitizer.touch("A", "base_1").is_some());
        assert!(digitizer.touch("E", "base_1").is_none());
        assert!(digitizer.touch("A", "plate9_1").is_none());
        assert!(digitizer.touch("A", "nonsense").is_none());
    }
}
