//! The watch over load cell and motor beside one reel in f64: what a robot does to a reel is no
//! fault, what an amplifier does is one.

use control::friction::travel;
use control::plausible::Watch;
use control::unit::{Drive, Output};
use control::{AdcCode, Config, EncoderCounts, Fault, Newton};
use proptest::prelude::*;

/// Reel, gear and motor at the cable, kg (emulator/plant).
const MASS_KG: f64 = 0.51;
/// Nominal time between two samples, s.
const SAMPLE_S: f64 = 3.125e-3;
/// Steps of the reel's motion in a sample.
const STEPS: u32 = 125;

/// What happens to the reel.
#[derive(Debug, Clone, Copy)]
struct Course {
    /// Speed at which the robot takes the cable away, m/s (negative: comes nearer), and for how
    /// long, s.
    away_m_per_s: f64,
    away_s: f64,
    /// Size of the robot's acceleration, m/s^2; infinity is a step of its speed.
    away_m_per_s2: f64,
    /// Tension before and between, N.
    held: f64,
    /// Stiffness of the cable, N/m.
    stiffness: f64,
    /// Dry friction of the reel, as a share of the configured one.
    friction: f64,
    /// Factor on the amplifier's gain, from 0.3 s.
    amplifier: f64,
}

/// How far the robot has taken the cable `t` seconds after it began, m.
fn away_m(course: &Course, t: f64) -> f64 {
    let speed = course.away_m_per_s.abs();
    let ramp_s = speed / course.away_m_per_s2;
    let ramped = |t: f64| match t.max(0.0) {
        t if t < ramp_s => 0.5 * course.away_m_per_s2 * t * t,
        t => speed * (t - 0.5 * ramp_s),
    };
    course.away_m_per_s.signum() * (ramped(t) - ramped(t - course.away_s))
}

/// The fault that the watch raises within 0.6 s, with the time.
fn fault(course: Course) -> Option<(Fault, f64)> {
    let held = course.held;
    let config = Config::nominal();
    let wire = Config::from_wire(&config).unwrap();
    let gain = f64::from(config.friction_gain_q16) / 65_536.0;
    let per_load = f64::from(config.coulomb_load_q16) / 65_536.0;
    let offset = f64::from(config.friction_offset_un) * 1e-6;
    let coulomb = f64::from(config.coulomb_un) * 1e-6;
    // The command that holds the tension in the middle of the band.
    let command = (held - offset) / gain;
    let friction = course.friction * (coulomb + per_load * command);
    let (mut reel_m, mut speed, mut contact) = (0.0f64, 0.0f64, 0.0f64);
    let mut tension = held;
    let mut watch = Watch::default();
    let mut last = EncoderCounts(0);
    let nm_per_count = f64::from(config.travel_nm_per_count);
    let filtered = |past: &[f64]| past.iter().sum::<f64>() / past.len() as f64;
    let mut past = vec![held; 4];
    for sample in 0..192 {
        let t = f64::from(sample) * SAMPLE_S;
        let jump = if t < 0.3 { 1.0 } else { course.amplifier };
        let pull = gain * command * jump + offset;
        for step in 0..STEPS {
            let dt = SAMPLE_S / f64::from(STEPS);
            let now = t + f64::from(step) * dt - 0.1;
            let tip_m = away_m(&course, now);
            tension = (held + course.stiffness * (tip_m + reel_m)).max(0.0);
            // A contact that bends by 30 um and then slides.
            contact = (contact + friction / 3e-5 * speed * dt).clamp(-friction, friction);
            speed += (pull - tension - contact - 20.0 * speed) / MASS_KG * dt;
            reel_m += speed * dt;
        }
        past.rotate_left(1);
        past[3] = tension;
        let counts = EncoderCounts((reel_m * 1e9 / nm_per_count).round() as i64);
        let output = Output {
            command: Newton::from_un((command * 1e6) as i32),
            direct: Newton::from_un((filtered(&past) * 1e6) as i32),
            tension: Newton::from_un((filtered(&past) * 1e6) as i32),
            setpoint: Newton::from_un((held * 1e6) as i32),
            travel_nm: travel(last, counts, config.travel_nm_per_count),
            ..Output::default()
        };
        last = counts;
        // Codes differ from each other, as noise makes them.
        let code = AdcCode::new(1_000 * sample);
        if let Some((fault, _)) = watch.sample(&wire, Drive::Follow, code, &output) {
            return Some((fault, t));
        }
    }
    None
}

/// A step of the robot's speed away from the reel, with three newton held.
fn step_away() -> Course {
    Course {
        away_m_per_s: 0.05,
        away_s: 0.1,
        away_m_per_s2: f64::INFINITY,
        held: 3.0,
        stiffness: 1e4,
        friction: 1.0,
        amplifier: 1.0,
    }
}

/// A reel that stopped after a fast run counted as sliding for 0.1 s: found by the property below.
#[test]
fn a_reel_that_comes_to_rest_slides_no_longer() {
    let course = Course {
        away_m_per_s: 0.054_766,
        away_s: 0.149_495,
        stiffness: 11_170.0,
        friction: 1.271_07,
        ..step_away()
    };
    assert_eq!(fault(course), None);
}

proptest! {
    /// The reel pays out, the tension is above the setpoint, and friction stops the reel within
    /// milliseconds.
    #[test]
    fn a_robot_that_takes_the_cable_away_and_stops_is_no_fault(
        away_m_per_s in 0.002..0.06,
        away_s in 0.01..0.15,
        stiffness in 5e3..2e4,
        friction in 0.7..1.3,
    ) {
        let course = Course { away_m_per_s, away_s, stiffness, friction, ..step_away() };
        prop_assert_eq!(fault(course), None);
    }

    /// At any tension, in both directions, with the acceleration of a robot that moves by hand (3
    /// m/s^2).
    #[test]
    fn a_robot_that_moves_and_stops_is_no_fault(
        away_m_per_s in -0.06..0.06,
        away_s in 0.01..0.15,
        held in 1.0..10.0,
        stiffness in 5e3..2e4,
        friction in 0.7..1.3,
    ) {
        let course = Course {
            away_m_per_s,
            away_s,
            away_m_per_s2: 3.0,
            held,
            stiffness,
            friction,
            ..step_away()
        };
        prop_assert_eq!(fault(course), None);
    }
}

#[test]
fn an_amplifier_that_jumps_is_found_within_20_ms() {
    for stiffness in [5e3, 1e4, 2e4] {
        let course = Course {
            away_m_per_s: 0.0,
            stiffness,
            amplifier: 2.5,
            ..step_away()
        };
        let found = fault(course);
        assert!(
            matches!(found, Some((Fault::Implausible | Fault::OutputStuck, t)) if t < 0.32),
            "{found:?}"
        );
    }
}

/// A slack cable that is taken up, or with an infinite rise one that breaks under a command: its
/// reel is free, and takes up what friction leaves of the command. The fault within 0.1 s.
fn free_reel(command_n: f64, n_per_s: f64, friction: f64, mass_kg: f64) -> Option<(Fault, f64)> {
    let config = Config::nominal();
    let wire = Config::from_wire(&config).unwrap();
    let newton = |n: f64| Newton::from_un((n * 1e6) as i32);
    let mut watch = Watch::default();
    let (mut speed, mut reel_m, mut last) = (0.0f64, 0.0f64, EncoderCounts(0));
    let mut past = [0.0; 4];
    for sample in -8..32 {
        let t = f64::from(sample) * SAMPLE_S;
        let command = if n_per_s.is_finite() {
            command_n.min(n_per_s * t.max(0.0))
        } else {
            command_n
        };
        // Before, the reel rests with the tension that the command makes. The converter's filter
        // takes four samples.
        past.rotate_left(1);
        past[3] = if sample < 0 { command } else { 0.0 };
        let tension = newton(past.iter().sum::<f64>() / 4.0);
        let at = EncoderCounts((reel_m * 1e9 / f64::from(config.travel_nm_per_count)) as i64);
        let output = Output {
            command: newton(command),
            setpoint: newton(command),
            tension,
            direct: tension,
            travel_nm: travel(last, at, config.travel_nm_per_count),
            ..Output::default()
        };
        last = at;
        if let Some((fault, _)) =
            watch.sample(&wire, Drive::Follow, AdcCode::new(1_000 * sample), &output)
        {
            return Some((fault, t));
        }
        if sample >= 0 {
            // What the model makes of it, with another friction.
            let least = f64::from(wire.least_tension(newton(command)).to_un()) * 1e-6;
            let free_n = (command - friction * (command - least)).max(0.0);
            let before = speed;
            speed += free_n / mass_kg * SAMPLE_S;
            reel_m += 0.5 * (before + speed) * SAMPLE_S;
        }
    }
    None
}

proptest! {
    /// However fast the command rises, and with other friction than configured.
    #[test]
    fn a_reel_that_is_free_is_no_fault(
        command_n in 1.2..12.0,
        n_per_s in 20.0..1e5,
        friction in 0.7..1.3,
    ) {
        prop_assert_eq!(free_reel(command_n, n_per_s, friction, MASS_KG), None);
    }
}

/// A cable that breaks, or a robot that comes nearer fast: the reel moves before the load cell
/// shows that nothing holds it.
#[test]
fn a_cable_that_breaks_is_no_reel_that_is_held() {
    for command_n in [2.0, 4.0, 8.0, 11.0] {
        for friction in [0.7, 1.0, 1.3] {
            let found = free_reel(command_n, f64::INFINITY, friction, MASS_KG);
            assert_eq!(found, None, "{command_n} N, {friction}");
        }
    }
}

/// The same reel with an encoder that stands still: a mass without end.
#[test]
fn a_reel_that_rests_on_a_slack_cable_is_found_within_50_ms_of_what_would_move_it() {
    for (command_n, n_per_s) in [(12.0, 100.0), (12.0, 1e5), (4.0, 100.0), (2.8, 1e5)] {
        let found = free_reel(command_n, n_per_s, 1.0, f64::INFINITY);
        let moves_s = 1.2 / n_per_s;
        assert!(
            matches!(found, Some((Fault::Implausible, t)) if t - moves_s < 0.05),
            "{command_n} N at {n_per_s} N/s: {found:?}"
        );
    }
}

/// A cable that was tight and lets go while the encoder stands still is for the encoder's watch:
/// this one waits for it.
#[test]
fn a_cable_that_was_tight_is_not_being_taken_up() {
    for command_n in [2.0, 4.0, 8.0] {
        let found = free_reel(command_n, f64::INFINITY, 1.0, f64::INFINITY);
        let early = found.filter(|(_, t)| *t < 0.05);
        assert_eq!(early, None, "{command_n} N");
    }
}

/// How long a command of this size lasts until a slack cable whose reel does not move is a fault,
/// ms; `None`: it is none within half a second.
fn still_ms(command_n: f64) -> Option<f64> {
    let config = Config::nominal();
    let wire = Config::from_wire(&config).unwrap();
    let mut watch = Watch::default();
    for sample in 0..160 {
        let output = Output {
            command: Newton::from_un((command_n * 1e6) as i32),
            setpoint: Newton::from_un(3_000_000),
            ..Output::default()
        };
        let code = AdcCode::new(1_000 * sample);
        if let Some((fault, _)) = watch.sample(&wire, Drive::Follow, code, &output) {
            assert_eq!(fault, Fault::Implausible);
            return Some(f64::from(sample) * 1e3 * SAMPLE_S);
        }
    }
    None
}

/// 50 ms, where a sound reel can't rest. Friction of 1.3 times the configured one, which a bring-up
/// lets pass, and 0.5 N of a cable that counts as slack hold up to 1.9 N.
#[test]
fn a_command_that_moves_nothing_is_a_fault() {
    let config = Config::nominal();
    let [gain, per_load] = [config.friction_gain_q16, config.coulomb_load_q16]
        .map(|share| f64::from(share) / 65_536.0);
    let [offset, coulomb] =
        [config.friction_offset_un, config.coulomb_un].map(|force| f64::from(force) * 1e-6);
    let holds_n =
        |tension: f64, share: f64| (tension + share * coulomb - offset) / (gain - share * per_load);
    println!(
        "a reel as configured turns from {:.2} N on",
        holds_n(0.0, 1.0)
    );
    println!(
        "one with 1.3 times its friction holds 0.5 N up to {:.2} N",
        holds_n(0.5, 1.3)
    );
    let from = |within_ms: f64| {
        let commands = (0..=400).map(|step| f64::from(step) * 0.01);
        commands.fold(None, |from, command_n| {
            match still_ms(command_n).filter(|ms| *ms <= within_ms) {
                Some(_) => from.or(Some(command_n)),
                None => None,
            }
        })
    };
    let (soon_n, late_n) = (from(50.0).unwrap(), from(500.0).unwrap());
    println!("a fault within 50 ms from {soon_n:.2} N on, at all from {late_n:.2} N on");
    for command_n in [late_n, 0.5 * (late_n + soon_n), soon_n, 4.0] {
        println!("{command_n:.2} N: {:?} ms", still_ms(command_n));
    }
    assert!(late_n > holds_n(0.5, 1.3), "a sound reel may rest there");
    assert!(soon_n < 2.5 && late_n < 2.1, "{soon_n} {late_n}");
}
