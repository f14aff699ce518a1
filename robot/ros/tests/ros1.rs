//! The ROS 1 source against Debian's own rosmaster, rostopic and rosbag: no double of ours in
//! between.
//!
//! `cargo test -p robot-ros --features ros1 --test ros1`. Where the tools are not installed the
//! test says so and does nothing; `apt-get install python3-rosnode python3-rostopic python3-rosbag
//! python3-rosmaster python3-geometry-msgs python3-sensor-msgs` installs them. The test with the
//! real client of CRTK also needs what docs/robot.md says.
#![cfg(feature = "ros1")]

use common::{ros, Process, Ros, PATIENCE};
use robot::crtk::AdapterConfig;
use robot::source::{Estimate, Poll, Ros1Config, Source};
use robot::state::{Acts, Clock, Frame, Meaning, Stamp, TipForce};
use robot::watch::{Event, WatchConfig};
use robot_ros::ros1::Ros1;
use std::process::Stdio;
use std::time::{Duration, Instant};

mod common;

/// A source, polled on the host's clock, with everything that came so far.
struct Listener {
    source: Ros1,
    began: Instant,
    all: Poll,
}

impl Listener {
    fn poll(&mut self) {
        let poll = self
            .source
            .poll(self.began.elapsed().as_nanos() as i64)
            .expect("the node lives");
        self.all.extend(poll);
    }

    /// Polls until `done`.
    fn until(&mut self, what: &str, mut done: impl FnMut(&mut Self) -> bool) {
        let limit = Instant::now() + PATIENCE;
        loop {
            self.poll();
            if done(self) {
                return;
            }
            assert!(
                Instant::now() < limit,
                "never came: {what}; {} states, events {:?}",
                self.all.states.len(),
                self.all.events
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

const JOINTS: &str = "{header: auto, name: [shoulder, elbow, insertion], position: [0.5, 1.5, 0.4], velocity: [0.01, 0.02, 0.003], effort: [0.1, -0.2, 3.0]}";
const POSE: &str =
    "{header: auto, pose: {position: {x: 0.02, y: -0.01, z: -0.08}, orientation: {w: 1.0}}}";

fn force(y: f64) -> TipForce {
    TipForce {
        frame: Frame::Rig,
        acts: Acts::ByTool,
        meaning: Meaning::Measured,
        force_n: [0.0, y, 0.0],
        torque_n_m: None,
    }
}

fn publish(ros: &Ros, topic: &str, kind: &str, text: &str) -> Process {
    ros.start("rostopic", &["pub", "-s", "-r", "50", topic, kind, text])
}

fn listener(ros: &Ros) -> Listener {
    let config = Ros1Config {
        master: Some(ros.master()),
        namespace: "/arm".to_owned(),
        adapter: AdapterConfig {
            frame: Frame::RavenCrtk,
            // rostopic stamps when it publishes; two processes are not in step.
            max_skew_s: 0.2,
            ..AdapterConfig::default()
        },
        watch: WatchConfig {
            // The test runs beside others: only what is meant to stop may stop it.
            max_age_s: 2.0,
            max_clock_step_s: 2.0,
            ..WatchConfig::default()
        },
        ..Ros1Config::default()
    };
    Listener {
        source: Ros1::open(&config).expect("the master is there"),
        began: Instant::now(),
        all: Poll::default(),
    }
}

#[test]
fn a_robot_on_debians_ros() {
    let Some((ros, _core)) = ros() else { return };
    let mut listener = listener(&ros);
    let joints = publish(&ros, "/arm/measured_js", "sensor_msgs/JointState", JOINTS);
    let _pose = publish(&ros, "/arm/measured_cp", "geometry_msgs/PoseStamped", POSE);

    // rostopic takes its time to start: a silence before the first state is no fault of the source.
    listener.until("the first state", |l| !l.all.states.is_empty());
    listener.all.events.clear();
    listener.until("states with joints and tip", |l| {
        l.all.states.iter().filter(|s| s.tip.is_some()).count() > 20
    });
    let state = listener
        .all
        .states
        .iter()
        .rev()
        .find(|s| s.tip.is_some())
        .unwrap();
    let read = state.joints.as_ref().unwrap();
    assert_eq!(*read.names, ["shoulder", "elbow", "insertion"]);
    assert_eq!(read.position, [0.5, 1.5, 0.4]);
    assert_eq!(read.effort.as_ref().unwrap().value, [0.1, -0.2, 3.0]);
    assert_eq!(state.tip.as_ref().unwrap().position_m, [0.02, -0.01, -0.08]);
    assert_eq!(listener.all.stop(), None);

    our_force_reaches_a_bag(&ros, &mut listener);
    a_request_reaches_us(&ros, &mut listener);

    // A second publisher of the same topic.
    let second = publish(&ros, "/arm/measured_js", "sensor_msgs/JointState", JOINTS);
    listener.until("two publishers", |l| {
        l.all
            .events
            .iter()
            .any(|e| matches!(e, Event::TwoPublishers { .. }))
    });
    drop(second);

    // The robot goes away.
    drop(joints);
    listener.until("silence", |l| {
        l.all
            .events
            .iter()
            .any(|e| matches!(e, Event::Silent { .. }))
    });
    assert!(listener.all.stop().is_some());
}

/// rosbag records what we publish, with its definition, and reads it back.
fn our_force_reaches_a_bag(ros: &Ros, listener: &mut Listener) {
    let bag = ros.folder.path().join("run.bag");
    let path = bag.to_str().expect("a path");
    // It ends by itself once it has so many messages of each topic: no time that has to be enough.
    let _recorder = ros.start(
        "rosbag",
        &[
            "record",
            "-l",
            "20",
            "-O",
            path,
            "/cable_rig/spatial/measured_cf",
            "/cable_rig/spatial/measured_cf_estimated",
            "/cable_rig/spatial/measured_cf_estimated_half_width",
            "/arm/measured_js",
        ],
    );
    ros.finished(&bag, || {
        listener.poll();
        let force = force(-2.5);
        (listener.source.publish(&force, &force)).expect("published");
        let estimate = Estimate {
            force,
            half_n: Some([0.0, 0.3, 0.0]),
            stamp: Stamp {
                t_ns: 1_234_567_890_500_000_000,
                clock: Clock::RobotUtc,
            },
        };
        (listener.source.publish_estimate(&estimate)).expect("published");
    });
    let info = ros
        .command("rosbag", &["info", path])
        .stdout(Stdio::piped())
        .output()
        .expect("rosbag info");
    let info = String::from_utf8_lossy(&info.stdout).into_owned();
    assert!(info.contains("/cable_rig/spatial/measured_cf"), "{info}");
    assert!(
        info.contains("geometry_msgs/WrenchStamped [d78d3cb249ce23087ade7e7d0c40cfa7]"),
        "{info}"
    );
    let line = |topic: &str| {
        let topic = format!("/cable_rig/spatial/{topic}");
        let text = ros
            .command("rostopic", &["echo", "-b", path, "-p", &topic])
            .stdout(Stdio::piped())
            .output()
            .expect("rostopic echo");
        let text = String::from_utf8_lossy(&text.stdout).into_owned();
        text.lines().nth(1).unwrap_or_default().to_owned()
    };
    // By the tool -2.5 N is 2.5 N on the tool, which is what we publish, and say.
    let measured = line("measured_cf");
    assert!(
        measured.contains("raven_crtk") && measured.contains(",2.5,"),
        "{measured}"
    );
    // The stamp of an estimate is that of its state, not that of the publication.
    for (topic, force) in [
        ("measured_cf_estimated", ",2.5,"),
        ("measured_cf_estimated_half_width", ",0.3,"),
    ] {
        let line = line(topic);
        assert!(
            line.contains("1234567890500000000") && line.contains(force),
            "{topic}: {line}"
        );
    }
}

#[test]
fn a_pose_that_stops_while_the_joints_go_on_is_told() {
    let Some((ros, _core)) = ros() else { return };
    let mut listener = listener(&ros);
    let _joints = publish(&ros, "/arm/measured_js", "sensor_msgs/JointState", JOINTS);
    let pose = publish(&ros, "/arm/measured_cp", "geometry_msgs/PoseStamped", POSE);
    listener.until("states with a tip", |l| {
        l.all.states.iter().any(|state| state.tip.is_some())
    });
    drop(pose);
    listener.until("the end of the tip", |l| {
        (l.all.events.iter()).any(|e| matches!(e, Event::TipSilent { .. }))
    });
    let before = listener.all.states.len();
    listener.until("joints after that", |l| l.all.states.len() > before);
}

#[test]
fn a_topic_of_another_type_is_named_with_both_types() {
    let Some((ros, _core)) = ros() else { return };
    let mut listener = listener(&ros);
    let _joints = publish(&ros, "/arm/measured_js", "sensor_msgs/JointState", JOINTS);
    let transform = "{header: auto, transform: {rotation: {w: 1.0}}}";
    let kind = "geometry_msgs/TransformStamped";
    let _pose = publish(&ros, "/arm/measured_cp", kind, transform);
    listener.until("the wrong type", |l| {
        let texts = l.all.events.iter().map(|event| (event, event.to_string()));
        texts.into_iter().any(|(event, text)| {
            event.stops()
                && text.contains(kind)
                && text.contains("geometry_msgs/PoseStamped")
                && text.contains("cp_is_transform")
        })
    });
}

#[test]
fn a_second_rig_of_the_same_name_is_refused_and_the_first_one_goes_on() {
    let Some((ros, _core)) = ros() else { return };
    let mut first = listener(&ros);
    let config = Ros1Config {
        master: Some(ros.master()),
        ..Ros1Config::default()
    };
    let error = Ros1::open(&config).unwrap_err().to_string();
    assert!(
        error.contains("`/force_rig` is taken") && !error.contains("roscore` running"),
        "{error}"
    );
    first.poll();
    let second = Ros1Config {
        node: "/force_rig_2".to_owned(),
        ..config
    };
    Ros1::open(&second).expect("another name");
    first.poll();
}

/// What rosnode prints of our node, without the lines that its other end may add.
fn rosnode_info(ros: &Ros) -> String {
    let output = ros
        .command("rosnode", &["info", "/force_rig"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .output()
        .expect("rosnode info");
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && error.is_empty(), "{error}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn rosnode_tells_the_rig_with_its_connections() {
    let Some((ros, _core)) = ros() else { return };
    if !std::path::Path::new("/usr/bin/rosnode").exists() {
        println!("skipped: /usr/bin/rosnode is not installed (Debian: python3-rosnode)");
        return;
    }
    let mut listener = listener(&ros);
    let _joints = publish(&ros, "/arm/measured_js", "sensor_msgs/JointState", JOINTS);
    let measured_cf = "/cable_rig/spatial/measured_cf";
    let _echo = ros.start("rostopic", &["echo", measured_cf]);
    listener.until("states", |l| l.all.states.len() > 5);
    let limit = Instant::now() + PATIENCE;
    let info = loop {
        let info = rosnode_info(&ros);
        let of_both = ["inbound", "outbound"].map(|way| info.contains(way));
        if of_both == [true; 2] {
            break info;
        }
        assert!(Instant::now() < limit, "{info}");
    };
    let pid = format!("Pid: {}", std::process::id());
    let inbound = "topic: /arm/measured_js\n    * to: /rostopic";
    let outbound = format!("topic: {measured_cf}\n    * to: /rostopic");
    for text in [&pid, inbound, &outbound, "transport: TCPROS"] {
        assert!(info.contains(text), "{text}\n{info}");
    }
    let ping = ros
        .command("rosnode", &["ping", "-c", "1", "/force_rig"])
        .stdout(Stdio::piped())
        .output()
        .expect("rosnode ping");
    let ping = String::from_utf8_lossy(&ping.stdout).into_owned();
    assert!(ping.contains("xmlrpc reply from"), "{ping}");
    // Nothing of ours stays behind.
    drop(listener);
    let mut list = ros.command("rosnode", &["list"]);
    let list = list.stdout(Stdio::piped()).output();
    let list = list.expect("rosnode list").stdout;
    let list = String::from_utf8_lossy(&list).into_owned();
    assert!(!list.contains("/force_rig"), "{list}");
}

/// As users of CRTK write it: a class that the client fills with the device's topics, then
/// `check_connections`.
const CRTK_CLIENT: &str = r#"
import sys, crtk

class Device:
    class Spatial:
        pass

    def __init__(self, ral):
        self.utils = crtk.utils(self, ral)
        self.utils.add_operating_state()
        self.spatial = self.Spatial()
        self.in_space = crtk.utils(self.spatial, ral.create_child("spatial"))
        self.in_space.add_measured_cf()
        self.in_space.add_servo_cf()

ral = crtk.ral("client", "cable_rig")
device = Device(ral)
ral.check_connections(30.0)
assert device.wait_for_operating_state("DISABLED", 30.0), device.operating_state()
assert device.is_homed()
device.spatial.servo_cf([0.0, 1.5, 0.0, 0.0, 0.0, 0.0])
force, stamp = device.spatial.measured_cf(wait_timeout=30.0)
device.state_command("pause")
print("force", force[1], "at", stamp > 0.0)
sys.stdout.flush()
ral.create_rate(1.0).sleep()
"#;

#[test]
fn the_client_of_crtk_finds_its_device() {
    let Some((ros, _core)) = ros() else { return };
    let Some(folder) = std::env::var_os("CRTK_TEST_PYTHONPATH") else {
        println!("skipped: CRTK_TEST_PYTHONPATH names no folder with crtk and crtk_msgs");
        return;
    };
    let mut listener = listener(&ros);
    let script = ros.folder.path().join("client.py");
    std::fs::write(&script, CRTK_CLIENT).expect("the script");
    let mut client = ros.command("python3", &[script.to_str().expect("a path")]);
    let client = client
        .env("PYTHONPATH", folder)
        .env("ROS_VERSION", "1")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut client = Process(client.expect("python3"));
    let limit = Instant::now() + PATIENCE;
    while client.0.try_wait().expect("a status").is_none() {
        listener.poll();
        let force = force(-2.5);
        (listener.source.publish(&force, &force)).expect("published");
        assert!(Instant::now() < limit, "the client does not end");
        std::thread::sleep(Duration::from_millis(10));
    }
    let said = |stream: &mut dyn std::io::Read| {
        let mut said = String::new();
        stream.read_to_string(&mut said).expect("text");
        said
    };
    let out = said(client.0.stdout.as_mut().expect("a pipe"));
    let error = said(client.0.stderr.as_mut().expect("a pipe"));
    assert!(out.contains("force 2.5 at True"), "{out}{error}");
    listener.until("the request and the command", |l| {
        l.all
            .requests
            .iter()
            .any(|force| force.force_n == [0.0, 1.5, 0.0])
            && l.all.commands.iter().any(|command| command == "pause")
    });
}

#[test]
fn a_publisher_that_was_killed_is_named_and_the_other_is_used() {
    let Some((ros, _core)) = ros() else { return };
    let killed = publish(&ros, "/arm/measured_js", "sensor_msgs/JointState", JOINTS);
    let count = |wanted: usize| {
        let limit = Instant::now() + PATIENCE;
        loop {
            let info = ros
                .command("rostopic", &["info", "/arm/measured_js"])
                .stdout(Stdio::piped())
                .output()
                .expect("rostopic info");
            let info = String::from_utf8_lossy(&info.stdout).into_owned();
            if info.matches("http://").count() >= wanted {
                return;
            }
            assert!(Instant::now() < limit, "{info}");
        }
    };
    count(1);
    // Killed, not ended: it stays registered.
    drop(killed);
    let _joints = publish(&ros, "/arm/measured_js", "sensor_msgs/JointState", JOINTS);
    count(2);
    let mut listener = listener(&ros);
    listener.until("states", |l| l.all.states.len() > 5);
    listener.until("the dead one's name", |l| {
        (l.all.events.iter()).any(|event| event.to_string().contains("rosnode cleanup"))
    });
    assert!(!(listener.all.events.iter()).any(|e| matches!(e, Event::TwoPublishers { .. })));
}

/// A force that is asked for over servo_cf.
fn a_request_reaches_us(ros: &Ros, listener: &mut Listener) {
    let _commander = publish(
        ros,
        "/cable_rig/spatial/servo_cf",
        "geometry_msgs/WrenchStamped",
        "{header: auto, wrench: {force: {x: 0.5, y: 1.5, z: -0.5}}}",
    );
    listener.until("a request", |l| !l.all.requests.is_empty());
    let request = &listener.all.requests[0];
    assert_eq!(request.force_n, [0.5, 1.5, -0.5]);
    assert_eq!(
        (request.acts, request.meaning),
        (Acts::OnTool, Meaning::Requested)
    );
}

#[test]
fn a_pose_of_nan_on_debians_ros() {
    let Some((ros, _core)) = ros() else { return };
    let mut listener = listener(&ros);
    let bad = JOINTS.replace("[0.5, 1.5, 0.4]", "[0.5, .nan, 0.4]");
    let _joints = publish(&ros, "/arm/measured_js", "sensor_msgs/JointState", &bad);
    listener.until("an event", |l| {
        l.all.events.iter().any(|e| matches!(e, Event::Invalid(_)))
    });
    assert!(listener.all.states.is_empty());
}

#[test]
fn without_a_master_the_error_says_where_it_was_looked_for() {
    let config = Ros1Config {
        master: Some("http://127.0.0.1:1".to_owned()),
        ..Ros1Config::default()
    };
    let error = Ros1::open(&config).unwrap_err().to_string();
    assert!(
        error.contains("http://127.0.0.1:1") && error.contains("roscore"),
        "{error}"
    );
}
