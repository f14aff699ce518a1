//! Input of every kind through the public entry: formats, units, groups, and data that cannot be
//! analysed.

mod held;
mod text;

use residual::{load, run, spec::Spec, Error, Options, Report, Verdict};
use std::io::Write;
use std::path::PathBuf;

/// A folder of its own for one test, removed at the end.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    fn path(&self) -> PathBuf {
        self.0.path().to_path_buf()
    }

    fn put(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }
}

const MODEL: &str = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
command = { column = "c", unit = "N" }
velocity = { column = "v", unit = "rad/s" }
[[terms]]
name = "tension"
expr = "command"
fixed = 1.0
"#;

/// Pseudo-random number in -1..1 that depends on the row only.
fn hash(i: usize, salt: u64) -> f64 {
    2.0 * random::of(i as u64 ^ salt << 40) - 1.0
}

/// Rows (time, target, command, velocity) of one run with Coulomb friction of 0.5 N.
fn rows(run: u64, n: usize) -> Vec<[f64; 4]> {
    (0..n)
        .map(|i| {
            let t = i as f64 * 0.02;
            let v = (1.3 * t + run as f64).sin() + 0.4 * (3.1 * t).cos();
            let c = 3.0 + (0.7 * t + 2.0 * run as f64).sin();
            let noise = 0.08 * (hash(i, run) + hash(i, run + 77) + hash(i, run + 155));
            [t, c - 0.5 * v.signum() + noise, c, v]
        })
        .collect()
}

fn csv(rows: &[[f64; 4]]) -> String {
    rows.iter().fold("t,y,c,v\n".to_string(), |s, r| {
        s + &format!("{},{},{},{}\n", r[0], r[1], r[2], r[3])
    })
}

fn analyse(data: &[PathBuf], model: &str) -> Result<Report, Error> {
    run(
        &Options {
            data: data.to_vec(),
            model: Spec::parse(model)?,
            out: None,
        },
        &mut (),
    )
}

fn assert_coulomb(r: &Report) {
    assert_eq!(r.verdict, Verdict::Effect, "{}", r.markdown());
    assert_eq!(r.effects[0].name, "coulomb", "{}", r.markdown());
    let f = r.effects[0].params["friction"];
    assert!((f + 0.5).abs() < 0.02, "{f}");
    let ci = r.effects[0].ci["friction"];
    assert!(ci[0] < f && f < ci[1] && ci[1] - ci[0] < 0.05, "{ci:?}");
}

/// Three logs with Coulomb friction.
fn written(folder: &Folder, text: &dyn Fn(&[[f64; 4]]) -> String, extension: &str) -> Vec<PathBuf> {
    (0..3)
        .map(|run| folder.put(&format!("{run}.{extension}"), &text(&rows(run, 600))))
        .collect()
}

#[test]
fn plain_gzip_and_blank_separated_text_agree() {
    let dir = Folder::new();
    for run in 0..3 {
        dir.put(&format!("run{run}.csv"), &csv(&rows(run, 1500)));
    }
    let plain = analyse(&[dir.path()], MODEL).unwrap();
    assert_coulomb(&plain);
    let board = plain.compensation().unwrap();
    assert!(
        board.friction == plain.effects[0].params["friction"]
            && board.left_out.is_empty()
            && board.offset == 0.0
    );

    let zipped = Folder::new();
    for run in 0..3 {
        let file = std::fs::File::create(zipped.path().join(format!("run{run}.csv.gz"))).unwrap();
        let mut gz = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
        gz.write_all(csv(&rows(run, 1500)).as_bytes()).unwrap();
        gz.finish().unwrap();
    }
    let gzip = analyse(&[zipped.path()], MODEL).unwrap();
    assert_eq!(gzip.baseline.heldout_rmse, plain.baseline.heldout_rmse);

    let blank = Folder::new();
    for run in 0..3 {
        let text = rows(run, 1500).iter().fold(String::new(), |s, r| {
            s + &format!("  {} {}\t{} {}\n", r[0], r[1], r[2], r[3])
        });
        blank.put(&format!("run{run}.txt"), &text);
    }
    let model =
        format!("[input]\nseparator = \"blank\"\nheader = [\"t\", \"y\", \"c\", \"v\"]\n{MODEL}");
    assert_eq!(
        analyse(&[blank.path()], &model).unwrap().last.heldout_rmse,
        plain.last.heldout_rmse
    );
}

#[cfg(feature = "parquet")]
#[test]
fn parquet_agrees_with_text() {
    use parquet::data_type::DoubleType;
    use parquet::file::{properties::WriterProperties, writer::SerializedFileWriter};
    use parquet::schema::parser::parse_message_type;
    use std::sync::Arc;
    let dir = Folder::new();
    let text = Folder::new();
    let schema = Arc::new(parse_message_type("message log { required double t; optional double y; required double c; required double v; }").unwrap());
    for run in 0..2 {
        let data = rows(run, 1500);
        text.put(&format!("run{run}.csv"), &csv(&data));
        let file = std::fs::File::create(dir.path().join(format!("run{run}.parquet"))).unwrap();
        let mut w = SerializedFileWriter::new(
            file,
            schema.clone(),
            Arc::new(WriterProperties::builder().build()),
        )
        .unwrap();
        for part in data.chunks(700) {
            let mut group = w.next_row_group().unwrap();
            for c in 0..4 {
                let values: Vec<f64> = part.iter().map(|r| r[c]).collect();
                let mut col = group.next_column().unwrap().unwrap();
                let defined = vec![1i16; values.len()];
                col.typed::<DoubleType>()
                    .write_batch(&values, (c == 1).then_some(&defined[..]), None)
                    .unwrap();
                col.close().unwrap();
            }
            group.close().unwrap();
        }
        w.close().unwrap();
    }
    let a = analyse(&[dir.path()], MODEL).unwrap();
    let b = analyse(&[text.path()], MODEL).unwrap();
    assert_coulomb(&a);
    assert_eq!(a.baseline.heldout_rmse, b.baseline.heldout_rmse);
}

#[test]
fn the_extended_model_reproduces_the_fit_and_the_frozen_one_transfers() {
    let dir = Folder::new();
    for run in 0..3 {
        dir.put(&format!("run{run}.csv"), &csv(&rows(run, 1500)));
    }
    let out = dir.path().join("out");
    let first = run(
        &Options {
            data: vec![dir.path()],
            model: Spec::parse(MODEL).unwrap(),
            out: Some(out.clone()),
        },
        &mut (),
    )
    .unwrap();
    for name in [
        "report.json",
        "report.md",
        "report.html",
        "effect-1-coulomb.svg",
    ] {
        assert!(out.join(name).exists(), "{name}");
    }
    // The verdict comes first, and the picture has its axes.
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    let body = page.split_once("</h1>").unwrap().1.trim_start();
    assert!(
        body.starts_with(
            "<p class=\"verdict effect\"><strong>Verdict: <code>effect</code>.</strong> The model lacks coulomb"
        ),
        "{}",
        &body[..300]
    );
    for part in [
        "velocity, rad/s</text>",
        "residual, N</text>",
        "run0.csv, run1.csv, run2.csv",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert_eq!(Report::read(&out.join("report.json")).unwrap(), first);
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(json["verdict"], "effect");
    assert_eq!(
        json["baseline"]["heldout_rmse"].as_f64(),
        Some(first.baseline.heldout_rmse)
    );
    assert_eq!(
        json["final"]["heldout_rmse"].as_f64(),
        Some(first.last.heldout_rmse)
    );
    for key in [
        "name",
        "params",
        "ci",
        "heldout_before",
        "heldout_after",
        "rival",
    ] {
        assert!(json["effects"][0].get(key).is_some(), "{key}");
    }
    assert!(json["seen_not_material"].is_array() && json["hygiene"].is_array());
    let data: Vec<PathBuf> = (0..3)
        .map(|r| dir.path().join(format!("run{r}.csv")))
        .collect();
    let again = analyse(
        &data,
        &std::fs::read_to_string(out.join("MODEL.extended.toml")).unwrap(),
    )
    .unwrap();
    assert_eq!(again.verdict, Verdict::None, "{}", again.markdown());
    assert!((again.baseline.heldout_rmse / first.last.heldout_rmse - 1.0).abs() < 1e-6);

    let other = Folder::new();
    for run in 10..12 {
        other.put(&format!("run{run}.csv"), &csv(&rows(run, 1500)));
    }
    let moved = analyse(
        &[other.path()],
        &std::fs::read_to_string(out.join("MODEL.frozen.toml")).unwrap(),
    )
    .unwrap();
    assert!(moved.baseline.heldout_rmse < 1.1 * first.last.heldout_rmse);
}

#[test]
fn the_model_of_the_readme_works_as_it_stands() {
    let readme = include_str!("../../../README.md");
    let (_, block) = readme
        .split_once("<!-- model:begin -->\n```toml\n")
        .unwrap();
    let (model, _) = block.split_once("```\n<!-- model:end -->").unwrap();
    let dir = Folder::new();
    for run in 0..3 {
        let text = csv(&rows(run, 1500));
        dir.put(
            &format!("run{run}.csv"),
            &text.replacen("t,y,c,v", "time_s,force_n,command_n,speed_rad_s", 1),
        );
    }
    assert_coulomb(&analyse(&[dir.path()], model).unwrap());
}

#[test]
fn units_convert_and_blocks_of_one_file_hold_out() {
    let dir = Folder::new();
    let data: Vec<[f64; 4]> = rows(0, 4000)
        .into_iter()
        .map(|[t, y, c, v]| [t * 1000.0, y * 1000.0 + 200.0, c, v])
        .collect();
    let path = dir.put("one.csv", &csv(&data));
    let model = MODEL
        .replace(
            "{ column = \"t\", unit = \"s\" }",
            "{ column = \"t\", unit = \"s\", scale = 0.001 }",
        )
        .replace(
            "{ column = \"y\", unit = \"N\" }",
            "{ column = \"y\", unit = \"N\", scale = 0.001, offset = -0.2 }",
        );
    assert_coulomb(&analyse(&[path], &format!("{model}\n[holdout]\nblock_s = 10\n")).unwrap());
}

fn refused(name: &str, text: &str, model: &str) -> (u8, String) {
    let dir = Folder::new();
    dir.put("a.csv", text);
    // Without its last line: copies are refused for being copies.
    let shorter = text
        .trim_end()
        .rsplit_once('\n')
        .map_or(text, |(head, _)| head);
    dir.put("b.csv", shorter);
    let out = dir.path().join("out");
    let err = Spec::parse(model)
        .and_then(|model| {
            run(
                &Options {
                    data: vec![dir.path().join("a.csv"), dir.path().join("b.csv")],
                    model,
                    out: Some(out.clone()),
                },
                &mut (),
            )
        })
        .expect_err(name);
    assert!(!out.exists(), "{name}: a report was written");
    (err.exit_code(), err.to_string())
}

#[test]
fn bad_input_is_refused_with_a_reason_and_no_report() {
    let good = csv(&rows(0, 800));
    let cases: Vec<(&str, String, String, u8, &str)> = vec![
        ("missing", good.replace("t,y,c,v", "t,y,c,w"), MODEL.into(), 3, "no column `v`"),
        ("text", good.replacen("\n0.02,", "\n0.02,oops", 1), MODEL.into(), 3, ":3: column `y`"),
        ("nan", csv(&rows(0, 800).iter().map(|r| [r[0], f64::NAN, r[2], r[3]]).collect::<Vec<_>>()), MODEL.into(), 4, "finite"),
        ("constant", csv(&rows(0, 800).iter().map(|r| [r[0], r[1], 3.0, 0.0]).collect::<Vec<_>>()), MODEL.into(), 4, "constant excitation"),
        ("flat", csv(&rows(0, 800).iter().map(|r| [r[0], 1.0, r[2], r[3]]).collect::<Vec<_>>()), MODEL.into(), 4, "target is constant"),
        ("two and two exchanged", csv(&rows(0, 800).chunks(2).flat_map(|pair| pair.iter().rev().cloned()).collect::<Vec<_>>()), MODEL.into(), 4, "time does not grow"),
        ("short", csv(&rows(0, 8)), MODEL.into(), 4, "rows are left"),
        ("first", good.replacen("\n0,", "\noops,", 1), MODEL.into(), 3, ":2: column `t`"),
        ("separator", good.replace(',', ";"), MODEL.into(), 3, "input.separator = \";\""),
        ("cells", good.replacen("\n0.02,", "\n0.02,1,", 1), MODEL.into(), 3, "line 3: 5 cells"),
        ("binary", "\0\u{fffd}t,y".repeat(400), MODEL.into(), 3, "a.csv: line 1: this is not text"),
        ("keep", good.clone(), format!("{MODEL}\n[rows]\nkeep = \"abs(velocity > 5\"\n"), 2, "abs(velocity > 5"),
        ("empty", String::new(), MODEL.into(), 3, "empty"),
        (
            "rank",
            good.clone(),
            format!("{MODEL}[[terms]]\nname = \"one\"\nexpr = \"velocity\"\n[[terms]]\nname = \"two\"\nexpr = \"3 * velocity\"\n"),
            4,
            "two",
        ),
        ("column", good.clone(), format!("{MODEL}[[terms]]\nname = \"x\"\nexpr = \"nosuch * 2\"\n"), 2, "nosuch"),
        ("syntax", good.clone(), MODEL.replace("expr = \"command\"", "expr = \"command *\""), 2, "missing at the end"),
        ("key", good.clone(), MODEL.replace("fixed", "fixd"), 2, "fixd"),
        ("by", good.clone(), format!("{MODEL}\n[holdout]\nby = [\"unit\"]\n"), 2, "unit"),
    ];
    for (name, text, model, code, part) in cases {
        let (got, message) = refused(name, &text, &model);
        assert!(
            got == code && message.contains(part),
            "{name}: exit {got}, {message}"
        );
    }
    let dir = Folder::new();
    let out = dir.path().join("out");
    let options = |data: Vec<PathBuf>| Options {
        data,
        model: Spec::parse(MODEL).unwrap(),
        out: Some(out.clone()),
    };
    let names = || {
        let mut names: Vec<_> = std::fs::read_dir(&out)
            .unwrap()
            .filter_map(|e| e.ok()?.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    };
    let long = [0, 1].map(|run| dir.put(&format!("long{run}.csv"), &csv(&rows(run, 1500))));
    let short = vec![dir.put("short.csv", &csv(&rows(0, 8)))];
    run(&options(long.to_vec()), &mut ()).unwrap();
    let there = names();
    for name in [
        "report.json",
        "report.html",
        "report.md",
        "effect-1-coulomb.svg",
    ] {
        assert!(there.iter().any(|n| n == name), "{name} not in {there:?}");
    }
    assert!(run(&options(short.clone()), &mut ()).is_err());
    let left = names();
    assert!(
        !left.is_empty() && left.iter().all(|n| n.starts_with("MODEL.")),
        "stale: {left:?}"
    );

    // A report that no analysis wrote is not removed.
    std::fs::write(out.join("report.md"), "my own").unwrap();
    assert!(run(&options(short), &mut ()).is_err());
    assert_eq!(
        std::fs::read_to_string(out.join("report.md")).unwrap(),
        "my own"
    );

    let dir = Folder::new();
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(good.as_bytes()).unwrap();
    let whole = gz.finish().unwrap();
    let path = dir.path().join("cut.csv.gz");
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let err = analyse(&[path], MODEL).unwrap_err();
    assert!(
        err.exit_code() == 3 && err.to_string().contains("cut off or damaged"),
        "{err}"
    );

    let dir = Folder::new();
    let one = dir.put("only.csv", &good);
    let err = analyse(&[one], MODEL).unwrap_err();
    assert!(
        err.exit_code() == 4 && err.to_string().contains("block_s"),
        "{err}"
    );
    assert_eq!(
        analyse(&[dir.path().join("nothing.csv")], MODEL)
            .unwrap_err()
            .exit_code(),
        3
    );
}

#[test]
fn columns_in_memory_agree_with_files() {
    let dir = Folder::new();
    let mut tables = vec![];
    for run in 0..3 {
        let data = rows(run, 1500);
        let path = dir.put(&format!("run{run}.csv"), &csv(&data));
        let column = |c: usize| data.iter().map(|r| r[c]).collect::<Vec<f64>>();
        tables.push(
            load::Table::new(path)
                .with("t", column(0))
                .with("y", column(1))
                .with("c", column(2))
                .with("v", column(3)),
        );
    }
    let spec = Spec::parse(MODEL).unwrap();
    let files = analyse(&[dir.path()], MODEL).unwrap();
    let loaded = load::from_tables(tables.clone(), &spec).unwrap();
    let memory = residual::analyse(&spec, loaded, &mut ()).unwrap();
    assert_coulomb(&memory);
    assert_eq!(memory, files);

    let odd = tables[0].clone().with("short", vec![1.0]);
    let error = load::from_tables(vec![odd], &spec).unwrap_err();
    assert!(
        error.exit_code() == 4 && error.to_string().contains("column `short` has 1 rows"),
        "{error}"
    );
    let error = load::from_tables(vec![load::Table::new("empty")], &spec).unwrap_err();
    assert!(error.to_string().contains("no column `t`"), "{error}");
}

#[test]
fn json_is_read_by_its_name_and_left_alone_in_a_folder() {
    let dir = Folder::new();
    let lines = |rows: &[[f64; 4]]| {
        rows.iter().fold(String::new(), |s, r| {
            let [t, y, c, v] = r;
            s + &format!("{{\"t\": {t}, \"y\": {y}, \"c\": {c}, \"v\": {v}}}\n")
        })
    };
    let named = Folder::new();
    let files = written(&named, &lines, "json");
    assert_coulomb(&analyse(&files, MODEL).unwrap());
    let json = dir.put("a.json", "{\"t\": [1, 2]}");
    let error = analyse(&[json], MODEL).unwrap_err();
    assert!(error.to_string().contains("no column `y`"), "{error}");
    // In a folder it is left alone, as any other file.
    for run in 0..3 {
        dir.put(&format!("run{run}.csv"), &csv(&rows(run, 1500)));
    }
    assert_coulomb(&analyse(&[dir.path()], MODEL).unwrap());
}

#[test]
fn flaws_are_reported_and_handled_as_the_model_file_says() {
    let dir = Folder::new();
    for run in 0..3 {
        let mut data = rows(run, 1500);
        data[200][1] *= 256.0;
        data[400][1] += 9.0;
        dir.put(&format!("run{run}.csv"), &csv(&data));
    }
    let has = |r: &Report, check: &str| r.hygiene.iter().any(|f| f.check == check);
    let seen = analyse(&[dir.path()], MODEL).unwrap();
    assert!(
        has(&seen, "scale256") && has(&seen, "spike"),
        "{:?}",
        seen.hygiene
    );
    assert!(seen.last.heldout_rmse > 1.0);
    let handled = analyse(
        &[dir.path()],
        &format!("{MODEL}\n[hygiene]\nscale256 = \"fix\"\nspikes = \"drop\"\n"),
    )
    .unwrap();
    assert_coulomb(&handled);
}

#[test]
fn copies_and_columns_of_one_name_are_refused() {
    let folder = Folder::new();
    let same = csv(&rows(1, 600));
    let data = vec![folder.put("a.csv", &same), folder.put("b.csv", &same)];
    let error = analyse(&data, MODEL).unwrap_err().to_string();
    assert!(
        error.contains("a.csv and b.csv have the same 600"),
        "{error}"
    );
    let twice = |rows: &[[f64; 4]]| csv(rows).replacen("t,y,c,v", "t,y,c,y", 1);
    let data = written(&folder, &twice, "txt");
    let error = analyse(&data, MODEL).unwrap_err().to_string();
    assert!(error.contains("2 columns are named `y`"), "{error}");
}

#[test]
fn values_without_meaning_are_refused() {
    for (from, to, says) in [
        ("[[terms]]", "[holdout]\nfolds = 1\n[[terms]]", "folds = 1"),
        ("[[terms]]", "[hygiene]\ngap_s = nan\n[[terms]]", "gap_s"),
        (
            "[[terms]]",
            "[hygiene]\nspikes = \"fix\"\n[[terms]]",
            "only scale256",
        ),
        (
            "[[terms]]",
            "[selection]\ndecoys = 10000000000\n[[terms]]",
            "10000 decoys",
        ),
        (
            "column = \"t\", unit = \"s\"",
            "column = \"t\", unit = \"ms\"",
            "scale = 1e-3",
        ),
    ] {
        let error = Spec::parse(&MODEL.replacen(from, to, 1))
            .unwrap_err()
            .to_string();
        assert!(error.contains(says), "{to}: {error}");
    }
    let sum = vec!["1"; 20_000].join(" + ");
    let error = Spec::parse(&MODEL.replacen("expr = \"command\"", &format!("expr = \"{sum}\""), 1));
    assert!(error.unwrap_err().to_string().contains("operators"));
    let folder = Folder::new();
    let huge = |r: &[[f64; 4]]| {
        let mut r = r.to_vec();
        r[40][1] = 1e308;
        csv(&r)
    };
    let data = written(&folder, &huge, "csv");
    let error = analyse(&data, MODEL).unwrap_err().to_string();
    assert!(error.contains("beyond 1e140"), "{error}");
}

#[test]
fn check_data_say_whether_what_was_found_holds_elsewhere() {
    let folder = Folder::new();
    let data = written(&folder, &csv, "csv");
    let other = folder.put("other.dat", &csv(&rows(9, 600)));
    let options = Options {
        data: data.clone(),
        model: Spec::parse(MODEL).unwrap(),
        out: None,
    };
    let report = residual::run_checked(&options, &[other], &mut ()).unwrap();
    assert_coulomb(&report);
    let check = report.check.expect("check data were given");
    assert_eq!((check.rows, check.files.len()), (600, 1));
    assert!(check.found_rmse < 0.5 * check.declared_rmse, "{check:?}");
    assert_eq!(check.repeated_rows, 0);
    // The motion of one of the logs, from another moment on.
    let again = folder.put("again.dat", &csv(&rows(1, 600)[90..]));
    let report = residual::run_checked(&options, &[again], &mut ()).unwrap();
    let check = report.check.as_ref().expect("check data were given");
    assert_eq!((check.rows, check.repeated_rows), (510, 510));
    assert!(report
        .summary()
        .contains("on the motion of the searched data"));
    let text = report.markdown();
    assert!(
        text.contains("Their motion is one that the searched data have as well"),
        "{text}"
    );
    // Friction the other way: what was found harms there, so it is no finding.
    let turned: Vec<[f64; 4]> = rows(9, 600)
        .iter()
        .map(|r| [r[0], 2.0 * r[2] - r[1], r[2], r[3]])
        .collect();
    let against = folder.put("against.dat", &csv(&turned));
    let report = residual::run_checked(&options, &[against], &mut ()).unwrap();
    assert!(report.effects.is_empty(), "{}", report.markdown());
    assert_eq!(report.improves[0].name, "coulomb");
    assert!(report.improves[0].unsupported.contains("check data"));
    assert_eq!(report.verdict, Verdict::Unknown);
}

/// One log of five has noise of its own that no column shows.
#[test]
fn each_log_has_its_error_and_the_one_that_is_unlike_is_named() {
    let folder = Folder::new();
    let files = |louder: u64| -> Vec<PathBuf> {
        let one = |run: u64| {
            let mut rows = rows(run, 1500);
            if run == louder {
                for (i, row) in rows.iter_mut().enumerate() {
                    row[1] += hash(i, 1000) + hash(i, 1001);
                }
            }
            folder.put(&format!("log-{run}.csv"), &csv(&rows))
        };
        (0..5).map(one).collect()
    };
    let report = analyse(&files(9), MODEL).unwrap();
    assert_coulomb(&report);
    assert_eq!(report.by_log.len(), 5);
    for log in &report.by_log {
        assert_eq!(log.rows, 1500);
        assert!(log.declared_rmse > 0.45 && log.final_rmse < 0.1, "{log:?}");
    }
    assert!(report.hygiene.iter().all(|f| f.check != "unlike log"));
    let report = analyse(&files(3), MODEL).unwrap();
    let words = report.summary();
    assert!(words.contains("unlike the others"), "{words}");
    assert!(words.contains("(log-3.csv: 0.8"), "{words}");
    let page = report.markdown();
    assert!(page.contains("| log-3.csv | 1500 | "), "{page}");
}

#[test]
fn a_wrong_time_base_and_a_repeated_motion_are_noted() {
    let folder = Folder::new();
    let log = |scale: f64, motion: u64, run: u64| {
        let mut x = 0.0;
        let start = "t,y,c,v,x\n".to_string();
        rows(motion, 600)
            .iter()
            .enumerate()
            .fold(start, |s, (i, r)| {
                let y = r[1] + 0.01 * hash(i, 1000 + run);
                let line = format!("{},{y},{},{},{x}\n", scale * r[0], r[2], r[3]);
                x += 0.02 * r[3];
                s + &line
            })
    };
    let model = MODEL.replacen(
        "[[terms]]",
        "angle = { column = \"x\", unit = \"rad\" }\n[selection]\nonly = [\"coulomb\"]\n[[terms]]",
        1,
    );
    let put = |scale: f64, same: bool| -> Vec<PathBuf> {
        (0..3)
            .map(|run| {
                let motion = if same { 1 } else { run };
                folder.put(&format!("{run}.csv"), &log(scale, motion, run))
            })
            .collect()
    };
    let checks = |data: &[PathBuf]| -> Vec<String> {
        let report = analyse(data, &model).unwrap();
        report.hygiene.iter().map(|f| f.check.clone()).collect()
    };
    let has = |found: &[String], name: &str| found.iter().any(|c| c == name);
    let good = checks(&put(1.0, false));
    assert!(
        !has(&good, "speed against angle") && !has(&good, "repeated motion"),
        "{good:?}"
    );
    let slow = checks(&put(2.0, false));
    assert!(has(&slow, "speed against angle"), "{slow:?}");
    let same = checks(&put(1.0, true));
    assert!(has(&same, "repeated motion"), "{same:?}");
}

#[test]
fn a_velocity_that_stands_while_the_angle_moves_is_refused() {
    let folder = Folder::new();
    let model = MODEL.replacen(
        "[[terms]]",
        "angle = { column = \"x\", unit = \"rad\" }\n[selection]\nonly = [\"coulomb\"]\n[[terms]]",
        1,
    );
    // What run 1 has in place of its velocity, and how far its angle moves.
    let logs = |dead: Option<f64>, moves: f64| -> Vec<PathBuf> {
        (0..3)
            .map(|run| {
                let mut x = 0.0;
                let mut text = "t,y,c,v,x\n".to_string();
                for (i, r) in rows(run, 600).iter().enumerate() {
                    let v = dead.filter(|_| run == 1).unwrap_or(r[3]);
                    let noise = 1e-5 * hash(i, 77);
                    let line = format!("{},{},{},{v},{}\n", r[0], r[1], r[2], x + noise);
                    text += &line;
                    x += 0.02 * if run == 1 { moves * r[3] } else { r[3] };
                }
                folder.put(&format!("{run}.csv"), &text)
            })
            .collect()
    };
    for stuck in [0.0, 0.37] {
        let error = analyse(&logs(Some(stuck), 1.0), &model)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("1.csv: the velocity is") && error.contains("angle moves"),
            "{error}"
        );
        // At rest a velocity of 0 is right, and the noise of the angle is no motion.
        if stuck == 0.0 {
            analyse(&logs(Some(0.0), 0.0), &model).unwrap();
        }
    }
    analyse(&logs(None, 1.0), &model).unwrap();
}
