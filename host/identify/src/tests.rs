//! The whole identification against the board in memory.

use super::excite::MIN_SESSION_S;
use super::*;
use control::convert::REEL_RADIUS_M;
use control::SystemState;
use plant::effects::{AmplifierGain, ChangingFriction, Coulomb, Effect, Periodic, Shaft};
use plant::PlantConfig;
use residual::Report;
use rig::{Rig, UnitSettings, DEFAULT_TEXT};
use run::NoopObserver;
use session::link::fake::{Behavior, FakeBoard};
use session::Session;
use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;
use wire::UNITS;

/// What a run said.
#[derive(Default)]
struct Said(Vec<String>);

impl run::Observer for Said {
    fn notice(&mut self, text: &str) {
        self.0.push(text.to_owned());
    }
}

fn rig() -> Rig {
    Rig::built_in().unwrap()
}

/// Records, analyses, corrects; and the part of the swing that was left.
fn identified(effects: Vec<Effect>) -> (Findings, f64) {
    identified_from(&rig(), DEFAULT_TEXT, effects)
}

/// The same with another rig file.
fn identified_from(rig: &Rig, text: &str, effects: Vec<Effect>) -> (Findings, f64) {
    let recording = recorded(rig, effects);
    let out = tempfile::tempdir().unwrap();
    let findings = find(&recording, rig, "rig", text, out.path(), &mut ()).unwrap();
    (findings, recording.swing)
}

fn recorded(rig: &Rig, effects: Vec<Effect>) -> Recording {
    let plant = PlantConfig {
        effects,
        ..PlantConfig::default()
    };
    let mut board = FakeBoard::with(Behavior::Good, 3, plant);
    let stop = AtomicBool::new(false);
    let zeroing = run::Zeroing::Measure;
    let recording = excite(
        &mut board,
        rig,
        24.0,
        1.0,
        &zeroing,
        &stop,
        &mut NoopObserver,
    )
    .unwrap();
    assert_eq!(board.system, SystemState::Ready, "disarmed at the end");
    recording
}

/// Friction that grows or falls by 0.5 N with a time constant of 20 s, in two units.
#[test]
fn friction_that_changes_is_seen_in_the_units_that_have_it() {
    for (begin_n, end_n) in [(0.0, 0.5), (0.5, 0.0)] {
        let recording = recorded(
            &rig(),
            vec![Effect::ChangingFriction(ChangingFriction {
                units: vec![1, 4],
                begin_n,
                end_n,
                time_constant_s: 20.0,
                run_s: 0.0,
            })],
        );
        for unit in 0..UNITS {
            let change = FrictionChange::of(&recording.rows(unit)).unwrap();
            assert_eq!(
                change.counts(),
                [1, 4].contains(&unit),
                "{unit}: {change:?}"
            );
            // Recorded from 5 s on, for 24 s.
            let due_n = (end_n - begin_n) * ((-5.0_f64 / 20.0).exp() - (-29.0_f64 / 20.0).exp());
            assert!(
                !change.counts() || (change.change_n - due_n).abs() < 0.1,
                "{change:?}, {due_n} N due"
            );
        }
    }
}

#[test]
fn what_each_unit_has_beyond_the_rig_file_is_found_and_declared() {
    let effects = vec![
        Effect::Coulomb(Coulomb {
            units: vec![0],
            constant_n: 0.6,
            per_load: 0.0,
        }),
        Effect::Periodic(Periodic {
            units: vec![1],
            shaft: Shaft::Motor,
            order: 1.0,
            amplitude_n: 0.6,
            phase_rad: 0.0,
        }),
        Effect::AmplifierGain(AmplifierGain {
            units: vec![2],
            relative_error: -0.25,
        }),
    ];
    let (findings, swing) = identified(effects.clone());
    assert_eq!(swing, 1.0, "no more force than was to be expected");
    let (old, new) = (rig().units, findings.rig.units);
    let friction = |u: &UnitSettings| u.coulomb_n + 4.5 * u.coulomb_per_n;
    // Units differ by some 0.1 N by themselves.
    let more = friction(&new[0]) - friction(&old[0]);
    assert!((more - 0.6).abs() < 0.25, "{:?}", findings.units[0]);
    let name = findings.units[0].report.effects[0].name.as_str();
    assert!(name.ends_with("coulomb"), "{name}");

    let ripple = new[1].ripples[0];
    let motor_turn_m = TAU * REEL_RADIUS_M * 7.0 / 26.0;
    assert!(
        (ripple.period_m / motor_turn_m - 1.0).abs() < 0.01,
        "{ripple:?} {:?}",
        findings.units[1]
    );
    assert!((ripple.amplitude_n - 0.6).abs() < 0.06, "{ripple:?}");
    assert!(ripple.phase_rad.abs() < 0.15, "{ripple:?}");

    let scale = new[2].dac_codes_per_n / old[2].dac_codes_per_n * 0.75;
    assert!((scale - 1.0).abs() < 0.04, "{scale}");

    for i in 3..UNITS {
        assert!((friction(&new[i]) - friction(&old[i])).abs() < 0.3);
        assert!(new[i].ripples[0].is_none());
    }
    let parsed = Rig::parse("rig", &findings.rewritten.text).unwrap();
    assert_eq!(parsed, findings.rig);
    let pooled = report::over_units(&findings.units).unwrap();
    assert!(
        pooled.contains("Only in some: ") && pooled.contains("gain (unit 3"),
        "{pooled}"
    );
    let of_one = |n: u8| UnitFinding {
        unit: n,
        ..findings.units[2].clone()
    };
    let alike: Vec<UnitFinding> = (1..=6).map(of_one).collect();
    let pooled = report::over_units(&alike).unwrap();
    assert!(
        pooled.starts_with("In most of the 6 units: ") && pooled.contains("gain (6)"),
        "{pooled}"
    );
    assert!(!pooled.contains("Only"), "{pooled}");
    assert_eq!(report::over_units(&[]), None);
    finds_nothing_more(&findings, effects);
    refuses_what_is_not_clear(&findings.units[0].report);
    names_what_may_stand_for_an_effect(findings.units[0].clone());
}

/// A second identification of the same rig, with what the first declared: what is left is within
/// the error of a session. A margin that each one adds would be 0.1 N.
fn finds_nothing_more(first: &Findings, effects: Vec<Effect>) {
    let (second, _) = identified_from(&first.rig, &first.rewritten.text, effects);
    for (old, new) in first.rig.units.iter().zip(&second.rig.units) {
        let friction = |u: &UnitSettings| u.coulomb_n + 4.5 * u.coulomb_per_n;
        let more = [
            friction(new) - friction(old),
            new.friction_offset_n - old.friction_offset_n,
            4.5 * (new.dac_codes_per_n / old.dac_codes_per_n - 1.0),
        ];
        assert!(
            more.iter().all(|n| n.abs() < 0.05),
            "unit {}: {more:?}",
            old.number
        );
        assert_eq!(new.ripples, old.ripples, "unit {}", old.number);
    }
}

#[test]
fn a_rig_with_much_friction_is_found_out() {
    let (findings, _) = identified(vec![Effect::Coulomb(Coulomb {
        units: vec![],
        constant_n: 0.0,
        per_load: 0.2,
    })]);
    for (old, new) in rig().units.iter().zip(&findings.rig.units) {
        let friction = |u: &UnitSettings| u.coulomb_n + 4.0 * u.coulomb_per_n;
        let more = friction(new) - friction(old);
        // Units differ by some 0.1 N by themselves.
        assert!((more - 0.8).abs() < 0.3, "{more} {:?}", findings.units);
    }
}

/// A rig whose runs are each 10 % better than the one before, as one that warms up: that is no gain
/// of the findings.
#[test]
fn a_rig_that_gets_better_by_itself_shows_no_gain() {
    let mut board = FakeBoard::new(Behavior::Good);
    let options = run::Options::new([0.0, 2.5, 0.0], 4.0);
    let outcome = run::set_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap();
    let figures = Figures::of(&outcome).unwrap();
    let found = Findings {
        units: Vec::new(),
        rig: rig(),
        rewritten: findings::Rewritten {
            text: String::new(),
            changed: vec!["something".to_owned()],
        },
    };
    let left = |with_findings: f64| {
        let mut random = random::SplitMix64::new(1);
        let mut size = 1.0;
        let mut trial = Trial::new(Held::Whole(outcome.clone(), figures), found.clone(), 1.0);
        let mut hold = |run: Run<'_>| -> Result<Held, ()> {
            size *= 0.9;
            let factor = if run.with_findings {
                with_findings
            } else {
                1.0
            };
            let part = factor * size * (0.01 * random.normal()).exp();
            let of_run = Figures {
                tension_rms_n: figures.tension_rms_n.map(|rms| rms * part),
                worst_tension_rms_n: figures.worst_tension_rms_n * part,
                tip_rms_n: figures.tip_rms_n * part,
                ..figures
            };
            Ok(Held::Whole(outcome.clone(), of_run))
        };
        trial.compare(&rig(), MOST_PAIRS, &mut hold).unwrap();
        trial.left
    };
    assert!(
        matches!(left(1.0), Some(Left::NotBetter(_))),
        "{:?}",
        left(1.0)
    );
    assert_eq!(left(0.5), None);
}

/// Repetitions on an emulated rig are no copies, or two of them would seem to confirm anything.
#[test]
fn runs_of_one_emulated_rig_have_figures_of_their_own() {
    let held = |run: u64| {
        let options = session::link::EmbeddedOptions {
            run,
            ..Default::default()
        };
        let mut link = session::link::fast::FastRig::open(&options).unwrap();
        let options = run::Options::new([0.0, 2.5, 0.0], 12.0);
        let outcome = run::set_force(&mut link, &rig(), &options, &mut NoopObserver).unwrap();
        Figures::of(&outcome).unwrap()
    };
    let (first, second) = (held(0), held(1));
    assert_eq!(first, held(0));
    let ratio = second.worst_tension_rms_n / first.worst_tension_rms_n;
    assert!(ratio != 1.0 && (0.5..2.0).contains(&ratio), "{ratio}");
}

/// The rig of a seed whose physics is that of a file.
fn rig_of(seed: u64, plant: &std::path::Path) -> session::link::fast::FastRig {
    let options = session::link::EmbeddedOptions {
        seed: Some(seed),
        plant: Some(plant.to_owned()),
        ..Default::default()
    };
    session::link::fast::FastRig::open(&options).unwrap()
}

/// At 0 V a reel with much friction holds its cable as an output that is stuck does. The board
/// tells them apart by the declared friction.
#[test]
fn a_rig_whose_friction_is_declared_ends_its_sessions_without_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let plant = folder.path().join("rough.toml");
    let rough =
        "cable.initial_slack_m = 0.003\n\n[[effects]]\nkind = \"coulomb\"\nconstant_n = 1.5\n";
    std::fs::write(&plant, rough).unwrap();
    let mut declared = rig();
    for unit in &mut declared.units {
        unit.coulomb_n += 1.5;
        // Friction alone holds 2.6 N.
        unit.tension_min_n = 4.0;
    }
    for seed in 1..=3 {
        let mut link = rig_of(seed, &plant);
        let options = run::Options::new([0.0, 2.5, 0.0], 4.0);
        let outcome = run::set_force(&mut link, &declared, &options, &mut NoopObserver).unwrap();
        assert!(
            outcome.faults.is_empty(),
            "seed {seed}: {:?}",
            outcome.faults
        );
        let status = Session::connect(&mut link).unwrap().get_status().unwrap();
        assert_eq!(status.fault, 0, "seed {seed}");
    }
}

/// Behind fault 45 the board may latch fault 15: the cable of the unit whose load cell is in doubt
/// went slack by the robot, and its reel shows nothing. Other cables are tight for some time, and
/// the board refuses a clear meanwhile.
#[test]
fn a_session_that_a_late_drive_ends_is_cleared() {
    let folder = tempfile::tempdir().unwrap();
    let plant = folder.path().join("late.toml");
    let mut behind = 0;
    for seed in 1..=6 {
        for delay_s in [0.0035, 0.00414, 0.006, 0.0092] {
            let late = format!("[[effects]]\nkind = \"command_delay\"\ndelay_s = {delay_s}\n");
            std::fs::write(&plant, late).unwrap();
            let mut link = rig_of(seed, &plant);
            let options = run::Options::new([0.0, 2.5, 0.0], 4.0);
            let mut said = Said::default();
            let held = hold(&mut link, &rig(), &options, true, &mut said);
            held.unwrap_or_else(|error| panic!("seed {seed}, {delay_s} s: {error}"));
            let status = Session::connect(&mut link).unwrap().get_status().unwrap();
            assert_eq!(status.fault, 0);
            assert!(
                status.units.iter().all(|unit| unit.fault == 0),
                "{status:?}"
            );
            behind += usize::from(said.0.iter().any(|text| text.contains("fault 15")));
        }
    }
    assert!(behind > 0);
}

#[test]
fn a_fault_of_another_cause_is_not_cleared_with_it() {
    use super::trial::{of_a_swing, other_fault};
    let over_tension = control::Fault::OverTension.code();
    assert!(of_a_swing(over_tension, 19_999) && !of_a_swing(over_tension, 20_000));
    let negative = control::Fault::TensionNegative.code();
    assert!(of_a_swing(negative, 3_999) && !of_a_swing(negative, 4_000));
    let status = |board: (u16, u32), units: &[(usize, u16)]| {
        let mut link = FakeBoard::new(Behavior::Good);
        let mut board_status = Session::connect(&mut link).unwrap().get_status().unwrap();
        (board_status.fault, board_status.fault_detail) = board;
        for &(n, fault) in units {
            board_status.units[n].fault = fault;
        }
        other_fault(&board_status).map(|fault| (fault.unit, fault.code))
    };
    let (implausible, stuck) = (
        control::Fault::Implausible.code(),
        control::Fault::OutputStuck.code(),
    );
    for n in 0..UNITS {
        let unseen = (n as u32 + 1) << 24 | 0xFF_FFFF;
        let other = (n + 1) % UNITS;
        assert_eq!(status((0, 0), &[(n, implausible)]), None);
        assert_eq!(status((stuck, unseen), &[(n, implausible)]), None);
        let both = [(n, implausible), (other, over_tension)];
        assert_eq!(status((0, 0), &both), None);
        let both = [(n, implausible), (other, implausible)];
        assert_eq!(status((stuck, unseen), &both), None);
        let seen = (n as u32 + 1) << 24 | 2_100;
        let kept = Some((None, stuck));
        assert_eq!(status((stuck, seen), &[(n, implausible)]), kept);
        assert_eq!(status((stuck, unseen), &[(other, implausible)]), kept);
        assert_eq!(status((14, unseen), &[(n, implausible)]), Some((None, 14)));
        let silent = Some((Some(other as u8 + 1), 42));
        assert_eq!(
            status((stuck, unseen), &[(n, implausible), (other, 42)]),
            silent
        );
    }
    assert_eq!(status((stuck, 0xFF_FFFF), &[]), Some((None, stuck)));
    assert_eq!(status((stuck, u32::MAX), &[]), Some((None, stuck)));
}

/// The shortest session that the command allows is long enough for an analysis of every unit.
#[test]
fn the_shortest_session_can_be_analysed() {
    for seed in [3, 4] {
        let mut board = FakeBoard::with(Behavior::Good, seed, PlantConfig::default());
        let stop = AtomicBool::new(false);
        let zeroing = run::Zeroing::Measure;
        let recording = excite(
            &mut board,
            &rig(),
            MIN_SESSION_S,
            1.0,
            &zeroing,
            &stop,
            &mut NoopObserver,
        )
        .unwrap();
        assert!((recording.duration_s() - MIN_SESSION_S).abs() < 0.1);
        let out = tempfile::tempdir().unwrap();
        let found = find(&recording, &rig(), "rig", DEFAULT_TEXT, out.path(), &mut ());
        let found = found.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        assert_eq!(found.units.len(), UNITS);
    }
}

/// An effect without a setting: nothing is changed, and the report says what helps.
#[test]
fn what_helps_is_said_where_the_board_has_no_setting() {
    let time: Vec<f64> = (0..1200).map(|i| f64::from(i % 300) * 0.02).collect();
    let command: Vec<f64> = (0..1200)
        .map(|i| 5.0 + 3.0 * (0.03 * f64::from(i)).sin() + (0.11 * f64::from(i)).cos())
        .collect();
    let noise = |i: usize| ((i * i) as f64).sin();
    let target = (0..1200)
        .map(|i| command[i] - 0.02 * command[i] * command[i] + 0.01 * noise(i))
        .collect();
    let data = residual::Data::from_columns(time, [("command", command), ("target", target)])
        .sequences((0..4).map(|run| 300 * run..300 * (run + 1)))
        .build()
        .unwrap();
    let model = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                 command = { column = \"c\" }\n[[terms]]\nname = \"y\"\nexpr = \"command\"\n";
    let spec = residual::spec::Spec::parse(model).unwrap();
    let report = residual::analyse(&spec, data, &mut ()).unwrap();
    assert!(usable(&report).is_err(), "{}", report.summary());
    let advice = advice(&report);
    assert!(
        advice
            .iter()
            .any(|line| line.starts_with("quadratic") && line.contains("weights")),
        "{advice:?} {}",
        report.summary()
    );
}

/// Names of another course of the search that predicts as well are in all that is written.
fn names_what_may_stand_for_an_effect(mut unit: UnitFinding) {
    use residual::EffectKind::{Gain, Hysteresis};
    let own = unit.report.effects[0].name;
    unit.report.equal_paths = vec![residual::EqualPath {
        effects: vec![own],
        instead: vec![Hysteresis, Gain],
        heldout_rmse: 0.1,
    }];
    let record = report::unit(&unit);
    assert_eq!(record["equal_paths"][0]["instead"][1], "gain");
    let line = report::effect(&unit.report, &unit.report.effects[0]);
    assert!(
        line.starts_with(&format!("{own} or hysteresis and gain (")),
        "{line}"
    );
}

/// From a report that a board may use: the same with other verdicts.
fn refuses_what_is_not_clear(clear: &Report) {
    use residual::{Ambiguity, EffectKind, Structure, Verdict};
    assert!(usable(clear).is_ok(), "{}", clear.summary());
    let with = |change: &dyn Fn(&mut Report)| {
        let mut report = clear.clone();
        change(&mut report);
        usable(&report)
    };
    for verdict in [Verdict::None, Verdict::Unknown] {
        let why = with(&|r| r.verdict = verdict).unwrap_err();
        assert!(why.contains("verdict"), "{why}");
    }
    let rivals = |names: [EffectKind; 2]| {
        with(&move |r| {
            r.verdict = Verdict::NotIdentifiable;
            r.not_identifiable = vec![Ambiguity::new(names.to_vec(), "")];
        })
    };
    assert!(rivals([EffectKind::Coulomb, EffectKind::Backlash]).is_err());
    assert!(rivals([EffectKind::Coulomb, EffectKind::Delay]).is_err());
    // The same friction by either name.
    assert!(rivals([EffectKind::LoadDependentCoulomb, EffectKind::Coulomb]).is_ok());
    let nameless = |part: f64| {
        with(&move |r| {
            let explained = r.baseline.heldout_rmse - r.last.heldout_rmse;
            r.structure = vec![Structure::new(
                "time",
                part * explained / r.last.heldout_rmse,
                0.0,
            )];
        })
    };
    assert!(nameless(0.05).is_ok());
    assert!(nameless(0.2).unwrap_err().contains("time"));
}
