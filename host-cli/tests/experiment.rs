//! `forcectl experiment` as a program: checked, run, refused, reported.

mod common;

use common::{expect, folder};

#[test]
fn an_experiment_is_checked_run_and_reported() {
    let temporary = folder();
    let folder = temporary.path();
    let text = expect(folder, "experiment check --print", 0, &[]).out;
    let text = text
        .replace("minutes = 20.0", "minutes = 0.05")
        .replace("trials = 9", "trials = 1");
    std::fs::write(folder.join("short.toml"), &text).unwrap();
    let checked = ["at all 31 places"];
    expect(folder, "experiment check short.toml", 0, &checked);

    let run = "experiment run short.toml --out out";
    expect(folder, run, 0, &["1 of 1 trials", "report"]);
    for path in [
        "dataset/trial-01.parquet",
        "dataset/card.json",
        "report/tracking.svg",
    ] {
        assert!(folder.join("out").join(path).is_file(), "{path}");
    }
    expect(folder, run, 2, &["--resume"]);
    let report = "experiment report out --report-into page";
    expect(folder, report, 0, &[]);
    assert!(folder.join("page/data-card.md").is_file());
}

#[test]
fn what_can_t_be_done_is_refused_before_anything_is_made() {
    let temporary = folder();
    let folder = temporary.path();
    let text = expect(folder, "experiment check --print", 0, &[]).out;
    let text = text
        .replace("largest_n = 4.5", "largest_n = 11.9")
        .replace("fastest_n_per_s = 0.3", "fastest_n_per_s = 60.0");
    std::fs::write(folder.join("large.toml"), text).unwrap();
    let refused = ["the nearest is", "nothing was driven"];
    expect(folder, "experiment run large.toml --out out", 2, &refused);
    assert!(!folder.join("out").exists());
    expect(folder, "experiment report .", 2, &["holds no experiment"]);
}
