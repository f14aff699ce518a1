//! Units of angle and velocity by their values, and whether the two agree.

use super::columns::Column;
use residual_columns::format::num;
use std::f64::consts::TAU;

/// Rows between the two places whose difference is compared: quantised angles have no slope from
/// row to row.
const REACH: usize = 10;

/// A column in the model file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Measure {
    pub(super) unit: String,
    pub(super) scale: f64,
    /// What is to be asked about it.
    pub(super) question: Option<String>,
}

impl Measure {
    /// What the header says of a column.
    pub(super) fn of(column: &Column) -> Measure {
        let known = !column.name.unit.is_empty();
        if !known && !column.stated.is_empty() {
            return Measure::guessed(&column.stated, "unit, as the file has it".into());
        }
        Measure {
            unit: column.name.unit.into(),
            scale: column.name.scale,
            question: (!known).then(|| "unit".into()),
        }
    }

    fn guessed(unit: &str, question: String) -> Measure {
        Measure {
            unit: unit.into(),
            scale: 1.0,
            question: Some(question),
        }
    }
}

/// The slope of the angle as a multiple of the velocity, with a column as time; `None` if the two
/// do not move alike.
pub(super) fn slope(time: &Column, angle: &Column, velocity: &Column) -> Option<f64> {
    let unit = |c: &Column| c.name.unit;
    let alike = match (unit(angle), unit(velocity)) {
        ("", "") => true,
        (x, v) => v == format!("{x}/s"),
    };
    if !alike {
        return None;
    }
    let (t, x, v) = (time.values, angle.values, velocity.values);
    let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
    for start in 0..t.len().saturating_sub(REACH) {
        let end = start + REACH;
        let moved = x[end] - x[start];
        let driven: f64 = (start..end)
            .map(|i| 0.5 * (v[i] + v[i + 1]) * (t[i + 1] - t[i]))
            .sum();
        if moved.is_finite() && driven.is_finite() {
            aa += driven * driven;
            ab += driven * moved;
            bb += moved * moved;
        }
    }
    let agreement = ab / (aa * bb).sqrt();
    (agreement > 0.9).then(|| ab / aa * angle.name.scale / velocity.name.scale)
}

/// The angle, with a unit by its range where its name has none. `velocity` is the column of the
/// velocity.
pub(super) fn angle(column: &Column, velocity: Option<&Column>) -> Measure {
    let named = Measure::of(column);
    if !named.unit.is_empty() {
        return named;
    }
    let of_velocity = velocity.and_then(|v| v.name.unit.strip_suffix("/s"));
    if let Some(unit) = of_velocity.filter(|_| velocity.is_some_and(|v| v.name.scale == 1.0)) {
        return Measure::guessed(unit, format!("{unit}, as the velocity has it"));
    }
    let finite = || column.values.iter().copied().filter(|v| v.is_finite());
    let lo = finite().fold(f64::INFINITY, f64::min);
    let hi = finite().fold(f64::NEG_INFINITY, f64::max);
    let range = format!("values of {} to {}", num(lo), num(hi));
    let largest = hi.max(-lo);
    let whole = finite().all(|v| v == v.round());
    if largest <= 4.0 * TAU && !(whole && largest > TAU) {
        let what = "taken as rad; write another unit for a slide (\"m\", \"mm\")";
        Measure::guessed("rad", format!("{range}: {what}"))
    } else if largest <= 2000.0 && !(whole && largest > 720.0) {
        let what =
            "taken as deg; write another unit for a slide (\"mm\") or for counts of an encoder";
        Measure::guessed("deg", format!("{range}: {what}"))
    } else {
        let what = "they seem counts of an encoder; write unit = \"rad\" and scale = 6.28319 / counts per turn, as a number. \
                    Ripples are looked for in angles only";
        Measure::guessed("", format!("{range}: {what}"))
    }
}

/// The velocity, with the unit of the angle per second where its name has none.
pub(super) fn velocity(column: &Column, angle: Option<&Measure>) -> Measure {
    let named = Measure::of(column);
    match angle.filter(|a| !a.unit.is_empty() && named.unit.is_empty()) {
        Some(angle) => Measure::guessed(
            &format!("{}/s", angle.unit),
            "unit, from that of the angle".into(),
        ),
        None => named,
    }
}

/// What a slope of the angle other than the velocity means; `slope` is their ratio with the time in
/// s.
pub(super) fn contradiction(slope: f64) -> Option<String> {
    if (0.8..1.25).contains(&slope) {
        return None;
    }
    let near = |x: f64| (0.9..1.1).contains(&(slope / x)) || (0.9..1.1).contains(&(slope * x));
    let cause = if near(1e3) || near(1e6) {
        "time, angle or velocity lacks a factor of 1000, such as ms for s or mm for m"
    } else if near(360.0 / TAU) {
        "one seems to be in deg, the other in rad"
    } else if near(60.0 / TAU) || near(TAU) || near(60.0) || near(6.0) {
        "the velocity seems to be in turns per second or per minute"
    } else {
        "a unit, a scale or the gear ratio of one of them is another"
    };
    Some(format!(
        "the slope of the angle is {} times the velocity: {cause}",
        num(slope)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::guess::columns::columns;
    use crate::load::Table;

    #[test]
    fn the_range_of_an_angle_shows_its_unit() {
        for (size, whole, unit, hint) in [
            (3.0, false, "rad", "taken as rad"),
            (170.0, false, "deg", "taken as deg"),
            (170.0, true, "deg", "taken as deg"),
            (4095.0, true, "", "counts"),
            (8158.0, false, "", "scale = 6.28319 / counts"),
        ] {
            let values = (0..100).map(|i| {
                let x = size * (0.1 * f64::from(i)).sin();
                if whole {
                    x.round()
                } else {
                    x
                }
            });
            let table = Table::new("a").with("q", values.collect());
            let guess = angle(&columns(&table, false)[0], None);
            let question = guess.question.unwrap();
            assert_eq!(guess.unit, unit, "{question}");
            assert!(question.contains(hint), "{question}");
        }
    }

    #[test]
    fn a_slope_that_is_not_the_velocity_is_named() {
        let time: Vec<f64> = (0..300).map(|i| 0.01 * f64::from(i)).collect();
        let table = Table::new("a")
            .with("q", time.iter().map(|t| (3.0 * t).sin()).collect())
            .with("dq", time.iter().map(|t| 3e-3 * (3.0 * t).cos()).collect())
            .with("t", time);
        let columns = columns(&table, false);
        let ratio = slope(&columns[2], &columns[0], &columns[1]).unwrap();
        assert!((ratio / 1e3 - 1.0).abs() < 0.02, "{ratio}");
        assert!(contradiction(ratio).unwrap().contains("factor of 1000"));
        assert!(contradiction(57.3).unwrap().contains("deg"));
        assert!(contradiction(1.01).is_none());
    }
}
