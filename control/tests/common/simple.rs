//! A minimal, independent rig: one mass on a spring whose other end moves, Karnopp friction (a
//! speed band in which it sticks), an ideal motor, a moving average of four samples' length for the
//! converter's delay. Shares nothing with the plant but the measured friction law.

use control::unit::{Drive, Setpoint};
use control::{AdcCode, Config, Controller, EncoderCounts, Input, InvCos, Micros, Newton, State};
use wire::message::UnitConfig;

const MASS_KG: f64 = 0.46;
const STEP_S: f64 = 25e-6;
/// Speed below which the mass counts as standing.
const STICK_M_PER_S: f64 = 2e-4;
const COUNT_M: f64 = 4.229e-6;

/// RMS tension error in N over 20 s, at 4 N, while that end moves with 8 mm/s RMS and up to 1 Hz.
pub fn rms_while_moving(wire: &UnitConfig, stiffness_n_per_m: f64) -> f64 {
    let config = Config::from_wire(wire).expect("in range");
    let mut state = State::default();
    let (k, setpoint) = (stiffness_n_per_m, 4.0);
    let damping = 0.03 * 2.0 * (k * MASS_KG).sqrt();
    let sample_steps = 125; // 3.125 ms
    let (mut x, mut v, mut command, mut pending) = (0.0f64, 0.0f64, 0.0, 0.0);
    let mut history = vec![0.0; 4 * sample_steps];
    let (mut sum, mut square, mut count) = (0.0, 0.0, 0.0);
    for n in 0..(23.0 / STEP_S) as usize {
        let t = n as f64 * STEP_S;
        // Away from the reel is positive; amplitudes for 8 mm/s together.
        let fade = (t / 2.0).min(1.0);
        let wave = |hz: f64, speed: f64| {
            let w = std::f64::consts::TAU * hz;
            (speed / w * (w * t).sin(), speed * (w * t).cos())
        };
        let (a, b, c) = (wave(0.13, 0.009), wave(0.31, 0.006), wave(0.97, 0.002));
        let (hand, hand_speed) = (fade * (a.0 + b.0 + c.0), fade * (a.1 + b.1 + c.1));
        // x: cable wound in.
        let stretch = hand + x;
        let tension = (k * stretch + damping * (hand_speed + v)).max(0.0);
        let push = 0.155 + 1.018 * command - tension;
        let band = 0.909 + 0.154 * command;
        if v.abs() < STICK_M_PER_S && push.abs() <= 1.05 * band {
            v = 0.0;
        } else {
            let against = if v.abs() < STICK_M_PER_S {
                push.signum()
            } else {
                v.signum()
            };
            let next = v + STEP_S * (push - band * against) / MASS_KG;
            // Friction stops, it never reverses.
            v = if v != 0.0 && next * v < 0.0 && push.abs() <= 1.05 * band {
                0.0
            } else {
                next
            };
        }
        x += STEP_S * v;
        let slot = n % history.len();
        sum += tension - history[slot];
        history[slot] = tension;
        if n % sample_steps == 0 {
            let force = sum / history.len() as f64 + if n % 2 == 0 { 0.003 } else { -0.003 };
            let input = Input {
                adc_code: AdcCode::new((force / 6.85e-6) as i32),
                encoder_counts: EncoderCounts((x / COUNT_M).floor() as i64),
                at: Micros((t * 1e6) as u32),
                setpoint: Setpoint {
                    tension: Newton::from_un((setpoint * 1e6) as i32),
                    inv_cos: InvCos::ONE,
                    reel: None,
                },
                drive: Drive::Follow,
            };
            pending = Controller::step(&config, &mut state, input)
                .command
                .to_f64();
        }
        if n % sample_steps == 8 {
            command = pending; // 0.2 ms later
        }
        if t > 3.0 {
            square += (tension - setpoint).powi(2);
            count += 1.0;
        }
    }
    (square / count).sqrt()
}
