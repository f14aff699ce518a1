//! An experiment whose robot is a ROS 1 node, with Debian's rosmaster, rospy and rosbag beside it.
//!
//! `cargo test -p host-cli --features ros1 --test ros1`. Where the tools are not installed the
//! tests say so and do nothing. The board is the fast rig at the pace of real time; the robot is a
//! script below.
#![cfg(feature = "ros1")]

use experiment::{self, Experiment, Options, Status, Summary};
use experiment::{table::Table, NoopWatcher};
use recording::merge::{merge, Merge};
use rig::{LinkChoice, Rig};
use ros::{Process, Ros};
use run::Zeroing;
use session::link::{self, EmbeddedOptions};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Instant;

#[path = "../../robot/ros/tests/common/mod.rs"]
mod ros;

/// A robot that moves its first joint and its tip by its own clock: 200 states a second.
const ROBOT: &str = r#"
import math, rospy
from sensor_msgs.msg import JointState
from geometry_msgs.msg import PoseStamped
rospy.init_node("arm")
joints = rospy.Publisher("/arm/measured_js", JointState, queue_size=100)
tip = rospy.Publisher("/arm/measured_cp", PoseStamped, queue_size=100)
rate = rospy.Rate(200)
while not rospy.is_shutdown():
    now = rospy.Time.now()
    s = math.sin(0.5 * (now.to_sec() % 1000.0))
    pose = PoseStamped()
    pose.header.stamp = now
    pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = -0.080 + 0.004 * s, 0.025, -0.140
    pose.pose.orientation.w = 1.0
    tip.publish(pose)
    state = JointState(name=["shoulder", "elbow", "insertion"], position=[s, 1.5, 0.4],
                       velocity=[0.0, 0.0, 0.0], effort=[0.1, 0.2, 3.0])
    state.header.stamp = now
    joints.publish(state)
    rate.sleep()
"#;

/// The tests run beside others: only what is meant to stop a trial may stop it.
const EXPERIMENT: &str = r#"
schema = 1
name = "ros1"
seed = 1
trials = 1
minutes = 0.1
rate_hz = 50
attempts = 1
record_samples = true

[robot]
kind = "crtk-ros1"
master = "MASTER"
namespace = "/arm"
[robot.adapter]
frame = "rig"
max_skew_s = 0.2
[robot.watch]
max_age_s = 2.0
max_clock_step_s = 2.0

[force]
kind = "one_axis"
axis = [0.0, 1.0, 0.0]
toward_plus = 3
toward_minus = 4
pretension_n = 2.0
largest_n = 4.5
slowest_n_per_s = 1.0
fastest_n_per_s = 3.0

[gates]
tracking_rms_n = 2.0
samples_lost = 0.05
rows_lost = 0.3
sync_error_s = 0.05
force_age_s = 0.05
saturated = 0.5
"#;

/// A core with the robot, where Debian's tools are installed.
fn robot() -> Option<(Ros, Process, Process)> {
    if !Path::new("/usr/lib/python3/dist-packages/rospy").exists() {
        println!("skipped: rospy is not installed (Debian: python3-rospy)");
        return None;
    }
    let (ros, core) = ros::ros()?;
    let script = ros.folder.path().join("arm.py");
    std::fs::write(&script, ROBOT).expect("the script");
    let arm = ros.start("python3", &[script.to_str().expect("a path")]);
    // Until its node has its topics.
    let began = Instant::now();
    let output = || {
        let mut list = ros.command("rostopic", &["list"]);
        list.stdout(Stdio::piped()).output().expect("rostopic list")
    };
    while !String::from_utf8_lossy(&output().stdout).contains("/arm/measured_js") {
        assert!(
            began.elapsed() < ros::PATIENCE,
            "the robot's node does not come up"
        );
    }
    Some((ros, core, arm))
}

fn run(ros: &Ros, root: &Path) -> Summary {
    let text = EXPERIMENT.replace("MASTER", &ros.master());
    let experiment = Experiment::parse("ros1.toml", &text).expect("the experiment");
    let rig = Rig::built_in().expect("the built-in rig");
    let open = || {
        let paced = EmbeddedOptions {
            paced: true,
            ..EmbeddedOptions::default()
        };
        Ok((link::open(&LinkChoice::Fast, &paced)?, Zeroing::Measure))
    };
    let options = Options {
        open: Some(&open),
        ..Options::default()
    };
    experiment::run(&experiment, &rig, root, &options, &mut NoopWatcher)
        .expect("the folder can be written")
}

fn out_of(ros: &Ros, program: &str, arguments: &[&str]) -> String {
    let mut command = ros.command(program, arguments);
    let output = command.stdout(Stdio::piped()).output().expect(program);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_robot_on_ros_1_gives_a_dataset_and_its_bag_merges_with_our_recording() {
    let Some((ros, _core, _arm)) = robot() else {
        return;
    };
    let bag = ros.folder.path().join("day.bag");
    let bag_name = bag.to_str().expect("a path");
    let topics = ["/arm/measured_js", "/cable_rig/spatial/measured_cf"];
    let mut recorder = ros.start("rosbag", &["record", "-O", bag_name, topics[0], topics[1]]);
    let root = tempfile::tempdir().expect("a folder");
    let summary = run(&ros, root.path());
    recorder.interrupt();
    ros.finished(&bag, || ());
    assert_eq!(summary.good, [1], "{:#?}", summary.attempts);

    let rows = Table::read(&root.path().join("dataset/trial-01.parquet")).expect("the dataset");
    let column = |name: &str| rows.column(name).expect(name).to_vec();
    assert!(rows.rows() > 200, "{}", rows.rows());
    // Each row has the joints that the robot had by its own stamp.
    for (stamp_s, q1) in column("robot_time_s")
        .iter()
        .zip(column("joint_position_1"))
    {
        let wanted = (0.5 * (stamp_s % 1000.0)).sin();
        assert!((q1 - wanted).abs() < 1e-5, "{stamp_s}: {q1} {wanted}");
    }
    // Robot and board pass the same time: what differs is jitter within the stated error.
    let apart: Vec<f64> = (column("robot_time_s").iter())
        .zip(column("board_time_s"))
        .map(|(robot, board)| robot - board)
        .collect();
    let error_s = column("sync_error_s").iter().copied().fold(0.0, f64::max);
    let spread = apart.iter().copied().fold(f64::MIN, f64::max)
        - apart.iter().copied().fold(f64::MAX, f64::min);
    assert!(spread <= 2.0 * error_s, "{spread} {error_s}");
    let force = column("force_y_n");
    assert!(force.iter().any(|f| f.abs() > 0.5));

    // The bag holds our force, with its definition.
    let info = out_of(&ros, "rosbag", &["info", bag_name]);
    assert!(topics.iter().all(|topic| info.contains(topic)), "{info}");
    let csv = out_of(&ros, "rostopic", &["echo", "-b", bag_name, "-p", topics[0]]);
    let log = root.path().join("measured_js.csv");
    std::fs::write(&log, csv).expect("the log");
    let out = root.path().join("merged.parquet");
    let merged = merge(&Merge {
        recording: &root.path().join("trials/trial-01/attempt-1/recording"),
        log: &log,
        time: "field.header.stamp",
        shift_s: 0.0,
        log_error_s: 1e-3,
        out: &out,
    })
    .expect("the bag's rows are joined");
    // The robot ran before and after the trial as well.
    assert!(merged.joined > 600, "{merged}");
    assert!(merged.error_max_s.is_some_and(|s| s < 0.02), "{merged}");
    compare(
        &merged_tensions(&out),
        &column("robot_time_s"),
        &column("tension_3_n"),
    );
}

/// UTC (s) and tension of cable 3 (N) of the merged rows.
fn merged_tensions(path: &PathBuf) -> Vec<(f64, f64)> {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;
    let file = std::fs::File::open(path).expect("the merged file");
    let reader = SerializedFileReader::new(file).expect("Parquet");
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    let index = |name: &str| {
        let mut columns = schema.columns().iter();
        columns.position(|c| c.name() == name).expect(name)
    };
    let (time, tension) = (index("field.header.stamp"), index("rig_tension_n_3"));
    let rows = reader.get_row_iter(None).expect("rows");
    rows.map(|row| row.expect("a row"))
        .filter_map(|row| {
            Some((
                row.get_double(time).ok()? * 1e-9,
                row.get_double(tension).ok()?,
            ))
        })
        .collect()
}

/// Both ways give the same tension at the same time of the robot, but for the board's filter.
fn compare(merged: &[(f64, f64)], at_s: &[f64], tension_n: &[f64]) {
    let mut errors = Vec::new();
    for (at_s, tension_n) in at_s.iter().zip(tension_n) {
        let near = merged.iter().find(|(t, _)| (t - at_s).abs() < 1e-3);
        errors.extend(near.map(|(_, merged_n)| (merged_n - tension_n).abs()));
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() > 100, "{} common rows", errors.len());
    let median_n = errors[errors.len() / 2];
    assert!(median_n < 0.15, "{median_n}");
}

#[test]
fn a_robot_that_leaves_ros_in_a_trial_ends_it_and_its_rows_are_kept() {
    let Some((ros, _core, arm)) = robot() else {
        return;
    };
    let root = tempfile::tempdir().expect("a folder");
    let attempt = root.path().join("trials/trial-01/attempt-1");
    let summary = std::thread::scope(|scope| {
        let run = scope.spawn(|| run(&ros, root.path()));
        // The recording grows by rows of the robot: the trial is under way.
        let began = Instant::now();
        let recorded = attempt.join("recording/run.mcap");
        let rows = || {
            let entries = recording::read::Reader::open(&recorded)
                .into_iter()
                .flatten();
            entries
                .filter(|entry| matches!(entry, recording::read::Entry::Message { topic, .. } if topic == "/robot"))
                .count()
        };
        while rows() < 50 {
            assert!(began.elapsed() < 2 * ros::PATIENCE, "no rows");
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        drop(arm);
        run.join().expect("the run")
    });
    let [attempt_1] = summary.attempts.as_slice() else {
        panic!("{:?}", summary.attempts);
    };
    assert_eq!(attempt_1.status, Status::Stopped);
    assert!(attempt_1.disarmed);
    let reason = attempt_1.reason.as_deref().expect("a reason");
    assert!(reason.contains("published nothing"), "{reason}");
    let rows = Table::read(&attempt.join("rows.parquet")).expect("the rows are kept");
    assert!(rows.rows() >= 50);
}
