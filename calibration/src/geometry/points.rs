//! Digitizer points: what they are called, and how a table of them is read.
//!
//! Labels, capital or small, with `_`, `-`, `.` or a blank between the parts:
//!
//! | label | point |
//! | --- | --- |
//! | `base_1`, `base_a`, ... | a hole of the robot's base frame whose position the CAD model gives (thesis, figure 3.19) |
//! | `plate2_1` to `plate2_3` | hole 1 to 3 of calibration plate 2 (thesis, figure 3.21); further holes help the joint estimate |
//! | `unit4_exit` | where the cable of unit 4 meets its reel (P_Cable, thesis, figure 3.20) |
//! | `unit4_cell1` to `unit4_cell3` | three points on the face of the load cell (P_Loadcell) |

use crate::input::{InputError, Location, Table};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::fmt;

/// Units that a rig may have; a label with a higher number is a mistake.
pub const MAX_UNITS: u8 = 16;

/// What a point is.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Label {
    /// Hole of the robot's base, by the name that the CAD model gives.
    Base(String),
    /// Hole of a calibration plate.
    Plate {
        /// Plate, as numbered by the user.
        plate: u8,
        /// Hole, from 1.
        hole: u8,
    },
    /// Where the cable of a unit leaves its reel.
    Exit {
        /// Unit, from 1.
        unit: u8,
    },
    /// Point on the face of a unit's load cell.
    Cell {
        /// Unit, from 1.
        unit: u8,
        /// Point, 1 to 3.
        point: u8,
    },
}

impl Label {
    /// Reads a label; `None` for a text that is none.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let lower = text.trim().to_lowercase();
        let (first, second) = lower.split_once(['_', '-', '.', ' '])?;
        let number = |text: &str, most: u8| -> Option<u8> {
            let digits = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            let value: u8 = if digits {
                text.parse().ok()?
            } else {
                return None;
            };
            (1..=most).contains(&value).then_some(value)
        };
        if first == "base" {
            let name = !second.is_empty() && second.bytes().all(|b| b.is_ascii_alphanumeric());
            return name.then(|| Self::Base(second.to_owned()));
        }
        if let Some(plate) = first.strip_prefix("plate") {
            return Some(Self::Plate {
                plate: number(plate, 99)?,
                hole: number(second, 99)?,
            });
        }
        let unit = number(first.strip_prefix("unit")?, MAX_UNITS)?;
        if second == "exit" {
            return Some(Self::Exit { unit });
        }
        let point = number(second.strip_prefix("cell")?, 3)?;
        Some(Self::Cell { unit, point })
    }
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Base(name) => write!(f, "base_{name}"),
            Self::Plate { plate, hole } => write!(f, "plate{plate}_{hole}"),
            Self::Exit { unit } => write!(f, "unit{unit}_exit"),
            Self::Cell { unit, point } => write!(f, "unit{unit}_cell{point}"),
        }
    }
}

/// One touch of the digitizer.
#[derive(Debug, Clone, PartialEq)]
pub struct PointReading {
    /// What was touched.
    pub label: Label,
    /// Where, in the digitizer's frame at this station, m.
    pub position_m: Vector3<f64>,
    /// Name of the place where the digitizer stood.
    pub station: String,
    /// Where it was entered.
    pub at: Location,
}

/// Positions of the base holes in the robot's base frame, from the CAD model.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Position of each hole, m, by the name after `base_`.
    pub holes_m: BTreeMap<String, Vector3<f64>>,
    /// Standard deviation of a coordinate, m: how exactly the holes were made. 0 takes the CAD
    /// model as exact.
    pub hole_sd_m: f64,
}

/// Largest coordinate that makes sense, m: no digitizer arm reaches further, and a table in mm that
/// claims to be in m has coordinates in the hundreds. Not a test for units: see [`super::faults`].
const FURTHEST_M: f64 = 1e5;

/// Reads digitizer points from a table with the columns `label`, `x_mm`, `y_mm`, `z_mm` (or `x_m`,
/// `y_m`, `z_m`) and `station`. The unit has to be declared in the header. `file` is the name that
/// errors give.
///
/// # Errors
/// [`InputError`] with the line of the first cell that can't be used.
pub fn read_points(file: &str, text: &str) -> Result<Vec<PointReading>, InputError> {
    let table = Table::parse(file, text)?;
    let (columns, scale) = coordinate_columns(&table, &["label", "station"])?;
    let label = table.column("label")?;
    let station = table.column("station")?;
    table
        .rows()
        .iter()
        .map(|row| {
            let name = table.text(row, station);
            if name.is_empty() {
                return Err(table.bad_value(row, station, "each point needs the station it was measured from"));
            }
            Ok(PointReading {
                label: Label::parse(table.text(row, label)).ok_or_else(|| {
                    table.bad_value(
                        row,
                        label,
                        "a label is base_NAME, plateN_HOLE, unitN_exit or unitN_cell1 to unitN_cell3",
                    )
                })?,
                position_m: position(&table, row, &columns, scale)?,
                station: name.to_owned(),
                at: row.at.clone(),
            })
        })
        .collect()
}

/// Reads the base holes from a table with the columns `label` (`base_NAME`) and `x_mm`, `y_mm`,
/// `z_mm` (or `x_m`, ...). `hole_sd_m` as in [`Reference`].
///
/// # Errors
/// [`InputError`] with the line of the first cell that can't be used; a hole given twice is one.
pub fn read_reference(file: &str, text: &str, hole_sd_m: f64) -> Result<Reference, InputError> {
    let table = Table::parse(file, text)?;
    let (columns, scale) = coordinate_columns(&table, &["label"])?;
    let label = table.column("label")?;
    let mut holes_m = BTreeMap::new();
    for row in table.rows() {
        let Some(Label::Base(name)) = Label::parse(table.text(row, label)) else {
            return Err(table.bad_value(
                row,
                label,
                "the CAD model gives holes of the base: base_NAME",
            ));
        };
        if holes_m
            .insert(name, position(&table, row, &columns, scale)?)
            .is_some()
        {
            return Err(table.bad_value(row, label, "this hole is given twice"));
        }
    }
    Ok(Reference { holes_m, hole_sd_m })
}

fn coordinate_columns(table: &Table, others: &[&str]) -> Result<([usize; 3], f64), InputError> {
    for (unit, scale) in [("mm", 1e-3), ("m", 1.0)] {
        let names = ["x", "y", "z"].map(|axis| format!("{axis}_{unit}"));
        if table.find(&names[0]).is_some() {
            let mut known: Vec<&str> = others.to_vec();
            known.extend(names.iter().map(String::as_str));
            table.check_columns(&known)?;
            return Ok((
                [
                    table.column(&names[0])?,
                    table.column(&names[1])?,
                    table.column(&names[2])?,
                ],
                scale,
            ));
        }
    }
    // The header doesn't say in which unit: no guess.
    table.column("x_mm").map(|_| ([0; 3], 1.0))
}

fn position(
    table: &Table,
    row: &crate::input::Row,
    columns: &[usize; 3],
    scale: f64,
) -> Result<Vector3<f64>, InputError> {
    let mut out = Vector3::zeros();
    for (i, &column) in columns.iter().enumerate() {
        out[i] = table.number(row, column)? * scale;
        if out[i].abs() > FURTHEST_M {
            return Err(table.bad_value(row, column, "no digitizer reaches that far"));
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn labels_are_read_in_any_spelling() {
        for (text, want) in [
            ("Base_A1", Some(Label::Base("a1".into()))),
            ("plate2.3", Some(Label::Plate { plate: 2, hole: 3 })),
            ("UNIT6 exit", Some(Label::Exit { unit: 6 })),
            ("unit1-cell3", Some(Label::Cell { unit: 1, point: 3 })),
            ("unit1_cell4", None),
            ("unit0_exit", None),
            ("unit+1_exit", None),
            ("base_", None),
            ("plate1", None),
            ("", None),
        ] {
            assert_eq!(Label::parse(text), want, "{text}");
        }
    }

    #[test]
    fn units_are_declared_and_mistakes_named() {
        let mm = read_points(
            "p.csv",
            "label,x_mm,y_mm,z_mm,station\nbase_1,100,200,-300,A\n",
        )
        .unwrap();
        let m = read_points(
            "p.csv",
            "label;x_m;y_m;z_m;station\nbase_1;0.1;0.2;-0.3;A\n",
        )
        .unwrap();
        assert!((mm[0].position_m - m[0].position_m).norm() < 1e-15);
        let message = |text: &str| read_points("p.csv", text).unwrap_err().to_string();
        assert!(message("label,x,y,z,station\nbase_1,1,2,3,A\n").contains("no column `x_mm`"));
        assert!(
            message("label,x_mm,y_mm,z_mm,station\n\nbase_1,1,two,3,A\n")
                .starts_with("p.csv:3: `two`")
        );
        assert!(message("label,x_mm,y_mm,z_mm,station\nbase_1,1,nan,3,A\n")
            .starts_with("p.csv:2: `nan`"));
        assert!(message("label,x_mm,y_mm,z_mm,station\nbas_1,1,2,3,A\n")
            .starts_with("p.csv:2: `bas_1`"));
        assert!(message("label,x_mm,y_mm,z_mm,station\nbase_1,1,2,3,\n").contains("station"));
        assert!(message("label,x_mm,y_m,z_mm,station\nbase_1,1,2,3,A\n").contains("y_m"));
        assert!(message("").contains("empty"));
        let twice = read_reference(
            "r.csv",
            "label,x_m,y_m,z_m\nbase_1,0,0,0\nbase_1,0,0,1\n",
            0.0,
        );
        assert!(twice.unwrap_err().to_string().starts_with("r.csv:3:"));
    }

    proptest! {
        #[test]
        fn a_label_survives_its_own_text(plate in 1u8..=99, hole in 1u8..=99, unit in 1u8..=16, point in 1u8..=3) {
            for label in [
                Label::Plate { plate, hole },
                Label::Exit { unit },
                Label::Cell { unit, point },
                Label::Base(format!("h{hole}")),
            ] {
                prop_assert_eq!(Label::parse(&label.to_string()), Some(label));
            }
        }

        #[test]
        fn any_text_is_read_or_refused(text in "\\PC{0,60}") {
            let _ = Label::parse(&text);
            let _ = read_points("f", &text);
            let _ = read_points("f", &format!("label,x_m,y_m,z_m,station\n{text}"));
        }
    }
}
