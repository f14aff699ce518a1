//! Exit points and axes from a digitizer: which points to touch in which order, and the survey put
//! into the record.

use super::{CalibrateError, Result};
use calibration::geometry::{self, GeometryError, Options, Survey};
use calibration::record::Record;
use nalgebra::Vector3;
use rig::Rig;

/// Header of the points; `calibration::geometry::read_points` takes it.
pub const HEADER: &str = "label,x_mm,y_mm,z_mm,station";
/// Stations of the plan: the first sees the base, each further one the plates before and after it,
/// the last one the base again.
const STATIONS: [&str; 4] = ["A", "B", "C", "D"];
/// Calibration plates between them.
const PLATES: u8 = 3;
/// Holes of a plate.
const HOLES: u8 = 4;

/// The points to touch, station by station: the closed layout of docs/calibration/figures.md. Each
/// unit is touched from two stations.
#[must_use]
pub fn plan(base_holes: &[String], units: &[u8], touches: usize) -> Vec<(String, String)> {
    let mut out = Vec::new();
    let count = STATIONS.len();
    for (s, station) in STATIONS.iter().enumerate() {
        let mut labels: Vec<String> = Vec::new();
        if s == 0 || s + 1 == count {
            labels.extend(base_holes.iter().map(|name| format!("base_{name}")));
        }
        for plate in 1..=PLATES {
            if usize::from(plate) == s || usize::from(plate) == s + 1 {
                labels.extend((1..=HOLES).map(|hole| format!("plate{plate}_{hole}")));
            }
        }
        for (i, unit) in units.iter().enumerate() {
            let home = i * count / units.len();
            if home == s || (home + 1) % count == s {
                labels.push(format!("unit{unit}_exit"));
                labels.extend((1..=3).map(|point| format!("unit{unit}_cell{point}")));
            }
        }
        for _ in 0..touches {
            out.extend(
                labels
                    .iter()
                    .map(|label| ((*station).to_owned(), label.clone())),
            );
        }
    }
    out
}

/// A row of the points file from what a digitizer typed: three numbers in mm, parted by blanks,
/// commas, semicolons or tabs.
///
/// # Errors
/// What is wrong with the line.
pub fn row(typed: &str, label: &str, station: &str) -> std::result::Result<String, String> {
    let cells: Vec<&str> = typed
        .split([' ', ',', ';', '\t'])
        .filter(|cell| !cell.is_empty())
        .collect();
    let numbers: Option<Vec<f64>> = cells
        .iter()
        .map(|cell| cell.parse().ok().filter(|v: &f64| v.is_finite()))
        .collect();
    match numbers.as_deref() {
        Some([x, y, z]) => Ok(format!("{label},{x},{y},{z},{station}")),
        _ => Err(format!(
            "`{}` is not a point: three finite numbers in mm, for example 103.2 -20.15 341.0",
            typed.trim()
        )),
    }
}

/// The survey of a table of points.
///
/// # Errors
/// Text that can't be read, with file and line; points that do not fit together, named by
/// likelihood.
pub fn survey(
    points: (&str, &str),
    base: (&str, &str),
    rig: &Rig,
    digitizer_sd_m: f64,
    hole_sd_m: f64,
) -> Result<Survey> {
    let readings = geometry::read_points(points.0, points.1).map_err(CalibrateError::input)?;
    let reference =
        geometry::read_reference(base.0, base.1, hole_sd_m).map_err(CalibrateError::input)?;
    let options = Options {
        digitizer_sd_m,
        workspace_center_m: Some(rig.workspace.center_m),
        ..Options::default()
    };
    geometry::survey(&readings, &reference, &options).map_err(|error| match error {
        // Each fault that is found in a mirrored table has a false name.
        GeometryError::Faults(_) if geometry::is_mirrored(&readings, &reference, &options) => {
            CalibrateError::refused(format!(
                "{0}: the whole table is mirrored against {1}: the points fit together once one axis is turned round. Two columns are exchanged, or one has the wrong sign, in all lines of {0} (or of {1}); correct them",
                points.0, base.0
            ))
        }
        GeometryError::Faults(_) => CalibrateError::refused(format!(
            "{}: the points do not fit together\n{error}\nto leave out line N: --leave-out N",
            points.0
        )),
        GeometryError::NotFinite { .. } | GeometryError::UnknownHole { .. } => {
            CalibrateError::input(error)
        }
        other => CalibrateError::refused(format!("{}: {other}", points.0)),
    })
}

/// A table of points without the lines that the user leaves out. They stay as blank lines: the
/// others keep their numbers.
///
/// # Errors
/// A line that no point stands in.
pub fn without_lines(file: &str, text: &str, left_out: &[usize]) -> Result<String> {
    let mut lines: Vec<&str> = text.lines().collect();
    let is_row = |line: &str| !line.trim().is_empty() && !line.trim_start().starts_with('#');
    let header = lines.iter().position(|line| is_row(line)).unwrap_or(0);
    let rows: Vec<bool> = lines.iter().map(|line| is_row(line)).collect();
    for &line in left_out {
        let at = line.wrapping_sub(1);
        if at <= header || !rows.get(at).is_some_and(|row| *row) {
            return Err(CalibrateError::input(format!(
                "{file}: no point stands in line {line}, which is to be left out"
            )));
        }
        lines[at] = "";
    }
    Ok(lines.join("\n") + "\n")
}

/// Largest change of an exit point that is taken without a question, m: no unit is touched up by
/// that much.
const SMALL_CHANGE_M: f64 = 0.05;
/// An exit point that is by this factor nearer to where another unit was is that unit's.
const NEARER: f64 = 3.0;

/// How far the exit point of each unit of a survey is from where the record has it, m.
#[must_use]
pub fn changes_m(record: &Record, survey: &Survey) -> Vec<(u8, f64)> {
    let changes = survey.units.iter().filter_map(|found| {
        let old = record.units.iter().find(|u| u.number == found.unit)?;
        Some((
            found.unit,
            (found.exit_m - Vector3::from(old.exit_m)).norm(),
        ))
    });
    changes.collect()
}

/// Compares the exit points with those of the record: labels of two units that are exchanged
/// everywhere fit together.
///
/// # Errors
/// A unit that stands where another one was; all of them are named.
pub fn check_units(record: &Record, survey: &Survey) -> Result<()> {
    let mut wrong = Vec::new();
    for (number, change_m) in changes_m(record, survey) {
        let Some(found) = survey.units.iter().find(|unit| unit.unit == number) else {
            continue;
        };
        let others = record.units.iter().filter(|unit| unit.number != number);
        let nearest = others
            .map(|unit| {
                (
                    unit.number,
                    (found.exit_m - Vector3::from(unit.exit_m)).norm(),
                )
            })
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((other, distance_m)) = nearest else {
            continue;
        };
        if change_m > SMALL_CHANGE_M && NEARER * distance_m < change_m {
            wrong.push(format!(
                "unit {number}: its exit point is {:.0} mm from where it was, and {:.0} mm from where unit {other} was: these are probably the points of unit {other}; correct the labels, or --replace if the units were exchanged",
                1e3 * change_m,
                1e3 * distance_m
            ));
        }
    }
    if wrong.is_empty() {
        Ok(())
    } else {
        Err(CalibrateError::refused(wrong.join("\n")))
    }
}

/// Puts a survey into the record. Units that it has not seen keep what they have.
///
/// # Errors
/// The survey has a unit that the rig has not.
pub fn apply(record: &mut Record, survey: &Survey) -> Result<()> {
    let date = record.date.clone();
    let n = record.units.len();
    let mut all = record.geometry_covariance();
    let mut place = Vec::new();
    for unit in &survey.units {
        let at = record
            .units
            .iter()
            .position(|u| u.number == unit.unit)
            .ok_or_else(|| CalibrateError::input(format!("the rig has no unit {}", unit.unit)))?;
        let found = &mut record.units[at];
        found.exit_m = unit.exit_m.into();
        found.axis = unit.axis.into();
        found.geometry_date.clone_from(&date);
        place.push(at);
    }
    for (i, &a) in place.iter().enumerate() {
        // What was correlated with the old estimate of this unit is not with the new one.
        for b in (0..n).filter(|b| !place.contains(b)) {
            all.view_mut((6 * a, 6 * b), (6, 6)).fill(0.0);
            all.view_mut((6 * b, 6 * a), (6, 6)).fill(0.0);
        }
        for (j, &b) in place.iter().enumerate() {
            let block = survey.covariance.view((6 * i, 6 * j), (6, 6));
            all.view_mut((6 * a, 6 * b), (6, 6)).copy_from(&block);
        }
    }
    record.set_geometry_covariance(&all);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::standin::Digitizer;
    use known::base;

    fn digitized(inject: Option<&str>, touches: usize) -> (String, String) {
        let rig = Rig::built_in().unwrap();
        let mut digitizer = Digitizer::new(3, None).unwrap();
        if let Some(what) = inject {
            digitizer.inject(&what.parse().unwrap());
        }
        let units: Vec<u8> = rig.units.iter().map(|u| u.number).collect();
        let mut text = format!("{HEADER}\n");
        for (station, label) in plan(&digitizer.base_holes(), &units, touches) {
            let point = digitizer.touch(&station, &label).unwrap();
            text.push_str(&row(&point, &label, &station).unwrap());
            text.push('\n');
        }
        (text, digitizer.base_csv())
    }

    #[test]
    fn the_survey_finds_the_plant_behind_the_stand_in() {
        let rig = Rig::built_in().unwrap();
        let (points, base_csv) = digitized(None, 10);
        let found = survey(("p.csv", &points), ("b.csv", &base_csv), &rig, 2e-4, 0.0).unwrap();
        let truth = Digitizer::new(3, None).unwrap();
        let mut record = base::nominal(&rig, "2026-11-22");
        apply(&mut record, &found).unwrap();
        for unit in &record.units {
            let (exit, axis) = truth.unit(unit.number);
            let error = (nalgebra::Vector3::from(unit.exit_m) - exit).norm();
            assert!(error < 6e-4, "unit {}: {error}", unit.number);
            assert!(nalgebra::Vector3::from(unit.axis).dot(&axis) > 0.999_9);
            assert_eq!(unit.geometry_date, "2026-11-22");
        }
        assert!(!record.cross.is_empty());
        record.write().unwrap();
    }

    #[test]
    fn bad_points_are_named_with_file_and_line() {
        let rig = Rig::built_in().unwrap();
        let (points, base_csv) = digitized(None, 1);
        let fails = |points: &str| {
            survey(("p.csv", points), ("b.csv", &base_csv), &rig, 2e-4, 0.0)
                .unwrap_err()
                .to_string()
        };
        assert!(fails("").contains("p.csv: the file is empty"));
        let text = points.replacen("base_1,", "base_1,x", 1);
        assert!(fails(&text).starts_with("p.csv:2: `x"), "{}", fails(&text));
        let mut lines: Vec<String> = points.lines().map(str::to_owned).collect();
        lines[4] = "base_4,nan,1,2,A".to_owned();
        assert!(fails(&lines.join("\n")).starts_with("p.csv:5: `nan`"));
        // Millimetres that claim to be metres.
        let metres = points.replacen("x_mm,y_mm,z_mm", "x_m,y_m,z_m", 1);
        let told = fails(&metres);
        assert!(told.contains("0.001") || told.contains("mm"), "{told}");
        // A row that was pasted twice.
        let mut twice: Vec<String> = points.lines().map(str::to_owned).collect();
        twice.push(twice[9].clone());
        let told = fails(&twice.join("\n"));
        assert!(told.contains(&format!("p.csv:{}", twice.len())), "{told}");
        // Station C without a plate in common with the others.
        let lonely: Vec<&str> = points
            .lines()
            .filter(|line| !(line.ends_with(",C") && line.starts_with("plate")))
            .filter(|line| {
                !(line.ends_with(",C") && line.starts_with("unit")) || line.starts_with("unit4")
            })
            .filter(|line| !line.starts_with("unit4") || line.ends_with(",C"))
            .collect();
        let told = fails(&lonely.join("\n"));
        assert!(
            told.contains("station `C`") && told.contains("p.csv:"),
            "{told}"
        );
        for (bad, what) in [("1 2", "three"), ("1 2 x", "three"), ("1 2 inf", "three")] {
            assert!(row(bad, "base_1", "A").unwrap_err().contains(what));
        }
        assert_eq!(
            row(" 1.5; -2,3\t", "base_1", "A").unwrap(),
            "base_1,1.5,-2,3,A"
        );
    }

    #[test]
    fn points_of_two_units_under_each_others_labels_are_named() {
        let rig = Rig::built_in().unwrap();
        let (points, base_csv) = digitized(None, 1);
        let find = |points: &str| {
            survey(("p.csv", points), ("b.csv", &base_csv), &rig, 2e-4, 0.0).unwrap()
        };
        let mut record = base::nominal(&rig, "2026-11-22");
        let found = find(&points);
        // The rig file has each exit within some millimetres.
        check_units(&record, &found).unwrap();
        apply(&mut record, &found).unwrap();
        assert!(changes_m(&record, &found).iter().all(|(_, m)| *m == 0.0));
        let exchanged = points
            .replace("unit3_", "unitX_")
            .replace("unit4_", "unit3_")
            .replace("unitX_", "unit4_");
        let exchanged = find(&exchanged);
        let told = check_units(&record, &exchanged).unwrap_err().to_string();
        assert!(
            told.contains("unit 3:")
                && told.contains("probably the points of unit 4; correct the labels, or --replace")
                && told.contains("probably the points of unit 3"),
            "{told}"
        );
        assert!(!told.contains("unit 1:"), "{told}");
        // A unit that was moved to a new place stands where none was.
        record.units[0].exit_m[0] += 0.08;
        check_units(&record, &found).unwrap();
        let moved = changes_m(&record, &found)[0];
        assert!(moved.0 == 1 && (moved.1 - 0.08).abs() < 1e-12, "{moved:?}");
    }

    #[test]
    fn a_mirrored_table_is_told_as_a_whole() {
        let rig = Rig::built_in().unwrap();
        let (points, base_csv) = digitized(None, 1);
        let exchanged: Vec<String> = points
            .lines()
            .map(|line| {
                let mut cells: Vec<&str> = line.split(',').collect();
                if cells[0] != "label" {
                    cells.swap(1, 2);
                }
                cells.join(",")
            })
            .collect();
        let exchanged = exchanged.join("\n");
        let told = survey(("p.csv", &exchanged), ("b.csv", &base_csv), &rig, 2e-4, 0.0)
            .unwrap_err()
            .to_string();
        assert!(
            told.contains("p.csv: the whole table is mirrored"),
            "{told}"
        );
        assert!(!told.contains("p.csv:2"), "{told}");
    }

    #[test]
    fn a_bad_touch_is_left_out_and_the_others_keep_their_lines() {
        let rig = Rig::built_in().unwrap();
        let (points, base_csv) = digitized(None, 2);
        let mut lines: Vec<String> = points.lines().map(str::to_owned).collect();
        let mut cells: Vec<String> = lines[20].split(',').map(str::to_owned).collect();
        cells[1] = (cells[1].parse::<f64>().unwrap() + 40.0).to_string();
        lines[20] = cells.join(",");
        let text = lines.join("\n");
        let find = |text: &str| survey(("p.csv", text), ("b.csv", &base_csv), &rig, 2e-4, 0.0);
        let told = find(&text).unwrap_err().to_string();
        assert!(
            told.contains("p.csv:21") && told.contains("--leave-out N"),
            "{told}"
        );
        let corrected = without_lines("p.csv", &text, &[21]).unwrap();
        let found = find(&corrected).unwrap();
        assert!(found.residuals.iter().all(|r| r.at.line != 21));
        assert!(found.residuals.iter().any(|r| r.at.line == 22));
        let last = text.lines().count();
        for line in [0, 1, last + 1] {
            let told = without_lines("p.csv", &text, &[line])
                .unwrap_err()
                .to_string();
            assert!(
                told.contains(&format!("no point stands in line {line},")),
                "{told}"
            );
        }
        assert!(without_lines("p.csv", &text, &[21, 21]).is_ok());
        assert!(without_lines("p.csv", &corrected, &[21]).is_err());
    }

    #[test]
    fn a_bumped_station_is_named() {
        let rig = Rig::built_in().unwrap();
        let (points, base_csv) = digitized(Some("bump=B:3"), 1);
        let told = survey(("p.csv", &points), ("b.csv", &base_csv), &rig, 2e-4, 0.0)
            .unwrap_err()
            .to_string();
        assert!(told.contains("station `B` moved by about 3."), "{told}");
    }
}
