//! `forcectl residual`: arguments, exit codes, where reports go, and what `--apply` does with a rig
//! file. What the analysis makes of bad logs is tested where it lives, in `residual/tests`.
#![cfg(feature = "residual")]

mod common;

use residual::{Report, Verdict};
use std::path::Path;

const MODEL: &str = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "force", unit = "N" }
command = { column = "command", unit = "N" }
velocity = { column = "speed", unit = "rad/s" }
[[terms]]
name = "as commanded"
expr = "command"
fixed = 1.0
"#;

/// Another term with a coefficient of its own.
const SECOND_TERM: &str = "[[terms]]\nname = \"zero\"\nexpr = \"1\"\n";

/// A folder of its own for one test, removed at the end.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(common::folder())
    }

    /// A folder with three logs of a drive with that much Coulomb friction (N), and a model file.
    fn with_logs(friction_n: f64) -> Self {
        let folder = Self::new();
        folder.put("MODEL.toml", MODEL);
        std::fs::create_dir(folder.path().join("logs")).expect("made");
        for run in 0..3 {
            folder.put(&format!("logs/run{run}.csv"), &log(run, friction_n));
        }
        folder
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn put(&self, name: &str, text: &str) {
        std::fs::write(self.path().join(name), text).expect("written");
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    fn has(&self, name: &str) -> bool {
        self.path().join(name).exists()
    }

    /// Runs `forcectl` in the folder.
    fn forcectl(&self, line: &str) -> common::Said {
        common::run(self.path(), line)
    }

    /// Runs it, and expects the exit code and all words in what it says.
    fn expect(&self, line: &str, code: i32, words: &[&str]) -> common::Said {
        common::expect(self.path(), line, code, words)
    }
}

/// A number in -1..1 that depends on the row only.
fn noise(i: u64) -> f64 {
    2.0 * random::of(i) - 1.0
}

fn log(run: u32, friction_n: f64) -> String {
    let mut text = "t,command,speed,force\n".to_string();
    for i in 0..800u32 {
        let (t, phase) = (f64::from(i) * 0.02, f64::from(run));
        let speed = (1.3 * t + phase).sin() + 0.4 * (3.1 * t).cos();
        let command = 3.0 + (0.7 * t + 2.0 * phase).sin();
        let key = u64::from(run) << 32 | u64::from(i);
        let noise = 0.08 * (noise(key) + noise(key + (1 << 20)) + noise(key + (2 << 20)));
        let force = command - friction_n * speed.signum() + noise;
        text += &format!("{t},{command},{speed},{force}\n");
    }
    text
}

/// Names of the texts of a report in a folder.
fn reports(folder: &Path) -> Vec<String> {
    ["report.md", "report.html", "report.json"]
        .into_iter()
        .filter(|name| folder.join(name).exists())
        .map(String::from)
        .collect()
}

#[test]
fn a_report_never_replaces_the_model_that_is_read() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path().join("o")).expect("made");
    for name in ["MODEL.extended.toml", "MODEL.frozen.toml"] {
        folder.put(&format!("o/{name}"), MODEL);
        let line = format!("residual --data logs --model o/{name} --out o");
        folder.expect(&line, 2, &[name, "would be lost"]);
        assert_eq!(folder.read(&format!("o/{name}")), MODEL);
    }
}

#[test]
fn wrong_arguments_end_before_anything_is_written() {
    let folder = Folder::with_logs(0.5);
    folder.put("key.toml", &MODEL.replace("fixed", "fixd"));
    folder.put(
        "newton.toml",
        &MODEL.replace(
            "column = \"force\", unit = \"N\"",
            "column = \"force\", unit = \"V\"",
        ),
    );
    folder.put("two.toml", &format!("{MODEL}{SECOND_TERM}"));
    let rig = folder.forcectl("check --print").out;
    folder.put("rig.toml", &rig);
    folder.put("broken.toml", "[rig\n");
    folder.put("logs/notes.md", "no log");
    let cases: &[(&str, i32, &[&str])] = &[
        ("--data logs --out out", 2, &["--model"]),
        ("--model MODEL.toml --out out", 2, &["--data"]),
        (
            "--data logs --model MODEL.toml --apply rig.toml",
            2,
            &["--out"],
        ),
        ("logs --model MODEL.toml --increment", 2, &["--apply"]),
        ("logs --model key.toml", 2, &["key.toml", "fixd", "line 10"]),
        ("logs --model no.toml", 2, &["no.toml", "model file"]),
        (
            "logs --model logs",
            2,
            &["logs: cannot be read", "model file"],
        ),
        (
            "runs --model MODEL.toml",
            3,
            &["--data runs", "check the path"],
        ),
        ("logs runs --model MODEL.toml", 3, &["--data runs"]),
        (
            "logs/run0.csv --model MODEL.toml",
            4,
            &["one group", "block_s"],
        ),
        (
            "logs --model MODEL.toml --apply no.toml",
            3,
            &["--apply no.toml", "rig file"],
        ),
        (
            "logs --model MODEL.toml --apply broken.toml",
            3,
            &["broken.toml:1"],
        ),
        (
            "logs --model newton.toml --apply rig.toml",
            2,
            &["target in N"],
        ),
        (
            "logs --model two.toml --apply rig.toml",
            2,
            &["2 terms", "--increment"],
        ),
    ];
    for (arguments, code, words) in cases {
        let line = if arguments.starts_with("--") {
            format!("residual {arguments}")
        } else {
            format!("residual --out out --data {arguments}")
        };
        folder.expect(&line, *code, words);
        assert!(!folder.has("out"), "{arguments} wrote something");
    }
    let line = "--json residual --data logs/run0.csv --model MODEL.toml --out out";
    let said = folder.expect(line, 4, &[]);
    let json: serde_json::Value = serde_json::from_str(&said.out).expect("JSON");
    assert_eq!(json["exit_code"], 4, "{json}");
    let error = json["error"].as_str().expect("a text");
    assert!(error.contains("one group"), "{error}");
}

#[test]
fn a_place_that_takes_no_reports_is_refused_and_left_as_it_is() {
    let folder = Folder::with_logs(0.5);
    folder.put("file", "mine");
    std::fs::create_dir(folder.path().join("own")).expect("made");
    folder.put("own/report.md", "my own");
    let base = "residual --data logs --model MODEL.toml --out";
    folder.expect(&format!("{base} file"), 7, &["file", "folder"]);
    folder.expect(&format!("{base} file/below"), 7, &["file", "folder"]);
    folder.expect(
        &format!("{base} own"),
        7,
        &["own/report.md", "another folder"],
    );
    assert_eq!(
        (folder.read("file"), folder.read("own/report.md")),
        ("mine".into(), "my own".into())
    );
    assert_eq!(
        std::fs::read_dir(folder.path().join("own"))
            .expect("is there")
            .count(),
        1
    );
    // Told at once, not after the analysis: it does not even read the logs.
    folder.expect(
        "residual --data logs --model no.toml --out own",
        7,
        &["own/report.md"],
    );
    // A log inside the folder of reports that cannot be read is a bad log, no bad folder.
    folder.put("logs/cut.parquet", "no parquet");
    folder.expect(
        "residual --data logs --model MODEL.toml --out logs",
        3,
        &["cut.parquet"],
    );
}

#[test]
fn reports_are_written_replaced_and_gone_when_a_run_fails() {
    let folder = Folder::with_logs(0.5);
    // The folder of reports lies among the data: reports are no logs.
    let good = "residual --data . --model MODEL.toml --out out";
    let found = ["The model lacks coulomb"];
    folder.expect("residual --data . --model MODEL.toml", 0, &found);
    let entries = std::fs::read_dir(folder.path()).expect("is there").count();
    assert_eq!(entries, 2, "without --out nothing is written");
    for _ in 0..2 {
        folder.expect(good, 0, &["The model lacks coulomb", "out/report.html"]);
        assert_eq!(reports(&folder.path().join("out")).len(), 3);
    }
    let report = Report::read(&folder.path().join("out/report.json")).expect("a report");
    assert_eq!(report.verdict, Verdict::Effect);
    assert_eq!(report.files.len(), 3);
    folder.expect(
        "residual --data logs/run0.csv --model MODEL.toml --out out",
        4,
        &["one group"],
    );
    assert_eq!(reports(&folder.path().join("out")), Vec::<String>::new());
    assert!(!folder.has("out/effect-1-coulomb.svg"));
    // What it found can be run again; it is the declared model of the next look.
    folder.expect(
        "residual --data logs --model out/MODEL.extended.toml --out again",
        0,
        &["Nothing material is missing"],
    );
}

#[test]
fn a_rig_file_is_copied_with_what_the_board_can_use_or_not_at_all() {
    let folder = Folder::with_logs(0.5);
    let rig = folder.forcectl("check --print").out;
    folder.put("rig.toml", &rig);
    let base = "residual --model MODEL.toml --out out --apply rig.toml --data";
    folder.expect(
        &format!("{base} logs"),
        0,
        &["out/rig.residual.toml", "changed", "coulomb_n"],
    );
    assert_eq!(
        folder.read("rig.toml"),
        rig,
        "the rig file itself is left alone"
    );
    let changed = folder.read("out/rig.residual.toml");
    assert!(changed != rig && changed.lines().count() == rig.lines().count());
    folder.expect("check out/rig.residual.toml", 0, &[]);

    // Nothing found: nothing written, and what an earlier run wrote is not passed off as new.
    for run in 0..3 {
        folder.put(&format!("logs/run{run}.csv"), &log(run, 0.0));
    }
    folder.expect(
        &format!("{base} logs"),
        6,
        &[
            "Nothing material",
            "no rig file written",
            "rig.residual.toml is of an earlier run",
        ],
    );
    assert_eq!(folder.read("out/rig.residual.toml"), changed);
    let said = folder.expect(&format!("--json {base} logs"), 6, &[]);
    let json: serde_json::Value = serde_json::from_str(&said.out).expect("JSON");
    assert!(json["applied"]["file"].is_null(), "{json}");
    assert_eq!(json["report"]["verdict"], "none");
}

#[test]
fn init_writes_a_model_file_that_runs_and_keeps_one_that_is_there() {
    let folder = Folder::with_logs(0.5);
    folder.expect(
        "residual --data logs --model new.toml --init",
        0,
        &[
            "new.toml written",
            "questions",
            "tried on the data: ",
            "rows are read with it",
        ],
    );
    folder.put("text.csv", "t,y\n0,a\n0.1,b\n0.2,c\n");
    folder.expect(
        "residual --data text.csv --model text.toml --init",
        0,
        &["text.toml written", "it does not run yet: "],
    );
    let model = folder.read("new.toml");
    assert!(model.contains("target = { column = \"force\""), "{model}");
    folder.expect(
        "residual --data logs --model new.toml",
        0,
        &["The model lacks coulomb", "found        coulomb"],
    );
    folder.expect(
        "residual --data logs --model new.toml --init",
        2,
        &["new.toml exists"],
    );
}

#[test]
fn check_data_are_evaluated_and_must_exist() {
    let folder = Folder::with_logs(0.5);
    folder.put("other.csv", &log(7, 0.5));
    folder.expect(
        "residual --data logs --model MODEL.toml --check other.csv",
        0,
        &["The model lacks coulomb", "On the check data: RMSE"],
    );
    folder.expect(
        "residual --data logs --model MODEL.toml --check none.csv",
        3,
        &["--check none.csv", "does not exist"],
    );
}

/// The model file for recordings fits what forcectl records, and finds the friction of the cables
/// there.
#[cfg(feature = "record")]
#[test]
fn a_recording_is_analysed_with_the_model_file_that_init_writes() {
    let bench = Folder::new();
    bench.expect(
        "set-force 0 2.5 0 --link fast --duration 40 --record rec",
        0,
        &["recording"],
    );
    bench.expect(
        "residual --data rec --model MODEL.toml --init",
        0,
        &["--data rec/samples.parquet --model MODEL.toml"],
    );
    bench.expect(
        "residual --data rec/samples.parquet --model MODEL.toml --out found",
        0,
        &["coulomb"],
    );
    let report: serde_json::Value = serde_json::from_str(&bench.read("found/report.json")).unwrap();
    assert_eq!(report["effects"][0]["name"], "coulomb");
    // The plant's: 0.909 N and 0.154 of a tension of 2 to 4.6 N.
    let friction = -report["effects"][0]["params"]["friction"].as_f64().unwrap();
    assert!((0.9..1.6).contains(&friction), "{friction} N");
}
