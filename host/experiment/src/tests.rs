//! Whole experiments on the fast rig with the virtual arm, in order and not.

use super::dataset::{COLUMNS, TRUTH_COLUMNS};
use super::feed::Tamper;
use super::sequence::run_tampered;
use super::table::Table;
use super::*;
use rig::Rig;
use robot::source::{SourceConfig, StaticConfig};
use std::path::Path;

/// Seconds of a trial of these tests.
fn short(seconds: f64) -> Experiment {
    Experiment {
        minutes: seconds / 60.0,
        trials: 1,
        ..Experiment::thesis().unwrap()
    }
}

fn run_with(
    experiment: &Experiment,
    root: &Path,
    options: &Options,
    tamper: &mut dyn FnMut(usize, u32) -> Option<Tamper>,
) -> Summary {
    let rig = Rig::built_in().unwrap();
    run_tampered(experiment, &rig, root, options, &mut NoopWatcher, tamper).unwrap()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(count)).sqrt()
}

#[test]
fn the_quick_experiment_gives_a_dataset_whose_label_is_the_true_force() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = Experiment::thesis().unwrap().quick();
    let summary = run_with(
        &experiment,
        folder.path(),
        &Options::default(),
        &mut |_, _| None,
    );
    assert_eq!(summary.good, [1], "{:?}", summary.attempts);
    let folder = Folder::open(folder.path()).unwrap().0;
    let rows = Table::read(&folder.dataset(1)).unwrap();
    assert_eq!(rows.names().len(), COLUMNS.len());
    assert!(rows.names().iter().all(|name| !name.contains("true")));
    assert!(rows.rows() >= 5995, "{}", rows.rows());
    let truth = Table::read(&folder.truth(1)).unwrap();
    assert_eq!(truth.names().len(), TRUTH_COLUMNS.len());
    assert_eq!(truth.column("t_s"), rows.column("t_s"));
    for axis in ["x", "y", "z"] {
        let label = rows.column(&format!("force_{axis}_n")).unwrap();
        let real = truth.column(&format!("true_force_{axis}_n")).unwrap();
        let error = rms(label.iter().zip(real).map(|(a, b)| a - b));
        assert!(error < 0.1, "{axis}: {error}");
    }
    let y = rows.column("force_y_n").unwrap();
    assert!(y.iter().any(|f| *f > 1.0) || y.iter().any(|f| *f < -1.0));
    // The arm moves, and its torques carry the force.
    let q1 = rows.column("joint_position_1").unwrap();
    assert!(q1.iter().fold(0.0_f64, |m, q| m.max((q - q1[0]).abs())) > 0.05);
}

/// Board time at which a trial's profile begins is above this, and a trial of [`SECONDS`] ends
/// after it, s.
const DURING_S: f64 = 12.5;
const SECONDS: f64 = 8.0;

/// Calls `change` for every state after [`DURING_S`] of the first attempt.
fn in_first_attempt(
    change: impl Fn(robot::state::RobotState) -> Vec<robot::state::RobotState> + Send + Clone + 'static,
) -> impl FnMut(usize, u32) -> Option<Tamper> {
    move |_, attempt| {
        let change = change.clone();
        let tamper: Tamper = Box::new(move |states| {
            let mut out = Vec::new();
            for state in states {
                if state.stamp.t_ns as f64 * 1e-9 > DURING_S {
                    out.extend(change(state));
                } else {
                    out.push(state);
                }
            }
            out
        });
        (attempt == 1).then_some(tamper)
    }
}

/// A robot that goes wrong in the first attempt: the rig is disarmed, the attempt is marked with
/// these words and keeps its rows, and the trial is repeated.
fn goes_wrong(
    words: &str,
    change: impl Fn(robot::state::RobotState) -> Vec<robot::state::RobotState> + Send + Clone + 'static,
) {
    let folder = tempfile::tempdir().unwrap();
    let summary = run_with(
        &short(SECONDS),
        folder.path(),
        &Options::default(),
        &mut in_first_attempt(change),
    );
    let [first, second] = summary.attempts.as_slice() else {
        panic!("two attempts: {:?}", summary.attempts);
    };
    assert_eq!(
        (first.status, second.status),
        (Status::Stopped, Status::Good)
    );
    let reason = first.reason.as_deref().unwrap();
    assert!(reason.contains(words), "{reason}");
    assert!(first.disarmed && second.disarmed);
    assert!(
        first.events.iter().any(|event| event.contains(words)),
        "{:?}",
        first.events
    );
    // Nothing recorded is lost, and the rows are not in the dataset.
    let rows = Table::read(&folder.path().join("trials/trial-01/attempt-1/rows.parquet")).unwrap();
    assert_eq!(rows.rows() as u64, first.figures.rows);
    let last = rows.column("board_time_s").unwrap()[rows.rows() - 1];
    assert!(
        (DURING_S - 0.021..=DURING_S + 0.12).contains(&last),
        "{last}"
    );
    let kept = Table::read(&folder.path().join("dataset/trial-01.parquet")).unwrap();
    assert!(kept.column("attempt").unwrap().iter().all(|n| *n == 2.0));
    assert_eq!(summary.good, [1]);
}

#[test]
fn a_robot_that_stops_publishing_ends_the_attempt() {
    goes_wrong("published nothing", |_| Vec::new());
}

#[test]
fn a_second_publisher_ends_the_attempt() {
    goes_wrong("two publishers", |state| {
        let mut other = state.clone();
        other.publisher = "another".into();
        vec![state, other]
    });
}

#[test]
fn a_pose_that_is_not_a_number_ends_the_attempt() {
    goes_wrong("can't be used", |mut state| {
        state.tip.as_mut().unwrap().position_m[1] = f64::NAN;
        vec![state]
    });
}

#[test]
fn a_tip_that_is_lost_ends_the_attempt_while_the_joints_go_on() {
    goes_wrong("published no tip", |mut state| {
        state.tip = None;
        vec![state]
    });
}

#[test]
fn a_robot_in_fault_or_disabled_or_not_homed_ends_the_attempt() {
    use robot::state::{Operating, OperatingState};
    for (operating, is_homed, words) in [
        (Operating::Fault, true, "in FAULT"),
        (Operating::Disabled, true, "DISABLED"),
        (Operating::Enabled, false, "not homed"),
    ] {
        goes_wrong(words, move |mut state| {
            state.operating = Some(OperatingState {
                state: operating,
                is_homed,
                is_busy: false,
            });
            vec![state]
        });
    }
}

#[test]
fn another_frame_and_a_jump_of_8_mm_end_the_attempt() {
    goes_wrong("in the frame `ECM`", |mut state| {
        state.tip.as_mut().unwrap().frame_id = "ECM".into();
        vec![state]
    });
    goes_wrong("tip jumped", |mut state| {
        state.tip.as_mut().unwrap().position_m[0] += 0.008;
        vec![state]
    });
}

#[test]
fn a_clock_that_stands_ends_the_attempt() {
    goes_wrong("published nothing that can be used", |mut state| {
        state.stamp.t_ns = (DURING_S * 1e9) as i64 + 1;
        vec![state]
    });
}

#[test]
fn efforts_that_are_not_known_are_left_out_and_counted_and_the_trial_is_good() {
    let folder = tempfile::tempdir().unwrap();
    let summary = run_with(
        &short(SECONDS),
        folder.path(),
        &Options::default(),
        &mut in_first_attempt(|mut state| {
            let effort = state.joints.as_mut().unwrap().effort.as_mut().unwrap();
            effort.value[1] = f64::NAN;
            vec![state]
        }),
    );
    let [attempt] = summary.attempts.as_slice() else {
        panic!("one attempt: {:?}", summary.attempts);
    };
    assert_eq!(attempt.status, Status::Good, "{:?}", attempt.reason);
    assert!(attempt.figures.robot_left_out["joint effort"] > 100);
    assert_eq!(attempt.figures.robot_events, 1);
    let [event] = attempt.events.as_slice() else {
        panic!("{:?}", attempt.events);
    };
    assert!(event.contains("joint effort"), "{event}");
    // Joints that are gone are another matter: rows without them are no rows.
    let summary = run_with(
        &short(SECONDS),
        &folder.path().join("joints"),
        &Options::default(),
        &mut in_first_attempt(|mut state| {
            state.joints.as_mut().unwrap().position[1] = f64::NAN;
            vec![state]
        }),
    );
    let first = &summary.attempts[0];
    assert_eq!(first.status, Status::OutsideGates, "{:?}", first.reason);
    assert!(first.figures.robot_left_out["joints"] > 100);
    assert!(first.figures.rows_incomplete > 0);
}

#[test]
fn a_clock_that_jumps_ends_the_attempt() {
    goes_wrong("clock jumped", |mut state| {
        state.stamp.t_ns += 3_000_000_000;
        vec![state]
    });
}

#[test]
fn joints_that_do_not_fit_end_the_attempt() {
    goes_wrong("reports the joints", |mut state| {
        state.joints.as_mut().unwrap().names = ["a", "b", "c"].map(str::to_owned).to_vec().into();
        vec![state]
    });
}

#[test]
fn a_trial_outside_its_gates_is_kept_and_repeated_and_stays_left_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let mut experiment = short(3.0);
    experiment.gates.tracking_rms_n = 0.0;
    let summary = run_with(
        &experiment,
        folder.path(),
        &Options::default(),
        &mut |_, _| None,
    );
    assert!(summary.good.is_empty());
    assert_eq!(summary.left, [1]);
    let status: Vec<Status> = summary.attempts.iter().map(|a| a.status).collect();
    assert_eq!(status, [Status::OutsideGates; 2]);
    let reason = summary.attempts[0].reason.as_deref().unwrap();
    assert!(reason.contains("tracking_rms_n"), "{reason}");
    // Noise differs from attempt to attempt.
    let rows = |attempt| {
        let path = format!("trials/trial-01/attempt-{attempt}/rows.parquet");
        Table::read(&folder.path().join(path)).unwrap()
    };
    let (one, two) = (rows(1), rows(2));
    assert_eq!(
        one.column("force_commanded_y_n"),
        two.column("force_commanded_y_n")
    );
    assert_ne!(one.column("force_y_n"), two.column("force_y_n"));
    let error = report::write(&Folder::open(folder.path()).unwrap().0, &experiment).unwrap_err();
    assert!(
        error.to_string().contains("no trial is good yet"),
        "{error}"
    );
}

/// Records rows and their truth as a trial does, and cuts the file off in its last chunk.
fn leave_recording(attempt: &folder::AttemptFolder, rows: &Table, truth: &Table) {
    use super::dataset::{BOARD_TIME, ROWS, TRUTH};
    use recording::{Metadata, Recorder, CHUNK_PERIOD, MCAP_FILE};
    let metadata = Metadata::new(&Rig::built_in().unwrap(), true)
        .without_samples()
        .with_columns(&[ROWS, TRUTH]);
    let mut recorder = Recorder::create(&attempt.recording(), &metadata).unwrap();
    let file = attempt.recording().join(MCAP_FILE);
    for row in 0..rows.rows() {
        let values = rows.row(row);
        let board_s = values[BOARD_TIME];
        recorder.columns(ROWS.topic, board_s, values);
        recorder.columns(TRUTH.topic, board_s, truth.row(row));
        if row == rows.rows() / 2 {
            // A chunk is on the disk.
            let before = std::fs::metadata(&file).unwrap().len();
            for _ in 0..1000 {
                std::thread::sleep(CHUNK_PERIOD / 10);
                if std::fs::metadata(&file).unwrap().len() > before + 1000 {
                    break;
                }
            }
        }
    }
    drop(recorder);
    let whole = std::fs::read(&file).unwrap();
    let opcode_of_chunk = |at: &usize| whole[*at] == 6;
    // The last chunk ends somewhere in the last records; the summary behind it goes as well.
    let chunks = records(&whole);
    let last = chunks.iter().rfind(|at| opcode_of_chunk(at)).unwrap();
    std::fs::write(&file, &whole[..last + 100]).unwrap();
}

/// Where the records of an MCAP file begin: after the magic, each with an opcode and a length of 8
/// bytes.
fn records(file: &[u8]) -> Vec<usize> {
    let mut at = 8;
    let mut found = Vec::new();
    while at + 9 <= file.len() - 8 {
        found.push(at);
        let length = u64::from_le_bytes(file[at + 1..at + 9].try_into().unwrap());
        at += 9 + length as usize;
    }
    found
}

#[test]
fn an_experiment_goes_on_where_it_was_broken_off_and_shards_share_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let experiment = Experiment {
        trials: 3,
        ..short(4.0)
    };
    let rig = Rig::built_in().unwrap();
    let second = Options {
        shard: "2/2".parse().unwrap(),
        ..Options::default()
    };
    let summary = run_with(&experiment, root, &second, &mut |_, _| None);
    assert_eq!((summary.good.clone(), summary.left), (vec![2], vec![1, 3]));
    // What a killed program leaves of trial 1: a recording without its end, and no result.
    let (open, _) = Folder::open(root).unwrap();
    let rows = Table::read(&open.dataset(2)).unwrap();
    let truth = Table::read(&open.truth(2)).unwrap();
    let attempt = open.attempt(1, 1);
    attempt.begin().unwrap();
    leave_recording(&attempt, &rows, &truth);
    // Whoever only looks leaves it alone: it may be in progress.
    assert_eq!(open.good(&experiment).unwrap().len(), 1);
    assert!(!attempt.path().join("result.json").exists());
    let again = |resume| Options {
        resume,
        ..Options::default()
    };
    let refused = run(&experiment, &rig, root, &again(false), &mut NoopWatcher).unwrap_err();
    assert!(refused.to_string().contains("--resume"), "{refused}");
    let summary = run_with(&experiment, root, &again(true), &mut |_, _| None);
    assert_eq!((summary.good, summary.left), (vec![1, 2, 3], vec![]));
    assert!(
        summary.attempts.iter().all(|a| a.trial != 2),
        "trial 2 was done"
    );
    let kept = open.attempts(1).unwrap();
    let status: Vec<Status> = kept.iter().map(|a| a.status).collect();
    assert_eq!(status, [Status::BrokenOff, Status::Good]);
    for (name, whole) in [("rows.parquet", &rows), ("truth.parquet", &truth)] {
        let part = Table::read(&attempt.path().join(name)).unwrap();
        // All chunks but the one in which the program was killed.
        assert!(
            part.rows() > 50 && part.rows() < whole.rows(),
            "{name}: {}",
            part.rows()
        );
        for column in whole.names() {
            let (part, whole) = (part.column(column).unwrap(), whole.column(column).unwrap());
            let same = part
                .iter()
                .zip(whole)
                .all(|(a, b)| a == b || (a.is_nan() && b.is_nan()));
            assert!(same, "{column}");
        }
    }
    // With the rows in their own files, a recording that nobody asked for is gone.
    assert!(!open.attempt(1, 2).recording().exists());
    // A file that somebody has changed is no ground truth any more.
    let file = open.dataset(2);
    let whole = std::fs::read(&file).unwrap();
    for damaged in [Some(&whole[..whole.len() / 2]), None] {
        match damaged {
            Some(bytes) => std::fs::write(&file, bytes).unwrap(),
            None => std::fs::remove_file(&file).unwrap(),
        }
        let resumed = run(&experiment, &rig, root, &again(true), &mut NoopWatcher).unwrap_err();
        let reported = crate::report::write(&open, &experiment).unwrap_err();
        for said in [resumed.to_string(), reported.to_string()] {
            assert!(
                said.contains("trial-02.parquet") && said.contains("--resume"),
                "{said}"
            );
        }
    }
    std::fs::write(&file, &whole).unwrap();
    let truth = std::fs::read(open.truth(2)).unwrap();
    std::fs::remove_file(open.truth(2)).unwrap();
    assert!(run(&experiment, &rig, root, &again(true), &mut NoopWatcher).is_ok());
    std::fs::write(open.truth(2), truth).unwrap();
    // Another experiment does not fit into this folder.
    let other = Experiment {
        seed: 2,
        ..experiment.clone()
    };
    let refused = run(&other, &rig, root, &again(true), &mut NoopWatcher).unwrap_err();
    assert!(
        refused.to_string().contains("another experiment"),
        "{refused}"
    );

    let into = root.join("page");
    let written = report::write(&open, &experiment).unwrap();
    report::copy(&open, &into).unwrap();
    let text = std::fs::read_to_string(written.join("README.md")).unwrap();
    assert!(text.contains("3 of 3 trials"), "{text}");
    for name in [
        "README.md",
        "coverage.svg",
        "force.svg",
        "data-card.md",
        "card.json",
    ] {
        assert!(into.join(name).is_file(), "{name}");
    }
    assert!(std::fs::read_dir(&into).unwrap().all(|f| {
        f.unwrap()
            .path()
            .extension()
            .is_some_and(|e| e != "parquet")
    }));
    let card: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(into.join("card.json")).unwrap()).unwrap();
    assert_eq!(card["trials"].as_array().unwrap().len(), 3);
    assert_eq!(card["attempts_not_used"][0]["status"], "broken_off");
    let file = &card["trials"][0]["files"]["dataset/trial-01.parquet"];
    assert_eq!(*file, files::sha256(&open.dataset(1)).unwrap());
}

#[test]
fn a_trial_that_another_process_runs_is_refused_and_left_as_it_is() {
    let temporary = tempfile::tempdir().unwrap();
    let root = temporary.path();
    let experiment = Experiment {
        trials: 2,
        ..short(3.0)
    };
    let rig = Rig::built_in().unwrap();
    let folder = Folder::create(root, &experiment, &rig).unwrap();
    let attempt = folder.attempt(2, 1);
    attempt.begin().unwrap();
    let other = lock::TrialLock::take(&folder, 2).unwrap();
    let again = Options {
        resume: true,
        ..Options::default()
    };
    let refused = run(&experiment, &rig, root, &again, &mut NoopWatcher).unwrap_err();
    let words = format!("process {}", std::process::id());
    assert!(
        refused.to_string().contains("trial 2") && refused.to_string().contains(&words),
        "{refused}"
    );
    assert!(!attempt.path().join("result.json").exists(), "not marked");
    assert!(!folder.attempt(1, 1).path().exists(), "nothing was begun");
    // The other shard is free meanwhile, and this one when the other process has ended.
    let first = Options {
        shard: "1/2".parse().unwrap(),
        ..again.clone()
    };
    assert_eq!(
        run_with(&experiment, root, &first, &mut |_, _| None).good,
        [1]
    );
    drop(other);
    assert_eq!(
        run_with(&experiment, root, &again, &mut |_, _| None).good,
        [1, 2]
    );
}

#[test]
fn the_raven_s_path_pulls_with_the_board_s_motors_off() {
    use recording::read::{mcap_of, Entry, Reader};
    let temporary = tempfile::tempdir().unwrap();
    let mut experiment = short(6.0);
    experiment.path = file::ControlPath::Raven;
    experiment.record_samples = true;
    // The path is coarser than the board's gate.
    experiment.gates.tracking_rms_n = 1.0;
    let summary = run_with(
        &experiment,
        temporary.path(),
        &Options::default(),
        &mut |_, _| None,
    );
    assert_eq!(summary.good, [1], "{:?}", summary.attempts);
    let folder = Folder::open(temporary.path()).unwrap().0;
    let truth = Table::read(&folder.truth(1)).unwrap();
    for unit in [3, 4] {
        let tension = truth.column(&format!("true_tension_{unit}_n")).unwrap();
        let mean = tension.iter().sum::<f64>() / tension.len() as f64;
        assert!(mean > 1.5, "cable {unit}: {mean}");
    }
    // 32768 is 0 V.
    let mut samples = 0;
    for entry in Reader::open(&mcap_of(&folder.attempt(1, 1).recording())).unwrap() {
        match entry {
            Entry::Message { topic, data, .. } if topic == "/sample" => {
                let sample: serde_json::Value = serde_json::from_slice(&data).unwrap();
                assert_eq!(sample["dac_code"], 32_768, "{sample}");
                samples += 1;
            }
            _ => {}
        }
    }
    assert!(samples > 1000, "{samples}");
}

#[test]
fn a_force_of_three_axes_is_applied_with_all_units() {
    let folder = tempfile::tempdir().unwrap();
    let mut experiment = short(8.0);
    experiment.force = file::Force::ThreeAxes {
        largest_n: 3.0,
        slowest_n_per_s: 1.0,
        fastest_n_per_s: 2.0,
    };
    experiment.trajectories[0].kind = robot::trajectory::Kind::StopAndGo;
    let summary = run_with(
        &experiment,
        folder.path(),
        &Options::default(),
        &mut |_, _| None,
    );
    assert_eq!(summary.good, [1], "{:?}", summary.attempts);
    let rows = Table::read(&folder.path().join("dataset/trial-01.parquet")).unwrap();
    for axis in ["x", "z"] {
        let force = rows.column(&format!("force_{axis}_n")).unwrap();
        assert!(force.iter().any(|f| f.abs() > 0.5), "{axis}");
    }
    assert!(rows.column("tension_1_n").unwrap().iter().all(|t| *t > 1.0));
}

/// A rig that a person has stopped stays stopped: no further attempt, no further trial.
#[test]
fn a_stop_ends_the_experiment() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = Experiment {
        trials: 2,
        robot: SourceConfig::Static(StaticConfig {
            position_m: [-0.08, 0.025, -0.14],
        }),
        ..short(4.0)
    };
    let rig = Rig::built_in().unwrap();
    let opened = std::cell::Cell::new(0);
    let open = || {
        opened.set(opened.get() + 1);
        let mut link: Box<dyn session::link::RigLink> = Box::new(
            session::link::fast::FastRig::with(core_sim::Options::default())?,
        );
        let mut session = session::Session::connect(link.as_mut()).unwrap();
        session.command(&wire::Command::Stop).unwrap();
        Ok((link, run::Zeroing::Measure))
    };
    let options = Options {
        open: Some(&open),
        ..Options::default()
    };
    let root = folder.path();
    let summary = crate::run(&experiment, &rig, root, &options, &mut NoopWatcher).unwrap();
    assert_eq!(opened.get(), 1, "{summary:?}");
    assert_eq!(summary.attempts.len(), 1);
    assert_eq!(summary.attempts[0].status, Status::BrokenOff);
    let said = summary.stopped.clone().unwrap();
    assert!(
        said.contains("fault 3") && said.contains("forcectl clear"),
        "{said}"
    );
    assert_eq!((summary.left, summary.interrupted), (vec![1, 2], false));
    // Stopped and cleared between two attempts: the next one never begins.
    let between = || {
        let who = "the rig was stopped by a person".to_owned();
        Err(crate::ExperimentError::StoppedElsewhere(who))
    };
    let options = Options {
        open: Some(&between),
        ..Options::default()
    };
    let root_c = root.join("c");
    let summary = crate::run(&experiment, &rig, &root_c, &options, &mut NoopWatcher).unwrap();
    assert_eq!(
        summary.stopped.as_deref(),
        Some("the rig was stopped by a person")
    );
    assert!(summary.attempts.is_empty() && summary.left == [1, 2]);
    assert!(!root_c.join("trials/trial-01/attempt-1").exists());
    // A robot that stands where no cable reaches is refused before anything is driven.
    let outside = Experiment {
        robot: SourceConfig::Static(StaticConfig {
            position_m: [0.0, 0.0, 0.0],
        }),
        ..experiment.clone()
    };
    let refused = crate::run(&outside, &rig, &root.join("d"), &options, &mut NoopWatcher);
    assert!(refused
        .unwrap_err()
        .to_string()
        .contains("outside of [workspace]"));
    // Without a rig to open nothing is driven.
    let refused = crate::run(
        &experiment,
        &rig,
        &root.join("b"),
        &Options::default(),
        &mut NoopWatcher,
    );
    assert!(refused.unwrap_err().to_string().contains("no rig is named"));
}

struct Notices(Vec<String>);

impl Watcher for Notices {
    fn notice(&mut self, text: &str) {
        self.0.push(text.to_owned());
    }
}

/// Hours of such a dataset would be refused by the training, and not before.
#[test]
fn a_robot_that_tells_its_tip_alone_is_told_after_its_first_good_trial() {
    let rig = Rig::built_in().unwrap();
    let open = || {
        let rig = session::link::fast::FastRig::with(core_sim::Options::default())?;
        let link: Box<dyn session::link::RigLink> = Box::new(rig);
        Ok((link, run::Zeroing::Measure))
    };
    let options = Options {
        open: Some(&open),
        ..Options::default()
    };
    let still = Experiment {
        trials: 2,
        robot: SourceConfig::Static(StaticConfig {
            position_m: [-0.08, 0.025, -0.14],
        }),
        ..short(4.0)
    };
    let said = |experiment: &Experiment, options: &Options<'_>| {
        let folder = tempfile::tempdir().unwrap();
        let mut notices = Notices(vec![]);
        let summary = crate::run(experiment, &rig, folder.path(), options, &mut notices).unwrap();
        assert_eq!(summary.good, [1, 2], "{summary:?}");
        let of_joints = |text: &&String| text.contains("reports no joints");
        notices.0.iter().filter(of_joints).count()
    };
    assert_eq!(said(&still, &options), 1);
    let arm = Experiment {
        trials: 2,
        ..short(4.0)
    };
    assert_eq!(said(&arm, &Options::default()), 0);
}
