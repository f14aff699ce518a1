//! Model files that run as they are written.

use super::*;

/// As [`of`], and the model file reads the log.
fn runs(text: &str) -> (Spec, String) {
    runs_as(text.as_bytes())
}

pub(super) fn runs_as(bytes: &[u8]) -> (Spec, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    std::fs::write(&path, bytes).unwrap();
    let text = guess(std::slice::from_ref(&path)).unwrap();
    let spec = Spec::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    crate::load::load(&[path], &spec).unwrap_or_else(|e| panic!("{e}\n{text}"));
    (spec, text)
}

/// Rows of three values that are not steady.
fn three(i: usize) -> [f64; 3] {
    let t = 0.01 * i as f64;
    [
        3.0 + (7.0 * t).sin(),
        (11.0 * t).cos(),
        (5.0 * t).sin() + 0.1 * (i % 7) as f64,
    ]
}

#[test]
fn a_labview_file_without_times_has_its_rate_and_its_names() {
    let part = "Channels\t3\t\t\t\nDelta_X\t0.010000\t0.010000\t0.010000\t\n\
                ***End_of_Header***\t\t\t\t\nX_Value\tcommand\tvelocity\tforce\tComment\n";
    let rows = |from: usize| -> String {
        let line = |i: usize| {
            let [a, b, c] = three(i);
            format!("\t{a:.6}\t{b:.6}\t{c:.6}\n")
        };
        (from..from + 300).map(line).collect()
    };
    let head = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\n";
    let (spec, text) = runs(&format!("{head}{part}{}\n{part}{}", rows(0), rows(500)));
    assert_eq!(spec.input.rate, 100.0, "{text}");
    assert_eq!(spec.roles.target.column, "force", "{text}");
    assert_eq!(spec.roles.command.unwrap().column, "command");
}

#[test]
fn a_date_and_a_time_of_day_are_the_time() {
    let rows: String = (0..300)
        .map(|i| {
            let [a, b, c] = three(i);
            let s = 50.0 + 0.01 * i as f64;
            format!(
                "2026-03-04,23:5{}:{:06.3},{a:.4},{b:.4},{c:.4}\n",
                8 + (s / 60.0) as usize,
                s % 60.0
            )
        })
        .collect();
    let (spec, text) = runs(&format!(
        "Date,Time,Command(N),Speed(rad/s),Force(N)\n{rows}"
    ));
    assert_eq!(spec.roles.time.column, "Date+Time", "{text}");
    let rows: String = (0..300)
        .map(|i| {
            let [a, b, c] = three(i);
            format!(
                "{i},{},{},{a:.4},{b:.4},{c:.4}\n",
                1_741_082_400 + i / 100,
                i % 100 * 10_000_000
            )
        })
        .collect();
    let (spec, text) = runs(&format!(
        "seq,stamp.secs,stamp.nsecs,command,velocity,force\n{rows}"
    ));
    assert_eq!(spec.roles.time.column, "stamp.secs+stamp.nsecs", "{text}");
    assert_eq!(spec.roles.target.column, "force", "{text}");
}

#[test]
fn channels_with_units_below_and_names_that_repeat_make_a_file_that_runs() {
    let rows: String = (0..300)
        .map(|i| {
            let [a, b, c] = three(i);
            format!("{:E},{a:+E},{b:+E},{c:+E}\n", -1.0 + 0.005 * i as f64)
        })
        .collect();
    let (spec, text) = runs(&format!("x-axis,1,2,3\nsecond,Volt,Volt,Volt\n{rows}"));
    assert_eq!(spec.input.header, ["x-axis", "1", "2", "3"], "{text}");
    assert_eq!(
        (
            spec.roles.time.column.as_str(),
            spec.roles.target.unit.as_str()
        ),
        ("x-axis", "V"),
        "{text}"
    );
    let (spec, text) = runs(&format!("time,Volt,Volt,Volt\n{rows}"));
    assert_eq!(
        spec.input.header,
        ["time", "Volt", "Volt_2", "Volt_3"],
        "{text}"
    );
}

#[test]
fn lines_with_labels_have_names_and_no_decimal_comma() {
    let rows: String = (0..300)
        .map(|i| {
            let [a, b, c] = three(i);
            let s = 0.025 * i as f64;
            format!("10:11:{s:06.3} -> cmd: {a:.3} N, speed: {b:.3} rad/s, force: {c:.3} N\n")
        })
        .collect();
    let (spec, text) = runs(&format!("10:10:59.100 -> Scale detected!\n{rows}"));
    assert_eq!(spec.input.decimal, ".", "{text}");
    assert_eq!(spec.roles.target.column, "force", "{text}");
    assert_eq!(spec.roles.velocity.unwrap().column, "speed");
}

#[test]
fn an_old_german_table_is_understood() {
    let rows: String = (0..300)
        .map(|i| {
            let [a, b, c] = three(i);
            format!(
                "{:.5};{a:.5};{b:.5};{:.5};{c:.5}\n",
                0.01 * i as f64,
                40.0 * b
            )
            .replace('.', ",")
        })
        .collect();
    let text =
        format!("Prüfzeit;Sollkraft;Geschwindigkeit;Winkel;Prüfkraft\ns;N;rad/s;°;N\n{rows}");
    let old: Vec<u8> = text.chars().map(|c| c as u8).collect();
    for bytes in [old, text.clone().into_bytes()] {
        let (spec, said) = runs_as(&bytes);
        assert_eq!(spec.roles.time.column, "Prüfzeit", "{said}");
        assert_eq!(spec.roles.target.column, "Prüfkraft", "{said}");
        assert_eq!(spec.roles.command.as_ref().unwrap().column, "Sollkraft");
        assert_eq!(spec.roles.angle.as_ref().unwrap().unit, "deg", "{said}");
    }
    // Names in one line only.
    let one: Vec<u8> = text
        .replacen("s;N;rad/s;°;N\n", "", 1)
        .chars()
        .map(|c| c as u8)
        .collect();
    assert_eq!(runs_as(&one).0.roles.target.column, "Prüfkraft");
}

#[test]
fn counters_are_no_target_and_lists_in_cells_are_named() {
    let rows: String = (0..300)
        .map(|i| {
            let [a, b, _] = three(i);
            format!(
                "{:.9},{i},base,\"({a:.5}, {b:.5})\",\"['yaw', 'pitch']\"\n",
                0.01 * i as f64
            )
        })
        .collect();
    let (spec, text) = of(&format!(
        "Time,header.seq,header.frame_id,effort,name\n{rows}"
    ));
    assert_eq!(spec.roles.target.column, "?", "{text}");
    assert!(
        text.contains("several numbers in one cell, as text: \"effort\". Split"),
        "{text}"
    );
}

#[test]
fn marks_between_thousands_are_read() {
    for (cell, separator, thousands, decimal) in [
        ("1.234,5", ";", ".", ","),
        ("\"1,234.5\"", ",", ",", "."),
        ("1'234.5", ",", "'", "."),
        ("1\u{202f}234,5", ";", " ", ","),
    ] {
        let rows: String = (0..300)
            .map(|i| format!("0{separator}{cell}{separator}{i}\n"))
            .collect();
        let (spec, text) = runs(&format!("a{separator}force{separator}t\n{rows}"));
        let of = (spec.input.thousands.as_str(), spec.input.decimal.as_str());
        assert_eq!(of, (thousands, decimal), "{text}");
        assert!(text.contains("the mark between thousands"), "{text}");
    }
    // Three digits behind a comma are no proof of thousands, but between quotation marks in a file
    // of commas they are none of a decimal comma.
    for (first, thousands, decimal) in [("1,234", ",", "."), ("0,123", "", ",")] {
        let rows: String = (0..300)
            .map(|i| format!("{i},\"{first}\",\"2,345\"\n"))
            .collect();
        let (spec, text) = of(&format!("t,force,speed\n{rows}"));
        let of = (spec.input.thousands.as_str(), spec.input.decimal.as_str());
        assert_eq!(of, (thousands, decimal), "{text}");
    }
}

#[test]
fn rows_of_one_variable_each_are_named() {
    let rows: String = (0..300)
        .map(|i| format!("\"{}\";{},5;{}\n", ["F", "v", "x"][i % 3], i % 7, i / 3))
        .collect();
    let (_, text) = of(&format!("VarName;VarValue;Stamp\n{rows}"));
    assert!(text.contains("\"VarName\" has F, v, x in turn"), "{text}");
    // States do not take turns from row to row.
    let rows: String = (0..300)
        .map(|i| format!("{};{};{}\n", ["run", "hold"][i / 20 % 2], i % 7, i))
        .collect();
    let (_, text) = of(&format!("state;force;t\n{rows}"));
    assert!(!text.contains("in turn"), "{text}");
}

#[test]
fn a_unit_that_changes_within_a_column_is_an_error() {
    let rows = |last: &str| -> String {
        let all = (0..299).map(|i| format!("{},{}.5 N\n", 0.01 * f64::from(i), i % 7));
        all.chain([format!("2.99,1.5 {last}\n")]).collect()
    };
    let of = |last| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        std::fs::write(&path, format!("t,force\n{}", rows(last))).unwrap();
        let spec = Spec::parse(
            "[roles]\ntime = { column = \"t\", unit = \"s\" }\ntarget = { column = \"force\", unit = \"N\" }\n\
             [holdout]\nblock_s = 0.2\n[[terms]]\nname = \"offset\"\nexpr = \"1\"\n",
        );
        crate::load::load(&[path], &spec.unwrap()).map(|data| data.kept_rows().len())
    };
    assert_eq!(of("N").unwrap(), 300);
    let why = of("kN").unwrap_err().to_string();
    assert!(why.contains("`1.5 kN` is not a number"), "{why}");
}

/// A day that may be a month is told: steps over midnight depend on it.
#[test]
fn a_date_whose_month_is_not_sure_is_a_check() {
    let check = |date: &str| {
        let rows: String = (0..300)
            .map(|i| {
                let t = f64::from(i) * 0.01;
                format!("{date} 10:00:{t:06.3},{}\n", i % 7)
            })
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        std::fs::write(&path, format!("when,force_n\n{rows}")).unwrap();
        let spec = Spec::parse(&guess(std::slice::from_ref(&path)).unwrap()).unwrap();
        let data = crate::load::load(&[path], &spec).unwrap();
        // Seconds since 1970 are good to 0.2 us.
        assert!((data.frame().step() - 0.01).abs() < 1e-6);
        let told = data.findings().iter().map(|f| format!("{f:?}"));
        told.filter(|f| f.contains("may be exchanged")).count()
    };
    assert_eq!(check("4/3/2026"), 1);
    assert_eq!(check("13/3/2026"), 0);
}

/// A machine that was told a force and measured one: that it was a setpoint of some controller is
/// asked.
#[test]
fn a_setpoint_in_the_unit_of_the_target_is_the_command_where_there_is_none() {
    let rows: String = (0..300)
        .map(|i| {
            let [a, b, c] = three(i);
            format!("{:.4};{a:.4};{b:.4};{c:.4}\n", 0.01 * i as f64).replace('.', ",")
        })
        .collect();
    for head in [
        "Zeit [s];Sollkraft [N];Winkel [rad];Prüfkraft [N]",
        "Temps (s);Consigne (N);Angle (rad);Force (N)",
        "Tiempo (s);Consigna (N);Ángulo (rad);Fuerza (N)",
    ] {
        let (spec, text) = of(&format!("{head}\n{rows}"));
        let names: Vec<&str> = head.split(';').collect();
        assert_eq!(spec.roles.time.column, names[0], "{text}");
        assert_eq!(spec.roles.command.unwrap().column, names[1], "{text}");
        assert_eq!(spec.roles.angle.unwrap().column, names[2], "{text}");
        assert_eq!(spec.roles.target.column, names[3], "{text}");
        assert!(spec.roles.setpoint.is_none() && text.contains("a setpoint in the unit"));
    }
    // That of another quantity is none.
    let (spec, text) = of(&format!("t_s;target_pos_rad;q_rad;torque_nm\n{rows}"));
    assert!(
        spec.roles.command.is_none() && spec.roles.setpoint.is_some(),
        "{text}"
    );
}

#[test]
fn topics_of_unlike_rates_are_named() {
    let rows: String = (0..300)
        .map(|i| {
            let ([a, b, c], t) = (three(i), 0.01 * i as f64);
            format!("{t:.4},{a:.4},{b:.4},\n{:.4},,,{c:.4}\n", t + 0.003)
        })
        .collect();
    let (_, text) = of(&format!(
        "__time,/rig/effort[0],/rig/velocity[0],/wrench/force/z\n{rows}"
    ));
    for part in [
        "or is it \"/wrench/force/z\"",
        "no row has both the target and \"/wrench/force/z\"",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn rows_with_words_at_the_head_of_a_log_are_rows() {
    for words in ["heating", "#DIV/0!", "not ready"] {
        let rows: String = (0..300)
            .map(|i| {
                let [a, b, c] = three(i);
                let temperature = if i < 120 {
                    words.into()
                } else {
                    format!("{:.2}", 20.0 + a)
                };
                format!(
                    "{:.3},{a:.4},{b:.4},{c:.4},{temperature}\n",
                    0.01 * i as f64
                )
            })
            .collect();
        let (spec, text) = of(&format!("time,command,velocity,force,temp\n{rows}"));
        assert_eq!(spec.input.skip, 0, "{words}: {text}");
    }
}

#[test]
fn the_unit_of_a_stated_rate_may_stand_beside_it() {
    let rows: String = (0..300)
        .map(|i| three(i).map(|x| format!("{x:.5}")).join(",") + "\n")
        .collect();
    for stated in [
        "Sample Period:,10,ms",
        "Sample Period,10 ms",
        "Sampling interval [us],10000",
        "Sample rate (kHz),0.1",
        "Sample rate,6000 /min",
        "Data rate: 100 SPS",
        "\"SampleRate\",100.0,100.0,100.0",
        "FREQUENCY,100",
    ] {
        let (spec, text) = of(&format!("{stated}\ncommand,velocity,force\n{rows}"));
        assert!((spec.input.rate - 100.0).abs() < 1e-6, "{stated}: {text}");
    }
    // Of a unit that is not known no rate is made.
    let text = text_of(&format!(
        "Sample rate,100 blocks\ncommand,velocity,force\n{rows}"
    ));
    assert!(text.contains("# rate = ..."), "{text}");
}

#[test]
fn names_that_are_understood_are_taken_before_lines_of_kinds() {
    let rows: String = (0..300)
        .map(|i| {
            let [a, b, c] = three(i);
            format!("{:.3},{a:.4},{b:.4},{c:.4}\n", 0.01 * i as f64)
        })
        .collect();
    let kinds = "Type: double,Type: double,Type: double,Type: double\n\
                 Interp: linear,Interp: linear,Interp: linear,Interp: linear\n";
    let (spec, text) = of(&format!("time,command,velocity,force\n{kinds}{rows}"));
    assert_eq!(spec.roles.target.column, "force", "{text}");
    assert_eq!(spec.roles.time.column, "time", "{text}");
}
