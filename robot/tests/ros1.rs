//! The ROS 1 source against Debian's own roscore, rostopic and rosbag: no double of ours in between.
//!
//! `cargo test -p robot --features ros1 --test ros1`. Where the tools are not installed the test says so and does nothing;
//! `apt-get install python3-roslaunch python3-rostopic python3-rosbag python3-rosmaster python3-geometry-msgs
//! python3-sensor-msgs` installs them.
#![cfg(feature = "ros1")]

use robot::crtk::AdapterConfig;
use robot::source::ros1::Ros1;
use robot::source::{Poll, Ros1Config, Source};
use robot::state::{Acts, Frame, Meaning, TipForce};
use robot::watch::{Event, WatchConfig};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Programs that the test needs.
const TOOLS: [&str; 3] = ["/usr/bin/roscore", "/usr/bin/rostopic", "/usr/bin/rosbag"];
/// How long to wait for something that must come. It is no measure of anything.
const PATIENCE: Duration = Duration::from_secs(60);

/// A process in a group of its own, ended with the test.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        signal(&self.0, "-KILL");
        let _ = self.0.wait();
    }
}

fn signal(child: &Child, signal: &str) {
    let group = format!("-{}", child.id());
    let _ = Command::new("kill").args([signal, "--", &group]).status();
}

struct Ros {
    port: u16,
    folder: tempfile::TempDir,
}

impl Ros {
    fn command(&self, program: &str, arguments: &[&str]) -> Command {
        use std::os::unix::process::CommandExt;
        let mut command = Command::new(format!("/usr/bin/{program}"));
        command
            .args(arguments)
            .env("PATH", "/usr/bin:/bin")
            .env("ROS_MASTER_URI", self.master())
            .env("ROS_IP", "127.0.0.1")
            .env("ROS_LOG_DIR", self.folder.path())
            .env("ROS_HOME", self.folder.path())
            .current_dir(self.folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0);
        command
    }

    fn start(&self, program: &str, arguments: &[&str]) -> Process {
        Process(self.command(program, arguments).spawn().expect(program))
    }

    fn publish(&self, topic: &str, kind: &str, text: &str) -> Process {
        self.start("rostopic", &["pub", "-s", "-r", "50", topic, kind, text])
    }

    fn master(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }
}

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
        self.all.states.extend(poll.states);
        self.all.events.extend(poll.events);
        self.all.requests.extend(poll.requests);
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

fn ros() -> Option<(Ros, Process)> {
    if let Some(missing) = TOOLS.iter().find(|tool| !Path::new(tool).exists()) {
        println!("skipped: {missing} is not installed");
        return None;
    }
    let port = TcpListener::bind("127.0.0.1:0")
        .and_then(|socket| socket.local_addr())
        .expect("a free port")
        .port();
    let ros = Ros {
        port,
        folder: tempfile::tempdir().expect("a folder"),
    };
    let core = ros.start("roscore", &["-p", &port.to_string()]);
    let limit = Instant::now() + PATIENCE;
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(Instant::now() < limit, "roscore does not come up");
        std::thread::sleep(Duration::from_millis(50));
    }
    Some((ros, core))
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
    let joints = ros.publish("/arm/measured_js", "sensor_msgs/JointState", JOINTS);
    let _pose = ros.publish("/arm/measured_cp", "geometry_msgs/PoseStamped", POSE);

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
    let second = ros.publish("/arm/measured_js", "sensor_msgs/JointState", JOINTS);
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
    let mut recorder = ros.start(
        "rosbag",
        &[
            "record",
            "-O",
            path,
            "/cable_rig/spatial/measured_cf",
            "/arm/measured_js",
        ],
    );
    let active = ros.folder.path().join("run.bag.active");
    let mut published = 0;
    listener.until("the bag grows with our topic", |l| {
        published += 1;
        l.source
            .publish(&force(-2.5), &force(-2.5))
            .expect("published");
        // Well past the header and a chunk of messages.
        published > 300 && active.exists()
    });
    signal(&recorder.0, "-INT");
    let _ = recorder.0.wait();
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
    let text = ros
        .command(
            "rostopic",
            &["echo", "-b", path, "-p", "/cable_rig/spatial/measured_cf"],
        )
        .stdout(Stdio::piped())
        .output()
        .expect("rostopic echo");
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    // By the tool -2.5 N is 2.5 N on the tool, which is what we publish, and say.
    let line = text.lines().nth(1).unwrap_or_default();
    assert!(
        line.contains("raven_crtk/force_on_tool") && line.contains(",2.5,"),
        "{text}"
    );
}

/// A force that is asked for over servo_cf.
fn a_request_reaches_us(ros: &Ros, listener: &mut Listener) {
    let _commander = ros.publish(
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
    let _joints = ros.publish("/arm/measured_js", "sensor_msgs/JointState", &bad);
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
