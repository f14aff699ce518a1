//! Ripples over the reel's angle: added to a unit's settings, and merged where a fit has split one.

use super::bounded;
use rig::RippleSettings;
use std::f64::consts::TAU;

/// Ripples whose periods differ by less than this part are the same one.
const SAME_PERIOD_TOLERANCE: f64 = 0.03;

/// Largest change of a ripple's amplitude, N.
const MAX_AMPLITUDE_CHANGE_N: f64 = 2.0;
/// Largest change of a ripple's amplitude per load, N per N.
const MAX_AMPLITUDE_PER_N_CHANGE: f64 = 0.2;

/// Adds a ripple: to the one of the same period, or in a free place.
pub(super) fn add_ripple(
    ripples: &mut [RippleSettings],
    found: &residual::Ripple,
    travel_m_per_rad: f64,
) -> Result<(), String> {
    let period_m = TAU * travel_m_per_rad / found.order;
    if !(5e-4..=1.0).contains(&period_m) {
        return Err(format!(
            "a ripple with a period of {:.4} mm of cable is out of the board's range",
            period_m * 1e3
        ));
    }
    let same = |r: &RippleSettings| {
        !r.is_none() && (r.period_m / period_m - 1.0).abs() < SAME_PERIOD_TOLERANCE
    };
    let place = ripples
        .iter()
        .position(same)
        .or_else(|| ripples.iter().position(RippleSettings::is_none))
        .ok_or("there is no place for another ripple")?;
    let slot = &mut ripples[place];
    let was_there = !slot.is_none();
    // As vectors: one part that is constant and one that grows with the load have one phase in the
    // board.
    let (sin, cos) = found.phase.sin_cos();
    let (old, old_sin, old_cos) = if was_there {
        let amplitude = if found.of_load {
            slot.amplitude_per_n
        } else {
            slot.amplitude_n
        };
        let (s, c) = slot.phase_rad.sin_cos();
        (amplitude, s, c)
    } else {
        (0.0, 0.0, 0.0)
    };
    if was_there && (slot.amplitude_n != 0.0) == found.of_load {
        return Err(
            "a ripple of that period is declared in another form (with load, without): check both"
                .into(),
        );
    }
    let x = old * old_cos + found.amplitude * cos;
    let y = old * old_sin + found.amplitude * sin;
    slot.phase_rad = y.atan2(x);
    if found.of_load {
        slot.amplitude_per_n = bounded(
            "ripple_amplitude_per_n",
            old,
            x.hypot(y),
            MAX_AMPLITUDE_PER_N_CHANGE,
            0.0..=0.2,
        )?;
    } else {
        slot.amplitude_n = bounded(
            "ripple_amplitude_n",
            old,
            x.hypot(y),
            MAX_AMPLITUDE_CHANGE_N,
            0.0..=3.0,
        )?;
    }
    if !was_there {
        slot.period_m = period_m;
    }
    Ok(())
}

/// Merges ripples whose orders the travel can't separate.
///
/// Over `turns` of the angle two orders are separable where they differ by 0.6 / turns. Closer ones
/// are one ripple that the fit has split. The merged ripple has their mean order, weighted by
/// amplitude, and their sum in the middle of the travel.
pub fn merge_ripples(ripples: &mut Vec<residual::Ripple>, angles_rad: &[f64]) {
    let low = angles_rad.iter().copied().fold(f64::INFINITY, f64::min);
    let high = angles_rad.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (middle, turns) = (0.5 * (low + high), (high - low) / TAU);
    if !(turns > 0.0 && turns.is_finite()) {
        return;
    }
    let mut merged: Vec<residual::Ripple> = Vec::new();
    for found in ripples.drain(..) {
        let near = merged
            .iter_mut()
            .find(|r| r.of_load == found.of_load && (r.order - found.order).abs() < 0.6 / turns);
        let Some(r) = near else {
            merged.push(found);
            continue;
        };
        let (y1, x1) = (r.order * middle + r.phase).sin_cos();
        let (y2, x2) = (found.order * middle + found.phase).sin_cos();
        let x = r.amplitude * x1 + found.amplitude * x2;
        let y = r.amplitude * y1 + found.amplitude * y2;
        let weight = r.amplitude / (r.amplitude + found.amplitude);
        r.order = weight * r.order + (1.0 - weight) * found.order;
        r.amplitude = x.hypot(y);
        let phase = y.atan2(x) - r.order * middle;
        r.phase = phase - TAU * (phase / TAU).round();
    }
    *ripples = merged;
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual::Ripple;

    fn ripple(order: f64, amplitude: f64, phase: f64, of_load: bool) -> Ripple {
        Ripple {
            order,
            amplitude,
            phase,
            of_load,
        }
    }

    #[test]
    fn a_ripple_that_a_fit_has_split_becomes_one_again() {
        // 0.3 and 0.2 N of orders 3.66 and 3.80 that are in step at 0.5 rad, in the middle of one
        // turn.
        let angles: Vec<f64> = (0..100).map(|n| 0.5 + 0.06 * f64::from(n - 50)).collect();
        let middle = 0.5 * (angles[0] + angles[99]);
        let at = |order: f64| 1.0 - order * middle;
        let mut ripples = vec![
            ripple(3.66, 0.3, at(3.66), false),
            ripple(9.0, 0.1, 0.0, false),
            ripple(3.80, 0.2, at(3.80), false),
        ];
        merge_ripples(&mut ripples, &angles);
        assert_eq!(ripples.len(), 2, "{ripples:?}");
        assert!((ripples[0].order - 3.716).abs() < 1e-9);
        assert!((ripples[0].amplitude - 0.5).abs() < 1e-9);
        let phase = (ripples[0].order * middle + ripples[0].phase - 1.0).sin();
        assert!(phase.abs() < 1e-9, "{ripples:?}");
        // Nothing to go by, nothing done.
        let mut two = vec![ripple(3.7, 0.3, 0.0, false), ripple(3.8, 0.3, 0.0, false)];
        merge_ripples(&mut two, &[]);
        assert_eq!(two.len(), 2);
    }
}
