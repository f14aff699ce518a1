//! Where the units are: exit points and load-cell axes in the robot's base frame, from digitizer
//! points (thesis 3.5.2).
//!
//! [`survey`] does all of it: the joint estimate of all stations and points with covariances, the
//! chain of the thesis beside it ([`chain`]), and the search for faults in the points where they do
//! not fit together ([`faults`]). The labels and the tables are in [`points`].
//!
//! Uncertainties rest on the digitizer's standard deviation, which the caller gives. Whether the
//! points bear it out is told by [`Survey::p`] and [`Survey::sd_estimate_m`].

pub mod chain;
pub mod faults;
mod network;
pub mod points;
mod units;

#[cfg(test)]
#[path = "../../tests/common/scene.rs"]
pub(crate) mod testing;

pub use points::{read_points, read_reference, Label, PointReading, Reference};
pub use units::UnitGeometry;

use crate::input::Location;
use crate::stats;
use faults::Finding;
use nalgebra::{DMatrix, Matrix3, Vector3};
use network::{Items, Network, Solution, State};
use std::collections::BTreeMap;

/// What [`survey`] has to know besides the points.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Standard deviation of the digitizer in one coordinate, m. The MicroScribe MX with a hand on
    /// it: about 2e-4.
    pub digitizer_sd_m: f64,
    /// A point of the workspace, base frame, m: the axes point towards it. Without it they follow
    /// the right-hand rule over the cell points 1, 2, 3.
    pub workspace_center_m: Option<Vector3<f64>>,
    /// Faults are looked for where the p-value of all residuals is below this.
    pub alarm_level: f64,
    /// Whether the chain of the thesis gets covariances too (slower).
    pub chain_covariance: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            digitizer_sd_m: 2e-4,
            workspace_center_m: None,
            alarm_level: 1e-3,
            chain_covariance: true,
        }
    }
}

/// A surveyed rig.
#[derive(Debug, Clone)]
pub struct Survey {
    /// The units by the joint estimate.
    pub units: Vec<UnitGeometry>,
    /// Covariance of all units together, six rows a unit (`exit_m`, `axis`), in the order of
    /// [`Self::units`]. Errors of the stations are common to units, so it is not block-diagonal.
    pub covariance: DMatrix<f64>,
    /// The units by the chain of the thesis, or why it can't be followed.
    pub chain: Result<Vec<UnitGeometry>, GeometryError>,
    /// Position and covariance of each point, base frame, m and m^2.
    pub points: BTreeMap<Label, (Vector3<f64>, Matrix3<f64>)>,
    /// Chi-square of all residuals.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: usize,
    /// Probability of residuals at least as large.
    pub p: f64,
    /// Standard deviation of the digitizer that the residuals show, m; NaN without degrees of
    /// freedom.
    pub sd_estimate_m: f64,
    /// Residual of each reading, in the order given.
    pub residuals: Vec<PointResidual>,
}

/// What the joint estimate leaves of one reading.
#[derive(Debug, Clone, PartialEq)]
pub struct PointResidual {
    /// Where the reading was entered.
    pub at: Location,
    /// What was touched.
    pub label: Label,
    /// Station.
    pub station: String,
    /// Measured less expected, digitizer frame, m.
    pub residual_m: Vector3<f64>,
}

/// Why points give no geometry.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeometryError {
    /// An option that can't be used.
    #[error("{name} is {value}; it has to be finite and above 0 (hole_sd_m may be 0)")]
    BadOption {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A coordinate that is not finite.
    #[error("{at}: a coordinate is not a finite number")]
    NotFinite {
        /// The reading.
        at: Location,
    },
    /// A base hole that the CAD model doesn't have.
    #[error("{at}: the CAD model has no hole `{label}`; it has {known}")]
    UnknownHole {
        /// The reading.
        at: Location,
        /// The label.
        label: String,
        /// Labels that are known.
        known: String,
    },
    /// Nothing ties the points to the base.
    #[error("no station has measured three holes of the robot's base that the CAD model knows; measure base_... from at least one station")]
    NoBase,
    /// A station that shares too few points with the others.
    #[error("{at}: station `{station}` is not tied to the others: it shares {} with stations that are tied to the base; measure at least three common points that are not on a line, as the three holes of a plate", if .shared.is_empty() { "no point" } else { .shared.as_str() })]
    NotConnected {
        /// First reading of the station.
        at: Location,
        /// The station.
        station: String,
        /// Points it shares.
        shared: String,
    },
    /// A station whose common points lie on a line.
    #[error("{at}: the points {labels} that tie station `{station}` to the others lie on a line ({off_line_mm:.3} mm off it, no more than the digitizer's noise); they leave a rotation open: measure a further point off that line")]
    Collinear {
        /// First reading of the station.
        at: Location,
        /// The station.
        station: String,
        /// The points.
        labels: String,
        /// Root mean square distance from the best line, mm.
        off_line_mm: f64,
    },
    /// The chain of the thesis finds no plate to go on.
    #[error("{at}: no plate has its holes 1 to 3 measured both from station `{station}` and from a station that is tied to the base")]
    NoCommonPlate {
        /// First reading of the station.
        at: Location,
        /// The station.
        station: String,
    },
    /// A unit without one of its four points.
    #[error("unit {unit} has no point `{label}`; a unit needs its exit and three points on its load cell")]
    MissingPoint {
        /// The unit.
        unit: u8,
        /// The point.
        label: String,
    },
    /// Points of a cell on a line.
    #[error("the three cell points of unit {unit} lie on a line and have no normal; measure them again, far apart")]
    CellOnALine {
        /// The unit.
        unit: u8,
    },
    /// Points of a cell that give no axis: nearly on a line, or too near to each other.
    #[error("the cell points {labels} of unit {unit} give its axis to +-{sd_deg:.0} degrees only: they lie nearly on a line or too near to each other; measure them further apart")]
    VagueAxis {
        /// The unit.
        unit: u8,
        /// The points.
        labels: String,
        /// Standard deviation of the axis in its worst direction, degrees.
        sd_deg: f64,
    },
    /// The normal equations are singular.
    #[error("the points do not determine all stations; measure more common points")]
    Undetermined,
    /// The fit does not come to rest.
    #[error("the joint fit does not converge: points or a station are far off, and no single mistake that is known explains it; leave out one station after the other to find which")]
    NoConvergence,
    /// The points do not fit together, and this explains it.
    #[error("{}", faults::describe(.0))]
    Faults(Vec<Finding>),
}

/// Exit points and axes of all units, from readings of the digitizer.
///
/// # Errors
/// [`GeometryError`]. [`GeometryError::Faults`] names readings that do not fit; nothing is
/// estimated from them.
pub fn survey(
    readings: &[PointReading],
    reference: &Reference,
    options: &Options,
) -> Result<Survey, GeometryError> {
    check(options)?;
    let sd = options.digitizer_sd_m;
    let copies = faults::copies(readings, sd);
    if !copies.is_empty() {
        return Err(GeometryError::Faults(copies));
    }
    let items = Items::new(readings, reference)?;
    let network = Network::new(&items);
    let solution = network
        .initial(sd)
        .and_then(|start| network.solve(start, sd));
    let p = |s: &Solution| stats::chi_square_survival(s.chi_square, s.degrees_of_freedom);
    let solution = match solution {
        Ok(solution) if p(&solution) >= options.alarm_level => solution,
        Ok(_) => {
            return Err(GeometryError::Faults(faults::find(
                readings,
                &items,
                sd,
                options.alarm_level,
            )?))
        }
        Err(error) => {
            // A station in the wrong unit can look like one whose points all lie in one place, or
            // leave the fit no place to rest.
            let found = match error {
                GeometryError::Collinear { .. } | GeometryError::NoConvergence => {
                    faults::find(readings, &items, sd, options.alarm_level)?
                }
                _ => Vec::new(),
            };
            let unit = |f: &Finding| matches!(f.fault, faults::Fault::Unit { .. });
            return Err(if found.iter().any(unit) {
                GeometryError::Faults(found)
            } else {
                error
            });
        }
    };
    finish(readings, &network, &solution, options)
}

/// The Cramer-Rao bound of a survey: covariances of the units that no unbiased estimate can beat,
/// at true positions.
///
/// `readings` say which points are measured from which station how often; their coordinates only
/// start the search for the stations' poses and the bound is taken at the fit. Give noise-free
/// readings to get it at the truth.
///
/// # Errors
/// As [`survey`].
pub fn cramer_rao(
    readings: &[PointReading],
    reference: &Reference,
    options: &Options,
) -> Result<Vec<UnitGeometry>, GeometryError> {
    check(options)?;
    let items = Items::new(readings, reference)?;
    let network = Network::new(&items);
    let solution = network.solve(
        network.initial(options.digitizer_sd_m)?,
        options.digitizer_sd_m,
    )?;
    Ok(units_of(&items, &solution, options)?.0)
}

/// Whether points that do not fit the reference fit it once each is mirrored: two axes of the table
/// are exchanged, or one has the wrong sign.
#[must_use]
pub fn is_mirrored(readings: &[PointReading], reference: &Reference, options: &Options) -> bool {
    let sd = options.digitizer_sd_m;
    let mirrored: Vec<PointReading> = readings
        .iter()
        .cloned()
        .map(|mut reading| {
            reading.position_m.z = -reading.position_m.z;
            reading
        })
        .collect();
    let p = || {
        check(options)?;
        let items = Items::new(&mirrored, reference)?;
        let network = Network::new(&items);
        let solution = network.solve(network.initial(sd)?, sd)?;
        Ok::<f64, GeometryError>(stats::chi_square_survival(
            solution.chi_square,
            solution.degrees_of_freedom,
        ))
    };
    p().is_ok_and(|p| p >= options.alarm_level)
}

fn check(options: &Options) -> Result<(), GeometryError> {
    for (name, value) in [
        ("digitizer_sd_m", options.digitizer_sd_m),
        ("alarm_level", options.alarm_level),
    ] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(GeometryError::BadOption { name, value });
        }
    }
    Ok(())
}

fn units_of(
    items: &Items,
    solution: &Solution,
    options: &Options,
) -> Result<(Vec<UnitGeometry>, DMatrix<f64>), GeometryError> {
    let number = |label: &Label| items.landmarks.iter().position(|l| l == label);
    units::assemble(
        &items.landmarks,
        |label| number(label).map(|l| solution.state.landmarks_m[l]),
        |a, b| match (number(a), number(b)) {
            (Some(a), Some(b)) => solution.covariance(a, b),
            _ => Matrix3::zeros(),
        },
        options.workspace_center_m,
    )
}

fn finish(
    readings: &[PointReading],
    network: &Network<'_>,
    solution: &Solution,
    options: &Options,
) -> Result<Survey, GeometryError> {
    let items = network.data;
    let (units, covariance) = units_of(items, solution, options)?;
    let State { poses, landmarks_m } = &solution.state;
    let dof = solution.degrees_of_freedom;
    Ok(Survey {
        units,
        covariance,
        chain: chain::solve(
            network,
            options.digitizer_sd_m,
            options.workspace_center_m,
            options.chain_covariance,
        ),
        points: items
            .landmarks
            .iter()
            .enumerate()
            .filter(|(l, _)| network.groups.iter().any(|g| g.landmark == *l))
            .map(|(l, label)| (label.clone(), (landmarks_m[l], solution.covariance(l, l))))
            .collect(),
        chi_square: solution.chi_square,
        degrees_of_freedom: dof,
        p: stats::chi_square_survival(solution.chi_square, dof),
        sd_estimate_m: options.digitizer_sd_m * (solution.chi_square / dof as f64).sqrt(),
        residuals: readings
            .iter()
            .zip(&items.items)
            .map(|(r, item)| PointResidual {
                at: r.at.clone(),
                label: r.label.clone(),
                station: r.station.clone(),
                residual_m: item.position_m
                    - poses[item.station].apply(&landmarks_m[item.landmark]),
            })
            .collect(),
    })
}

#[cfg(test)]
mod tests;
