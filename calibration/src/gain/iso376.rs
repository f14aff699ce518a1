//! The procedure of ISO 376:2011 for force-proving instruments: its figures, their uncertainty and
//! the class that results.
//!
//! The cell is loaded to the largest force three times. Then come two rising series in one position
//! (X1, X2), and a rising series with a falling one in each of two further positions, 120 and 240
//! degrees about the axis (X3 with X'4, X5 with X'6). Each series begins and ends with the empty
//! cell. At last the largest force stays on for five minutes.
//!
//! A deflection is a code less the code of the empty cell before its series. Of one load:
//!
//! ```text
//! b  = (max - min) of X1, X3, X5 over their mean      reproducibility, the cell mounted anew
//! b' = |X2 - X1| over their mean                      repeatability, the cell untouched
//! fc = mean of X1, X3, X5 over the interpolated, less 1
//! v  = mean of |X'4 - X3| / X3 and |X'6 - X5| / X5    reversibility
//! ```
//!
//! and of the whole: the zero error f0, what the empty cell moved by over a series, and the creep c
//! from 30 to 300 s, both over the deflection at the largest force.
//!
//! The sequence, the formulas and the combination of the uncertainties ([`Load::u`]) are written
//! from memory of ISO 376:2011 (clauses 7 and 8, annex C) and EURAMET cg-4 (2011), 6.1; neither
//! text was at hand. The limits ([`Class::limits`]) of b, b', fc, f0 and c agree with those of a
//! calibration laboratory's public program. The limits of v and the combination were found in no
//! public source. Compare them with the standard before a certificate rests on them.

use super::{Gain, Options, Reading, Term};
use std::fmt;

/// Times that the largest force is put on before the first series.
pub const PRELOADS: usize = 3;
/// Loads that ask for an interpolation have at least so many different forces.
pub const LEAST_LOADS: usize = 8;
/// Weights of the procedure, g: eight sums of one weight each of 100, 200, 500 and 1000 g, 10 % to
/// 100 %.
pub const WEIGHTS_G: [f64; 8] = [100.0, 200.0, 300.0, 500.0, 600.0, 700.0, 800.0, 1000.0];
/// Times after a load came on between which creep counts, s.
pub const CREEP_S: (f64, f64) = (30.0, 300.0);
/// How far a reading may be from these times, s.
const CREEP_WITHIN_S: f64 = 5.0;
/// A class has to hold from half of the largest force on, or below.
const LEAST_RANGE: f64 = 0.5;
/// Below this part of the largest force no class is given.
const LOWEST: f64 = 0.02;

/// Class of a force-proving instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// Class 00, the best.
    Class00,
    /// Class 0.5.
    Class05,
    /// Class 1.
    Class1,
    /// Class 2.
    Class2,
}

/// Limits of a class, as parts of the force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Reproducibility b.
    pub reproducibility: f64,
    /// Repeatability b'.
    pub repeatability: f64,
    /// Interpolation error fc, either way.
    pub interpolation: f64,
    /// Zero error f0, either way.
    pub zero: f64,
    /// Reversibility v.
    pub reversibility: f64,
    /// Creep c.
    pub creep: f64,
    /// Expanded uncertainty of the calibrating force.
    pub force_95: f64,
    /// Least force, in resolutions.
    pub resolutions: f64,
}

impl Class {
    /// All classes, the best first.
    pub const ALL: [Self; 4] = [Self::Class00, Self::Class05, Self::Class1, Self::Class2];

    /// The limits. Where they come from: see the module.
    #[must_use]
    pub fn limits(self) -> Limits {
        // b, b', fc, f0, v, c, force in percent; resolutions.
        let (percent, resolutions) = match self {
            Self::Class00 => ([0.05, 0.025, 0.025, 0.012, 0.07, 0.025, 0.01], 4000.0),
            Self::Class05 => ([0.10, 0.05, 0.05, 0.025, 0.15, 0.05, 0.02], 2000.0),
            Self::Class1 => ([0.20, 0.10, 0.10, 0.05, 0.30, 0.10, 0.05], 1000.0),
            Self::Class2 => ([0.40, 0.20, 0.20, 0.10, 0.50, 0.20, 0.10], 500.0),
        };
        let [reproducibility, repeatability, interpolation, zero, reversibility, creep, force_95] =
            percent.map(|value| 0.01 * value);
        Limits {
            reproducibility,
            repeatability,
            interpolation,
            zero,
            reversibility,
            creep,
            force_95,
            resolutions,
        }
    }
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Class00 => "00",
            Self::Class05 => "0.5",
            Self::Class1 => "1",
            Self::Class2 => "2",
        })
    }
}

/// Figures of one load, relative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Calibrating force, N.
    pub force_n: f64,
    /// Reproducibility b.
    pub reproducibility: f64,
    /// Repeatability b'.
    pub repeatability: f64,
    /// Interpolation error fc, with its sign.
    pub interpolation: f64,
    /// Reversibility v.
    pub reversibility: f64,
    /// Expanded uncertainty of the calibrating force (weights, gravity, air, pulley), k = 2.
    pub force_95: f64,
    /// Combined standard uncertainty of a force of this size by this cell, mounted as in the
    /// calibration.
    pub u: f64,
}

/// Figures of a cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Of each load, the smallest first.
    pub loads: Vec<Load>,
    /// Largest zero error f0 of a series, relative to the largest deflection, with its sign.
    pub zero: f64,
    /// Creep c, relative to the largest deflection; `None` where no load stayed for 300 s.
    pub creep: Option<f64>,
    /// Resolution, N: two standard errors of a reading of the empty cell, or one code.
    pub resolution_n: f64,
    /// Degree of the interpolation: 1, or 2 where the fit has a curve.
    pub degree: usize,
}

/// A class with the range of forces in which it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Classified {
    /// The class.
    pub class: Class,
    /// Smallest force of the range, N.
    pub from_n: f64,
    /// Largest force of the range, N.
    pub to_n: f64,
}

/// What the readings lack for the figures.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Missing {
    /// A series without a load, or without the empty cell.
    #[error("ISO 376: series {series} has no reading of {weight_g} g; weigh it once more, or calibrate without --iso-376")]
    Reading {
        /// The series, as in the standard.
        series: u8,
        /// The weight, g; 0 for the empty cell.
        weight_g: f64,
    },
    /// Too few different loads.
    #[error("ISO 376: {found} different loads; an interpolation asks for {LEAST_LOADS} or more")]
    Loads {
        /// How many there are.
        found: usize,
    },
    /// A deflection that is none.
    #[error("ISO 376: the code does not rise with the load in series {series}")]
    Deflection {
        /// The series, as in the standard.
        series: u8,
    },
}

/// The readings of a procedure, by series.
struct Table<'r> {
    readings: &'r [Reading],
}

impl Table<'_> {
    fn of(&self, series: u8) -> impl DoubleEndedIterator<Item = &Reading> {
        (self.readings.iter()).filter(move |r| r.series == Some(series))
    }

    /// The empty cell before a series: a falling one has that of the rising one before it.
    fn before(&self, series: u8) -> Result<&Reading, Missing> {
        let rising = match series {
            4 => 3,
            6 => 5,
            other => other,
        };
        let weight_g = 0.0;
        let found = self.of(rising).find(|r| r.weight_g == weight_g);
        found.ok_or(Missing::Reading {
            series: rising,
            weight_g,
        })
    }

    /// The empty cell after a series.
    fn after(&self, series: u8) -> Result<&Reading, Missing> {
        let weight_g = 0.0;
        let before = self.before(series)?;
        let found = self.of(series).rfind(|r| r.weight_g == weight_g);
        found
            .filter(|r| r.at != before.at)
            .ok_or(Missing::Reading { series, weight_g })
    }

    /// Deflection of a load in a series, codes.
    fn deflection(&self, series: u8, weight_g: f64) -> Result<f64, Missing> {
        let before = self.before(series)?.code;
        let codes: Vec<f64> = (self.of(series))
            .filter(|r| r.weight_g == weight_g)
            .map(|r| r.code - before)
            .collect();
        if codes.is_empty() {
            return Err(Missing::Reading { series, weight_g });
        }
        let mean = codes.iter().sum::<f64>() / codes.len() as f64;
        if mean == 0.0 {
            return Err(Missing::Deflection { series });
        }
        Ok(mean)
    }

    /// Largest change of the code from 30 to 300 s after the load of the last series came on, or
    /// was taken off, codes.
    fn crept(&self, largest_g: f64) -> Option<f64> {
        let change = |weight_g: f64| -> Option<f64> {
            let age = |r: &Reading| Some(r.time_s? - r.since_s?);
            let near = |at_s: f64| {
                (self.of(super::reading::CREEP))
                    .filter(|r| r.weight_g == weight_g)
                    .filter_map(|r| Some(((age(r)? - at_s).abs(), r.code)))
                    .filter(|(off, _)| *off <= CREEP_WITHIN_S)
                    .min_by(|a, b| a.0.total_cmp(&b.0))
            };
            Some((near(CREEP_S.1)?.1 - near(CREEP_S.0)?.1).abs())
        };
        match (change(largest_g), change(0.0)) {
            (Some(on), Some(off)) => Some(on.max(off)),
            (on, off) => on.or(off),
        }
    }
}

/// Whether the readings are those of the procedure.
#[must_use]
pub fn is_procedure(readings: &[Reading]) -> bool {
    readings.iter().any(|r| r.series.is_some())
}

/// The figures of the procedure. `gain`: the fit of the same readings, `options`: those of the fit.
///
/// # Errors
/// [`Missing`] names what is not there.
pub fn figures(readings: &[Reading], gain: &Gain, options: &Options) -> Result<Figures, Missing> {
    let corrected = |r: &Reading| Reading {
        weight_g: *(options.corrections_g.get(&r.at.line)).unwrap_or(&r.weight_g),
        ..r.clone()
    };
    let readings: Vec<Reading> = (readings.iter())
        .filter(|r| !options.left_out.contains(&r.at.line))
        .map(corrected)
        .collect();
    let table = Table {
        readings: &readings,
    };
    let mut weights: Vec<f64> = (table.of(1)).map(|r| r.weight_g).collect();
    weights.retain(|weight| *weight > 0.0);
    weights.sort_by(f64::total_cmp);
    weights.dedup();
    if weights.len() < LEAST_LOADS {
        return Err(Missing::Loads {
            found: weights.len(),
        });
    }
    let largest_g = weights[weights.len() - 1];
    let degree = 1 + usize::from(gain.terms.contains_key(&Term::Quadratic));
    let mut means = Vec::new();
    for &weight_g in &weights {
        let x = |series| table.deflection(series, weight_g);
        let mean = (x(1)? + x(3)? + x(5)?) / 3.0;
        means.push((options.force_n(weight_g), mean));
    }
    let interpolated = interpolation(&means, degree);
    let largest = means[means.len() - 1].1;
    let mut zero: f64 = 0.0;
    for series in [1, 2, 4, 6] {
        let moved = table.after(series)?.code - table.before(series)?.code;
        let of = match series {
            4 => 3,
            6 => 5,
            other => other,
        };
        let error = moved / table.deflection(of, largest_g)?;
        if error.abs() > zero.abs() {
            zero = error;
        }
    }
    let creep = table
        .crept(largest_g)
        .map(|change| (change / largest).abs());
    let empty = readings.iter().filter(|r| r.weight_g == 0.0);
    let widest = empty.map(|r| r.standard_error_codes).fold(0.0, f64::max);
    let resolution_n = (2.0 * widest).max(1.0) / gain.codes_per_n.abs();
    // The part of a scale that changes with temperature, over the range of the series.
    let temperatures: Vec<f64> = readings.iter().filter_map(|r| r.temperature_c).collect();
    let span_k = temperatures
        .iter()
        .fold(f64::NEG_INFINITY, |a, b| a.max(*b))
        - temperatures.iter().fold(f64::INFINITY, |a, b| a.min(*b));
    let per_k = (gain.terms.get(&Term::SlopeTemperature))
        .map_or(0.0, |term| (term.value / gain.codes_per_n).abs());
    let temperature = if span_k > 0.0 {
        per_k * 0.5 * span_k / 3f64.sqrt()
    } else {
        0.0
    };
    let root3 = 3f64.sqrt();
    let mut loads = Vec::new();
    for (&weight_g, &(force_n, mean)) in weights.iter().zip(&means) {
        let x = |series| table.deflection(series, weight_g);
        let turned = [x(1)?, x(3)?, x(5)?];
        let spread = turned.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b))
            - turned.iter().fold(f64::INFINITY, |a, b| a.min(*b));
        let squares: f64 = turned.iter().map(|value| (value - mean).powi(2)).sum();
        let repeatability = (2.0 * (x(2)? - x(1)?) / (x(1)? + x(2)?)).abs();
        let interpolation = mean / interpolated(force_n) - 1.0;
        let opens =
            |rising: u8| -> Result<f64, Missing> { Ok((x(rising + 1)? / x(rising)? - 1.0).abs()) };
        // A falling series begins at the largest force.
        let reversibility = if weight_g == largest_g {
            0.0
        } else {
            0.5 * (opens(3)? + opens(5)?)
        };
        let force = options.force_relative_sd(weight_g);
        let parts = [
            force,
            (squares / 6.0).sqrt() / mean.abs(),
            repeatability / root3,
            resolution_n / force_n / 6f64.sqrt(),
            creep.unwrap_or(0.0) / root3,
            zero,
            temperature,
            interpolation,
            reversibility / root3,
        ];
        loads.push(Load {
            force_n,
            reproducibility: spread / mean.abs(),
            repeatability,
            interpolation,
            reversibility,
            force_95: 2.0 * force,
            u: parts.iter().map(|part| part * part).sum::<f64>().sqrt(),
        });
    }
    Ok(Figures {
        loads,
        zero,
        creep,
        resolution_n,
        degree,
    })
}

/// Least squares of deflections over forces through the origin, of degree 1 or 2.
fn interpolation(points: &[(f64, f64)], degree: usize) -> impl Fn(f64) -> f64 {
    let sum = |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|(f, x)| of(*f, *x)).sum::<f64>();
    let (s2, s3, s4) = (
        sum(&|f, _| f * f),
        sum(&|f, _| f.powi(3)),
        sum(&|f, _| f.powi(4)),
    );
    let (y1, y2) = (sum(&|f, x| f * x), sum(&|f, x| f * f * x));
    let determinant = s2 * s4 - s3 * s3;
    let (slope, bend) = if degree == 2 && determinant > 0.0 {
        (
            (y1 * s4 - y2 * s3) / determinant,
            (y2 * s2 - y1 * s3) / determinant,
        )
    } else {
        (y1 / s2, 0.0)
    };
    move |force| force * (slope + bend * force)
}

impl Figures {
    /// The names of the figures of a load that exceed the limits of a class.
    #[must_use]
    pub fn beyond(&self, load: &Load, class: Class) -> Vec<&'static str> {
        let limits = class.limits();
        let least_n =
            (limits.resolutions * self.resolution_n).max(LOWEST * self.largest_n() * (1.0 - 1e-9));
        [
            (
                "reproducibility b",
                load.reproducibility > limits.reproducibility,
            ),
            (
                "repeatability b'",
                load.repeatability > limits.repeatability,
            ),
            (
                "interpolation fc",
                load.interpolation.abs() > limits.interpolation,
            ),
            ("zero f0", self.zero.abs() > limits.zero),
            ("reversibility v", load.reversibility > limits.reversibility),
            ("creep c", self.creep.unwrap_or(0.0) > limits.creep),
            ("calibrating force", load.force_95 > limits.force_95),
            ("resolution", load.force_n < least_n),
        ]
        .into_iter()
        .filter_map(|(name, exceeds)| exceeds.then_some(name))
        .collect()
    }

    /// Largest force, N.
    #[must_use]
    pub fn largest_n(&self) -> f64 {
        self.loads.last().map_or(0.0, |load| load.force_n)
    }

    /// The range in which a class holds: from the largest force down to the last load within all
    /// limits.
    fn range(&self, class: Class) -> Option<Classified> {
        let holds = |load: &&Load| self.beyond(load, class).is_empty();
        let lowest = self.loads.iter().rev().take_while(holds).last()?;
        let to_n = self.largest_n();
        (lowest.force_n <= LEAST_RANGE * to_n * (1.0 + 1e-9)).then_some(Classified {
            class,
            from_n: lowest.force_n,
            to_n,
        })
    }

    /// The best class that holds over at least the upper half of the forces.
    #[must_use]
    pub fn class(&self) -> Option<Classified> {
        Class::ALL.into_iter().find_map(|class| self.range(class))
    }

    /// What stands in the way of the next better class (of class 2 where there is none): figures
    /// that exceed its limits in the upper half of the forces. Empty for class 00.
    #[must_use]
    pub fn in_the_way(&self) -> Vec<&'static str> {
        let wanted = match self.class().map(|found| found.class) {
            Some(Class::Class00) => return Vec::new(),
            Some(Class::Class05) => Class::Class00,
            Some(Class::Class1) => Class::Class05,
            Some(Class::Class2) => Class::Class1,
            None => Class::Class2,
        };
        let upper = LEAST_RANGE * self.largest_n() * (1.0 - 1e-9);
        let mut names: Vec<&'static str> = Vec::new();
        for load in self.loads.iter().filter(|load| load.force_n >= upper) {
            for name in self.beyond(load, wanted) {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
        }
        names
    }

    /// Largest of a figure over the loads of the class's range, of all loads where there is no
    /// class.
    #[must_use]
    pub fn largest(&self, of: impl Fn(&Load) -> f64) -> f64 {
        let from_n = self.class().map_or(0.0, |class| class.from_n);
        let within = self.loads.iter().filter(|load| load.force_n >= from_n);
        within.map(|load| of(load).abs()).fold(0.0, f64::max)
    }
}

impl Reading {
    /// Which mounting of the cell this reading was taken in, from 0.
    pub(super) fn mounting(&self) -> u8 {
        match self.series {
            Some(3 | 4) => 1,
            Some(5..) => 2,
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests;
