//! Calibration of an emulated rig's load cells with a known weight on each.
//!
//! The thesis does this by hand (3.5.1) before the units are mounted. Every seed of the embedded
//! rig is another rig, whose cells differ by some percent, and no rig file can know them. On a real
//! rig the rig file holds the calibration, and this step does nothing.

use crate::error::RunError;
use crate::phase::{begin, tell_configs, Observer, Phase};
use emulator_link::Injection;
use rig::Rig;
use session::link::LinkError;
use session::{Session, TimedSample};
use std::time::Duration;
use wire::message::UnitConfig;
use wire::UNITS;

/// Calibration weight, N: about 500 g, the middle of the thesis's weights.
const WEIGHT_N: f64 = 5.0;
/// Time until the converter's filter holds nothing from before the weight changed.
const WEIGHT_SETTLE_TIME: Duration = Duration::from_millis(200);
/// Time over which a weight is averaged: 160 samples take 3 mN of noise to 0.3 mN, 0.06 per mille
/// of the weight.
const WEIGHING_TIME: Duration = Duration::from_millis(500);
/// Largest relative difference to the rig file's scale. A larger one is a mistake and no
/// calibration.
const MAX_SCALE_CHANGE: f64 = 0.25;

/// Calibrates the load cells of an emulated rig and sends the new scales. Does nothing on a real
/// rig, and leaves units alone whose gain was measured (`forcectl calibrate gain`).
pub(super) fn calibrate(
    session: &mut Session<'_>,
    rig: &Rig,
    configs: &mut [UnitConfig; UNITS],
    observer: &mut dyn Observer,
) -> Result<(), RunError> {
    let measured = (0..UNITS).all(|i| rig.has_measured_gain(i) || !configs[i].enabled);
    if measured || session.link().controls().is_none() {
        return Ok(());
    }
    begin(session, observer, Phase::Calibrate);
    let samples = weigh(session, observer)?;
    for (i, config) in configs
        .iter_mut()
        .enumerate()
        .filter(|(i, config)| config.enabled && !rig.has_measured_gain(*i))
    {
        let before = config.scale_pn_per_count;
        match scale_pn_per_count(&samples, i, config) {
            Ok(scale) => config.scale_pn_per_count = scale,
            Err(found) => observer.notice(&format!(
                "unit {}: the known weight gives {:.3e} N a count, the rig file says {:.3e}; the rig file's is kept",
                i + 1,
                found * 1e-12,
                f64::from(before) * 1e-12
            )),
        }
    }
    session.configure(configs)?;
    tell_configs(session, observer, configs);
    observer.progress(Phase::Calibrate, 1.0);
    Ok(())
}

/// Samples with the weight on every load cell.
fn weigh(
    session: &mut Session<'_>,
    observer: &mut dyn Observer,
) -> Result<Vec<TimedSample>, RunError> {
    hang_weights(session, WEIGHT_N)?;
    session.exchange(WEIGHT_SETTLE_TIME)?;
    observer.received(&session.drain());
    session.exchange(WEIGHING_TIME)?;
    let received = session.drain();
    observer.received(&received);
    hang_weights(session, 0.0)?;
    session.exchange(WEIGHT_SETTLE_TIME)?;
    observer.received(&session.drain());
    Ok(received.samples)
}

/// Scale of unit `i` (from 0) from samples with the weight on it, pN per count; the scale found as
/// an error where it is too far from the one in `config`.
fn scale_pn_per_count(samples: &[TimedSample], i: usize, config: &UnitConfig) -> Result<i32, f64> {
    let codes: Vec<f64> = samples
        .iter()
        .filter(|timed| usize::from(timed.sample.unit) == i)
        .map(|timed| f64::from(timed.sample.adc_code))
        .collect();
    let mean = codes.iter().sum::<f64>() / codes.len() as f64;
    let scale = WEIGHT_N / (mean - f64::from(config.zero_code)) * 1e12;
    // NaN and infinity (no samples, no change) are not within the limit.
    if (scale / f64::from(config.scale_pn_per_count) - 1.0).abs() <= MAX_SCALE_CHANGE {
        Ok(scale.round() as i32)
    } else {
        Err(scale)
    }
}

/// Hangs a weight on every load cell, N; 0 takes it off.
fn hang_weights(session: &mut Session<'_>, weight_n: f64) -> Result<(), LinkError> {
    if let Some(controls) = session.link().controls() {
        for unit in 1..=UNITS as u8 {
            controls.inject(Injection::PullCable(unit, weight_n))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::message::Sample;

    #[test]
    fn a_scale_follows_the_weight_within_its_limit() {
        let mut config = Rig::built_in().unwrap().units[0].to_wire();
        config.zero_code = 1000;
        let per_count_n = f64::from(config.scale_pn_per_count) * 1e-12;
        let with = |factor: f64| {
            let code = 1000 + (WEIGHT_N / (factor * per_count_n)).round() as i32;
            // Another unit's samples don't count.
            [(0, code), (0, code), (1, 5)].map(|(unit, code)| TimedSample {
                t_us: 0,
                sample: Sample {
                    unit,
                    adc_code: code,
                    ..Sample::default()
                },
            })
        };
        let found = scale_pn_per_count(&with(1.1), 0, &config).unwrap();
        let factor = f64::from(found) / f64::from(config.scale_pn_per_count);
        assert!((factor - 1.1).abs() < 1e-5, "{factor}");
        assert!(scale_pn_per_count(&with(1.3), 0, &config).is_err());
        // No samples.
        assert!(scale_pn_per_count(&[], 0, &config).is_err());
    }
}
