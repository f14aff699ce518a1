//! The ROS 2 source against another DDS, `cyclonedds` of PyPI: no double of ours in between.
//!
//! `cargo test -p robot-ros --features ros2 --test ros2`, with the environment variable
//! ROS2_TEST_PYTHON naming a Python that has cyclonedds (`python3` where it is not set). Without it
//! the test says so and does nothing.
#![cfg(feature = "ros2")]

use robot::crtk::{AdapterConfig, Robot};
use robot::source::{Estimate, Poll, Ros2Config, Source};
use robot::state::{Acts, Clock, Frame, Meaning, Operating, OperatingState, Stamp, TipForce};
use robot::watch::{Event, Unfit, WatchConfig};
use robot_ros::ros2::Ros2;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How long to wait for something that must come. It is no measure of anything.
const PATIENCE: Duration = Duration::from_secs(60);

/// A robot by the other DDS; ends with the test.
struct Peer {
    child: Child,
    lines: Arc<Mutex<Vec<String>>>,
}

impl Peer {
    /// Gives it a command.
    fn tell(&mut self, command: &str) {
        let to = self.child.stdin.as_mut().expect("its input");
        writeln!(to, "{command}").expect("it takes commands");
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn python() -> String {
    std::env::var("ROS2_TEST_PYTHON").unwrap_or_else(|_| "python3".to_owned())
}

fn peer(domain: u16) -> Peer {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ros2_peer.py");
    let mut child = Command::new(python())
        .args([script, &domain.to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the peer starts");
    let out = child.stdout.take().expect("its output");
    let lines = Arc::new(Mutex::new(Vec::new()));
    let to = Arc::clone(&lines);
    std::thread::spawn(move || {
        for line in BufReader::new(out).lines().map_while(Result::ok) {
            to.lock().expect("lines").push(line);
        }
    });
    Peer { child, lines }
}

/// A domain for this test alone, where the other DDS is installed.
fn domain(number: u16) -> Option<u16> {
    let installed = (Command::new(python()).args(["-c", "import cyclonedds"]))
        .stderr(Stdio::null())
        .status();
    if !installed.is_ok_and(|status| status.success()) {
        println!(
            "skipped: {} has no cyclonedds (ROS2_TEST_PYTHON names another Python)",
            python()
        );
        return None;
    }
    // Below 233, and hardly that of another run at the same time.
    Some(50 + 3 * (std::process::id() % 60) as u16 + number)
}

/// A source, polled on the host's clock, with everything that came so far.
struct Listener {
    source: Ros2,
    began: Instant,
    all: Poll,
}

impl Listener {
    fn new(domain: u16) -> Self {
        let config = Ros2Config {
            domain: Some(domain),
            namespace: "/arm".to_owned(),
            adapter: AdapterConfig {
                robot: Robot::Dvrk,
                frame: Frame::RavenCrtk,
                measured_cf: Some(Acts::ByTool),
                max_skew_s: 0.2,
                ..AdapterConfig::default()
            },
            watch: WatchConfig {
                // The test runs beside others: only what is meant to stop may stop it.
                max_age_s: 2.0,
                max_clock_step_s: 2.0,
                ..WatchConfig::default()
            },
            ..Ros2Config::default()
        };
        Self {
            source: Ros2::open(&config).expect("the domain is joined"),
            began: Instant::now(),
            all: Poll::default(),
        }
    }

    /// Polls and publishes a force until `done`.
    fn until(&mut self, what: &str, mut done: impl FnMut(&Self) -> bool) {
        let limit = Instant::now() + PATIENCE;
        loop {
            let now_ns = self.began.elapsed().as_nanos() as i64;
            let poll = self.source.poll(now_ns).expect("the node lives");
            self.all.extend(poll);
            self.source.publish(&force(), &force()).expect("published");
            (self.source.publish_estimate(&estimate())).expect("published");
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

/// By the tool: 2.5 N on the tool are -2.5 N by it.
fn force() -> TipForce {
    TipForce {
        frame: Frame::Rig,
        acts: Acts::ByTool,
        meaning: Meaning::Measured,
        force_n: [0.0, -2.5, 0.0],
        torque_n_m: None,
    }
}

/// Of a state long ago, with a half width of 0.3 N along y.
fn estimate() -> Estimate {
    Estimate {
        force: force(),
        half_n: Some([0.0, 0.3, 0.0]),
        stamp: Stamp {
            t_ns: 1_234_567_890_500_000_000,
            clock: Clock::RobotUtc,
        },
    }
}

#[test]
fn a_robot_by_another_dds() {
    let Some(domain) = domain(0) else { return };
    let first = peer(domain);
    let mut listener = Listener::new(domain);
    listener.until("states with joints and tip", |l| {
        l.all.states.iter().filter(|s| s.tip.is_some()).count() > 20
    });
    let state = (listener.all.states.iter().rev())
        .find(|state| state.tip.is_some())
        .expect("there is one");
    let joints = state.joints.as_ref().expect("joints");
    assert_eq!(*joints.names, ["shoulder", "elbow", "insertion"]);
    assert_eq!(joints.position, [0.5, 1.5, 0.4]);
    assert_eq!(joints.velocity.as_deref(), Some(&[0.01, 0.02, 0.003][..]));
    assert_eq!(
        joints.effort.as_ref().expect("effort").value,
        [0.1, -0.2, 3.0]
    );
    assert_eq!(
        state.tip.as_ref().expect("a tip").position_m,
        [0.02, -0.01, -0.08]
    );
    let received = state.received.as_ref().expect("a time of arrival");
    assert!((0..listener.began.elapsed().as_nanos() as i64).contains(&received.t_ns));

    listener.until("a request", |l| !l.all.requests.is_empty());
    let request = &listener.all.requests[0];
    assert_eq!(request.force_n, [0.5, 1.5, -0.5]);
    assert_eq!(
        (request.acts, request.meaning),
        (Acts::OnTool, Meaning::Requested)
    );

    listener.until("our force at the peer", |_| {
        let lines = first.lines.lock().expect("lines");
        lines
            .iter()
            .any(|line| line.contains("\"PSM1_base\"") && line.contains("[0.0, 2.5, 0.0]"))
    });
    listener.until("our estimate at the peer", |_| {
        let lines = first.lines.lock().expect("lines");
        // The stamp is that of the state, not that of the publication.
        let of_state = |line: &&String| line.contains("[1234567890, 500000000]");
        let has = |topic: &str, force: &str| {
            let topic = format!("\"{topic}\"");
            (lines.iter().filter(of_state))
                .any(|line| line.contains(&topic) && line.contains(force))
        };
        has("estimated", "[0.0, 2.5, 0.0]") && has("half_width", "[0.0, 0.3, 0.0]")
    });
    assert_eq!(listener.all.stop(), None);

    // A second publisher of the same topics, told apart message by message.
    let second = peer(domain);
    listener.until("two publishers", |l| {
        (l.all.events.iter()).any(|event| matches!(event, Event::TwoPublishers { .. }))
    });
    drop(second);

    // The robot goes away.
    drop(first);
    listener.until("silence", |l| {
        (l.all.events.iter()).any(|event| matches!(event, Event::Silent { .. }))
    });
}

#[test]
fn a_dvrk_2_keeps_its_operating_state_for_those_who_join_late() {
    let Some(domain) = domain(1) else { return };
    let mut robot = peer(domain);
    let mut listener = Listener::new(domain);
    // Published once, before we were there or not.
    listener.until("an operating state", |l| {
        l.all.states.iter().any(|state| state.operating.is_some())
    });
    let state = listener.all.states.last().expect("a state").clone();
    let operating = state.operating.expect("it holds");
    assert_eq!(
        (operating.state, operating.is_homed),
        (Operating::Enabled, true)
    );
    listener.until("a state with tip and force", |l| {
        (l.all.states.iter()).any(|s| s.tip.is_some() && s.force.is_some())
    });
    let state = (listener.all.states.iter().rev())
        .find(|state| state.tip.is_some() && state.force.is_some())
        .expect("there is one");
    assert_eq!(&*state.tip.as_ref().expect("a tip").frame_id, "PSM1_base");
    // Of the body's frame, turned with the tip; of motor efforts, so it is an estimate.
    let force = state.force.as_ref().expect("a force");
    for (got, wanted) in force.force_n.iter().zip([0.1, -0.2, -0.3]) {
        assert!((got - wanted).abs() < 1e-9, "{force:?}");
    }
    assert_eq!(
        (force.acts, force.meaning),
        (Acts::ByTool, Meaning::Estimated)
    );
    assert_eq!(listener.all.stop(), None);

    robot.tell("FAULT");
    listener.until("its fault", |l| {
        (l.all.events.iter()).any(|event| *event == Event::NotOperating(Unfit::Fault))
    });
    robot.tell("ENABLED");
    let before = listener.all.states.len();
    listener.until("its return", |l| l.all.states.len() > before);
    robot.tell("silence");
    listener.until("the end of its poses", |l| {
        (l.all.events.iter()).any(|event| matches!(event, Event::TipSilent { .. }))
    });
}

#[test]
fn the_rig_is_a_crtk_device() {
    let Some(domain) = domain(2) else { return };
    let mut listener = Listener::new(domain);
    // Told before the robot's side is there: it is kept.
    let mut peer = peer(domain);
    let says = |peer: &Peer, state: &str| {
        let lines = peer.lines.lock().expect("lines");
        lines
            .iter()
            .any(|line| line.contains("\"rig\"") && line.contains(state))
    };
    listener.until("our first state at the peer", |_| says(&peer, "DISABLED"));
    let enabled = OperatingState {
        state: Operating::Enabled,
        is_homed: true,
        is_busy: true,
    };
    listener
        .source
        .publish_operating(enabled)
        .expect("published");
    listener.until("our next state at the peer", |_| says(&peer, "ENABLED"));
    // The other side has found ours; ours may need longer to find the command's writer.
    listener.until("the robot", |l| !l.all.states.is_empty());
    listener.until("its command", |l| {
        peer.tell("command disable");
        l.all.commands.iter().any(|command| command == "disable")
    });
}

#[test]
fn a_domain_that_cant_be_is_refused_with_its_number() {
    let config = Ros2Config {
        domain: Some(40_000),
        ..Ros2Config::default()
    };
    let error = Ros2::open(&config).expect_err("no such domain").to_string();
    assert!(error.contains("40000"), "{error}");
}
