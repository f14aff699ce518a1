//! `[robot]` of the rig file, and sources against everything that can go wrong with them.

use robot::source::{Fed, Source, SourceConfig, SourceError, Udp, UdpConfig};
use robot::state::{Clock, Frame, Mount, RobotState, Stamp, StateError, TipState};
use robot::watch::{Event, WatchConfig};
use std::net::UdpSocket;
use std::time::Duration;

#[derive(serde::Deserialize, Debug)]
struct File {
    robot: SourceConfig,
}

fn read(text: &str) -> Result<SourceConfig, String> {
    toml::from_str::<File>(text)
        .map(|file| file.robot)
        .map_err(|error| error.to_string())
}

#[test]
fn every_kind_can_be_written_in_a_rig_file() {
    for (text, kind) in [
        ("[robot]\nkind = \"virtual\"\nseed = 3", "Virtual"),
        ("[robot]\nkind = \"crtk-ros1\"\nnamespace = \"/arm2\"\ncp_is_transform = true\n[robot.adapter]\nrobot = \"raven\"\nframe = \"raven_crtk\"", "CrtkRos1"),
        ("[robot]\nkind = \"crtk-ros2\"\ndomain = 3\n[robot.adapter]\nrobot = \"dvrk2\"\n[robot.topics]\nmeasured_cf = \"spatial/measured_cf\"", "CrtkRos2"),
        ("[robot]\nkind = \"udp\"\nlisten = \"127.0.0.1:0\"\n[robot.watch]\nmax_age_s = 0.2", "Udp"),
        ("[robot]\nkind = \"static\"\nposition_m = [0.0, 0.1, -0.1]", "Static"),
    ] {
        let config = read(text).unwrap();
        assert!(format!("{config:?}").starts_with(kind), "{config:?}");
    }
}

#[test]
fn mistakes_are_named() {
    for (text, word) in [
        ("[robot]\nkind = \"ros3\"", "crtk-ros1"),
        ("[robot]\nkind = \"udp\"\nport = 5", "port"),
        ("[robot]\nkind = \"static\"", "position_m"),
        ("[robot]\nkind = \"udp\"\n[robot.watch]\nage = 5", "age"),
        (
            "[robot]\nkind = \"crtk-ros1\"\n[robot.topics]\nforce = \"x\"",
            "measured_cf",
        ),
    ] {
        let error = read(text).unwrap_err();
        assert!(error.contains(word), "{text}: {error}");
    }
}

#[test]
fn a_source_that_cant_be_opened_says_why() {
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let config = UdpConfig {
        listen: taken.local_addr().unwrap().to_string(),
        ..UdpConfig::default()
    };
    assert!(matches!(
        Udp::listen(&config),
        Err(SourceError::Listen { .. })
    ));
}

const MS: i64 = 1_000_000;

/// A source on a port of its own, as it is by default.
fn listening() -> Udp {
    let config = UdpConfig {
        listen: "127.0.0.1:0".to_owned(),
        ..UdpConfig::default()
    };
    Udp::listen(&config).unwrap()
}

/// A source and a sender, and what comes out after `datagrams`, 10 ms apart.
fn after(frame: Frame, datagrams: &[&str]) -> (Vec<RobotState>, Vec<Event>) {
    let config = UdpConfig {
        listen: "127.0.0.1:0".to_owned(),
        frame,
        mount: Mount {
            translation_m: [0.0, 0.0, 1.0],
            ..Mount::default()
        },
        ..UdpConfig::default()
    };
    let mut source = Udp::listen(&config).unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let to = source.address();
    let (mut states, mut events) = (Vec::new(), Vec::new());
    for (n, datagram) in datagrams.iter().enumerate() {
        sender.send_to(datagram.as_bytes(), to).unwrap();
        let before = states.len() + events.len();
        // A datagram on the loopback is there at once or very soon; virtual time stands meanwhile.
        for _ in 0..20_000 {
            let poll = source.poll(10 * MS * (n as i64 + 1)).unwrap();
            states.extend(poll.states);
            events.extend(poll.events);
            if states.len() + events.len() > before {
                break;
            }
            std::thread::sleep(Duration::from_micros(100));
        }
    }
    (states, events)
}

#[test]
fn datagrams_become_states_in_the_rigs_frame() {
    let (states, events) = after(
        Frame::RavenCrtk,
        &[
            r#"{"stamp_s": 100.0, "seq": 1, "measured_cp": {"position": [0.1, 0.2, 0.3]}}"#,
            r#"{"stamp_s": 100.01, "seq": 2, "measured_cp": {"position": [0.1, 0.2, 0.301], "orientation": [0,0,0,1]}, "measured_js": {"name": ["a"], "position": [0.5], "effort": [1.5]}}"#,
        ],
    );
    assert!(events.is_empty(), "{events:?}");
    assert_eq!(states.len(), 2);
    let tip = states[1].tip.as_ref().unwrap();
    assert_eq!(tip.frame, Frame::Rig);
    assert!((tip.position_m[2] - 1.301).abs() < 1e-12);
    assert_eq!(states[0].stamp.clock, Clock::RobotUtc);
    assert_eq!(
        states[1]
            .joints
            .as_ref()
            .unwrap()
            .effort
            .as_ref()
            .unwrap()
            .value,
        [1.5]
    );
}

#[test]
fn frame_0_of_the_raven_goes_through_its_crtk_frame() {
    let (states, _) = after(
        Frame::Raven0,
        &[r#"{"measured_cp": {"position": [0.1, 0.2, 0.3]}}"#],
    );
    // x = -y0, y = -z0, z = x0, and the mount 1 m above.
    let tip = states[0].tip.as_ref().unwrap();
    for (got, expected) in tip.position_m.iter().zip([-0.2, -0.3, 1.1]) {
        assert!((got - expected).abs() < 1e-12, "{tip:?}");
    }
}

#[test]
fn bad_datagrams_are_events_and_never_states() {
    let good = r#"{"stamp_s": 100.0, "measured_cp": {"position": [0.1, 0.2, 0.3]}}"#;
    for bad in [
        r#"{"measured_cp": {"position": [0.1, 0.2]}}"#,
        r#"{"measured_cp": {"position": [0.1, 0.2, NaN]}}"#,
        r#"{"stamp_s": 100.01, "measured_cp": {"position": [0.1, 0.2, 1e999]}}"#,
        r#"{"stamp_s": 100.01}"#,
        r#"{"stamp_s": 100.01, "measured_js": {"name": ["a", "b"], "position": [1.0]}}"#,
        r#"{"stamp_s": 0, "measured_cp": {"position": [0.1, 0.2, 0.3]}}"#,
        r#"{"stamp_s": 100.01, "measured_cp": {"position": [0.1, 0.2, 0.308]}}"#,
        r#"{"stamp_s": 100.01, "measured_cp": {"position": [0.1, 0.2, 0.3], "frame_id": "ECM"}}"#,
        r#"{"stamp_s": 100.01, "measured_cp": {"position": [0.1, 0.2, 0.3]}, "operating_state": {"state": "FAULT"}}"#,
        r#"{"stamp_s": 100.01, "measured_cp": {"position": [0.1, 0.2, 0.3]}, "operating_state": {"state": "ENABLED", "is_homed": false}}"#,
        r#"{"stamp_s": 105.01, "measured_cp": {"position": [0.1, 0.2, 0.3]}}"#,
        r#"{"stamp_s": 100.01, "measured_cp": {"position": [0.1, 0.9, 0.3]}}"#,
    ] {
        let (states, events) = after(Frame::Rig, &[good, bad]);
        assert_eq!(states.len(), 1, "{bad}");
        assert_eq!(events.len(), 1, "{bad}: {events:?}");
        assert!(events[0].stops(), "{bad}: {events:?}");
    }
}

#[test]
fn what_is_no_message_is_left_out_counted_and_told_once() {
    let pose = |n: u32| {
        let stamp_s = 100.0 + 0.01 * f64::from(n);
        format!(r#"{{"stamp_s": {stamp_s}, "measured_cp": {{"position": [0.1, 0.2, 0.3]}}}}"#)
    };
    // A key of a message whose rest is another program's is still one of a robot.
    let long = format!(r#"{{"temperature": "{}"}}"#, "x".repeat(9_000));
    for none in [
        &b""[..],
        b"no pose",
        b"\xff\xfe\x00\x80\x01",
        b"42",
        b"[0.1, 0.2, 0.3]",
        b"{}",
        br#"{"temperature": 21.5}"#,
        br#"{"measured_cp": {"posi"#,
        long.as_bytes(),
    ] {
        let mut source = listening();
        let robot = UdpSocket::bind("127.0.0.1:0").unwrap();
        let other = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (mut states, mut events, mut count) = (0, Vec::new(), 0);
        for n in 0..5 {
            for (sender, datagram) in [(&other, none), (&robot, pose(n).as_bytes())] {
                sender.send_to(datagram, source.address()).unwrap();
            }
            for _ in 0..20_000 {
                let poll = source.poll(10 * MS * i64::from(n + 1)).unwrap();
                states += poll.states.len();
                events.extend(poll.events);
                count += poll.left_out.get("datagrams").copied().unwrap_or(0);
                if states as u32 > n && count > u64::from(n) {
                    break;
                }
                std::thread::sleep(Duration::from_micros(100));
            }
        }
        assert_eq!((states, count), (5, 5), "{none:?}: {events:?}");
        let [event @ Event::LeftOut(_)] = events.as_slice() else {
            panic!("{none:?}: {events:?}")
        };
        assert!(
            !event.stops() && event.to_string().contains("no message"),
            "{event}"
        );
        // Nothing else comes: that is no pose.
        other.send_to(none, source.address()).unwrap();
        std::thread::sleep(Duration::from_millis(20));
        let poll = source.poll(300 * MS).unwrap();
        assert!(
            matches!(poll.stop(), Some(Event::Silent { .. })),
            "{poll:?}"
        );
    }
}

/// Joints and tip of one stamp, in two datagrams.
fn halves(n: u32) -> [String; 2] {
    let stamp = format!(r#""stamp_s": {}"#, 100.0 + 0.01 * f64::from(n));
    [
        format!(r#"{{{stamp}, "measured_js": {{"name": ["a"], "position": [0.5]}}}}"#),
        format!(r#"{{{stamp}, "measured_cp": {{"position": [0.1, 0.2, 0.3]}}}}"#),
    ]
}

#[test]
fn joints_and_tip_of_one_stamp_in_two_datagrams_are_one_state() {
    for tip_first in [false, true] {
        let mut datagrams = Vec::new();
        for n in 0..5 {
            let mut both = halves(n);
            if tip_first {
                both.reverse();
            }
            datagrams.push(both);
        }
        let mut source = listening();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (mut states, mut events) = (Vec::new(), Vec::new());
        for (n, both) in datagrams.iter().enumerate() {
            let enabled = r#"{"operating_state": {"state": "ENABLED"}}"#;
            for datagram in [&both[0], enabled, &both[1]] {
                sender
                    .send_to(datagram.as_bytes(), source.address())
                    .unwrap();
            }
            std::thread::sleep(Duration::from_millis(20));
            let poll = source.poll(10 * MS * (n as i64 + 1)).unwrap();
            states.extend(poll.states);
            events.extend(poll.events);
        }
        // Nobody knew of pairs before the first one.
        assert_eq!(states.len(), 5, "{tip_first}: {states:?}");
        assert_eq!(events, [Event::Repeated], "{tip_first}");
        let whole = |state: &RobotState| state.joints.is_some() && state.tip.is_some();
        assert!(!whole(&states[0]) && states[1..].iter().all(whole));
        // One that stays alone is used alone, after its wait. So is a robot in fault.
        let [first, second] = if tip_first { [1, 0] } else { [0, 1] };
        let alone = &halves(6)[first];
        sender.send_to(alone.as_bytes(), source.address()).unwrap();
        std::thread::sleep(Duration::from_millis(20));
        let poll = source.poll(70 * MS).unwrap();
        assert!(
            poll.states.len() == 1 && !whole(&poll.states[0]),
            "{poll:?}"
        );
        // The second part of another stamp is no part of it.
        let late = &halves(7)[second];
        sender.send_to(late.as_bytes(), source.address()).unwrap();
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(source.poll(80 * MS).unwrap().states.len(), 1);
        let fault =
            halves(8)[first].replacen('{', r#"{"operating_state": {"state": "FAULT"}, "#, 1);
        sender.send_to(fault.as_bytes(), source.address()).unwrap();
        let (began, mut stopped) = (std::time::Instant::now(), false);
        while !stopped && began.elapsed() < Duration::from_secs(2) {
            stopped = source.poll(90 * MS).unwrap().stop().is_some();
        }
        assert!(stopped, "{tip_first}");
    }
}

#[test]
fn a_robot_that_tells_poses_alone_waits_for_no_joints() {
    let mut source = listening();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    for n in 0..3 {
        sender
            .send_to(halves(n)[1].as_bytes(), source.address())
            .unwrap();
        let mut states = 0;
        // Polled until it is there, and no later than it takes to come.
        let began = std::time::Instant::now();
        while states == 0 && began.elapsed() < Duration::from_secs(2) {
            states += source
                .poll(10 * MS * i64::from(n + 1))
                .unwrap()
                .states
                .len();
        }
        assert_eq!(states, 1);
    }
}

#[test]
fn flaws_of_what_is_not_needed_leave_the_pose_in_use() {
    let good = r#"{"stamp_s": 100.0, "measured_cp": {"position": [0.1, 0.2, 0.3]}, "measured_js": {"name": ["NaN"], "position": [1.0]}}"#;
    for (n, part) in [
        // As Python's json module writes them.
        (
            r#""measured_js": {"name": ["NaN"], "position": [1.0], "effort": [NaN]}"#,
            "joint effort",
        ),
        (
            r#""measured_js": {"name": ["NaN"], "position": [1.0], "velocity": [-Infinity]}"#,
            "joint velocity",
        ),
        (
            r#""measured_js": {"name": ["NaN"], "position": [1.0], "velocity": [null]}"#,
            "joint velocity",
        ),
        (
            r#""measured_js": {"name": ["NaN"], "position": [NaN]}"#,
            "joints",
        ),
        (r#""measured_js": {"position": [1.0]}"#, "joint names"),
    ] {
        let tip = r#""measured_cp": {"position": [0.1, 0.2, 0.301]}"#;
        let flawed = format!(r#"{{"stamp_s": 100.01, {tip}, {n}}}"#);
        let (states, events) = after(Frame::Rig, &[good, &flawed]);
        assert_eq!(states.len(), 2, "{n}: {events:?}");
        assert!((states[1].tip.as_ref().unwrap().position_m[2] - 1.301).abs() < 1e-12);
        let [event @ Event::LeftOut(_)] = events.as_slice() else {
            panic!("{n}: {events:?}")
        };
        assert!(
            !event.stops() && event.to_string().contains(part),
            "{event}"
        );
    }
}

/// A pose of ROS's shape.
fn of_ros(stamp: &str, frame: &str, x: f64) -> String {
    let header = format!(r#"{{"seq": 1, "stamp": {stamp}, "frame_id": "{frame}"}}"#);
    format!(r#"{{"measured_cp": {{"header": {header}, "position": [{x}, 0.2, 0.3]}}}}"#)
}

#[test]
fn stamp_and_frame_of_a_ros_header_count_in_every_shape() {
    for (first, second) in [
        (
            r#"{"secs": 100, "nsecs": 5}"#,
            r#"{"secs": 100, "nsecs": 10000005}"#,
        ),
        (
            r#"{"sec": 100, "nanosec": 5}"#,
            r#"{"sec": 100, "nanosec": 10000005}"#,
        ),
        ("100.000000005", "100.010000005"),
    ] {
        let good = of_ros(first, "PSM1_base", 0.1);
        let next = of_ros(second, "PSM1_base", 0.1001);
        let (states, events) = after(Frame::Rig, &[&good, &next]);
        assert!(states.len() == 2 && events.is_empty(), "{events:?}");
        assert_eq!(states[1].stamp.clock, Clock::RobotUtc);
        assert!((states[1].stamp.t_ns - 100_010_000_005).abs() < 100);
        let tip = states[1].tip.as_ref().unwrap();
        assert_eq!(&*tip.frame_id, "PSM1_base");
        for (bad, words) in [
            (of_ros("0", "PSM1_base", 0.1), "stamp is 0"),
            (
                of_ros(r#"{"secs": 0, "nsecs": 0}"#, "PSM1_base", 0.1),
                "stamp is 0",
            ),
            (of_ros(second, "ECM", 0.1), "`ECM`"),
            (of_ros("1795860000000", "PSM1_base", 0.1), "ms, us or ns"),
            (of_ros("\"now\"", "PSM1_base", 0.1), "a stamp that is none"),
            (of_ros(second, "PSM1_base", 0.9), "jumped"),
        ] {
            let (states, events) = after(Frame::Rig, &[&good, &bad]);
            assert_eq!((states.len(), events.len()), (1, 1), "{bad}: {events:?}");
            let told = events[0].to_string();
            assert!(events[0].stops() && told.contains(words), "{bad}: {told}");
        }
    }
}

#[test]
fn poses_that_repeat_an_old_stamp_of_ros_become_none() {
    let pose = |ms: u32| {
        of_ros(
            &format!(r#"{{"secs": 100, "nsecs": {}}}"#, ms * 1_000_000),
            "",
            0.1,
        )
    };
    // The same datagram again and again: one state, then the event of the age.
    let same = pose(500);
    let old = pose(400);
    for sent in [&same, &old] {
        let mut all = vec![same.as_str()];
        all.extend([sent.as_str(); 12]);
        let (states, events) = unwaited(&all);
        assert_eq!(states.len(), 1, "{sent}");
        assert!(events.iter().any(Event::stops), "{sent}: {events:?}");
    }
    // Joints that go on don't keep a pose alive that repeats its own stamp.
    let with_joints: Vec<String> = (0..14)
        .map(|n| {
            let js = format!(
                r#"{{"header": {{"stamp": {{"secs": 100, "nsecs": {}}}}}, "name": ["a"], "position": [1.0]}}"#,
                500_000_000 + n * 10_000_000
            );
            same.replace(r#"{"measured_cp""#, &format!(r#"{{"measured_js": {js}, "measured_cp""#))
        })
        .collect();
    let all: Vec<&str> = with_joints.iter().map(String::as_str).collect();
    let (_, events) = unwaited(&all);
    let silent = |event: &Event| matches!(event, Event::TipSilent { .. });
    assert!(events.iter().any(silent), "{events:?}");
}

/// As [`after`], for datagrams of which some leave no trace: each has 20 ms to come.
fn unwaited(datagrams: &[&str]) -> (Vec<RobotState>, Vec<Event>) {
    let mut source = listening();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let (mut states, mut events) = (Vec::new(), Vec::new());
    for (n, datagram) in datagrams.iter().enumerate() {
        sender
            .send_to(datagram.as_bytes(), source.address())
            .unwrap();
        std::thread::sleep(Duration::from_millis(20));
        let poll = source.poll(10 * MS * (n as i64 + 1)).unwrap();
        states.extend(poll.states);
        events.extend(poll.events);
    }
    (states, events)
}

#[test]
fn what_is_told_twice_has_to_agree() {
    let good =
        r#"{"stamp_s": 100.0, "measured_cp": {"position": [0.1, 0.2, 0.3], "frame_id": "a"}}"#;
    let twice = |stamp_s: f64, frame: &str| {
        let header = r#"{"stamp": {"secs": 100, "nsecs": 10400000}, "frame_id": "a"}"#;
        format!(
            r#"{{"stamp_s": {stamp_s}, "measured_cp": {{"header": {header}, "position": [0.1, 0.2, 0.3], "frame_id": "{frame}"}}}}"#
        )
    };
    // One of the two may be rounded to ms.
    let (states, events) = after(Frame::Rig, &[good, &twice(100.01, "a")]);
    assert!(states.len() == 2 && events.is_empty(), "{events:?}");
    assert_eq!(states[1].stamp.t_ns, 100_010_400_000);
    for (bad, key) in [
        (twice(100.02, "a"), "its stamp is"),
        (twice(100.01, "b"), "its frame_id is `b` and `a`"),
    ] {
        let (states, events) = after(Frame::Rig, &[good, &bad]);
        assert_eq!((states.len(), events.len()), (1, 1), "{bad}: {events:?}");
        let told = events[0].to_string();
        assert!(events[0].stops() && told.contains(key), "{told}");
    }
    // A bare pose may have a header of its own.
    let bare = r#"{"header": {"stamp": 100.01, "frame_id": "b"}, "position": [0.1, 0.2, 0.3]}"#;
    let (_, events) = after(Frame::Rig, &[good, bare]);
    assert!(
        matches!(events.as_slice(), [Event::Frame { .. }]),
        "{events:?}"
    );
}

#[test]
fn keys_that_are_not_known_are_told_once() {
    for (part, key) in [
        (
            r#""time": 5, "measured_cp": {"position": [0.1, 0.2, 0.3]}"#,
            "`time`",
        ),
        (
            r#""measured_cp": {"position": [0.1, 0.2, 0.3], "stamp": 5}"#,
            "`measured_cp.stamp`",
        ),
        (
            r#""measured_cp": {"position": [0.1, 0.2, 0.3], "header": {"time": 5}}"#,
            "`measured_cp.header.time`",
        ),
        (
            r#""measured_cp": {"position": [0.1, 0.2, 0.3]}, "operating_state": {"state": "ENABLED", "moves": 1}"#,
            "`operating_state.moves`",
        ),
    ] {
        let at = |stamp_s: f64| format!(r#"{{"stamp_s": {stamp_s}, {part}}}"#);
        let (states, events) = after(Frame::Rig, &[&at(100.0), &at(100.01)]);
        assert_eq!(states.len(), 2, "{part}");
        let [event @ Event::LeftOut(_)] = events.as_slice() else {
            panic!("{part}: {events:?}")
        };
        let told = event.to_string();
        assert!(
            told.contains(key) && told.contains("header.stamp"),
            "{told}"
        );
    }
}

/// The example of docs/robot.md holds every key that is known.
#[test]
fn the_example_of_the_page_is_read_whole() {
    let page = std::fs::read_to_string("../docs/robot.md").unwrap();
    let example = page.split("```json\n").nth(1).unwrap();
    let example = example.split("```").next().unwrap().replace('\n', " ");
    let (states, events) = after(Frame::Rig, &[&example]);
    assert!(events.is_empty(), "{events:?}");
    let [state] = states.as_slice() else {
        panic!("{states:?}")
    };
    let tip = state.tip.as_ref().unwrap();
    assert!(state.stamp.clock == Clock::RobotUtc && !tip.frame_id.is_empty());
    assert!(state.joints.is_some() && state.operating.is_some());
}

#[test]
fn a_fed_source_counts_what_it_leaves_out_and_tells_it_once() {
    let mut source = Fed::new("virtual arm", WatchConfig::default());
    let mut events = Vec::new();
    let mut count = 0;
    for n in 0..50 {
        let mut state = fed_state(10 * n);
        state.tip.as_mut().unwrap().orientation_xyzw = Some([0.0; 4]);
        source.feed([state]);
        let poll = source.poll(10 * n * MS).unwrap();
        assert_eq!(poll.states.len(), 1);
        count += poll.left_out.get("tip orientation").copied().unwrap_or(0);
        events.extend(poll.events);
    }
    assert_eq!((count, events.len()), (50, 1), "{events:?}");
}

#[test]
fn two_senders_are_two_publishers() {
    let mut source = listening();
    let to = source.address();
    let senders = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
    let mut events = Vec::new();
    for sender in &senders {
        sender
            .send_to(br#"{"measured_cp": {"position": [0.1, 0.2, 0.3]}}"#, to)
            .unwrap();
        for _ in 0..20_000 {
            let poll = source.poll(10 * MS).unwrap();
            events.extend(poll.events);
            if !poll.states.is_empty() || !events.is_empty() {
                break;
            }
            std::thread::sleep(Duration::from_micros(100));
        }
    }
    assert!(
        matches!(events.as_slice(), [Event::TwoPublishers { .. }]),
        "{events:?}"
    );
}

fn fed_state(t_ms: i64) -> RobotState {
    RobotState {
        publisher: "virtual".into(),
        sequence: None,
        stamp: Stamp {
            clock: Clock::Virtual,
            t_ns: t_ms * MS,
        },
        received: None,
        joints: None,
        tip: Some(TipState {
            frame: Frame::Rig,
            frame_id: "".into(),
            stamp_ns: None,
            position_m: [0.0; 3],
            orientation_xyzw: None,
            velocity_m_per_s: None,
            angular_velocity_rad_per_s: None,
        }),
        force: None,
        operating: None,
    }
}

#[test]
fn a_fed_source_passes_whole_cycles_and_notes_a_silence() {
    let mut source = Fed::new("virtual arm", WatchConfig::default());
    for cycle in 0..20 {
        source.feed((0..10).map(|n| fed_state(10 * cycle + n)));
        let poll = source.poll((10 * cycle + 9) * MS).unwrap();
        assert_eq!(poll.states.len(), 10);
        assert!(poll.events.is_empty(), "{:?}", poll.events);
    }
    let poll = source.poll(400 * MS).unwrap();
    assert!(matches!(poll.stop(), Some(Event::Silent { .. })));
    let mut bad = fed_state(410);
    bad.tip.as_mut().unwrap().position_m[0] = f64::NAN;
    source.feed([bad]);
    let poll = source.poll(410 * MS).unwrap();
    assert!(matches!(
        poll.stop(),
        Some(Event::Invalid(StateError::NotFinite { .. }))
    ));
}
