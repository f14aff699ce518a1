//! The watch over load cell and motor beside one reel in f64: what a robot does to a reel is no fault, what an amplifier
//! does is one.

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
    /// Speed at which the robot takes the cable away, m/s, and for how long, s.
    away_m_per_s: f64,
    away_s: f64,
    /// Stiffness of the cable, N/m.
    stiffness: f64,
    /// Dry friction of the reel, as a share of the configured one.
    friction: f64,
    /// Factor on the amplifier's gain, from 0.3 s.
    amplifier: f64,
}

/// The fault that the watch raises within 0.6 s, with the time.
fn fault(course: Course) -> Option<(Fault, f64)> {
    const HELD: f64 = 3.0;
    let config = Config::nominal();
    let wire = Config::from_wire(&config).unwrap();
    let gain = f64::from(config.friction_gain_q16) / 65_536.0;
    let per_load = f64::from(config.coulomb_load_q16) / 65_536.0;
    let offset = f64::from(config.friction_offset_un) * 1e-6;
    let coulomb = f64::from(config.coulomb_un) * 1e-6;
    // The command that holds the tension in the middle of the band.
    let command = (HELD - offset) / gain;
    let friction = course.friction * (coulomb + per_load * command);
    let (mut reel_m, mut speed, mut contact) = (0.0f64, 0.0f64, 0.0f64);
    let mut tension = HELD;
    let mut watch = Watch::default();
    let mut last = EncoderCounts(0);
    let nm_per_count = f64::from(config.travel_nm_per_count);
    let filtered = |past: &[f64]| past.iter().sum::<f64>() / past.len() as f64;
    let mut past = vec![HELD; 4];
    for sample in 0..192 {
        let t = f64::from(sample) * SAMPLE_S;
        let jump = if t < 0.3 { 1.0 } else { course.amplifier };
        let pull = gain * command * jump + offset;
        for step in 0..STEPS {
            let dt = SAMPLE_S / f64::from(STEPS);
            let now = t + f64::from(step) * dt - 0.1;
            let tip_m = course.away_m_per_s * now.clamp(0.0, course.away_s);
            tension = (HELD + course.stiffness * (tip_m + reel_m)).max(0.0);
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
            setpoint: Newton::from_un((HELD * 1e6) as i32),
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

proptest! {
    /// The reel pays out, the tension is above the setpoint, and friction stops the reel within milliseconds.
    #[test]
    fn a_robot_that_takes_the_cable_away_and_stops_is_no_fault(
        away_m_per_s in 0.002..0.06,
        away_s in 0.01..0.15,
        stiffness in 5e3..2e4,
        friction in 0.7..1.3,
    ) {
        let course = Course { away_m_per_s, away_s, stiffness, friction, amplifier: 1.0 };
        prop_assert_eq!(fault(course), None);
    }
}

#[test]
fn an_amplifier_that_jumps_is_found_within_20_ms() {
    for stiffness in [5e3, 1e4, 2e4] {
        let course = Course {
            away_m_per_s: 0.0,
            away_s: 0.0,
            stiffness,
            friction: 1.0,
            amplifier: 2.5,
        };
        let found = fault(course);
        assert!(
            matches!(found, Some((Fault::Implausible, t)) if t < 0.32),
            "{found:?}"
        );
    }
}
