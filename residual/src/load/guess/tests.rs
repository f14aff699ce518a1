//! Model files as a user gets them, from whole logs.

use super::*;
use crate::spec::Spec;

fn of(text: &str) -> (Spec, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    std::fs::write(&path, text).unwrap();
    let text = guess(&[path]).unwrap();
    let spec = Spec::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    (spec, text)
}

fn rows(separator: &str, decimal: &str) -> String {
    (0..80)
        .map(|i| {
            let cells = [0.01 * f64::from(i), f64::from(i % 7) + 0.5, 2.25];
            let cells: Vec<String> = cells
                .iter()
                .map(|c| format!("{c:.3}").replace('.', decimal))
                .collect();
            cells.join(separator) + "\n"
        })
        .collect()
}

#[test]
fn names_give_roles_and_units() {
    let (spec, text) = of(&format!("time_ms,force_n,speed_rad_s\n{}", rows(",", ".")));
    assert_eq!(
        (spec.roles.time.column.as_str(), spec.roles.time.scale),
        ("time_ms", 1e-3)
    );
    assert_eq!(
        (
            spec.roles.target.column.as_str(),
            spec.roles.target.unit.as_str()
        ),
        ("force_n", "N")
    );
    assert_eq!(spec.roles.velocity.unwrap().unit, "rad/s");
    // 80 rows 0.01 ms apart: blocks of at least 20 rows.
    assert_eq!(spec.holdout.block_s, Some(0.0002));
    assert!(text.contains("# ?"), "{text}");
}

#[test]
fn layouts_are_recognised() {
    let (spec, _) = of(&format!("logger 7\nTime;Iq;Position\n{}", rows(";", ",")));
    assert_eq!(
        (
            spec.input.skip,
            spec.input.decimal.as_str(),
            spec.input.separator.as_str()
        ),
        (1, ",", ";")
    );
    assert_eq!(spec.roles.target.column, "Iq");
    let (spec, text) = of(&format!(
        "%made by hand\n%Time, Torque, Position\n{}",
        rows(",", ".")
    ));
    assert_eq!(spec.input.header, ["Time", "Torque", "Position"], "{text}");
    let (spec, text) = of(&rows(" ", "."));
    assert_eq!(spec.input.header.len(), 3, "{text}");
    assert_eq!(spec.input.separator, "blank");
}

/// A log of `rows` rows, by the number of the row.
fn log(header: &str, rows: usize, cells: impl Fn(f64) -> Vec<f64>) -> String {
    let lines = (0..rows).map(|i| {
        let cells: Vec<String> = cells(i as f64).iter().map(|c| format!("{c:.6}")).collect();
        cells.join(",") + "\n"
    });
    format!("{header}{}", lines.collect::<String>())
}

#[test]
fn a_log_without_a_header_has_its_time() {
    for (step, first, scale) in [(10.0, 0.0, 1e-3), (0.01, 0.0, 1.0), (0.01, 1.7e9, 1.0)] {
        let (spec, text) = of(&log("", 2000, |i| {
            vec![first + step * i, (0.01 * i).sin(), (0.02 * i).cos()]
        }));
        let time = &spec.roles.time;
        assert_eq!(
            (time.column.as_str(), time.scale),
            ("column_1", scale),
            "{text}"
        );
        assert!(text.contains("grows as a time does"), "{text}");
        assert_eq!(
            (spec.input.rate, spec.holdout.block_s),
            (0.0, Some(1.0)),
            "{text}"
        );
        assert_eq!(spec.roles.target.column, "column_3");
        assert!(text.contains("without a role: \"column_2\"."), "{text}");
    }
}

#[test]
fn a_rate_is_asked_for_and_not_invented() {
    let (spec, text) = of(&log("cmd,force\n", 400, |i| {
        vec![(0.1 * i).sin(), (0.1 * i).cos()]
    }));
    assert_eq!((spec.input.rate, spec.holdout.block_s), (0.0, None));
    assert!(
        text.contains("# rate = ...   # ? rows per second"),
        "{text}"
    );
    assert!(text.contains("# block_s = ..."), "{text}");
    // Left unanswered, the analysis says what is missing.
    let table = Table::new("a")
        .with("cmd", vec![0.0; 9])
        .with("force", vec![0.0; 9]);
    let error = crate::load::from_tables(vec![table], &spec)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("give input.rate, the rows per second"),
        "{error}"
    );
}

#[test]
fn a_time_in_ms_is_seen_without_a_unit() {
    let (spec, text) = of(&log("t,x,f\n", 2000, |i| {
        vec![10.0 * i, (0.01 * i).sin(), 1.0 + i % 3.0]
    }));
    assert_eq!(spec.roles.time.scale, 1e-3, "{text}");
    assert!(text.contains("taken as ms"), "{text}");
    // 19.99 s, not 19990 s.
    assert_eq!(spec.holdout.block_s, Some(1.0), "{text}");
}

#[test]
fn a_factor_between_angle_and_velocity_is_named() {
    let (spec, text) = of(&log("t_s,q,dq,tau\n", 2000, |i| {
        let t = 1e-3 * i;
        vec![1e3 * t, (3.0 * t).sin(), 3.0 * (3.0 * t).cos(), i % 5.0]
    }));
    assert_eq!(spec.roles.time.scale, 1.0);
    assert!(text.contains("lacks a factor of 1000"), "{text}");
}

#[test]
fn the_joint_that_moves_most_is_taken_as_a_whole() {
    for (angle, velocity, torque) in [
        ("q", "dq", "tau"),
        ("actual_q_", "actual_qd_", "actual_current_"),
        ("Position", "Velocity", "Torque"),
        (
            "/joint_states.position[",
            "/joint_states.velocity[",
            "/joint_states.effort[",
        ),
    ] {
        let end = if angle.ends_with('[') { "]" } else { "" };
        let name = |what: &str, joint: usize| format!("{what}{joint}{end}");
        let names = |what| (1..=7).map(|k| name(what, k)).collect::<Vec<_>>().join(",");
        let header = format!(
            "time,{},{},{}\n",
            names(angle),
            names(velocity),
            names(torque)
        );
        let (spec, text) = of(&log(&header, 900, |i| {
            let t = 0.01 * i;
            let size = |k: i32| if k == 4 { 1.0 } else { 1e-3 * f64::from(k) };
            let mut row = vec![t];
            row.extend((1..=7).map(|k| size(k) * (2.0 * t).sin()));
            row.extend((1..=7).map(|k| 2.0 * size(k) * (2.0 * t).cos()));
            row.extend((1..=7).map(|k| f64::from(k) + i % 3.0));
            row
        }));
        assert_eq!(spec.roles.target.column, name(torque, 4), "{text}");
        assert_eq!(spec.roles.angle.unwrap().column, name(angle, 4), "{text}");
        assert_eq!(
            spec.roles.velocity.unwrap().column,
            name(velocity, 4),
            "{text}"
        );
        let rest = text.lines().find(|l| l.contains("without a role")).unwrap();
        assert!(
            !rest.contains(&format!("\"{}\"", name(torque, 4))),
            "{text}"
        );
    }
}

#[test]
fn a_target_with_an_index_has_columns_of_its_joint() {
    let (spec, text) = of(&log("time,q6,q7,temp6,tau7\n", 500, |i| {
        vec![
            0.01 * i,
            9.0 * (0.1 * i).sin(),
            (0.1 * i).sin(),
            20.0 + 0.01 * i,
            i % 3.0,
        ]
    }));
    assert_eq!(spec.roles.angle.unwrap().column, "q7", "{text}");
    assert!(spec.roles.temperature.is_none(), "{text}");
}

#[test]
fn an_angle_without_a_unit_is_asked_about() {
    let (spec, text) = of(&log("time,pos,iq\n", 500, |i| {
        vec![0.01 * i, 3.0 * (0.1 * i).sin(), i % 3.0]
    }));
    assert_eq!(spec.roles.angle.unwrap().unit, "rad");
    assert!(
        text.contains("values of -3.000 to 3.000: taken as rad"),
        "{text}"
    );
}

#[test]
fn exports_of_robots_are_read() {
    // rostopic echo -p: names in a comment, time in ns, a column of text.
    let lines: String = (0..500)
        .map(|i| {
            let (t, x) = (
                1_700_000_000_000_000_000_u64 + 10_000_000 * i,
                (0.05 * i as f64).sin(),
            );
            format!("{t},{i},base,{x:.4},{:.4}\n", 0.3 * x)
        })
        .collect();
    let (spec, text) = of(&format!(
        "%time,field.header.seq,field.header.frame_id,field.position0,field.effort0\n{lines}"
    ));
    assert_eq!(
        (spec.roles.time.column.as_str(), spec.roles.time.scale),
        ("time", 1e-9),
        "{text}"
    );
    assert_eq!(spec.roles.target.column, "field.effort0");
    assert_eq!(spec.roles.angle.unwrap().column, "field.position0");
}

#[test]
fn a_decimal_comma_between_blanks_is_no_separator() {
    let (spec, text) = of(&format!("Zeit Kraft\n{}", rows(" ", ",")).replace("Kraft", "Weg Kraft"));
    assert_eq!(
        (spec.input.separator.as_str(), spec.input.decimal.as_str()),
        ("blank", ","),
        "{text}"
    );
    assert_eq!(spec.roles.time.column, "Zeit");
}

#[test]
fn a_name_of_one_letter_comes_after_a_word() {
    let (spec, text) = of(&log("t,f_v,force_n\n", 500, |i| {
        vec![0.01 * i, i % 3.0, i % 5.0]
    }));
    assert_eq!(spec.roles.target.column, "force_n", "{text}");
}

#[test]
fn a_line_of_units_below_the_names_is_understood() {
    for (separator, units) in [
        (",", ["[ms]", "[N]", "[deg/s]"]),
        (";", ["ms", "N", "deg/s"]),
        ("\t", ["(ms)", "(N)", "(°/s)"]),
        (" ", ["ms", "N", "deg/s"]),
    ] {
        for prose in ["", "Rig 4\n\n", "Rig,4;a\n\"made by hand, cold, dry\"\n"] {
            let names = ["Time", "Force", "Speed"].join(separator);
            let units = units.join(separator);
            let (spec, text) = of(&format!(
                "{prose}{names}\n{units}\n{}",
                rows(separator, ".")
            ));
            let input = &spec.input;
            assert_eq!(input.skip, prose.lines().count() + 2, "{text}");
            assert_eq!(input.header, ["Time", "Force", "Speed"], "{text}");
            let roles = &spec.roles;
            assert_eq!(
                (roles.time.column.as_str(), roles.time.scale),
                ("Time", 1e-3),
                "{text}"
            );
            assert_eq!(
                (roles.target.column.as_str(), roles.target.unit.as_str()),
                ("Force", "N"),
                "{text}"
            );
            let velocity = spec.roles.velocity.unwrap();
            assert_eq!(velocity.unit, "deg/s", "{text}");
            assert!(!text.contains("? unit"), "{text}");
        }
    }
}

#[test]
fn a_second_line_may_have_gaps_labels_and_words() {
    // Names empty and repeated, a label before the units, a unit that is only text, the last cell missing.
    let (spec, text) = of(&format!(
        "Rig;4;cold\nName;\"Torque\";\nUnit;\"kNm\"\n{}",
        rows(";", ",")
    ));
    assert_eq!(spec.input.header, ["Name", "Torque", "column_3"], "{text}");
    assert_eq!(spec.input.skip, 3, "{text}");
    assert_eq!(spec.roles.time.column, "Name", "{text}");
    assert_eq!(spec.roles.target.unit, "kNm", "{text}");
    let (spec, text) = of(&format!("Time,x,x\ns,,-\n{}", rows(",", ".")));
    assert_eq!(spec.input.header, ["Time", "x", "x_2"], "{text}");
    // What was connected to each channel.
    let (spec, text) = of(&format!(
        "Time,Channel 1,Channel 2\ns,Motor torque,not used\n{}",
        rows(",", ".")
    ));
    assert_eq!(spec.roles.target.column, "Channel 1", "{text}");
    // Names and units in comments.
    let (spec, text) = of(&format!(
        "# Time, Force, q\n# ms, N, mrad\n{}",
        rows(",", ".")
    ));
    assert_eq!(spec.input.header, ["Time", "Force", "q"], "{text}");
    assert_eq!(spec.roles.time.scale, 1e-3, "{text}");
    assert_eq!(spec.roles.angle.unwrap().unit, "mrad", "{text}");
}

#[test]
fn one_line_of_names_is_not_taken_for_units() {
    for prose in ["", "Rig\n", "Rig 4,cold,dry\n", "Torque,speed 2,cold\n"] {
        for names in ["t,x,y", "t,v,a", "Time,F,s"] {
            let (spec, text) = of(&format!("{prose}{names}\n{}", rows(",", ".")));
            assert!(spec.input.header.is_empty(), "{text}");
            assert_eq!(spec.input.skip, prose.lines().count(), "{text}");
            assert_eq!(spec.roles.time.column, names.split(',').next().unwrap());
        }
    }
    // A separator at the end of the header only, or of the rows only.
    let (spec, text) = of(&format!("t,x,y,\n{}", rows(",", ".")));
    assert_eq!(spec.input.header, ["t", "x", "y"], "{text}");
    let ended = rows(",", ".").replace('\n', ",\n");
    let (spec, text) = of(&format!("t,x,y\n{ended}"));
    assert_eq!(spec.input.header, ["t", "x", "y", "column_4"], "{text}");
    // Channels with numbers as names, and a line of prose between the names and the rows.
    let (spec, text) = of(&format!("t,1,2\n{}", rows(",", ".")));
    assert!(spec.input.header.is_empty(), "{text}");
    let (spec, text) = of(&format!("t,x,y\nstarted by hand\n{}", rows(",", ".")));
    assert_eq!(spec.input.header, ["t", "x", "y"], "{text}");
    assert_eq!(spec.input.skip, 2, "{text}");
}

#[test]
fn a_log_without_a_layout_names_line_and_keys() {
    let error = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, text).unwrap();
        guess(&[path]).unwrap_err().to_string()
    };
    for (text, line) in [
        ("one\ntwo\n\nthree\n", "line 2"),
        ("a,b\nc,d\ne,f\n", "line 2"),
        ("", "line 1"),
    ] {
        let error = error(text);
        assert!(
            error.contains(line) && error.contains("input.skip"),
            "{error}"
        );
        assert!(error.contains("input.header"), "{error}");
    }
}

#[test]
fn a_time_in_minutes_is_one() {
    let (spec, text) = of(&format!(
        "Time,Force,Speed\nmin,N,rad/s\n{}",
        rows(",", ".")
    ));
    assert_eq!(spec.roles.time.scale, 60.0, "{text}");
}

#[test]
fn a_line_that_was_cut_off_does_not_keep_the_user_from_a_model_file() {
    let (spec, text) = of(&format!("t,force_n,speed\n{}0.8,1", rows(",", ".")));
    assert_eq!(spec.hygiene.text, Action::Drop);
    assert!(
        text.contains("1 line(s)") && text.contains("a.txt: line 82: 2 cells"),
        "{text}"
    );
}
