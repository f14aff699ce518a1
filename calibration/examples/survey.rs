//! Exit points and axes from the points of a digitizer, without forcectl:
//!
//! `cargo run -p calibration --example survey -- points.csv base.csv`
//!
//! Both tables have the columns `label`, `x_mm`, `y_mm`, `z_mm`; the points also `station`. Exit
//! code 1: the points do not fit together; the message names them.

use calibration::geometry::{self, Options};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut paths = std::env::args().skip(1);
    let (Some(points), Some(base)) = (paths.next(), paths.next()) else {
        return Err("name the points and the holes of the base: survey points.csv base.csv".into());
    };
    let read =
        |path: &str| std::fs::read_to_string(path).map_err(|error| format!("{path}: {error}"));
    let readings = geometry::read_points(&points, &read(&points)?)?;
    let reference = geometry::read_reference(&base, &read(&base)?, 0.0)?;
    let survey = geometry::survey(&readings, &reference, &Options::default())?;
    for unit in &survey.units {
        let [x, y, z] = [0, 1, 2].map(|i| 1e3 * unit.exit_m[i]);
        println!(
            "unit {}: exit point ({x:.2} {y:.2} {z:.2}) mm +- {:.2} mm, axis +- {:.2} degrees",
            unit.unit,
            1e3 * unit.exit_sd_m(),
            unit.axis_sd_rad().to_degrees()
        );
    }
    println!(
        "the points show a digitizer of {:.3} mm (p {:.2})",
        1e3 * survey.sd_estimate_m,
        survey.p
    );
    Ok(())
}
