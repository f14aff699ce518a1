//! An output that jumps to the end of its range and stays there, whatever is written. No sampling
//! sees that before the cable does, and no word takes it back: until the PLC has removed the power,
//! the amplifier's current limit alone bounds the pull.

use crate::injection::Injection;
use crate::rig::Rig;
use std::fmt::Write;

/// Current limits of the table, A.
const LIMITS_A: [f64; 7] = [0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3];
/// Tensions that are held when it happens, N; 0: the motors were stopped before.
const HELD_N: [f64; 6] = [0.0, 2.6, 4.0, 6.0, 9.0, 11.4];
/// Plants for each.
const PLANTS: u64 = 4;
/// How long each is watched, in milliseconds: the power is off after 100.
const WATCH_MS: u32 = 300;
/// Pull of a motor for a current, N/A: 52.1 mN m/A, 26:7, 10 mm.
const N_PER_A: f64 = 0.0521 * 26.0 / 7.0 / 0.01;

/// Largest tension in newton, and the first millisecond above 13 N; `None` where the motors cannot
/// hold `held_n`.
fn worst(seed: u64, limit_a: f64, held_n: f64) -> Option<(f64, Option<u32>)> {
    let mut most = (0.0f64, None::<u32>);
    for plant in 0..PLANTS {
        let seed = seed.wrapping_mul(1_000).wrapping_add(plant + 1);
        let mut rig = Rig::try_armed(seed, [held_n.max(2.6); 6], limit_a)?;
        if held_n == 0.0 {
            rig.inject(Injection::StopElsewhere);
            rig.run_ms(400);
        }
        for unit in 0..6 {
            let mut rig = rig.clone();
            rig.inject(Injection::DacFull(unit));
            for ms in 1..=WATCH_MS {
                rig.run_ms(1);
                let tension_n = rig.tension_n(unit);
                most.0 = most.0.max(tension_n);
                if tension_n > crate::outcome::TENSION_N {
                    most.1 = Some(most.1.map_or(ms, |first| first.min(ms)));
                }
            }
        }
    }
    Some(most)
}

/// The table: largest tension of six units of some plants, and when the first of them passed 13 N.
#[must_use]
pub fn table(seed: u64) -> String {
    let mut text = String::from("| current limit, A | pull at most, N |");
    for held_n in HELD_N {
        let _ = match held_n {
            0.0 => write!(text, " at 0 V |"),
            _ => write!(text, " holding {held_n} N |"),
        };
    }
    text.push_str("\n| ---: | ---: |");
    text.push_str(&" ---: |".repeat(HELD_N.len()));
    text.push('\n');
    for limit_a in LIMITS_A {
        let _ = write!(text, "| {limit_a} | {:.1} |", limit_a * N_PER_A);
        for held_n in HELD_N {
            let cell = match worst(seed, limit_a, held_n) {
                None => "cannot be held".to_owned(),
                Some((most_n, None)) => format!("{most_n:.1} N"),
                Some((most_n, Some(ms))) => format!("{most_n:.1} N, 13 N after {ms} ms"),
            };
            let _ = write!(text, " {cell} |");
        }
        text.push('\n');
    }
    text
}
