//! Logs of other programs and other languages.

use super::*;

/// A log with a name for each of its columns, of which the first grows as a time does.
fn named(header: &str) -> (Spec, String) {
    let count = header.lines().next().unwrap().split(',').count();
    of(&log(&format!("{header}\n"), 300, |i| {
        let cell = |k: usize| (0.05 * i * (1.0 + 0.3 * k as f64)).sin();
        std::iter::once(0.01 * i)
            .chain((1..count).map(cell))
            .collect()
    }))
}

/// The line of a role in a model file.
fn line<'a>(text: &'a str, role: &str) -> &'a str {
    let begin = format!("{role} = ");
    text.lines()
        .find(|l| l.starts_with(&begin))
        .unwrap_or_default()
}

#[test]
fn a_torque_is_none_of_its_parts() {
    for (unit, scale) in [
        ("ft-lb", 1.355_817_948),
        ("lbf·ft", 1.355_817_948),
        ("in·lbf", 0.112_984_829),
        ("lb.in", 0.112_984_829),
        ("oz-in", 0.007_061_552),
        ("kgf.cm", 0.098_066_5),
        ("N.cm", 0.01),
        ("N*mm", 1e-3),
        ("kN·m", 1e3),
        ("mNm", 1e-3),
    ] {
        for header in [
            format!("time (s),angle (deg),torque ({unit})"),
            format!("time,angle,torque\n(s),(deg),({unit})"),
        ] {
            let (spec, text) = named(&header);
            let target = &spec.roles.target;
            assert_eq!(
                (target.column.starts_with("torque"), target.unit.as_str()),
                (true, "N·m"),
                "{text}"
            );
            assert!((target.scale / scale - 1.0).abs() < 1e-6, "{text}");
            assert!(!line(&text, "target").contains('?'), "{text}");
        }
    }
}

#[test]
fn a_unit_of_several_parts_that_is_not_known_is_asked_about() {
    for unit in ["N/mm", "lbf.furlong", "A·s", "m/s^2"] {
        let (spec, text) = named(&format!("time (s),force ({unit})"));
        let target = &spec.roles.target;
        assert_eq!((target.unit.as_str(), target.scale), (unit, 1.0), "{text}");
        assert!(line(&text, "target").contains("# ? unit"), "{text}");
    }
}

#[test]
fn a_force_comes_before_a_coordinate() {
    for (header, target) in [
        ("Time,X,Y,Fz\ns,mm,mm,N", "Fz"),
        ("Time (s),Y (mm),Cell 4 (kN)", "Cell 4 (kN)"),
        ("Time (s),Y (mm),Mx (N·m),X (mm)", "Mx (N·m)"),
        ("Time,Extension,Load\n(s),(mm),(kN)", "Load"),
        ("t,y,a", "y"),
    ] {
        let (spec, text) = named(header);
        assert_eq!(spec.roles.target.column, target, "{text}");
    }
    let (spec, text) = named("Time,Extension,Load\n(s),(mm),(kN)");
    assert_eq!(spec.roles.angle.unwrap().column, "Extension", "{text}");
    // Where nothing else is there it is taken, with a question.
    let (spec, text) = named("Time,X,Y\ns,mm,mm");
    assert_eq!(spec.roles.target.column, "Y", "{text}");
    assert!(line(&text, "target").contains("a coordinate"), "{text}");
}

#[test]
fn a_temperature_is_the_last_choice_for_a_target() {
    let (spec, text) = named("millis,rpm,mA,degC");
    let target = &spec.roles.target;
    assert_eq!(
        (target.column.as_str(), target.unit.as_str(), target.scale),
        ("mA", "A", 1e-3),
        "{text}"
    );
    assert!(line(&text, "target").contains("# ?"), "{text}");
    assert_eq!(spec.roles.temperature.unwrap().column, "degC", "{text}");
    let (spec, text) = named("time (s),oven (°C)");
    assert_eq!(spec.roles.target.column, "oven (°C)", "{text}");
}

#[test]
fn roles_are_known_in_usual_languages() {
    for (header, quantity) in [
        ("Zeit [s],Standardweg [mm],Standardkraft [N]", "Kraft"),
        ("Time (s),Crosshead (mm),Load (N)", "force"),
        ("Temps (s),Course (mm),Couple (N.m)", "couple"),
        ("Tempo (s),Corsa (mm),Carico (N)", "carico"),
        ("Tiempo (s),Desplazamiento (mm),Carga (N)", "carga"),
        ("Tempo (s),Deslocamento (mm),Força (gf)", "força"),
        ("時間[s],変位[mm],トルク[N·m]", "トルク"),
        ("时间(s),位移(mm),力(N)", "力"),
        ("時間 (s),行程 (mm),載荷 (N)", "載荷"),
    ] {
        let (spec, text) = named(header);
        let names: Vec<&str> = header.split(',').collect();
        let roles = &spec.roles;
        assert_eq!(roles.time.column, names[0], "{text}");
        let angle = roles.angle.as_ref().unwrap_or_else(|| panic!("{text}"));
        assert_eq!(
            (angle.column.as_str(), angle.unit.as_str()),
            (names[1], "mm")
        );
        assert_eq!(roles.target.column, names[2], "{quantity}: {text}");
        assert!(!line(&text, "target").contains('?'), "{text}");
    }
    for (header, role) in [
        ("temps (s),température (°C),force (N)", "temperature"),
        ("時間[s],温度[°C],荷重[N]", "temperature"),
        ("時間[s],回転数[rpm],荷重[N]", "velocity"),
        ("时间[s],转速[rpm],扭矩[N·m]", "velocity"),
        ("tempo (s),corrente (A),forza (N)", "command"),
        ("時間[s],電流[A],荷重[N]", "command"),
    ] {
        let (_, text) = named(header);
        let name = header.split(',').nth(1).unwrap();
        assert!(line(&text, role).contains(name), "{role}: {text}");
    }
    // An acceleration is no velocity, and a cursor no travel.
    let (spec, text) = named("時間[s],加速度[m/s²],cursor,thermocouple_1,荷重[N]");
    assert!(
        spec.roles.velocity.is_none() && spec.roles.angle.is_none(),
        "{text}"
    );
    assert_eq!(spec.roles.target.column, "荷重[N]", "{text}");
}

#[test]
fn names_in_a_comment_may_follow_a_word() {
    for (comment, separator) in [
        ("# signals: t[s] q[rad] i_q[A] tau_cmd[Nm]", " "),
        ("# Columns: t[s], q[rad], i_q[A], tau_cmd[Nm]", " "),
        ("# t[s],q[rad],i_q[A],tau_cmd[Nm]", " "),
        ("# names: t[s], q[rad], i_q[A], tau_cmd[Nm]", ","),
        ("# t[s] q[rad] i_q[A] tau_cmd[Nm]", " "),
    ] {
        let body = log("", 300, |i| {
            let x = 0.05 * i;
            vec![0.01 * i, x.sin(), (1.3 * x).sin(), (1.7 * x).sin()]
        });
        let (spec, text) = of(&format!(
            "# bench: 7\n{comment}\n{}",
            body.replace(',', separator)
        ));
        assert_eq!(
            spec.input.header,
            ["t[s]", "q[rad]", "i_q[A]", "tau_cmd[Nm]"],
            "{text}"
        );
        let roles = &spec.roles;
        assert_eq!(roles.time.column, "t[s]", "{text}");
        assert_eq!(
            (roles.target.column.as_str(), roles.target.unit.as_str()),
            ("i_q[A]", "A"),
            "{text}"
        );
        assert_eq!(roles.angle.as_ref().unwrap().column, "q[rad]", "{text}");
        assert_eq!(roles.command.as_ref().unwrap().unit, "N·m", "{text}");
    }
    // A comment that has another number of words names nothing.
    let (_, text) = of(&format!("# made, by hand, cold\n{}", rows(" ", ".")));
    assert!(text.contains("the file has no header"), "{text}");
}

#[test]
fn names_below_a_line_of_kinds_are_those_of_the_numbers() {
    let body = log("", 300, |i| {
        vec![0.01 * i, (0.05 * i).sin(), (0.07 * i).sin()]
    });
    let body: String = body.lines().map(|l| format!(",{l}\n")).collect();
    let (spec, text) = of(&format!(
        "file,bench.mat\ntype,time,double,double\n\
         trace_values,\"Rig/Speed [mm/s]/Out1\",\"Rig/Force [kN]/Out1\"\n{body}"
    ));
    let roles = &spec.roles;
    assert_eq!(roles.time.column, "time", "{text}");
    assert_eq!(
        (
            roles.target.column.as_str(),
            roles.target.unit.as_str(),
            roles.target.scale
        ),
        ("Rig/Force [kN]/Out1", "N", 1e3),
        "{text}"
    );
    let velocity = roles.velocity.as_ref().unwrap();
    assert_eq!(velocity.unit, "mm/s", "{text}");
}

#[test]
fn a_date_beside_am_and_pm_has_its_month_first() {
    let rows: String = (0..400)
        .map(|i| {
            let (day, clock, half) = match i {
                0..200 => (
                    11,
                    format!("11:59:{:06.3}", 58.0 + 0.01 * f64::from(i)),
                    "PM",
                ),
                _ => (
                    12,
                    format!("12:00:{:06.3}", 0.01 * f64::from(i - 200)),
                    "AM",
                ),
            };
            format!("3/{day}/2025,{clock} {half},{},{}\n", i % 7, i % 5)
        })
        .collect();
    let (spec, text) = of(&format!("Date,Time,Force (N),Angle (deg)\n{rows}"));
    assert_eq!(spec.roles.time.column, "Date+Time", "{text}");
    assert!(text.contains("one file of 3.99"), "{text}");
}

#[test]
fn names_in_the_codes_of_japan_and_china_are_read() {
    let body = log("", 300, |i| {
        vec![0.01 * i, (0.05 * i).sin(), (0.07 * i).cos()]
    });
    for (head, code, name) in [
        (
            "装置,7号,\n時間,変位,荷重\n(秒),(mm),(kN)",
            encoding_rs::SHIFT_JIS,
            "Shift-JIS",
        ),
        ("时间(s),位移(mm),力(kN)", encoding_rs::GB18030, "GB18030"),
    ] {
        let (bytes, ..) = code.encode(head);
        let bytes = [&bytes[..], format!("\n{body}").as_bytes()].concat();
        let (spec, text) = run::runs_as(&bytes);
        let roles = &spec.roles;
        assert_eq!(roles.time.column, spec.input.header[0], "{text}");
        assert_eq!(
            (roles.target.unit.as_str(), roles.target.scale),
            ("N", 1e3),
            "{text}"
        );
        assert_eq!(roles.angle.as_ref().unwrap().unit, "mm", "{text}");
        assert!(text.contains(&format!("taken for {name}")), "{text}");
    }
}
