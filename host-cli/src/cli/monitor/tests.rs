//! The view in memory, and the lines.

use super::model::{reading, Estimated, Model, Reading};
use super::picture;
use super::plain::line;
use super::source::{Event, Update};
use super::view::View;
use nalgebra::Vector3;
use ratatui::backend::TestBackend;
use ratatui::Terminal;
use session::telemetry::{Drops, Telemetry};
use session::LatchedFault;
use std::time::Duration;
use wire::UNITS;

fn running() -> Telemetry {
    Telemetry {
        t_s: 12.3,
        tension_n: [2.041, 2.4, 4.512, 1.999, 2.474, 2.006].map(Some),
        setpoint_n: [2.042, 2.4, 4.9, 2.0, 2.469, 2.008].map(Some),
        state: "running".to_owned(),
        tip_m: Some([-0.08, 0.025, -0.14]),
        true_force_n: Some([-0.001, 2.51, 0.006]),
        force_n: Some([0.003, 2.498, -0.011]),
        zeroed: [Some(true); UNITS],
        unit_state: std::array::from_fn(|_| Some("running".to_owned())),
        estop_closed: Some(true),
        setpoint_age_ms: Some(4),
        latency_us: Some(368),
        drops: Drops {
            frames_lost: 3,
            conversions_missed: 7,
            ..Drops::default()
        },
        commander: Some("forcectl set-force (process 55)".to_owned()),
        clients: vec!["a".to_owned(), "b".to_owned()],
        ..Telemetry::default()
    }
}

fn ready() -> Telemetry {
    Telemetry {
        state: "ready".to_owned(),
        unit_state: std::array::from_fn(|_| Some("ready".to_owned())),
        setpoint_age_ms: None,
        commander: None,
        ..running()
    }
}

fn faulted() -> Telemetry {
    let mut now = Telemetry {
        state: "fault".to_owned(),
        faults: vec![
            LatchedFault {
                unit: None,
                code: 2,
                detail: 101,
            },
            LatchedFault {
                unit: Some(3),
                code: 33,
                detail: 13_194,
            },
        ],
        ..ready()
    };
    now.tension_n[2] = None;
    now.unit_state[2] = Some("faulted".to_owned());
    now
}

fn without_zeros() -> Telemetry {
    Telemetry {
        tension_n: [Some(-5.181); UNITS],
        zeroed: [Some(false); UNITS],
        force_n: None,
        ..ready()
    }
}

fn model(now: Telemetry) -> Model {
    let mut model = Model::default();
    model.take(Update::Telemetry(Box::new(now)));
    model
}

fn drawn(model: &Model, silence: Option<Duration>, (width, height): (u16, u16)) -> String {
    let view = View {
        model,
        title: "rig `bench`: embedded rig",
        scale_n: 12.0,
        silence,
    };
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| view.draw(frame)).unwrap();
    terminal.backend().to_string()
}

fn seen(now: Telemetry, size: (u16, u16)) -> String {
    drawn(&model(now), None, size)
}

fn has(text: &str, words: &[&str]) {
    for words in words {
        assert!(text.contains(words), "no `{words}` in\n{text}");
    }
}

#[test]
fn a_running_rig_shows_tensions_beside_setpoints_and_who_commands() {
    for size in [(110, 30), (80, 24), (60, 15)] {
        let text = seen(running(), size);
        has(
            &text,
            &[
                "RUNNING",
                "E-stop closed",
                "setpoints 4 ms old",
                "commander: forcectl set-force (process 55)  clients: 2",
                "1 running     2.041 /  2.042   -0.001",
                "3 running     4.512 /  4.900   -0.388",
                "measured  x   0.003  y   2.498  z  -0.011  length  2.498",
                "true      x  -0.001  y   2.510  z   0.006",
                "latency 0.368 ms  lost 3  damaged 0  dropped 0  missed 7",
                " s  STOP the rig: all motors 0 V",
                " q  end the view",
            ],
        );
    }
}

#[test]
fn a_bar_is_as_long_as_the_tension_and_marks_the_setpoint() {
    let mut now = running();
    now.tension_n[0] = Some(6.0);
    now.setpoint_n[0] = Some(9.0);
    // 80 columns: 38 for the numbers, a bar of 17.
    let text = seen(now, (80, 24));
    let row = text.lines().find(|row| row.contains("1 running")).unwrap();
    assert!(row.contains(" █████████····|··· "), "{row}");
}

/// A force along y of 2.5 N.
fn estimate(valid: bool, misfits: bool) -> Estimated {
    Estimated::Force {
        force_n: [None, Some(2.5), None],
        half_n: Some(0.25),
        valid,
        misfits,
    }
}

#[test]
fn an_estimate_stands_below_the_load_cells_force_and_is_bare_only_where_it_is_valid() {
    let number = "y   2.500";
    for (estimate, words) in [
        (estimate(true, false), "estimated y   2.500  +- 0.250"),
        (estimate(false, false), "estimated invalid: the friction"),
        (
            estimate(false, true),
            "estimated INVALID: the model no longer fits this robot",
        ),
        (Estimated::Silent, "estimated no states of the robot"),
    ] {
        let mut model = model(running());
        model.take(Update::Estimate(estimate.clone()));
        for size in [(110, 30), (80, 24), (60, 15)] {
            let text = drawn(&model, None, size);
            has(&text, &["measured  x   0.003", words, " q  end the view"]);
            let bare = text.contains(&format!("estimated {number}"));
            assert_eq!(bare, words.contains("+-"), "{text}");
        }
        let json = estimate.json();
        match estimate {
            Estimated::Silent => assert!(json.is_null()),
            Estimated::Force { valid, misfits, .. } => assert_eq!(
                json,
                serde_json::json!({"estimate_y_n": 2.5, "half_width_n": 0.25, "valid": valid, "misfits": misfits})
            ),
        }
    }
    // None was asked for.
    assert!(!seen(running(), (80, 24)).contains("estimated"));
}

#[test]
fn the_commanded_force_is_that_of_the_setpoints_while_the_units_run() {
    // Unit 1 pulls along x, the others have their reels at the tip's other side along y and z.
    let tip = Vector3::from([-0.08, 0.025, -0.14]);
    let far = [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
    ];
    let mut model = model(running());
    assert_eq!(model.commanded_n(), None);
    model.exits_m = Some(far.map(|way| tip + Vector3::from(way)));
    let force = model.commanded_n().unwrap();
    // Differences of the setpoints of opposite cables.
    for (got, wanted) in force.into_iter().zip([-0.358, 2.9, 0.461]) {
        assert!((got - wanted).abs() < 1e-9, "{force:?}");
    }
    has(
        &drawn(&model, None, (80, 24)),
        &["commanded x  -0.358  y   2.900  z   0.461"],
    );
    model.now.unit_state[5] = Some("offline".to_owned());
    let z = model.commanded_n().unwrap()[2];
    assert!((z - 2.469).abs() < 1e-9, "{z}");
    model.now.unit_state[5] = Some("faulted".to_owned());
    assert_eq!(model.commanded_n(), None);
}

#[test]
fn a_disarmed_rig_has_no_setpoints() {
    let text = seen(ready(), (80, 24));
    has(&text, &["DISARMED (ready), 0 V", "nobody commands"]);
    assert!(!text.contains("2.042") && !text.contains('|'), "{text}");
}

#[test]
fn faults_are_named_with_their_meaning_and_the_way_out() {
    let text = seen(faulted(), (80, 24));
    has(
        &text,
        &[
            "FAULT, all motors at 0 V",
            "3 faulted   fault 33, sensor silent",
            "board: fault 2, setpoints expired.",
            "unit 3: fault 33, sensor silent.",
            "brought up again.",
        ],
    );
    has(
        &seen(faulted(), (110, 30)),
        &["setpoints expired. The host stopped", "brought up again."],
    );
    // The faults stand above events; the keys stay.
    has(&seen(faulted(), (60, 15)), &["board: fault 2", " q "]);
}

#[test]
fn a_reading_without_a_zero_is_never_a_bare_tension() {
    let now = without_zeros();
    assert_eq!(reading(&now, 0), Reading::NoZero(-5.181));
    let text = seen(now.clone(), (80, 24));
    has(
        &text,
        &[
            "1 ready     NO ZERO (raw -5.181 N)",
            "measured  not known: a unit without a zero or a sample",
        ],
    );
    let plain = line(&now, 0.1);
    assert!(!plain.contains("5.181"), "{plain}");
    assert_eq!(plain.matches("no zero").count(), UNITS, "{plain}");
    // Not read yet is not the same as there.
    let unknown = Telemetry {
        zeroed: [None; UNITS],
        ..now.clone()
    };
    has(&seen(unknown, (80, 24)), &["zero not read yet"]);
    let zeroing = Telemetry {
        state: "zeroing".to_owned(),
        unit_state: std::array::from_fn(|_| Some("zeroing".to_owned())),
        ..now
    };
    has(
        &seen(zeroing.clone(), (80, 24)),
        &["ZEROING", "zero is being taken"],
    );
    let plain = line(&zeroing, 0.1);
    has(&plain, &["zeroing    zeroing"]);
    assert!(!plain.contains("5.181"), "{plain}");
}

#[test]
fn lines_carry_the_state() {
    assert_eq!(
        line(&running(), 0.1),
        "     0.10  running      2.041    2.400    4.512    1.999    2.474    2.006"
    );
    let mut now = faulted();
    now.unit_state[5] = Some("offline".to_owned());
    assert_eq!(
        line(&now, 12.0),
        "    12.00  fault        2.041    2.400        -    1.999    2.474      off"
    );
}

#[test]
fn what_is_old_is_said_to_be_old() {
    let silent = drawn(&model(running()), Some(Duration::from_secs(4)), (80, 24));
    has(&silent, &["NO DATA for 4 s; what is shown is old"]);
    assert!(!silent.contains("RUNNING"), "{silent}");
    let lost = Telemetry {
        state: "no link".to_owned(),
        tension_n: [None; UNITS],
        unit_state: Default::default(),
        estop_closed: None,
        ..ready()
    };
    has(&seen(lost, (80, 24)), &["LINK LOST", "no sample"]);
    has(&drawn(&Model::default(), None, (80, 24)), &["WAITING"]);
}

#[test]
fn events_are_logged_and_the_newest_are_seen() {
    let mut model = model(running());
    for n in 0..300 {
        model.take(Update::Event(Event {
            t_s: f64::from(n),
            kind: "commander".to_owned(),
            text: format!("event {n} \u{1b}[2J"),
            ..Event::default()
        }));
    }
    assert_eq!(model.log.len(), 200);
    let text = drawn(&model, None, (80, 24));
    has(&text, &["299.0 s  event 299"]);
    // Nobody's name controls the terminal.
    assert!(!text.contains('\u{1b}'));
}

#[test]
fn the_worst_latency_is_that_of_the_last_second() {
    let mut model = Model::default();
    for (t_s, latency_us) in [(0.0, 900), (0.5, 300), (1.2, 200)] {
        model.take(Update::Telemetry(Box::new(Telemetry {
            t_s,
            latency_us: Some(latency_us),
            ..running()
        })));
    }
    assert_eq!(model.worst_latency_us(), Some(300));
}

#[test]
fn every_size_of_terminal_is_drawn() {
    for now in [running(), faulted(), without_zeros(), Telemetry::default()] {
        let model = model(now);
        for width in [1, 2, 10, 37, 38, 39, 60, 72, 73, 200] {
            for height in [1, 2, 3, 9, 14, 15, 20, 21, 60] {
                drawn(&model, None, (width, height));
            }
        }
    }
}

#[test]
fn the_picture_holds_the_view_as_text() {
    let model = model(running());
    let view = View {
        model: &model,
        title: "rig <a> & b",
        scale_n: 12.0,
        silence: None,
    };
    let svg = picture::svg(&view);
    has(
        &svg,
        &["rig &lt;a&gt; &amp; b", "2.041 /  2.042", "STOP the rig"],
    );
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
}
