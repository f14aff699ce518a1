//! Tests of the survey on a scene whose truth is known.

use super::faults::Fault;
use super::testing::{layout, scene, Scene, CENTER_M};
use super::*;
use proptest::prelude::*;

const SD: f64 = 2e-4;

fn options() -> Options {
    Options {
        workspace_center_m: Some(Vector3::from(CENTER_M)),
        chain_covariance: false,
        ..Options::default()
    }
}

fn faults_of(scene: &Scene, readings: &[PointReading]) -> Vec<Finding> {
    match survey(readings, &scene.reference, &options()) {
        Err(GeometryError::Faults(found)) => found,
        other => panic!("not named: {:?}", other.map(|s| s.p)),
    }
}

#[test]
fn without_noise_the_truth_comes_back() {
    let scene = scene(3);
    let readings = scene.measure(1, 1, 1e-9);
    let found = survey(&readings, &scene.reference, &options()).unwrap();
    assert_eq!(found.units.len(), 6);
    for (joint, chain) in found.units.iter().zip(found.chain.as_ref().unwrap()) {
        let (exit, axis) = scene.unit(joint.unit);
        for unit in [joint, chain] {
            assert!((unit.exit_m - exit).norm() < 1e-7);
            assert!((unit.axis - axis).norm() < 1e-6);
        }
    }
}

#[test]
fn cell_points_that_are_nearly_on_a_line_give_no_axis() {
    let mut scene = scene(3);
    let at = |scene: &Scene, point| scene.points_m[&Label::Cell { unit: 4, point }];
    let (a, b) = (at(&scene, 1), at(&scene, 2));
    // A tenth of a millimetre off the middle of the two others: half of the digitizer's standard
    // deviation.
    let off = (b - a).cross(&Vector3::new(0.3, 0.8, -0.5)).normalize();
    let third = 0.5 * (a + b) + off * 1e-4;
    scene
        .points_m
        .insert(Label::Cell { unit: 4, point: 3 }, third);
    for seed in 0..10 {
        let found = survey(&scene.measure(seed, 3, SD), &scene.reference, &options());
        let Err(GeometryError::VagueAxis {
            unit: 4, sd_deg, ..
        }) = found
        else {
            panic!("seed {seed}: {:?}", found.map(|s| s.units[3].axis_sd_rad()));
        };
        assert!(sd_deg > 5.7, "{sd_deg}");
    }
    let told = survey(&scene.measure(1, 3, SD), &scene.reference, &options())
        .unwrap_err()
        .to_string();
    assert!(
        told.contains("unit4_cell1, unit4_cell2, unit4_cell3 of unit 4")
            && told.contains("further apart"),
        "{told}"
    );
}

#[test]
fn a_mirrored_table_is_told_from_one_with_a_fault() {
    let scene = scene(3);
    let good = scene.measure(5, 2, SD);
    assert!(!is_mirrored(&good, &scene.reference, &options()));
    let mut exchanged = good.clone();
    for reading in &mut exchanged {
        reading.position_m.swap_rows(0, 1);
    }
    assert!(survey(&exchanged, &scene.reference, &options()).is_err());
    assert!(is_mirrored(&exchanged, &scene.reference, &options()));
    let mut negated = good.clone();
    for reading in &mut negated {
        reading.position_m.y = -reading.position_m.y;
    }
    assert!(is_mirrored(&negated, &scene.reference, &options()));
    // One station of several is a fault of its own.
    let mut part = good;
    for reading in part.iter_mut().filter(|r| r.station == "B") {
        reading.position_m.x = -reading.position_m.x;
    }
    assert!(!is_mirrored(&part, &scene.reference, &options()));
}

/// Normalised squared errors over many surveys: their mean has to be the degrees of freedom, for
/// the joint estimate and the chain; and the joint estimate is better than the chain and not better
/// than its bound.
#[test]
fn covariances_are_those_of_the_errors() {
    let scene = layout(2, 0.1, 4, true);
    let full = Options {
        chain_covariance: true,
        ..options()
    };
    let truth = cramer_rao(&scene.measure(0, 2, 1e-9), &scene.reference, &options()).unwrap();
    let draws = 120;
    let (mut joint, mut chain, mut p_low) = (0.0, 0.0, 0);
    let (mut joint_m2, mut chain_m2, mut bound_m2) = (0.0, 0.0, 0.0);
    for seed in 0..draws {
        let found = survey(&scene.measure(seed, 2, SD), &scene.reference, &full).unwrap();
        p_low += u32::from(found.p < 0.1);
        for ((a, b), t) in found
            .units
            .iter()
            .zip(found.chain.as_ref().unwrap())
            .zip(&truth)
        {
            let (exit, _) = scene.unit(a.unit);
            for (unit, sum, squares) in [
                (a, &mut joint, &mut joint_m2),
                (b, &mut chain, &mut chain_m2),
            ] {
                let error = unit.exit_m - exit;
                let inverse = unit.exit_covariance_m2().try_inverse().unwrap();
                *sum += (error.transpose() * inverse * error)[0];
                *squares += error.norm_squared();
            }
            bound_m2 += t.exit_covariance_m2().trace();
        }
    }
    let n = (6 * draws) as f64;
    // Chi-square of 3 degrees of freedom; the six units share station errors, so at worst 120
    // independent means of 3 with a standard deviation of sqrt(6 / 120) = 0.22.
    for mean in [joint / n, chain / n] {
        assert!((2.3..3.7).contains(&mean), "{mean}");
    }
    assert!(
        (0.8..1.25).contains(&(joint_m2 / bound_m2)),
        "{joint_m2} {bound_m2}"
    );
    assert!(joint_m2 < chain_m2);
    // 12 expected, standard deviation 3.3.
    assert!((1..=26).contains(&p_low), "{p_low}");
}

#[test]
fn exchanged_labels_are_named() {
    let scene = scene(3);
    for (repeats, one_round) in [(1, false), (3, false), (3, true)] {
        let mut readings = scene.measure(5, repeats, SD);
        let (a, b) = (
            Label::Plate { plate: 2, hole: 1 },
            Label::Plate { plate: 2, hole: 3 },
        );
        let mut lines = Vec::new();
        let mut done = Vec::new();
        for r in readings.iter_mut().filter(|r| r.station == "C") {
            if one_round && done.contains(&r.label) {
                continue;
            }
            if r.label == a || r.label == b {
                done.push(r.label.clone());
                lines.push(r.at.line);
                r.label = if r.label == a { b.clone() } else { a.clone() };
            }
        }
        let found = faults_of(&scene, &readings);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(matches!(found[0].fault, Fault::Swapped { .. }), "{found:?}");
        // B and C see plate 2 and nobody else does: all repeats exchanged at C look the same as at
        // B.
        let all: Vec<&Finding> = found.iter().chain(&found[0].alternatives).collect();
        let right = all.iter().find(|f| {
            let mut named: Vec<usize> = f.at.iter().map(|l| l.line).collect();
            named.sort_unstable();
            named == lines
        });
        let share = if one_round { 0.9 } else { 0.4 };
        assert!(right.is_some_and(|f| f.probability > share), "{found:?}");
        assert!(
            all.iter().map(|f| f.probability).sum::<f64>() > 0.9,
            "{found:?}"
        );
    }
}

#[test]
fn a_wrong_label_is_named_with_the_right_one() {
    let scene = scene(3);
    let mut readings = scene.measure(5, 3, SD);
    let wrong = readings
        .iter_mut()
        .find(|r| r.station == "B" && r.label == Label::Plate { plate: 1, hole: 2 })
        .unwrap();
    wrong.label = Label::Plate { plate: 1, hole: 3 };
    let line = wrong.at.line;
    let found = faults_of(&scene, &readings);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].at[0].line, line);
    assert_eq!(
        found[0].fault,
        Fault::Mislabelled {
            right: "plate1_2".into()
        }
    );
}

#[test]
fn a_stray_reading_is_named() {
    let scene = scene(3);
    let mut readings = scene.measure(5, 3, SD);
    readings[30].position_m += Vector3::new(0.004, -0.002, 0.003);
    let found = faults_of(&scene, &readings);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!((&found[0].fault, found[0].at[0].line), (&Fault::Stray, 32));
    assert!(GeometryError::Faults(found)
        .to_string()
        .starts_with("points.csv:32: "));
}

#[test]
fn a_bumped_station_is_named_with_the_reading_after_the_bump() {
    let scene = scene(3);
    let mut readings = scene.measure(5, 3, SD);
    let indices: Vec<usize> = (0..readings.len())
        .filter(|&i| readings[i].station == "B")
        .collect();
    let from = indices[indices.len() / 2];
    let bump = crate::se3::exp(&nalgebra::Vector6::new(
        0.004, -0.003, 0.002, 0.004, -0.006, 0.003,
    ));
    for &i in indices.iter().filter(|i| **i >= from) {
        readings[i].position_m = bump.apply(&readings[i].position_m);
    }
    let found = faults_of(&scene, &readings);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        matches!(found[0].fault, Fault::Bumped { by_m } if (0.002..0.02).contains(&by_m)),
        "{found:?}"
    );
    assert_eq!(found[0].station.as_deref(), Some("B"));
    assert_eq!(found[0].at[0].line, readings[from].at.line);
}

#[test]
fn mirrored_and_wrong_units_are_named() {
    let scene = scene(3);
    let clean = scene.measure(5, 2, SD);
    let mut mirrored = clean.clone();
    for r in mirrored.iter_mut().filter(|r| r.station == "A") {
        r.position_m.y = -r.position_m.y;
    }
    let found = faults_of(&scene, &mirrored);
    assert_eq!(
        (&found[0].fault, found[0].station.as_deref()),
        (&Fault::Mirrored, Some("A"))
    );

    let mut all = clean.clone();
    for r in &mut all {
        r.position_m *= 1000.0;
    }
    let found = faults_of(&scene, &all);
    assert_eq!(
        (&found[0].fault, &found[0].station),
        (&Fault::Unit { factor: 1e-3 }, &None)
    );

    let mut one = clean.clone();
    for r in one.iter_mut().filter(|r| r.station == "C") {
        r.position_m *= 1e-3;
    }
    let found = faults_of(&scene, &one);
    assert_eq!(
        (&found[0].fault, found[0].station.as_deref()),
        (&Fault::Unit { factor: 1e3 }, Some("C"))
    );

    // Inches, centimetres, feet: the joint fit does not come to rest.
    for (station, factor) in [
        ("A", 25.4),
        ("B", 25.4),
        ("C", 25.4),
        ("A", 10.0),
        ("C", 304.8),
    ] {
        let mut other = clean.clone();
        for r in other.iter_mut().filter(|r| r.station == station) {
            r.position_m /= factor;
        }
        let found = faults_of(&scene, &other);
        assert_eq!(
            (&found[0].fault, found[0].station.as_deref()),
            (&Fault::Unit { factor }, Some(station))
        );
    }

    let mut row = clean;
    row[8].position_m *= 1000.0;
    let found = faults_of(&scene, &row);
    assert_eq!(
        (&found[0].fault, found[0].at[0].line),
        (&Fault::Unit { factor: 1e-3 }, 10)
    );
}

#[test]
fn two_faults_are_both_named() {
    let scene = scene(3);
    let mut readings = scene.measure(5, 3, SD);
    readings[3].position_m += Vector3::new(0.0, 0.01, 0.0);
    for r in readings.iter_mut().filter(|r| r.station == "A") {
        r.position_m.y = -r.position_m.y;
    }
    let found = faults_of(&scene, &readings);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found.iter().any(|f| f.fault == Fault::Mirrored));
    assert!(found
        .iter()
        .any(|f| f.fault == Fault::Stray && f.at[0].line == 5));
}

#[test]
fn copies_are_named_and_coarse_repeats_are_not() {
    let scene = scene(1);
    let mut readings = scene.measure(5, 3, SD);
    readings[4].position_m = readings[3].position_m;
    let found = faults_of(&scene, &readings);
    assert_eq!((&found[0].fault, found[0].at[0].line), (&Fault::Copied, 6));
    // A digitizer that shows tenths of a millimetre repeats itself by chance.
    let mut coarse = scene.measure(5, 20, 5e-5);
    for r in &mut coarse {
        r.position_m = r.position_m.map(|v| (v * 1e4).round() / 1e4);
    }
    assert!(super::faults::copies(&coarse, 5e-5).is_empty());
}

#[test]
fn a_worse_digitizer_is_named_as_noise() {
    let scene = scene(2);
    let found = faults_of(&scene, &scene.measure(5, 4, 3.0 * SD));
    assert!(
        matches!(found[0].fault, Fault::Noise { sd_m } if (2.5..3.5).contains(&(sd_m / SD))),
        "{found:?}"
    );
}

#[test]
fn points_on_a_line_and_lost_stations_are_named() {
    let mut scene = scene(2);
    let [a, b] = [1, 2].map(|hole| scene.points_m[&Label::Plate { plate: 1, hole }]);
    scene
        .points_m
        .insert(Label::Plate { plate: 1, hole: 3 }, a + (b - a) * 0.4);
    let error = survey(&scene.measure(1, 2, SD), &scene.reference, &options()).unwrap_err();
    assert!(
        matches!(&error, GeometryError::Collinear { station, .. } if station == "B"),
        "{error}"
    );
    assert!(error.to_string().starts_with("points.csv:"));

    let lost: Vec<PointReading> = scene_without_plate(1);
    let error = survey(&lost, &scene.reference, &options()).unwrap_err();
    assert!(
        matches!(&error, GeometryError::NotConnected { station, .. } if station == "B"),
        "{error}"
    );
}

fn scene_without_plate(number: u8) -> Vec<PointReading> {
    let readings = scene(2).measure(1, 1, SD);
    readings
        .into_iter()
        .filter(|r| !matches!(r.label, Label::Plate { plate, .. } if plate == number && r.station == "B"))
        .collect()
}

#[test]
fn other_bad_input_is_an_error() {
    let scene = scene(1);
    let good = scene.measure(1, 1, SD);
    let fails = |readings: &[PointReading], options: &Options| {
        survey(readings, &scene.reference, options).unwrap_err()
    };
    assert_eq!(fails(&[], &options()), GeometryError::NoBase);
    let mut nan = good.clone();
    nan[7].position_m.x = f64::NAN;
    assert!(matches!(fails(&nan, &options()), GeometryError::NotFinite { at } if at.line == 9));
    let mut hole = good.clone();
    hole[0].label = Label::Base("77".into());
    assert!(fails(&hole, &options())
        .to_string()
        .starts_with("points.csv:2: the CAD model has no hole `base_77`"));
    let few: Vec<PointReading> = good
        .iter()
        .filter(|r| r.label != (Label::Cell { unit: 2, point: 2 }))
        .cloned()
        .collect();
    assert!(matches!(
        fails(&few, &options()),
        GeometryError::MissingPoint { unit: 2, .. }
    ));
    let zero = Options {
        digitizer_sd_m: 0.0,
        ..options()
    };
    assert!(matches!(
        fails(&good, &zero),
        GeometryError::BadOption { .. }
    ));
}

#[test]
fn clean_surveys_raise_no_alarm() {
    let scene = scene(3);
    let alarms = (0..300)
        .filter(|&seed| {
            survey(
                &scene.measure(1000 + seed, 1, SD),
                &scene.reference,
                &options(),
            )
            .is_err()
        })
        .count();
    // 0.3 expected at the 0.1 % level; 5 or more has probability 2e-5.
    assert!(alarms < 5, "{alarms}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn any_points_end_in_a_survey_or_an_error(
        raw in prop::collection::vec((0usize..12, prop::array::uniform3(-1.0..1.0f64), 0usize..2), 0..14),
    ) {
        let scene = scene(1);
        let labels: Vec<Label> = scene.points_m.keys().cloned().collect();
        let readings: Vec<PointReading> = raw
            .iter()
            .enumerate()
            .map(|(i, (label, at, station))| PointReading {
                label: labels[*label].clone(),
                position_m: Vector3::from(*at),
                station: ["A", "B"][*station].to_owned(),
                at: Location { file: "f".into(), line: i + 2 },
            })
            .collect();
        let _ = survey(&readings, &scene.reference, &options());
    }
}
