//! Images of a tone: in a target that is logged more often than it is measured, and in one whose
//! rows have stamps that are not their times.

use super::refusal::{Against, Refusal};
use residual_columns::format::num;
use residual_columns::frame::Frame;
use residual_columns::stats;
use residual_effects::EffectKind;
use residual_search::model::Chosen;
use residual_search::Weight;

/// Marks all tones but the most valuable: where a target holds its values, or where they have the
/// stamps of later rows, one tone shows at several frequencies.
pub(super) fn images_of_a_tone(why: &mut [Option<Refusal>], chosen: &[Chosen], weights: &[Weight]) {
    // The weights begin with the most valuable.
    let tones = weights.iter().map(|w| w.index);
    let tones = tones.filter(|i| chosen[*i].effect.kind() == EffectKind::Tone);
    for i in tones.skip(1) {
        why[i].get_or_insert(Against::AsASeries.refuses(
            "a tone has images at other frequencies where the target holds its values: the largest alone can be told. Log each value \
             once, at its own time"
                .into(),
        ));
    }
}

/// Most rows after which the steps between uneven stamps come again.
const PATTERN: usize = 4;

/// Marks each tone that is the image of a larger one: stamps that are off by a pattern of `m` rows
/// put images at multiples of the row rate over `m`, more or less the frequency. `rate` is that of
/// the rows, on average, and `span` the length of the longest log in s.
pub(super) fn images_by_stamps(
    why: &mut [Option<Refusal>],
    chosen: &[Chosen],
    weights: &[Weight],
    (rate, span): (f64, f64),
) {
    // The weights begin with the most valuable.
    let tones: Vec<usize> = weights
        .iter()
        .map(|w| w.index)
        .filter(|i| chosen[*i].effect.kind() == EffectKind::Tone)
        .collect();
    for (place, i) in tones.iter().enumerate() {
        let own = chosen[*i].psi;
        let of = |j: &&usize| is_image(own, chosen[**j].psi, rate, 1.0 / span);
        if let Some(larger) = tones[..place].iter().find(of) {
            why[*i].get_or_insert(Against::Others.refuses(format!(
                "{} Hz is an image of {} Hz: the rows, {} in a second, have uneven stamps that are not the times of their values",
                num(own),
                num(chosen[*larger].psi),
                num(rate)
            )));
        }
    }
}

/// Longest step from row to row, over the usual one, that is no gap: a row that is missing makes
/// the step longer by two thirds of the longer of two steps like 10 and 15 ms.
const GAP: f64 = 1.6;

/// Rows in a second, missing ones counted; `dt` is the usual step in s.
pub(super) fn rows_per_second(frame: &Frame, dt: f64) -> f64 {
    let sequences = frame.sequences().iter();
    let steps: Vec<f64> = sequences
        .flat_map(|r| frame.time()[r.clone()].windows(2).map(|w| w[1] - w[0]))
        .filter(|step| *step < GAP * dt)
        .collect();
    1.0 / stats::mean(&steps)
}

/// Whether a frequency is an image of another.
fn is_image(own: f64, of: f64, rate: f64, resolution: f64) -> bool {
    (2..=PATTERN).any(|m| {
        (1..m).any(|k| {
            let line = k as f64 * rate / m as f64;
            let near = |image: f64| (image.abs() - own).abs() <= resolution;
            near(line - of) || near(line + of)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::reasons::tests::weights;
    use super::*;
    use residual_effects::{effect, Variant};

    /// 80 values in a second with stamps of the 5 ms grid, in turn 10 and 15 ms apart.
    #[test]
    fn uneven_stamps_have_images_at_parts_of_the_row_rate() {
        assert!(is_image(10.0, 30.0, 79.95, 0.03));
        assert!(!is_image(10.5, 30.0, 79.95, 0.03) && !is_image(30.0, 30.0, 79.95, 0.03));
        let tone = |psi| Chosen {
            effect: effect(EffectKind::Tone),
            variant: std::sync::Arc::new(Variant::linear("", vec![])),
            psi,
        };
        let chosen = [tone(10.0), tone(30.0), tone(21.3)];
        let mut why = vec![None; 3];
        images_by_stamps(&mut why, &chosen, &weights(&[1.1, 1.9, 1.3]), (80.0, 40.0));
        let gone: Vec<bool> = why.iter().map(Option::is_some).collect();
        assert_eq!(gone, [true, false, false]);
    }

    #[test]
    fn a_missing_row_does_not_change_the_rate() {
        let time: Vec<f64> = (0..400)
            .filter(|k| k % 37 != 5)
            .map(|k| (f64::from(k) * 2.5).ceil() * 0.005)
            .collect();
        let whole = std::iter::once(0..time.len()).collect();
        let frame = Frame::new(vec![], time, whole);
        for dt in [0.010, 0.015] {
            let rate = rows_per_second(&frame, dt);
            assert!((rate - 80.0).abs() < 0.5, "{rate}");
        }
    }

    #[test]
    fn the_largest_tone_stays() {
        use EffectKind::{PeriodicAngle, Tone};
        let chosen = [Tone, PeriodicAngle, Tone, Tone].map(|kind| Chosen {
            effect: effect(kind),
            variant: std::sync::Arc::new(Variant::linear("", vec![])),
            psi: 0.0,
        });
        let mut why = vec![None; 4];
        images_of_a_tone(&mut why, &chosen, &weights(&[1.1, 1.9, 1.3, 1.2]));
        let gone: Vec<bool> = why.iter().map(Option::is_some).collect();
        assert_eq!(gone, [true, false, false, true]);
    }
}
