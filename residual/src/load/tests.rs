//! Logs as a user has them, read as far as to the data; what an analysis makes of them is tested elsewhere.

use super::*;
use crate::hygiene::Finding;

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
    let mut z = ((row + 1_000_003 * run) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
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
fn a_term_that_cannot_be_squared_is_refused() {
    let model = MODEL.replace("\"command\"", "\"1e150 * command\"");
    let data = runs(|_, _| {}).load(&model).unwrap();
    let says = crate::baseline(&Spec::parse(&model).unwrap(), &data).unwrap_err();
    assert!(says.to_string().contains("term `gain` is"), "{says}");
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
