//! Tests of the record: what is written is read, what is wrong is named, what differs is told.

use super::*;
use crate::geometry::testing::UNITS;
use nalgebra::Matrix3;
use proptest::prelude::*;

fn gain_record() -> GainRecord {
    GainRecord {
        readings: 31,
        largest_n: 9.8,
        half_95_relative: 3.1e-4,
        readings_sd: 4e-5,
        weights_sd: 9e-5,
        gravity_sd: 5e-5,
        beyond_sd: 6e-5,
        remounting_sd: 2e-4,
        pulley_sd: 0.0,
        repeatability_n: 9e-4,
        chi_square: 41.2,
        degrees_of_freedom: 29,
        linearity_n: -1.1e-3,
        hysteresis_n: 0.049,
        hysteresis_se_n: 2e-3,
        gravity_m_per_s2: 9.81,
        operator: "R. Hooke".into(),
        note: String::new(),
        loading: "over a pulley".into(),
        residuals: vec![[0.0, 0.4, 1.0], [9.8, -0.2, 1.1]],
        weights: WeightsRecord {
            tolerance: "OIML class M2".into(),
            correlation: 1.0,
            certificate: "K-2026-117".into(),
            serial: String::new(),
        },
        temperature: Some(TemperatureRecord {
            from_c: 21.5,
            to_c: 24.0,
            scale_per_k: 2e-5,
            scale_per_k_sd: 1e-5,
            ..TemperatureRecord::default()
        }),
        iso376: Some(Iso376Record {
            class: "0.5".into(),
            from_n: 0.98,
            to_n: 9.8,
            in_the_way: vec!["creep c".into()],
            zero: -1e-4,
            creep: Some(4e-4),
            resolution_n: 1e-4,
            degree: 1,
            loads: vec![[9.8, 4e-4, 1e-4, -2e-5, 0.0, 1e-4, 5e-4]],
        }),
    }
}

#[test]
fn a_loop_is_a_rectangle_and_noise_is_none() {
    let found = gain_record();
    assert!((found.hysteresis_sd_n() - 0.049 / 12f64.sqrt()).abs() < 1e-12);
    let noise = GainRecord {
        hysteresis_n: -3e-3,
        ..found
    };
    assert_eq!(noise.hysteresis_sd_n(), 0.0);
    let mut bad = record();
    bad.units[1].gain.as_mut().unwrap().readings_sd = -1e-4;
    let told = bad.write().unwrap_err().to_string();
    assert!(told.contains("unit[2].gain"), "{told}");
}

fn record() -> Record {
    let units = UNITS
        .iter()
        .enumerate()
        .map(|(i, (exit, axis))| {
            let mut unit = UnitRecord {
                number: i as u8 + 1,
                unit_serial: String::new(),
                motor_serial: String::new(),
                cell_serial: format!("SBA-{i:04}"),
                converter_serial: String::new(),
                gain_date: "2026-03-14".into(),
                zero_date: String::new(),
                geometry_date: String::new(),
                n_per_code: 6.85e-6 * (1.0 + 0.01 * i as f64),
                n_per_code_sd: 2.1e-9,
                n_per_code2: 0.0,
                n_per_code2_sd: 0.0,
                creep: 0.0,
                creep_sd: 0.0,
                creep_s: 0.0,
                zero_codes: 12_345.678_9,
                zero_sd_codes: 31.0,
                mounting_n: 1.0 / 3.0,
                mounting_sd_n: 0.05,
                power_up_step_n: 0.1,
                exit_m: *exit,
                axis: Vector3::from(*axis).normalize().into(),
                covariance: Vec::new(),
                gain: Some(gain_record()),
            };
            let axis = Vector3::from(unit.axis);
            let mut covariance = SMatrix::<f64, 6, 6>::identity() * 4e-8;
            covariance
                .fixed_view_mut::<3, 3>(3, 3)
                .copy_from(&((Matrix3::identity() - axis * axis.transpose()) * 1e-5));
            unit.set_covariance(&covariance);
            unit
        })
        .collect();
    Record {
        schema: SCHEMA,
        hash: String::new(),
        date: "2026-03-14".into(),
        rig: "raven-left".into(),
        note: String::new(),
        valid_days: 365,
        gravity_m_per_s2: 9.81,
        common_gain_relative_sd: 1e-4,
        gravity_relative_sd: 5e-5,
        units,
        cross: Vec::new(),
    }
}

#[test]
fn what_is_written_reads_back_bit_by_bit() {
    let mut written = record();
    let mut all = written.geometry_covariance();
    all[(0, 6)] = 1e-8;
    all[(6, 0)] = 1e-8;
    assert!(written.set_geometry_covariance(&all));
    assert_eq!(written.cross.len(), 1);
    let text = written.write().unwrap();
    let read = Record::read("c.toml", &text).unwrap();
    written.hash = read.hash.clone();
    assert_eq!(read, written);
    assert_eq!(read.geometry_covariance(), all);
    assert!(read.diff(&written).is_empty());
    assert_eq!(read.write().unwrap(), text);
    // Layout and comments are not content.
    let spaced = text.replace(" = ", "  =  ") + "\n# a remark\n";
    assert!(Record::read("c.toml", &spaced).is_ok());
}

#[test]
fn a_record_of_the_first_version_is_read_as_it_was_written() {
    // The first version had the same keys without creep and without the figures of gains, and the
    // hash over them.
    let mut first = record();
    first.schema = 1;
    for unit in &mut first.units {
        unit.gain = None;
    }
    first.hash = first.content_hash();
    let text = toml::to_string(&first).unwrap();
    assert!(text.starts_with("schema = 1\n") && !text.contains("creep"));
    let read = Record::read("c.toml", &text).unwrap();
    assert_eq!(read.units[0].creep, 0.0);
    let mut crept = read;
    crept.units[0].creep = 0.01;
    assert!(crept.write().is_err(), "creep without a time constant");
    crept.units[0].creep_s = 60.0;
    let now = Record::read("c.toml", &crept.write().unwrap()).unwrap();
    assert_eq!((now.schema, now.units[0].creep), (SCHEMA, 0.01));
    assert_ne!(now.content_hash(), first.hash);
    let differences = now.diff(&first);
    assert!(differences.iter().any(|d| d.key == "unit 1 creep"));
}

#[test]
fn an_edit_by_hand_is_seen() {
    let text = record().write().unwrap();
    let edited = text.replacen("zero_codes = 12345.6789", "zero_codes = 12345.6788", 1);
    assert_ne!(edited, text);
    let error = Record::read("c.toml", &edited).unwrap_err();
    assert!(
        matches!(&error, RecordError::Hash { at, .. } if at.line == 2),
        "{error}"
    );
}

#[test]
fn every_mistake_names_line_and_key() {
    let text = record().write().unwrap();
    let line_of = |needle: &str| 1 + text.lines().position(|l| l.starts_with(needle)).unwrap();
    for (from, to, line, word) in [
        (
            "zero_sd_codes = 31.0",
            "zero_sd_codes = -31.0",
            line_of("zero_sd_codes"),
            "zero_sd_codes",
        ),
        (
            "zero_sd_codes = 31.0",
            "zero_sd_codes = nan",
            line_of("zero_sd_codes"),
            "zero_sd_codes",
        ),
        (
            "zero_sd_codes = 31.0",
            "zero_sd_codes = \"x\"",
            line_of("zero_sd_codes"),
            "zero_sd_codes",
        ),
        (
            "zero_sd_codes = 31.0",
            "zero_sd = 31.0",
            line_of("zero_sd_codes"),
            "zero_sd",
        ),
        ("schema = 3", "schema = 4", 1, "schema"),
        (
            "date = \"2026-03-14\"",
            "date = \"2026-02-30\"",
            line_of("date"),
            "date",
        ),
        (
            "number = 2",
            "number = 1",
            1 + text.lines().position(|l| l == "number = 2").unwrap(),
            "unit[2].number",
        ),
        ("rig = \"raven-left\"", "rig = raven", line_of("rig"), "rig"),
    ] {
        let edited = text.replacen(from, to, 1);
        assert_ne!(edited, text, "{from}");
        let message = Record::read("c.toml", &edited).unwrap_err().to_string();
        assert!(
            message.starts_with(&format!("c.toml:{line}: ")),
            "{line} {message}"
        );
        assert!(message.contains(word), "{word}: {message}");
    }
    let missing = text.replacen("gravity_m_per_s2 = 9.81\n", "", 1);
    assert_ne!(missing, text);
    let message = Record::read("c.toml", &missing).unwrap_err().to_string();
    assert!(message.contains("gravity_m_per_s2"), "{message}");
    assert!(Record::read("c.toml", "").is_err());
}

#[test]
fn impossible_values_are_not_written() {
    for change in [
        (|r: &mut Record| r.units[0].exit_m[0] = 335.0) as fn(&mut Record),
        |r| r.units[0].axis = [0.0; 3],
        |r| r.units[0].covariance[0] = -1.0,
        |r| r.units[0].covariance[1] = 1.0,
        |r| r.units[0].covariance.truncate(6),
        |r| r.units[0].n_per_code = 0.0,
        |r| r.units.clear(),
        |r| r.gravity_m_per_s2 = f64::NAN,
    ] {
        let mut bad = record();
        change(&mut bad);
        assert!(matches!(bad.write(), Err(RecordError::Value { .. })));
    }
}

#[test]
fn differences_are_told_in_standard_deviations() {
    let old = record();
    let mut new = old.clone();
    new.units[2].exit_m[1] += 0.002;
    new.units[4].n_per_code *= 1.0001;
    new.units[5].cell_serial = "other".into();
    let found = new.diff(&old);
    assert_eq!(found.len(), 3, "{found:?}");
    let exit = found.iter().find(|d| d.key == "unit 3 exit_m").unwrap();
    assert!((exit.sigmas.unwrap() - 0.002 / (2.0 * 4e-8f64).sqrt()).abs() < 1e-6);
    let gain = found.iter().find(|d| d.key == "unit 5 n_per_code").unwrap();
    assert!(gain.sigmas.unwrap() < 1.0);
    assert_eq!(found.iter().filter(|d| d.sigmas.is_none()).count(), 1);
}

/// Each leaf of a tree with something else in its place, one at a time, with its path.
fn altered(tree: &toml::Value, path: &str) -> Vec<(String, toml::Value)> {
    let within = |key: &str, inner: &toml::Value, put: &dyn Fn(toml::Value) -> toml::Value| {
        altered(inner, &format!("{path}/{key}"))
            .into_iter()
            .map(|(path, value)| (path, put(value)))
            .collect::<Vec<_>>()
    };
    let put_in_table = |key: &str, value: toml::Value| {
        let mut table = tree.as_table().unwrap().clone();
        table.insert(key.to_owned(), value);
        toml::Value::Table(table)
    };
    let put_in_list = |at: usize, value: toml::Value| {
        let mut list = tree.as_array().unwrap().clone();
        list[at] = value;
        toml::Value::Array(list)
    };
    let leaf = |value: toml::Value| vec![(path.to_owned(), value)];
    match tree {
        toml::Value::Table(table) => table
            .iter()
            .flat_map(|(key, inner)| within(key, inner, &|value| put_in_table(key, value)))
            .collect(),
        toml::Value::Array(list) => list
            .iter()
            .enumerate()
            .flat_map(|(at, inner)| within(&at.to_string(), inner, &|value| put_in_list(at, value)))
            .collect(),
        toml::Value::Float(number) => leaf((number + 1e-3).into()),
        toml::Value::Integer(number) => leaf((number + 1).into()),
        toml::Value::String(text) => leaf(format!("{text}x").into()),
        other => panic!("{path}: {other:?}"),
    }
}

#[test]
fn whatever_differs_is_told() {
    let mut full = record();
    full.note = "made in spring".into();
    for unit in &mut full.units {
        unit.unit_serial = "U".into();
        unit.motor_serial = "M".into();
        (unit.creep, unit.creep_sd, unit.creep_s) = (0.01, 0.001, 8.0);
        (unit.n_per_code2, unit.n_per_code2_sd) = (1e-14, 1e-15);
        unit.gain_date = full.date.clone();
        unit.zero_date = full.date.clone();
        unit.geometry_date = full.date.clone();
    }
    full.cross = vec![CrossCovariance {
        a: 1,
        b: 2,
        covariance: vec![1e-9; 36],
    }];
    let tree = toml::Value::try_from(&full).unwrap();
    let changes = altered(&tree, "");
    assert!(changes.len() > 200, "{}", changes.len());
    for (path, changed) in changes {
        let new: Record = changed.try_into().unwrap();
        assert!(!new.diff(&full).is_empty(), "{path} is left out");
    }
    assert!(full.diff(&full).is_empty());
}

proptest! {
    #[test]
    fn any_text_is_read_or_refused(text in "\\PC{0,80}", cut in 0usize..2000) {
        let _ = Record::read("f", &text);
        let good = record().write().unwrap();
        let short: String = good.chars().take(cut).collect();
        prop_assert!(Record::read("f", &short).is_err());
    }
}
