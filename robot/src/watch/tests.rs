use super::*;
use crate::state::{Clock, Frame, JointState, Operating, OperatingState, Stamp, TipState};

const MS: i64 = 1_000_000;

fn state(stamp_ms: i64) -> RobotState {
    RobotState {
        publisher: "robot".into(),
        sequence: None,
        stamp: Stamp {
            clock: Clock::RobotUtc,
            t_ns: 1_700_000_000_000_000_000 + stamp_ms * MS,
        },
        received: None,
        joints: Some(JointState {
            names: ["a".to_owned(), "b".to_owned()].into(),
            position: vec![0.0, 0.0],
            velocity: None,
            effort: None,
            setpoint: None,
        }),
        tip: Some(TipState {
            frame: Frame::Rig,
            frame_id: "base".into(),
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

/// A watch that has seen ten states, 10 ms apart.
fn watch() -> Watch {
    let mut watch = Watch::new(WatchConfig::default());
    for n in 0..10 {
        assert_eq!(watch.state(&state(10 * n), 10 * n * MS), Ok(None));
        assert_eq!(watch.tick(10 * n * MS), None);
    }
    watch
}

#[test]
fn a_robot_that_stops_publishing_is_one_event_and_so_is_its_return() {
    let mut watch = watch();
    assert_eq!(watch.tick(190 * MS), None);
    assert!(watch.is_alive(190 * MS));
    let event = watch.tick(191 * MS).unwrap();
    assert!(
        matches!(event, Event::Silent { .. }) && event.stops(),
        "{event}"
    );
    assert!(!watch.is_alive(191 * MS));
    assert_eq!(watch.tick(300 * MS), None, "one event for each silence");
    let resumed = watch.state(&state(400), 400 * MS).unwrap().unwrap();
    assert!(matches!(resumed, Event::Resumed { .. }) && !resumed.stops());
    assert!(watch.tick(600 * MS).is_some());
}

#[test]
fn a_robot_that_never_publishes_is_silent_too() {
    let mut watch = Watch::new(WatchConfig::default());
    assert_eq!(watch.tick(5 * MS), None);
    assert!(matches!(watch.tick(106 * MS), Some(Event::Silent { .. })));
    // It comes late: one event, with the whole gap.
    let event = watch.state(&state(200), 205 * MS).unwrap().unwrap();
    assert_eq!(event, Event::Resumed { gap_s: 0.2 });
    assert_eq!(watch.state(&state(210), 215 * MS), Ok(None));
}

#[test]
fn a_clock_that_is_set_is_one_event_either_way() {
    for by_ms in [500, -500, 150, -150] {
        let mut watch = watch();
        let mut events = Vec::new();
        for n in 10..30 {
            let usable = watch.state(&state(10 * n + by_ms), 10 * n * MS);
            events.extend(usable.err().filter(|event| watch.is_news(event)));
        }
        let jumps: Vec<f64> = (events.iter())
            .filter_map(|event| match event {
                Event::ClockJump { by_s } => Some(*by_s),
                _ => None,
            })
            .collect();
        let [by_s] = jumps.as_slice() else {
            panic!("{by_ms}: {events:?}")
        };
        assert!((by_s - by_ms as f64 * 1e-3).abs() < 1e-9, "{events:?}");
        // A clock that was set back shows as states that are older at first: told once.
        assert_eq!(events.len(), if by_ms < 0 { 2 } else { 1 }, "{events:?}");
        assert!(events.last().unwrap().stops());
        // From then on the new clock counts.
        assert_eq!(watch.state(&state(300 + by_ms), 300 * MS), Ok(None));
    }
}

#[test]
fn one_state_that_came_late_is_late_and_no_clock_jumped() {
    // By another way, after those that were sent later.
    let mut late = watch();
    for n in 10..30 {
        if n != 12 {
            assert_eq!(late.state(&state(10 * n), 10 * n * MS), Ok(None), "{n}");
        }
        if n == 28 {
            let event = late.state(&state(120), 10 * n * MS + 1).unwrap_err();
            assert_eq!(event, Event::OutOfOrder { by_s: 0.16 });
            assert!(!event.stops());
        }
    }
    // Several by that way at once are no clock that was set back either.
    for n in 13..18 {
        let event = late.state(&state(10 * n), 295 * MS).unwrap_err();
        assert!(matches!(event, Event::OutOfOrder { .. }), "{event}");
    }
    assert_eq!(late.state(&state(300), 300 * MS), Ok(None));
    // All of them, by a link that was held up: no state is usable, and that is said with its cause.
    let mut held_up = watch();
    let silent = held_up.tick(205 * MS).unwrap();
    assert!(matches!(silent, Event::Silent { .. }), "{silent}");
    for n in 10..20 {
        let event = held_up.state(&state(10 * n), 310 * MS).unwrap_err();
        assert!(matches!(event, Event::Late { .. }), "{n}: {event}");
    }
    assert!(held_up.state(&state(300), 310 * MS).unwrap().is_some());
    // A link that stays behind: the states are old, however regularly they come.
    let mut behind = watch();
    let mut stop = None;
    for n in 10..60 {
        let _ = behind.state(&state(10 * n - (5 * (n - 10)).min(200)), 10 * n * MS);
        stop = stop.or(behind.tick(10 * n * MS).map(|event| (n, event)));
    }
    let (n, event) = stop.unwrap();
    let text = event.to_string();
    assert!(
        event.stops() && text.contains("published nothing"),
        "{text}"
    );
    assert!(text.contains("late"), "{text}");
    // 100 ms behind at 30, and 100 ms without a usable state after that.
    assert!((40..=42).contains(&n), "{n}: {text}");
}

#[test]
fn a_stamp_that_stands_keeps_nothing_alive() {
    let mut watch = watch();
    let mut told = Vec::new();
    for n in 10..25 {
        let usable = watch.state(&state(90), 10 * n * MS);
        told.extend(usable.err().filter(|event| watch.is_news(event)));
        told.extend(watch.tick(10 * n * MS));
    }
    let [Event::Repeated, Event::NoneUsable { count, .. }] = told.as_slice() else {
        panic!("{told:?}")
    };
    assert_eq!(*count, 11);
    assert!(told[1].stops() && !told[0].stops());
}

#[test]
fn a_clock_of_another_rate_is_named_with_its_rate() {
    for (rate, words) in [(0.95, "0.950"), (1.05, "1.050"), (2.0, "2.000")] {
        let mut watch = Watch::new(WatchConfig::default());
        let event = (0..1000).find_map(|n| {
            let stamp_ms = (10.0 * rate * f64::from(n)) as i64;
            let usable = watch.state(&state(stamp_ms), 10 * i64::from(n) * MS);
            usable.err().filter(Event::stops)
        });
        let text = event.expect("an event").to_string();
        assert!(text.contains("rate") || text.contains("runs at"), "{text}");
        assert!(text.contains(words), "{text}");
    }
    // Slewed by NTP, and with delays that differ from state to state: in order.
    for rate in [0.999_5, 1.000_5] {
        let mut watch = Watch::new(WatchConfig::default());
        for n in 0..3000_i64 {
            let stamp_ns = (10e6 * rate * n as f64) as i64;
            let mut state = state(0);
            state.stamp.t_ns += stamp_ns;
            let delay_ns = 37 * n % 19 * MS;
            assert_eq!(watch.state(&state, 10 * n * MS + delay_ns), Ok(None), "{n}");
        }
    }
}

#[test]
fn a_state_counts_from_when_it_came_and_not_from_when_it_was_looked_for() {
    // This computer was held up for 150 ms; a thread took the states as they came.
    let mut watch = watch();
    for n in 10..25 {
        let mut state = state(10 * n);
        state.received = Some(Stamp {
            clock: Clock::HostMonotonic,
            t_ns: 10 * n * MS,
        });
        assert_eq!(watch.state(&state, 245 * MS), Ok(None), "{n}");
    }
    assert_eq!(watch.tick(245 * MS), None);
    assert!(watch.tick(345 * MS).is_some());
}

#[test]
fn joints_that_go_on_do_not_keep_a_tip_alive() {
    // No tip at all, and the last one again and again with its own stamp.
    for frozen in [false, true] {
        let mut watch = watch();
        let mut told = Vec::new();
        for n in 10..40 {
            let mut state = state(10 * n);
            let tip = state.tip.as_mut().unwrap();
            tip.stamp_ns = Some(super::tests::state(90).stamp.t_ns);
            if !frozen {
                state.tip = None;
            }
            assert_eq!(watch.state(&state, 10 * n * MS), Ok(None));
            told.extend(watch.tick(10 * n * MS).map(|event| (n, event)));
        }
        let [(n, event)] = told.as_slice() else {
            panic!("{told:?}")
        };
        assert!(matches!(event, Event::TipSilent { .. }) && event.stops());
        assert_eq!(*n, 20, "{event}");
    }
    // A robot that tells no tip has none to lose.
    let mut without = Watch::new(WatchConfig::default());
    for n in 0..40 {
        let mut state = state(10 * n);
        state.tip = None;
        assert_eq!(without.state(&state, 10 * n * MS), Ok(None));
        assert_eq!(without.tick(10 * n * MS), None);
    }
}

/// The last state was joined with the tip of the state before: where the robot ends, its tip is too
/// old first, and its joints do not go on.
#[test]
fn a_robot_that_ends_with_an_older_tip_is_not_said_to_go_on() {
    let mut watch = watch();
    for n in 10..20 {
        let mut state = state(10 * n);
        state.tip.as_mut().unwrap().stamp_ns = Some(super::tests::state(10 * n - 10).stamp.t_ns);
        assert_eq!(watch.state(&state, 10 * n * MS), Ok(None));
    }
    let told: Vec<_> = (190..400).filter_map(|t| watch.tick(t * MS)).collect();
    let [event] = told.as_slice() else {
        panic!("{told:?}")
    };
    // The tip's age of 0.1 s still ends it, not that of the state.
    let words = "the robot has published nothing for 0.091 s (a state and its tip may be 0.1 s old, `max_age_s`)";
    assert!(event.to_string().starts_with(words), "{event}");
    assert!(event.stops());
    // It comes back.
    let resumed = watch.state(&state(500), 500 * MS);
    assert!(
        matches!(resumed, Ok(Some(Event::Resumed { .. }))),
        "{resumed:?}"
    );
    assert_eq!(watch.tick(501 * MS), None);
}

#[test]
fn a_robot_that_says_that_it_must_not_be_used_stops_and_a_paused_one_does_not() {
    let all = [
        (Operating::Enabled, true, None),
        (Operating::Paused, true, None),
        (Operating::Disabled, true, Some("DISABLED")),
        (Operating::Fault, true, Some("FAULT")),
        (Operating::Fault, false, Some("FAULT")),
        (Operating::Disabled, false, Some("DISABLED")),
        (Operating::Enabled, false, Some("not homed")),
        (Operating::Paused, false, Some("not homed")),
    ];
    for (operating, is_homed, words) in all {
        let mut watch = watch();
        let mut state = state(100);
        state.operating = Some(OperatingState {
            state: operating,
            is_homed,
            is_busy: false,
        });
        match (watch.state(&state, 100 * MS), words) {
            (Ok(None), None) => {}
            (Err(event), Some(words)) => {
                assert!(
                    event.stops() && event.to_string().contains(words),
                    "{event}"
                );
            }
            (other, _) => panic!("{operating:?} {is_homed}: {other:?}"),
        }
    }
}

#[test]
fn another_frame_stops_and_one_that_is_expected_is_compared() {
    let mut watch = watch();
    let mut other = state(100);
    other.tip.as_mut().unwrap().frame_id = "ECM".into();
    for stamp_ms in [100, 110] {
        other.stamp.t_ns = state(stamp_ms).stamp.t_ns;
        let event = watch.state(&other, stamp_ms * MS).unwrap_err();
        let text = event.to_string();
        assert!(
            event.stops() && text.contains("`ECM`") && text.contains("`base`"),
            "{text}"
        );
    }
    let mut configured = Watch::new(WatchConfig {
        frame_id: Some("PSM1_base".to_owned()),
        ..WatchConfig::default()
    });
    assert!(matches!(
        configured.state(&state(0), 0),
        Err(Event::Frame { .. })
    ));
}

#[test]
fn a_tip_may_move_as_fast_as_an_arm_and_no_faster() {
    // 0.2 m/s at 100 Hz and at 1 kHz, with stamps that jitter by 2 ms at 100 Hz.
    for (period_us, jitter_us) in [(10_000, 2_000), (1_000, 0)] {
        let mut watch = Watch::new(WatchConfig::default());
        for n in 0..200_i64 {
            let at_us = n * period_us;
            let mut state = state(0);
            state.stamp.t_ns += 1000 * (at_us + n % 2 * jitter_us);
            state.tip.as_mut().unwrap().position_m[0] = 0.2e-6 * at_us as f64;
            assert_eq!(watch.state(&state, at_us * 1000 + 5 * MS), Ok(None), "{n}");
        }
    }
    // 8 mm in 10 ms: another frame, or another arm.
    let mut watch = watch();
    let mut moved = state(100);
    moved.tip.as_mut().unwrap().position_m[2] = 0.008;
    let event = watch.state(&moved, 100 * MS).unwrap_err();
    assert!(matches!(event, Event::TipJump { .. }) && event.stops());
    // Slow enough for 80 ms, and too far all the same.
    let mut rare = super::tests::watch();
    moved.stamp.t_ns = state(170).stamp.t_ns;
    moved.tip.as_mut().unwrap().position_m[2] = 0.012;
    let event = rare.state(&moved, 170 * MS).unwrap_err();
    assert!(
        matches!(event, Event::TipJump { limit_m: 0.01, .. }),
        "{event}"
    );
    // A tip that was away for long is compared with nothing: the arm may have moved.
    let mut away = super::tests::watch();
    assert!(away.tick(400 * MS).is_some());
    moved.tip.as_mut().unwrap().position_m[2] = 0.05;
    moved.stamp.t_ns = state(410).stamp.t_ns;
    assert!(away.state(&moved, 410 * MS).is_ok());
}

#[test]
fn joints_without_names_are_told_by_their_place() {
    let mut named = watch();
    let mut nameless = state(100);
    nameless.joints.as_mut().unwrap().names = Vec::new().into();
    let mut first = nameless.clone();
    let flaws = named.settle(&mut nameless);
    assert_eq!(nameless, state(100));
    assert!(named.left_out(&flaws[0]).is_some());
    assert_eq!(named.left_out(&flaws[0]), None, "one event for each part");
    assert_eq!(named.state(&nameless, 100 * MS), Ok(None));
    // From the beginning: numbers, which hold from then on.
    let mut new = Watch::new(WatchConfig::default());
    new.settle(&mut first);
    assert_eq!(
        *first.joints.as_ref().unwrap().names,
        ["joint_1", "joint_2"]
    );
    assert_eq!(new.state(&first, 100 * MS), Ok(None));
    assert!(matches!(
        new.state(&state(110), 110 * MS),
        Err(Event::JointNames { .. })
    ));
    // Another number of joints is another arm, names or not.
    let mut three = state(120);
    let joints = three.joints.as_mut().unwrap();
    (joints.names, joints.position) = (Vec::new().into(), vec![0.0; 3]);
    named.settle(&mut three);
    assert!(matches!(
        named.state(&three, 120 * MS),
        Err(Event::JointNames { .. })
    ));
}

#[test]
fn a_late_burst_of_states_is_no_jump() {
    let mut watch = watch();
    // Held up by the network for 60 ms, then all at once.
    for n in 10..16 {
        assert_eq!(watch.state(&state(10 * n), 150 * MS), Ok(None));
    }
}

#[test]
fn states_out_of_order_are_left_out_and_don_t_stop() {
    let mut watch = watch();
    let event = watch.state(&state(85), 95 * MS).unwrap_err();
    assert!(
        matches!(event, Event::OutOfOrder { .. }) && !event.stops(),
        "{event}"
    );
    assert_eq!(watch.state(&state(100), 100 * MS), Ok(None));
}

#[test]
fn a_second_publisher_is_refused_and_the_first_goes_on() {
    let mut watch = watch();
    let mut other = state(100);
    other.publisher = "impostor".into();
    let event = watch.state(&other, 100 * MS).unwrap_err();
    assert!(
        matches!(event, Event::TwoPublishers { .. }) && event.stops(),
        "{event}"
    );
    assert_eq!(watch.state(&state(100), 100 * MS), Ok(None));
}

#[test]
fn joints_that_don_t_fit_are_named() {
    let mut watch = watch();
    let mut other = state(100);
    other.joints.as_mut().unwrap().names = ["a".to_owned(), "c".to_owned()].into();
    let event = watch.state(&other, 100 * MS).unwrap_err();
    assert!(event.to_string().contains("\"c\""), "{event}");
    let mut configured = Watch::new(WatchConfig {
        joint_names: vec!["x".to_owned()],
        ..WatchConfig::default()
    });
    assert!(matches!(
        configured.state(&state(0), 0),
        Err(Event::JointNames { .. })
    ));
    let mut without = state(0);
    without.joints = None;
    assert!(matches!(
        configured.state(&without, 0),
        Err(Event::JointNames { .. })
    ));
}

#[test]
fn nan_poses_and_jumps_of_the_tip_stop() {
    let mut watch = watch();
    let mut bad = state(100);
    bad.tip.as_mut().unwrap().position_m[0] = f64::NAN;
    let event = watch.state(&bad, 100 * MS).unwrap_err();
    assert!(
        matches!(event, Event::Invalid(_)) && event.stops(),
        "{event}"
    );
    bad.tip.as_mut().unwrap().position_m[0] = 0.02;
    let event = watch.state(&bad, 110 * MS).unwrap_err();
    assert!(
        matches!(event, Event::TipJump { .. }) && event.stops(),
        "{event}"
    );
}
