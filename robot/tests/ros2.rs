//! The ROS 2 source against another DDS, `cyclonedds` of PyPI: no double of ours in between.
//!
//! `cargo test -p robot --features ros2 --test ros2`, with the environment variable ROS2_TEST_PYTHON naming a Python that has
//! cyclonedds (`python3` where it is not set). Without it the test says so and does nothing.
#![cfg(feature = "ros2")]

use robot::crtk::AdapterConfig;
use robot::source::ros2::Ros2;
use robot::source::{Poll, Ros2Config, Source};
use robot::state::{Acts, Frame, Meaning, TipForce};
use robot::watch::{Event, WatchConfig};
use std::io::{BufRead, BufReader};
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
    Some(50 + 2 * (std::process::id() % 80) as u16 + number)
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
                frame: Frame::RavenCrtk,
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
            self.all.states.extend(poll.states);
            self.all.events.extend(poll.events);
            self.all.requests.extend(poll.requests);
            self.source.publish(&force(), &force()).expect("published");
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
        lines.iter().any(|line| {
            line.contains("raven_crtk/force_on_tool") && line.contains("[0.0, 2.5, 0.0]")
        })
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
fn a_domain_that_cant_be_is_refused_with_its_number() {
    let config = Ros2Config {
        domain: Some(40_000),
        ..Ros2Config::default()
    };
    let error = Ros2::open(&config).expect_err("no such domain").to_string();
    assert!(error.contains("40000"), "{error}");
}
