//! Model files as a user gets them, from whole logs.

mod run;
mod strange;

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

/// The text alone, also of a file that does not run yet.
fn text_of(text: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    std::fs::write(&path, text).unwrap();
    guess(&[path]).unwrap()
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
    // Names empty and repeated, a label before the units, a unit that is only text, the last cell
    // missing.
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

#[test]
fn a_log_without_a_row_is_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("a.csv", "time_s,force_n\n");
    put("b.csv", "");
    put(
        "c.csv",
        &log("time_s,force_n\n", 100, |i| vec![0.01 * i, i % 5.0]),
    );
    let text = guess(&[folder.path().to_path_buf()]).unwrap();
    assert!(text.contains("Guessed from c.csv, one of 3"), "{text}");
    std::fs::remove_file(folder.path().join("c.csv")).unwrap();
    let error = guess(&[folder.path().to_path_buf()]).unwrap_err();
    assert!(error.to_string().contains("a.csv"), "{error}");
}

#[test]
fn a_date_is_no_time_and_the_user_is_told_what_to_do() {
    for date in ["21/10/2024-15:52:16", "2024.10.21-15.52.16"] {
        let lines: String = (0..100)
            .map(|i| format!("{date},{},{}\n", i % 7, i % 5))
            .collect();
        let (_, text) = of(&format!("when,force_n,speed\n{lines}"));
        assert!(
            text.contains("column \"when\" is a date") && text.contains(date),
            "{text}"
        );
        assert!(text.contains("total_seconds"), "{text}");
    }
}

#[test]
fn inches_and_kips_are_understood() {
    let (spec, text) = of(&log("time_s,disp_in,force_kip,vel_in_s\n", 200, |i| {
        let t = 0.01 * i;
        vec![t, (3.0 * t).sin(), i % 5.0, 3.0 * (3.0 * t).cos()]
    }));
    let roles = &spec.roles;
    let angle = roles.angle.as_ref().unwrap();
    assert_eq!(
        (angle.column.as_str(), angle.unit.as_str(), angle.scale),
        ("disp_in", "mm", 25.4),
        "{text}"
    );
    let velocity = roles.velocity.as_ref().unwrap();
    assert_eq!(
        (velocity.unit.as_str(), velocity.scale),
        ("mm/s", 25.4),
        "{text}"
    );
    assert_eq!(
        (roles.target.unit.as_str(), roles.target.scale),
        ("N", 4_448.221_615)
    );
}

#[test]
fn a_command_comes_before_a_supply_and_a_force_before_an_output() {
    let header = "time [s],a2 torque cmd [Nm],a2 torque [Nm],c2 voltage [V]\n";
    let (spec, text) = of(&log(header, 300, |i| {
        vec![
            0.01 * i,
            (0.1 * i).sin(),
            (0.1 * i).sin() + 0.1 * (i % 3.0),
            24.0 + 0.01 * (i % 2.0),
        ]
    }));
    assert_eq!(
        spec.roles.command.unwrap().column,
        "a2 torque cmd [Nm]",
        "{text}"
    );
    // A drive that was turned by hand has a command that is 0, and a supply that sags.
    let (spec, text) = of(&log(header, 300, |i| {
        vec![0.01 * i, 0.0, i % 3.0, 35.0 + i % 2.0]
    }));
    assert_eq!(spec.roles.command.unwrap().column, "a2 torque cmd [Nm]");
    assert!(
        text.contains("it does not change: is it the command"),
        "{text}"
    );
    // Alone it is taken, with a question.
    let (spec, text) = of(&log("t,force,voltage\n", 300, |i| {
        vec![0.01 * i, i % 5.0, 24.0 + 0.01 * (i % 2.0)]
    }));
    assert_eq!(spec.roles.command.unwrap().column, "voltage");
    assert!(
        text.contains("it does not change: is it the command"),
        "{text}"
    );
    let (spec, text) = of(&log("t,A,Y,V,F\n", 300, |i| {
        vec![0.01 * i, i % 5.0, i % 3.0, i % 2.0, i % 7.0]
    }));
    assert_eq!(spec.roles.target.column, "F", "{text}");
    assert!(text.contains("or is it \"Y\""), "{text}");
}

#[test]
fn a_separator_in_quotation_marks_is_none() {
    let (spec, text) = of(&log(
        "\"time, s\",\"command, N\",\"speed, rad/s\",\"force, N\"\n",
        200,
        |i| vec![0.01 * i, i % 3.0, i % 5.0, i % 7.0],
    ));
    assert!(
        spec.input.header.is_empty() && spec.input.skip == 0,
        "{text}"
    );
    assert_eq!(spec.roles.time.column, "time, s", "{text}");
    assert_eq!(spec.roles.target.column, "force, N", "{text}");
    let (spec, text) =
        of(&log("t,F,q\n", 100, |i| vec![0.01 * i, i % 3.0, i % 5.0]).replace(',', "|"));
    assert_eq!(spec.input.separator, "|", "{text}");
    // Lines of several kinds need a hand.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.log");
    let lines: String = (0..100)
        .map(|i| format!("FORCE,{i},1.5\nJOINT,{i},0.1,0.2\nIMU,{i},1,2,3\n"))
        .collect();
    std::fs::write(&path, lines).unwrap();
    let error = guess(&[path]).unwrap_err().to_string();
    assert!(error.contains("[[input.messages]]"), "{error}");
}

#[cfg(feature = "parquet")]
#[test]
fn a_parquet_log_has_a_model_file() {
    use crate::load::tests::put_column;
    use parquet::data_type::{DoubleType, Int64Type};
    use parquet::file::{properties::WriterProperties, writer::SerializedFileWriter};
    use std::sync::Arc;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    let schema =
        "message log { required int64 time_ms (TIMESTAMP(NANOS,true)); required double force_n; }";
    let schema = parquet::schema::parser::parse_message_type(schema).unwrap();
    let file = std::fs::File::create(&path).unwrap();
    let properties = Arc::new(WriterProperties::builder().build());
    let mut writer = SerializedFileWriter::new(file, Arc::new(schema), properties).unwrap();
    let mut group = writer.next_row_group().unwrap();
    let time: Vec<i64> = (0..400).map(|i| 10_000_000 * i).collect();
    put_column::<Int64Type>(&mut group, &time);
    let force: Vec<f64> = (0..400).map(|i| f64::from(i * i % 7)).collect();
    put_column::<DoubleType>(&mut group, &force);
    group.close().unwrap();
    writer.close().unwrap();
    let text = guess(std::slice::from_ref(&path)).unwrap();
    let spec = Spec::parse(&text).unwrap();
    assert_eq!(
        (spec.roles.time.column.as_str(), spec.roles.time.scale),
        ("time_ms", 1.0),
        "{text}"
    );
    assert_eq!(spec.roles.target.column, "force_n", "{text}");
    assert!(!text.contains("separator"), "{text}");
    let data = crate::load::load(&[path], &spec).unwrap();
    assert!((data.frame().step() - 0.01).abs() < 1e-9);
}

/// A force is what is measured, and what drives it is a setpoint or a current, where no command is
/// there; not the setpoint of a motion.
#[test]
fn what_drives_is_a_setpoint_or_a_current() {
    let command = |header: &str| {
        let count = header.trim().split(',').count();
        let (spec, text) = of(&log(header, 300, |i| {
            let cell = |k: usize| (0.05 * i * (1.0 + 0.3 * k as f64)).sin();
            std::iter::once(0.01 * i)
                .chain((1..count).map(cell))
                .collect()
        }));
        let command = spec.roles.command.map(|c| c.column);
        (spec.roles.target.column, command, text)
    };
    for (header, target, expected) in [
        (
            "t,Consigne (V),Couple (N.m)\n",
            "Couple (N.m)",
            Some("Consigne (V)"),
        ),
        ("time,Sollwert,Istwert\n", "Istwert", Some("Sollwert")),
        (
            "t,Motor Current (mA),Axial Force (N)\n",
            "Axial Force (N)",
            Some("Motor Current (mA)"),
        ),
        ("t,force,target_speed\n", "force", None),
        ("t,Kraft,Sollgeschwindigkeit\n", "Kraft", None),
        ("t,Sollkraft,Kraft,Strom\n", "Kraft", Some("Sollkraft")),
        ("t,current,q\n", "current", None),
    ] {
        let found = command(header);
        assert_eq!(
            (found.0.as_str(), found.1.as_deref()),
            (target, expected),
            "{}",
            found.2
        );
        assert_eq!(
            found.2.contains("taken for what"),
            expected.is_some(),
            "{}",
            found.2
        );
    }
}

#[test]
fn a_bridge_in_millivolts_per_volt_is_no_voltage() {
    let (spec, text) = of(&log("t,Bridge [mV/V],cmd [V]\n", 300, |i| {
        vec![0.01 * i, i % 5.0, i % 3.0]
    }));
    assert_eq!(spec.roles.target.unit, "mV/V", "{text}");
    assert_eq!(spec.roles.command.unwrap().unit, "V");
}

/// A time that falls from row to row is one all the same.
#[test]
fn the_newest_row_may_be_the_first() {
    let (spec, text) = of(&log("time,cmd,force\n", 300, |i| {
        vec![3.0 - 0.01 * i, i % 5.0, i % 3.0]
    }));
    assert_eq!(spec.roles.time.column, "time");
    assert!(text.contains("the newest row is the first"), "{text}");
}
