//! What is noted in a log: parts that stand twice, units and times of one file, targets that are
//! held, motions that repeat.

use super::*;

#[test]
fn parts_of_one_log_given_twice_are_noted() {
    let copied = |data: &Data| finding(data, "copied rows").map(|f| (f.count, f.first.clone()));
    assert_eq!(copied(&runs(|_, _| {}).load(MODEL).unwrap()), None);
    // One is the first half of another; then one that begins in the middle of another.
    for (from, to) in [(0, 100), (100, 200), (60, 160)] {
        let folder = runs(|_, _| {});
        folder.put("run9.csv", &csv(&rows(1, 200)[from..to]));
        let (count, first) = copied(&folder.load(MODEL).unwrap()).unwrap();
        assert!((95..=100).contains(&count), "{count} {first}");
        assert!(
            first.contains("run1.csv") && first.contains("run9.csv"),
            "{first}"
        );
    }
    // One log three times in one file, with a time that goes on.
    let folder = Folder::new();
    let mut all = Vec::new();
    for part in 0..3 {
        all.extend(
            rows(1, 400)
                .into_iter()
                .map(|[t, y, c]| [t + 8.0 * f64::from(part), y, c]),
        );
    }
    folder.put("a.csv", &csv(&all));
    let blocks = format!("{MODEL}[holdout]\nblock_s = 3.0\n");
    assert!(copied(&folder.load(&blocks).unwrap()).unwrap().0 > 600);
    // The same in other digits.
    let folder = runs(|_, _| {});
    let printed = rows(2, 150)
        .into_iter()
        .map(|[t, y, c]| [t, (y * 1e3).round() / 1e3, c]);
    folder.put("run9.csv", &csv(&printed.collect::<Vec<_>>()));
    let (count, first) = copied(&folder.load(MODEL).unwrap()).unwrap();
    assert!(
        count == 150 && first.contains("run9.csv"),
        "{count} {first}"
    );
    // One motion measured twice is no copy, nor is a signal of few steps.
    let repeated = runs(|run, rows| {
        for (i, row) in rows.iter_mut().enumerate() {
            row[2] = 3.0 + (0.02 * i as f64).sin();
            row[1] = row[2] + 0.1 * noise(i, run);
        }
    });
    assert_eq!(copied(&repeated.load(MODEL).unwrap()), None);
    let steps = runs(|run, rows| {
        for (i, row) in rows.iter_mut().enumerate() {
            row[1] = ((i + run) / 8 % 5) as f64;
        }
    });
    assert_eq!(copied(&steps.load(MODEL).unwrap()), None);
}

#[test]
fn an_angle_that_begins_again_is_noted_and_made_to_go_on_where_asked() {
    let folder = |unit: f64, speed: f64| {
        let folder = Folder::new();
        for run in 0..2usize {
            let mut text = "t,y,c,x,v\n".to_string();
            for i in 0..600usize {
                let x = run as f64 + speed * i as f64 - 2.0 * (0.03 * i as f64).sin();
                let wrapped = x.rem_euclid(std::f64::consts::TAU) * unit;
                text += &format!("{},{},0,{wrapped},1\n", 0.01 * i as f64, noise(i, run));
            }
            folder.put(&format!("{run}.csv"), &text);
        }
        folder
    };
    let degree = 360.0 / std::f64::consts::TAU;
    for (unit, name) in [(1.0, "rad"), (degree, "deg"), (degree, "degrees")] {
        let model = MODEL.replace("[[terms]]", &ANGLE.replace("rad", name));
        let data = folder(unit, 0.1).load(&model).unwrap();
        let found = finding(&data, "wrapped angle").unwrap();
        assert!(
            found.count > 10 && found.what.contains("hygiene.wraps"),
            "{found:?}"
        );
        let fix = format!("{model}[hygiene]\nwraps = \"fix\"\n");
        for speed in [0.1, -0.1] {
            let data = folder(unit, speed).load(&fix).unwrap();
            let found = finding(&data, "wrapped angle").unwrap();
            assert!(found.what.contains("was made to go on"), "{found:?}");
            let x = data.frame().column("angle").unwrap();
            for r in data.frame().sequences() {
                let moved = (x[r.end - 1] - x[r.start]) / unit;
                assert!(
                    (moved - speed * 599.0 + 2.0 * (0.03f64 * 599.0).sin()).abs() < 1e-9,
                    "{moved}"
                );
            }
        }
        // Beside a velocity of its own a spring still needs it.
        let beside = model.replace("[[terms]]", "velocity = { column = \"v\" }\n[[terms]]");
        let data = folder(unit, 0.1).load(&beside).unwrap();
        let found = finding(&data, "wrapped angle").unwrap();
        assert!(found.what.contains("springs, gaps"), "{found:?}");
    }
    // A length jumps as it likes.
    let length = MODEL.replace("[[terms]]", &ANGLE.replace("rad", "mm"));
    assert!(finding(&folder(1.0, 0.1).load(&length).unwrap(), "wrapped angle").is_none());
    let says = Spec::parse(&format!("{MODEL}[hygiene]\nwraps = \"drop\"\n")).unwrap_err();
    assert!(says.to_string().contains("hygiene.wraps"), "{says}");
}

/// One run of four has a column that is 1000 times as large, or in degrees.
#[test]
fn a_file_with_another_unit_is_told() {
    let load = |factor: f64, sizes: [f64; 4]| {
        let folder = Folder::new();
        for (run, size) in sizes.into_iter().enumerate() {
            let k = if run == 2 { factor } else { 1.0 };
            let mut text = "t,y,c\n".to_string();
            for i in 0..300usize {
                let command = size * (0.02 * (1.0 + 0.1 * run as f64) * i as f64).sin();
                text += &format!(
                    "{},{},{command}\n",
                    0.01 * i as f64,
                    k * (command + 0.1 * noise(i, run))
                );
            }
            folder.put(&format!("{run}.csv"), &text);
        }
        folder.load(MODEL).unwrap()
    };
    let told = |data: &Data| finding(data, "unit of a file").map(|f| f.what.clone());
    let what = told(&load(1e3, [1.0, 1.2, 0.9, 1.1])).unwrap();
    for words in ["in 2.csv column `y`", "larger, about the 1000", "convert"] {
        assert!(what.contains(words), "{what}");
    }
    assert!(told(&load(0.0175, [1.0; 4]))
        .unwrap()
        .contains("smaller, about the 57.30"));
    // No factor between units, small ones, and motions of every size.
    assert_eq!(told(&load(200.0, [1.0; 4])), None);
    assert_eq!(told(&load(9.8, [1.0; 4])), None);
    assert_eq!(told(&load(1e3, [1.0, 20.0, 1.0, 0.05])), None);
}

/// The newest row is the first: the same data, and it is said.
#[test]
fn a_log_with_the_newest_row_first_is_read_from_its_end() {
    let load = |backwards: bool| {
        let folder = Folder::new();
        for run in 0..2usize {
            let mut rows: Vec<String> = (0..300usize)
                .map(|i| format!("{},{},{}\n", 0.01 * i as f64, noise(i, run), i % 7))
                .collect();
            if backwards {
                rows.reverse();
            }
            folder.put(&format!("{run}.csv"), &format!("t,y,c\n{}", rows.concat()));
        }
        folder.load(MODEL).unwrap()
    };
    let (forward, backward) = (load(false), load(true));
    let column = |data: &Data, name: &str| data.frame().column(name).unwrap().to_vec();
    assert_eq!(forward.frame().time(), backward.frame().time());
    assert_eq!(column(&forward, "target"), column(&backward, "target"));
    assert!(finding(&forward, "newest first").is_none());
    assert_eq!(finding(&backward, "newest first").unwrap().count, 600);
}

/// Runs with an angle and its speed, the time of each run by a factor of its own.
fn stamped(factor: impl Fn(usize) -> f64) -> Data {
    let folder = Folder::new();
    for run in 0..8 {
        let mut text = "t,y,c,x,v\n".to_string();
        for i in 0..300 {
            let t = 0.01 * i as f64;
            let (x, v) = ((3.0 * t).sin(), 3.0 * (3.0 * t).cos());
            text += &format!("{},{},0,{x},{v}\n", factor(run) * t, noise(i, run));
        }
        folder.put(&format!("run{run}.csv"), &text);
    }
    let velocity = "velocity = { column = \"v\", unit = \"rad/s\" }\nangle =";
    folder
        .load(&MODEL.replace("[[terms]]", &ANGLE.replace("angle =", velocity)))
        .unwrap()
}

#[test]
fn a_file_with_a_wrong_time_is_named() {
    let check = "speed against angle";
    assert!(finding(&stamped(|_| 1.0), check).is_none());
    let data = stamped(|run| if run == 5 { 2.0 } else { 1.0 });
    let found = finding(&data, check).unwrap();
    assert_eq!(found.count, 300);
    assert!(found.what.contains("is 0.4999 times"), "{found:?}");
    assert!(
        found.what.contains("in run5.csv (0.4999) only"),
        "{found:?}"
    );
    let found = stamped(|_| 2.0);
    let found = finding(&found, check).unwrap();
    assert!(
        found.count == 2400 && found.first == "whole record",
        "{found:?}"
    );
}

#[test]
fn a_target_that_is_the_slope_of_the_velocity_is_noted() {
    let with = |noisy: f64| {
        let folder = Folder::new();
        for run in 0..2 {
            let mut text = "t,y,c,v\n".to_string();
            for i in 0..400 {
                let t = 0.01 * i as f64;
                let v = (3.0 * t + run as f64).sin();
                let y = 6.0 * (3.0 * t + run as f64).cos() + noisy * noise(i, run);
                text += &format!("{t},{y},0,{v}\n");
            }
            folder.put(&format!("{run}.csv"), &text);
        }
        let velocity = "velocity = { column = \"v\", unit = \"m/s\" }\n[[terms]]";
        let data = folder.load(&MODEL.replace("[[terms]]", velocity)).unwrap();
        finding(&data, "target from velocity").cloned()
    };
    let found = with(0.0).unwrap();
    assert!(found.what.contains("is 0.499"), "{found:?}");
    assert_eq!(with(1.0), None);
}

#[test]
fn a_column_that_an_expression_cannot_reach_is_noted() {
    let with = |column: &str, expr: &str, roles: &str| {
        let folder = runs(|_, _| {});
        for run in 0..3 {
            let path = folder.0.path().join(format!("run{run}.csv"));
            let text = std::fs::read_to_string(&path).unwrap();
            std::fs::write(&path, text.replacen("t,y,c", &format!("t,y,{column}"), 1)).unwrap();
        }
        let model = MODEL
            .replace("\"c\"", &format!("\"{column}\""))
            .replace("command =", roles);
        folder.load(&model.replace("\"command\"", &format!("\"{expr}\"")))
    };
    for (column, expr) in [
        ("elapsed", "elapsed"),
        ("file", "1 + file"),
        ("pi", "2 * pi"),
    ] {
        let data = with(column, expr, "command =").unwrap();
        let found = finding(&data, "shadowed column").unwrap();
        assert!(
            found.what.contains(column) && found.what.contains("roles.channels"),
            "{found:?}"
        );
    }
    // The column of the role of that name is no other.
    assert!(finding(
        &with("command", "command", "command =").unwrap(),
        "shadowed column"
    )
    .is_none());
    assert!(finding(
        &with("elapsed", "command", "command =").unwrap(),
        "shadowed column"
    )
    .is_none());
    let data = with(
        "command",
        "command",
        "velocity = { column = \"t\" }\nsetpoint =",
    );
    assert!(data.is_ok());
    // A name with signs cannot be written, and the error says what can.
    let says = with("force (N)", "force (N)", "command =")
        .unwrap_err()
        .to_string();
    assert!(says.contains("[roles.channels]"), "{says}");
    let says = with("motor force", "motor force", "command =")
        .unwrap_err()
        .to_string();
    assert!(says.contains("[roles.channels]"), "{says}");
}

/// One motion over and over in one log: blocks of time are those of one pass.
#[test]
fn a_motion_that_repeats_is_held_out_in_all_passes() {
    let period = 12.0;
    let log = |cycle: f64| {
        let own: Vec<[f64; 3]> = (0..3000)
            .map(|i| {
                let t = 0.02 * i as f64;
                let w = std::f64::consts::TAU / cycle;
                let c = 3.0 + (w * t).sin() + 0.6 * (3.0 * w * t).cos();
                [t, c + 0.1 * noise(i, 0), c]
            })
            .collect();
        let folder = Folder::new();
        folder.put("log.csv", &csv(&own));
        folder
            .load(&format!("[holdout]\nblock_s = 2.0\n{MODEL}"))
            .unwrap()
    };
    let data = log(period);
    assert_eq!(data.groups(), 6);
    let fold = |t: f64| data.fold()[(t / 0.02) as usize];
    assert_eq!(fold(1.0), fold(1.0 + period));
    assert_ne!(fold(1.0), fold(3.0));
    let noted = |data: &Data| data.hygiene.iter().any(|f| f.check == "repeated motion");
    assert!(noted(&data));
    let other = log(7000.0);
    assert_eq!((other.groups(), noted(&other)), (30, false));
}

/// The slope of an angle in degrees is held against a speed in radians.
#[test]
fn a_speed_in_another_unit_than_the_angle_is_held_against_it() {
    let told = |unit: &str| {
        let folder = Folder::new();
        for run in 0..2usize {
            let mut text = "t,y,c,x,v\n".to_string();
            for i in 0..300usize {
                let t = 0.01 * i as f64;
                let (x, v) = (100.0 * (3.0 * t).sin(), 300.0 * (3.0 * t).cos());
                text += &format!("{t},{},0,{x},{v}\n", noise(i, run));
            }
            folder.put(&format!("{run}.csv"), &text);
        }
        let velocity = format!("velocity = {{ column = \"v\", unit = \"{unit}\" }}\nangle =");
        let angle = ANGLE.replace("rad", "deg").replace("angle =", &velocity);
        let data = folder.load(&MODEL.replace("[[terms]]", &angle)).unwrap();
        finding(&data, "speed against angle").map(|f| f.what.clone())
    };
    assert_eq!(told("deg/s"), None);
    let what = told("rad/s").unwrap();
    assert!(what.contains("is 0.01745 times"), "{what}");
    // Of a unit that is not known nothing is said.
    assert_eq!(told("counts/s"), None);
}

/// Rows at rest repeat all that they have; a target that holds its values is told all the same.
#[test]
fn a_held_target_is_told_beside_rows_at_rest() {
    let folder = Folder::new();
    for run in 0..2usize {
        let mut text = "t,y,c\n".to_string();
        for i in 0..2000usize {
            // A tenth of the time nothing moves.
            let moving = i - (i % 1000).saturating_sub(900);
            let command = (0.01 * moving as f64).sin();
            text += &format!(
                "{},{},{command}\n",
                0.01 * i as f64,
                5.0 * noise(i / 5, run)
            );
        }
        folder.put(&format!("{run}.csv"), &text);
    }
    let data = folder.load(MODEL).unwrap();
    let held = finding(&data, "held target").unwrap();
    assert!(held.what.contains("for 5 rows"), "{held:?}");
    assert!(finding(&data, "repeat").is_none());
}

/// Two screws that turn on are alike in that alone.
#[test]
fn screws_that_turn_on_repeat_no_motion() {
    let load = |own: f64| {
        let folder = Folder::new();
        for run in 0..4usize {
            let mut text = "t,y,c,x\n".to_string();
            for i in 0..600usize {
                let t = 0.01 * i as f64;
                let x = 10.0 * t + 0.3 * ((2.0 + own * run as f64) * t).sin();
                text += &format!("{t},{},0,{x}\n", noise(i, run));
            }
            folder.put(&format!("{run}.csv"), &text);
        }
        let data = folder.load(&MODEL.replace("[[terms]]", ANGLE)).unwrap();
        finding(&data, "repeated motion").is_some()
    };
    assert!(!load(0.7) && load(0.0));
}
