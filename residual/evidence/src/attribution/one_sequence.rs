//! Effects that one sequence has and the others do not.

use crate::one_alone::{mean_of_others, stands_out, Own, BY_CHANCE, FEWEST};
use residual_columns::error::Error;
use residual_columns::format::num;
use residual_columns::linalg::dot;
use residual_search::{without, Outcome, Search};

/// Size in the other sequences, over that on the whole and that in the one, up to which they do not
/// have an effect.
const WITHOUT: f64 = 0.25;

/// Share of what the effect would add in the one sequence that it must add in some other, to be
/// missed there.
const MISSED: f64 = 0.1;

/// Why an effect is none of the rig, where it acts in one sequence alone although others have what
/// it depends on.
pub(super) fn in_one_sequence(
    search: &Search,
    outcome: &Outcome,
    index: usize,
) -> Result<Option<String>, Error> {
    let rows = search.problem.rows_of_runs();
    if rows.len() < FEWEST {
        return Ok(None);
    }
    let before = search.fit(&without(&outcome.chosen, index).1)?.fit.residual;
    let added: Vec<f64> = (before.iter().zip(&outcome.fitted.fit.residual))
        .map(|(before, after)| before - after)
        .collect();
    let own: Vec<Own> = rows
        .iter()
        .map(|r| {
            let (a, r) = (&added[r.clone()], &before[r.clone()]);
            let weight = dot(a, a);
            Own {
                size: if weight > 0.0 {
                    dot(a, r) / weight
                } else {
                    0.0
                },
                weight,
            }
        })
        .collect();
    Ok(alone(&own).map(|(index, others)| {
        format!(
            "it acts in sequence {} of {} alone: there it is {} times as large as on the whole, in the others {}",
            index + 1,
            own.len(),
            num(own[index].size),
            num(others)
        )
    }))
}

/// The sequence that alone has an effect, and its mean size in the others. Sizes are multiples of
/// that on the whole.
fn alone(own: &[Own]) -> Option<(usize, f64)> {
    let (index, p, _) = stands_out(own)?;
    let others = mean_of_others(own, index);
    let missed = own
        .iter()
        .enumerate()
        .any(|(k, o)| k != index && o.weight >= MISSED * own[index].weight);
    // A sequence with little of what the effect depends on has it at any size, by its noise.
    let is_alone = others.abs() <= WITHOUT * own[index].size.abs().min(1.0);
    (p * own.len() as f64 <= BY_CHANCE && is_alone && missed).then_some((index, others))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn own(sizes: [f64; 5], weights: [f64; 5]) -> Vec<Own> {
        let all = sizes.into_iter().zip(weights);
        all.map(|(size, weight)| Own { size, weight }).collect()
    }

    #[test]
    fn an_effect_is_missed_where_it_would_show() {
        let one = [0.01, 4.9, -0.03, 0.02, 0.01];
        assert!(alone(&own(one, [1.0; 5])).is_some_and(|(k, _)| k == 1));
        // The others have nothing of what it depends on.
        let there = [0.01, 1.0, 0.001, 0.0, 0.02];
        assert_eq!(alone(&own(one, there)), None);
        // It is larger there, and elsewhere too.
        let larger = [0.81, 1.9, 0.79, 0.8, 0.82];
        assert_eq!(alone(&own(larger, [1.0; 5])), None);
        // The others have it as on the whole; in the one it hardly acts, and its size is chance.
        let chance = [0.98, 5.7, 0.97, 0.98, 0.99];
        assert_eq!(alone(&own(chance, [1.0, 0.005, 1.0, 1.0, 1.0])), None);
        let all = [0.9, 1.1, 1.0, 0.95, 1.05];
        assert_eq!(alone(&own(all, [1.0; 5])), None);
    }
}
