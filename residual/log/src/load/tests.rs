//! Logs as a user has them, read as far as to the data; what an analysis makes of them is tested
//! elsewhere.

mod memory;
mod values;

use super::*;
use crate::finding::Finding;

/// The roles of every log here, and one term.
const MODEL: &str = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
command = { column = "c", unit = "N" }
[[terms]]
name = "gain"
expr = "command"
"#;

/// A folder with files of its own.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    fn put(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    fn load(&self, model: &str) -> Result<Data, Error> {
        load(&[self.0.path().to_path_buf()], &Spec::parse(model)?)
    }

    /// What is said where the folder cannot be read.
    fn refused(&self, model: &str) -> String {
        self.load(model).expect_err(model).to_string()
    }
}

/// Pseudo-random number in -1..1 that depends on the row and the run only.
fn noise(row: usize, run: usize) -> f64 {
    2.0 * random::of((row + 1_000_003 * run) as u64) - 1.0
}

/// Time, target and command of one run.
fn rows(run: usize, count: usize) -> Vec<[f64; 3]> {
    (0..count)
        .map(|i| {
            let t = 0.02 * i as f64;
            let c = 3.0 + (0.7 * t + 2.0 * run as f64).sin();
            [t, c + 0.1 * noise(i, run), c]
        })
        .collect()
}

fn csv(rows: &[[f64; 3]]) -> String {
    rows.iter().fold("t,y,c\n".to_string(), |s, [t, y, c]| {
        s + &format!("{t},{y},{c}\n")
    })
}

/// A folder with three runs, each changed.
fn runs(change: impl Fn(usize, &mut Vec<[f64; 3]>)) -> Folder {
    let folder = Folder::new();
    for run in 0..3 {
        let mut rows = rows(run, 200);
        change(run, &mut rows);
        folder.put(&format!("run{run}.csv"), &csv(&rows));
    }
    folder
}

/// The finding of a check.
fn finding<'a>(data: &'a Data, check: &str) -> Option<&'a Finding> {
    data.hygiene.iter().find(|f| f.check == check)
}

#[test]
fn a_value_that_cannot_be_squared_is_refused_with_its_line() {
    for (cell, limit) in [(0, "1e70"), (1, "1e140"), (2, "1e70")] {
        for value in [1e160, -1e308] {
            let folder = runs(|run, rows| {
                if run == 1 {
                    rows[40][cell] = value;
                }
            });
            let says = folder.refused(MODEL);
            let column = ["t", "y", "c"][cell];
            let place = format!("run1.csv: line 42: column `{column}`");
            assert!(says.contains(&place) && says.contains(limit), "{says}");
            // As a line that is no row it can be left out.
            let drop = format!("{MODEL}[hygiene]\ntext = \"drop\"\n");
            assert_eq!(folder.load(&drop).unwrap().frame().len(), 599);
        }
    }
    // The scale makes it so.
    let scaled = MODEL.replace("column = \"c\"", "column = \"c\", scale = 1e160");
    let says = runs(|_, _| {}).refused(&scaled);
    assert!(says.contains("run0.csv: line 2: column `c`"), "{says}");
    // A column that nothing uses may have any value.
    let unused = MODEL.replace("command = { column = \"c\", unit = \"N\" }\n", "");
    let unused = unused.replace("expr = \"command\"", "expr = \"1\"");
    runs(|_, rows| rows[40][2] = 1e308).load(&unused).unwrap();
    // Columns in memory have rows.
    let mut values = vec![0.0; 60];
    values[7] = 1e160;
    let time: Vec<f64> = (0..60).map(f64::from).collect();
    let table = Table::new("a")
        .with("t", time.clone())
        .with("y", time.clone())
        .with("c", values.clone());
    let says = from_tables(vec![table], &Spec::parse(MODEL).unwrap()).unwrap_err();
    assert!(
        says.to_string().contains("a: row 8 of the data: `command`"),
        "{says}"
    );
    let says = Data::from_columns(time.clone(), [("target", time), ("command", values)])
        .sequences([0..30, 30..60])
        .build()
        .unwrap_err();
    assert!(
        says.to_string().contains("`command` is 1e160 in row 7"),
        "{says}"
    );
}

#[test]
fn a_target_that_predicts_itself_is_refused() {
    let with = |from: &str, to: &str| {
        let model = MODEL.replace(from, to);
        Spec::parse(&model).expect_err(&model).to_string()
    };
    for (from, to, part) in [
        ("column = \"c\"", "column = \"y\"", "role `command`"),
        (
            "\"command\"",
            "\"target\"",
            "term `gain`: its expression has `target`",
        ),
        (
            "\"command\"",
            "\"command + y\"",
            "term `gain`: its expression has `y`",
        ),
        (
            "[[terms]]",
            "channels = { k = { column = \"y\" } }\n[[terms]]",
            "role `k`",
        ),
        (
            "[[terms]]\nname = \"gain\"\nexpr = \"command\"",
            "groups = { k = { column = \"y\" } }\n[[terms]]\nname = \"a\"\nexpr = \"k\"",
            "term `a`: its expression has `k`",
        ),
    ] {
        let says = with(from, to);
        assert!(
            says.contains(part) && says.contains("predict itself"),
            "{says}"
        );
    }
    // Rows may be chosen by the target, and a role may have the name of the target's column.
    Spec::parse(&format!("{MODEL}[rows]\nkeep = \"target > 0 && y < 9\"\n")).unwrap();
    let named = MODEL.replace("\"y\"", "\"command\"");
    Spec::parse(&named).unwrap();
}

#[test]
fn a_time_in_another_unit_than_seconds_is_refused_with_its_scale() {
    let with =
        |unit: &str| Spec::parse(&MODEL.replace("unit = \"s\"", &format!("unit = \"{unit}\"")));
    for unit in ["", "s", "S", "sec", "[s]", "Seconds", "Sekunden"] {
        with(unit).expect(unit);
    }
    for (unit, says) in [
        ("ms", "scale = 1e-3"),
        ("msec", "scale = 1e-3"),
        ("Milliseconds", "scale = 1e-3"),
        ("(ms)", "scale = 1e-3"),
        ("µs", "scale = 1e-6"),
        ("ns", "scale = 1e-9"),
        ("min", "scale = 60.0"),
        ("h", "scale = 3600.0"),
        ("hours", "scale = 3600.0"),
        ("days", "scale = 86400.0"),
        ("ticks", "the seconds in one of them"),
        ("s^2", "the seconds in one of them"),
    ] {
        let error = with(unit).expect_err(unit).to_string();
        assert!(error.contains(says) && error.contains(unit), "{error}");
    }
}

#[test]
fn folds_that_hold_nothing_out_are_refused() {
    for folds in [0, 1] {
        let says = Spec::parse(&format!("{MODEL}[holdout]\nfolds = {folds}\n")).unwrap_err();
        assert!(says.to_string().contains("2 or more"), "{says}");
    }
    assert_eq!(Spec::parse(MODEL).unwrap().holdout.folds, 10);
}

/// A map: `held` rows at each of 120 points of a turn, with a pause between points; an angle that
/// is `scattered` at a point.
fn map(held: usize, scattered: f64, moving: f64) -> Folder {
    let folder = Folder::new();
    for run in 0..2 {
        let mut text = "t,y,c,x\n".to_string();
        for point in 0..120 {
            for i in 0..held {
                let t = 2.0 * f64::from(point) + 0.001 * i as f64;
                let row = 1000 * point as usize + i;
                let x = 0.05 * f64::from(point)
                    + scattered * noise(row, 7)
                    + moving * i as f64 / held as f64;
                text += &format!("{t:.3},{},0,{x}\n", noise(row, run));
            }
        }
        folder.put(&format!("{run}.csv"), &text);
    }
    folder
}

const ANGLE: &str = "angle = { column = \"x\", unit = \"rad\" }\n[[terms]]";

#[test]
fn a_map_is_not_cut_into_its_points() {
    let model = MODEL.replace("[[terms]]", ANGLE);
    for held in [30, 100] {
        let data = map(held, 5e-4, 0.0).load(&model).unwrap();
        assert_eq!(data.frame().sequences().len(), 2, "{held}");
        let found = finding(&data, "held points").unwrap();
        assert!(
            found.count == 238 && found.what.contains("hygiene.gap_s"),
            "{found:?}"
        );
        // As the user says.
        let cut = format!("{model}[hygiene]\ngap_s = 0.5\n");
        let data = map(held, 5e-4, 0.0).load(&cut).unwrap();
        assert_eq!(data.frame().sequences().len(), 240);
    }
    // Runs of a motion with pauses are cut, and the note says how not to.
    let data = map(30, 0.0, 2.0).load(&model).unwrap();
    assert_eq!(data.frame().sequences().len(), 240);
    let found = finding(&data, "gap").unwrap();
    assert!(found.what.contains("set hygiene.gap_s"), "{found:?}");
    // Where nothing has a position the command tells; here it stands always.
    let data = map(30, 0.0, 0.0).load(MODEL).unwrap();
    assert_eq!(data.frame().sequences().len(), 240);
}

/// A log of two kinds of message: the target at 50 rows/s, the command at 100 rows/s.
fn kinds(drop: impl Fn(f64) -> bool, late: f64) -> String {
    let mut text = String::new();
    for i in 0..600 {
        let t = 0.01 * f64::from(i);
        if i % 2 == 0 {
            text += &format!("F,{t:.3},{}\n", noise(i as usize, 1));
        }
        if !drop(t) {
            text += &format!("C,{:.4},{}\n", t + late, t.sin());
        }
    }
    text
}

const KINDS: &str = "[[input.messages]]\nbegins = \"F,\"\nheader = [\"\", \"t\", \"y\"]\n\
                     [[input.messages]]\nbegins = \"C,\"\nheader = [\"\", \"t\", \"c\"]\n";

#[test]
fn nothing_is_made_up_in_a_gap_of_a_kind_of_message() {
    let model = format!("{KINDS}{MODEL}[holdout]\nblock_s = 1.0\n");
    let with = |text: &str, model: &str| {
        let folder = Folder::new();
        folder.put("a.log", text);
        folder.load(model)
    };
    let whole = with(&kinds(|_| false, -0.003), &model).unwrap();
    assert_eq!(whole.frame().len(), 300);
    assert!(finding(&whole, "gap of a kind").is_none());
    // A message that is missing here and there is no gap.
    let holes = with(&kinds(|t| (t * 10.0 + 1.0) % 3.0 < 0.25, -0.003), &model).unwrap();
    assert_eq!(holes.frame().len(), 300);
    // Three seconds without one are.
    let gap = kinds(|t| (1.5..4.5).contains(&t), -0.003);
    let data = with(&gap, &model).unwrap();
    assert!(
        (149..=151).contains(&data.frame().len()),
        "{}",
        data.frame().len()
    );
    assert_eq!(data.frame().sequences().len(), 2);
    let found = finding(&data, "gap of a kind").unwrap();
    assert_eq!(found.count, 300 - data.frame().len(), "{found:?}");
    assert!(finding(&data, "non-finite").is_none());
    // The model file may say that it is none.
    let long = with(&gap, &format!("{model}[hygiene]\ngap_s = 4.0\n")).unwrap();
    assert_eq!(long.frame().len(), 300);
    // Rows before the first message are counted as such.
    let late = with(&kinds(|_| false, 0.5), &model).unwrap();
    let found = finding(&late, "messages of others").unwrap();
    assert_eq!((found.count, late.frame().len()), (25, 275));
    // Kinds of two clocks have nothing in common.
    let says = with(&kinds(|_| false, 1e6), &model)
        .unwrap_err()
        .to_string();
    assert!(
        says.contains("no message of the kind `F,` (time 0 to 5.980)"),
        "{says}"
    );
}

#[test]
fn the_time_of_each_kind_of_message_must_not_fall() {
    let model = format!("{KINDS}{MODEL}[holdout]\nblock_s = 1.0\n");
    let mut lines: Vec<String> = kinds(|_| false, 0.0).lines().map(String::from).collect();
    let at = lines
        .iter()
        .position(|l| l.starts_with("C,3.0000"))
        .unwrap();
    lines[at] = lines[at].replace("C,3.0000", "C,1.0000");
    // A stamp that is repeated is a coarse clock, and one that is missing a missing row.
    let repeated = lines
        .iter()
        .position(|l| l.starts_with("C,4.0000"))
        .unwrap();
    lines[repeated] = lines[repeated].replace("C,4.0000", "C,3.9900");
    let missing = lines
        .iter()
        .position(|l| l.starts_with("C,5.0000"))
        .unwrap();
    lines[missing] = lines[missing].replace("C,5.0000", "C,");
    let folder = Folder::new();
    folder.put("a.log", &lines.join("\n"));
    let says = folder.refused(&model);
    let place = format!(
        "a.log: line {}: the time of the kind `C,` falls, from 2.99 to 1",
        at + 1
    );
    assert!(says.contains(&place), "{says}");
    let data = folder
        .load(&format!("{model}[hygiene]\ntime = \"drop\"\n"))
        .unwrap();
    assert_eq!(finding(&data, "time of a kind").unwrap().count, 1);
    assert_eq!(finding(&data, "messages without a time").unwrap().count, 1);
    assert_eq!(data.frame().len(), 300);
}

#[cfg(unix)]
#[test]
fn a_pipe_in_a_folder_is_passed_over_and_named() {
    let folder = runs(|_, _| {});
    let pipe = folder.0.path().join("live.csv");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let data = folder.load(MODEL).unwrap();
    let found = finding(&data, "no file").unwrap();
    assert!(
        found.count == 1 && found.first.ends_with("live.csv"),
        "{found:?}"
    );
    assert_eq!(data.files().len(), 3);
}

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

/// Topics of unlike rates that were joined in one table have most of their cells empty.
#[test]
fn a_table_with_most_cells_empty_says_what_helps() {
    let joined = |whole: usize| {
        let mut text = "t,y,c\n".to_string();
        for i in 0..400usize {
            let t = 0.01 * i as f64;
            let (y, c) = (noise(i, 0).to_string(), (3.0 * t).sin().to_string());
            let (y, c) = match i % 8 {
                k if k < whole => (y, c),
                k if k % 2 == 0 => (String::new(), c),
                _ => (y, String::new()),
            };
            text += &format!("{t},{y},{c}\n");
        }
        let folder = Folder::new();
        folder.put("a.csv", &text);
        folder.load(&format!("{MODEL}[holdout]\nblock_s = 0.5\n"))
    };
    let error = joined(0).unwrap_err().to_string();
    assert!(error.contains("interpolate"), "{error}");
    for (whole, rows) in [(2, 300), (4, 200)] {
        let data = joined(whole).unwrap();
        let found = finding(&data, "joined columns").unwrap();
        assert_eq!(found.count, rows, "{found:?}");
        assert!(found.what.contains("interpolate"), "{found:?}");
    }
    let data = joined(5).unwrap();
    assert!(finding(&data, "joined columns").is_none());
    assert_eq!(finding(&data, "non-finite").unwrap().count, 150);
    // A column without any value is no such thing, and is named, also one that only a term names.
    let mut text = "t,y,c,w\n".to_string();
    for i in 0..100usize {
        text += &format!("{},{},1,\n", 0.01 * i as f64, noise(i, 0));
    }
    let folder = Folder::new();
    folder.put("a.csv", &text);
    let term = MODEL.replace("expr = \"command\"", "expr = \"command * w\"");
    let error = folder.load(&term).unwrap_err().to_string();
    assert!(
        error.contains("`w` has none at all") && !error.contains("interpolate"),
        "{error}"
    );
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
fn a_rate_beside_a_time_is_refused() {
    let rated = format!("[input]\nrate = 200.0\n{MODEL}");
    let says = runs(|_, _| {}).refused(&rated);
    assert!(
        says.contains("the file has a column `t`, and input.rate = 200"),
        "{says}"
    );
    let made = rated.replace("\"t\"", "\"row_time\"");
    let data = runs(|_, _| {}).load(&made).unwrap();
    assert!((data.frame().step() - 0.005).abs() < 1e-9);
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

#[test]
fn text_in_utf_16_is_read() {
    for order in [u16::to_le_bytes, u16::to_be_bytes] {
        let folder = Folder::new();
        for run in 0..2 {
            let marked = format!("\u{feff}{}", csv(&rows(run, 60)));
            let bytes: Vec<u8> = marked.encode_utf16().flat_map(order).collect();
            std::fs::write(folder.0.path().join(format!("{run}.csv")), bytes).unwrap();
        }
        assert_eq!(folder.load(MODEL).unwrap().kept_rows().len(), 120);
    }
}

#[test]
fn what_is_no_log_is_said_to_be_what_it_is() {
    let says = |bytes: &[u8], keys: &str| {
        let folder = Folder::new();
        std::fs::write(folder.0.path().join("a.csv"), bytes).unwrap();
        folder.refused(&format!("{keys}{MODEL}"))
    };
    for (bytes, part) in [
        (&b"PK\x03\x04rest"[..], "a zip archive"),
        (b"\x93NUMPY\x01", "a NumPy array"),
        (b"MATLAB 5.0 MAT-file", "a MATLAB file"),
        (b"\x89HDF\r\n", "HDF5"),
        (b"MATLAB 7.3 MAT-file", "HDF5"),
        (b"\xff\xfet\0,", "UTF-16"),
    ] {
        let says = says(bytes, "");
        assert!(
            says.contains(part) && says.contains("CSV or Parquet"),
            "{says}"
        );
    }
    for (text, keys, part) in [
        ("t|y|c\n1|2|3\n", "", "input.separator = \"|\""),
        ("t;y;c\n1;2;3\n", "", "input.separator = \";\""),
        (
            "t,y,c\n1,2,3\n",
            "[input]\nskip = 9\n",
            "after the 9 lines of input.skip",
        ),
        (
            "\" rig 4, cold\nt,y,c\n1,2,3\n",
            "",
            "set input.comment = \"\\\"\"",
        ),
        (
            "t,y,c\n10/21/2024-15:52:16,2,3\n",
            "",
            "a date or a time of day",
        ),
        ("t,y,c\n21/10/2024-15:52:16,2,3\n", "", "total_seconds"),
        ("a,b\nx,y\n", "", "the file has a (text), b (text)"),
    ] {
        let says = says(text.as_bytes(), keys);
        assert!(says.contains(part), "{says}");
    }
    // As the message says.
    let folder = Folder::new();
    for run in 0..2 {
        folder.put(
            &format!("{run}.csv"),
            &format!("\" rig 4, cold\n{}", csv(&rows(run, 60))),
        );
    }
    folder
        .load(&format!("[input]\ncomment = \"\\\"\"\n{MODEL}"))
        .unwrap();
}

/// Writes the next column of a group of rows of a Parquet log.
#[cfg(feature = "parquet")]
pub(super) fn put_column<T: ::parquet::data_type::DataType>(
    group: &mut ::parquet::file::writer::SerializedRowGroupWriter<std::fs::File>,
    values: &[T::T],
) {
    let mut column = group.next_column().unwrap().unwrap();
    column.typed::<T>().write_batch(values, None, None).unwrap();
    column.close().unwrap();
}

/// Parquet logs: types of time, decimals and numbers without a sign; gzip and zstd.
#[cfg(feature = "parquet")]
#[test]
fn types_of_parquet_columns_are_converted() {
    use ::parquet::basic::{Compression, GzipLevel, ZstdLevel};
    use ::parquet::data_type::{DoubleType, Int32Type, Int64Type};
    use ::parquet::file::{properties::WriterProperties, writer::SerializedFileWriter};
    use ::parquet::schema::parser::parse_message_type;
    use std::sync::Arc;
    for (kind, per_second) in [
        ("TIMESTAMP(NANOS,true)", 1_000_000_000),
        ("TIMESTAMP(MICROS,false)", 1_000_000),
        ("TIMESTAMP_MILLIS", 1000),
        ("TIME(MICROS,true)", 1_000_000),
        ("DECIMAL(18,2)", 100),
        ("UINT_64", 1),
    ] {
        let schema = format!(
            "message log {{ required int64 t ({kind}); required double y; required int32 c (UINT_32); }}"
        );
        let schema = Arc::new(parse_message_type(&schema).unwrap());
        let folder = Folder::new();
        for run in 0..2 {
            let path = folder.0.path().join(format!("{run}.parquet"));
            let compression = match run {
                0 => Compression::GZIP(GzipLevel::default()),
                _ => Compression::ZSTD(ZstdLevel::default()),
            };
            let properties = WriterProperties::builder()
                .set_compression(compression)
                .build();
            let file = std::fs::File::create(path).unwrap();
            let mut writer =
                SerializedFileWriter::new(file, schema.clone(), Arc::new(properties)).unwrap();
            let mut group = writer.next_row_group().unwrap();
            let time: Vec<i64> = (0..50).map(|i| (1000 + i) * per_second).collect();
            put_column::<Int64Type>(&mut group, &time);
            let y: Vec<f64> = (0..50).map(|i| noise(i, run)).collect();
            put_column::<DoubleType>(&mut group, &y);
            let c: Vec<i32> = (0..50).map(|i| (4_000_000_000_u32 + i) as i32).collect();
            put_column::<Int32Type>(&mut group, &c);
            group.close().unwrap();
            writer.close().unwrap();
        }
        let data = folder.load(MODEL).unwrap();
        assert!((data.frame().time()[3] - 1003.0).abs() < 1e-6, "{kind}");
        assert_eq!(data.frame().column("command").unwrap()[3], 4_000_000_003.0);
        // What the type says already must not be said again.
        let scaled = MODEL.replace("unit = \"s\"", "unit = \"s\", scale = 1e-9");
        if kind.starts_with("TIME") {
            let says = folder.refused(&scaled);
            assert!(says.contains("leave `scale` out of role `time`"), "{says}");
        } else {
            folder.load(&scaled).unwrap();
        }
    }
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
