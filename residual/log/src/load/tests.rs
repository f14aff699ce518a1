//! Logs as a user has them, read as far as to the data; what an analysis makes of them is tested
//! elsewhere.

mod memory;
mod noted;
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
