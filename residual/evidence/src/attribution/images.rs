//! Images of a tone in a target that is logged more often than it is measured.

use super::refusal::{Against, Refusal};
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

#[cfg(test)]
mod tests {
    use super::super::reasons::tests::weights;
    use super::*;
    use residual_effects::{effect, Variant};

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
