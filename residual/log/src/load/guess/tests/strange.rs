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
