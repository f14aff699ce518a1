//! Images of a tone: in a target that is logged more often than it is measured, and in one whose
//! rows have stamps that are not their times.

use super::refusal::{Against, Refusal};
use residual_columns::error::Error;
use residual_columns::format::num;
use residual_columns::frame::Frame;
use residual_columns::linalg::{dot, squared_error, Cholesky};
use residual_columns::stats;
use residual_effects::EffectKind;
use residual_fit::problem::RANK_TOL;
use residual_search::model::Chosen;
use residual_search::{Search, Weight};
use std::f64::consts::TAU;
use std::ops::Range;

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

/// Marks each tone that may be the image of a larger one: where the stamps are off the times of
/// their rows by a pattern that repeats, a tone shows at other frequencies too. Rows that are
/// measured at even times show it at one.
pub(super) fn images_by_stamps(
    why: &mut [Option<Refusal>],
    search: &Search,
    chosen: &[Chosen],
    weights: &[Weight],
) -> Result<(), Error> {
    // The weights begin with the most valuable.
    let tones = weights.iter().map(|w| w.index);
    let tones: Vec<usize> = tones
        .filter(|i| chosen[*i].effect.kind() == EffectKind::Tone)
        .collect();
    if tones.len() < 2 {
        return Ok(());
    }
    let rows = Rows::new(&search.problem.kept_frame());
    for (place, i) in tones.iter().enumerate().skip(1) {
        for j in &tones[..place] {
            let rest: Vec<Chosen> = (0..chosen.len())
                .filter(|k| k != i && k != j)
                .map(|k| chosen[k].clone())
                .collect();
            let values = search.fit(&rest)?.fit.residual;
            let (own, larger) = (chosen[*i].psi, chosen[*j].psi);
            if rows.show_an_image(&values, own, larger) {
                why[*i].get_or_insert(Against::Others.refuses(format!(
                    "{} Hz may be an image of {} Hz: with the rows at even times, {} in a second, {} Hz alone explains both",
                    num(own),
                    num(larger),
                    num(rows.rate),
                    num(larger)
                )));
            }
        }
    }
    Ok(())
}

/// Longest step between stamps, over the step that nine of ten are below, that is no gap. A row
/// that is missing makes the step longer by two thirds of the longer of two steps like 10 and 15
/// ms.
const GAP: f64 = 1.6;

/// Share of the steps that are no longer than the usual long one: of 800 rows in a second with
/// stamps in ms a quarter has 2 ms, the others 1 ms.
const USUAL: f64 = 0.9;

/// Rows over which steps count as even: clocks wander, and what a clock loses over more rows is no
/// pattern of the stamps.
const TOGETHER: usize = 1024;

/// Fewest rows that show two tones beside a constant.
const FEWEST: usize = 32;

/// Share of what a tone adds that even times must give to the larger one. An image gives all. Two
/// true tones in 80 rows a second, 10 and 15 ms apart, gave up to 0.7 where the smaller has half of
/// the larger one's amplitude, and up to 0.97 at 0.2 of it, by chance of their phases.
const NEARLY_ALL: f64 = 0.9;

/// Rows with their stamps, and with the times that they have if they were measured at even steps.
struct Rows {
    /// Rows in a second, missing ones counted.
    rate: f64,
    stretches: Vec<Stretch>,
}

/// Rows of one sequence.
struct Stretch {
    rows: Range<usize>,
    stamps: Vec<f64>,
    even: Vec<f64>,
}

impl Rows {
    fn new(frame: &Frame) -> Rows {
        let time = frame.time();
        let steps_of = |r: &Range<usize>| time[r.clone()].windows(2).map(|w| w[1] - w[0]);
        let mut steps: Vec<f64> = frame.sequences().iter().flat_map(steps_of).collect();
        steps.sort_by(f64::total_cmp);
        let gap = match steps.as_slice() {
            [] => f64::INFINITY,
            steps => GAP * stats::quantile_sorted(steps, USUAL),
        };
        steps.retain(|step| *step < gap);
        let rate = 1.0 / stats::mean(&steps);
        let parts = frame.sequences().iter().flat_map(|r| {
            let starts = r.clone().step_by(TOGETHER);
            starts.map(|start| start..r.end.min(start + TOGETHER))
        });
        let stretches = parts.filter(|rows| rows.len() >= FEWEST).map(|rows| {
            let stamps = time[rows.clone()].to_vec();
            let mut count = 0.0;
            let after = steps_of(&rows).map(|step| {
                count += if step < gap {
                    1.0
                } else {
                    (step * rate).round()
                };
                count
            });
            let counts: Vec<f64> = std::iter::once(0.0).chain(after).collect();
            Stretch {
                even: on_a_line(&counts, &stamps),
                rows,
                stamps,
            }
        });
        Rows {
            rate,
            stretches: stretches.collect(),
        }
    }

    /// Whether a tone that these values show by their stamps is an image of a larger one: at even
    /// times the larger one alone explains as much, and this one nothing beside it.
    fn show_an_image(&self, values: &[f64], own: f64, larger: f64) -> bool {
        let explained = |even: bool, tones: &[f64]| -> f64 {
            let of = |s: &Stretch| {
                let times = if even { &s.even } else { &s.stamps };
                explained(&values[s.rows.clone()], times, tones)
            };
            self.stretches.iter().map(of).sum()
        };
        let [by_stamps, at_even] = [false, true].map(|even| explained(even, &[larger]));
        let own_of = |even: bool, alone: f64| explained(even, &[larger, own]) - alone;
        let seen = own_of(false, by_stamps);
        seen > 0.0
            && at_even - by_stamps >= NEARLY_ALL * seen
            && own_of(true, at_even) <= (1.0 - NEARLY_ALL) * seen
    }
}

/// Values of the straight line over `x` that is nearest to `y`.
fn on_a_line(x: &[f64], y: &[f64]) -> Vec<f64> {
    let (mx, my) = (stats::mean(x), stats::mean(y));
    let of = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        x.iter().zip(y).map(|(x, y)| f(x - mx, y - my)).sum()
    };
    let slope = of(&|x, y| x * y) / of(&|x, _| x * x).max(f64::MIN_POSITIVE);
    x.iter().map(|x| my + slope * (x - mx)).collect()
}

/// Sum of squares of values that sines of some frequencies in Hz take off, beside a constant.
fn explained(values: &[f64], times: &[f64], tones: &[f64]) -> f64 {
    let mean = stats::mean(values);
    let values: Vec<f64> = values.iter().map(|v| v - mean).collect();
    let start = times.first().copied().unwrap_or(0.0);
    let mut columns = vec![vec![1.0; times.len()]];
    for tone in tones {
        let phase = |t: &f64| TAU * tone * (t - start);
        columns.push(times.iter().map(|t| phase(t).sin()).collect());
        columns.push(times.iter().map(|t| phase(t).cos()).collect());
    }
    let g: Vec<f64> = columns
        .iter()
        .flat_map(|a| columns.iter().map(|b| dot(a, b)))
        .collect();
    let b: Vec<f64> = columns.iter().map(|a| dot(a, &values)).collect();
    let x = Cholesky::new(&g, columns.len(), RANK_TOL).solve(&b);
    let all = dot(&values, &values);
    all - squared_error(&g, &b, all, &x)
}

#[cfg(test)]
mod tests {
    use super::super::reasons::tests::weights;
    use super::*;
    use residual_columns::stats::Rng;
    use residual_effects::{effect, Variant};

    /// Tones in Hz, with their amplitudes.
    type Tones<'a> = &'a [(f64, f64)];

    /// Whether rows that were measured at some times, in s, with other stamps, show the second tone
    /// as an image of the first.
    fn is_image(times: &[f64], stamps: &[f64], tones: Tones, own: f64, larger: f64) -> bool {
        let mut rng = Rng::new(4);
        let mut value = |t: &f64| -> f64 {
            let sine = |(f, a): &(f64, f64)| a * (TAU * f * t + 0.3).sin();
            tones.iter().map(sine).sum::<f64>() + 0.05 * rng.normal()
        };
        let values: Vec<f64> = times.iter().map(&mut value).collect();
        let whole = std::iter::once(0..stamps.len()).collect();
        let rows = Rows::new(&Frame::new(vec![], stamps.to_vec(), whole));
        rows.show_an_image(&values, own, larger)
    }

    /// Even times, and their stamps on a grid that are the first after them.
    fn on_a_grid(rate: f64, grid: f64) -> (Vec<f64>, Vec<f64>) {
        let times = (0..4000).map(|k| f64::from(k) / rate);
        times.map(|t| (t, (t / grid - 1e-9).ceil() * grid)).unzip()
    }

    #[test]
    fn stamps_on_a_grid_have_images() {
        for (rate, grid, tone, image) in [
            // In turn 10 and 15 ms apart: half of the row rate, less the tone.
            (80.0, 0.005, 30.0, 10.0),
            // 1, 1, 1 and 2 ms: a quarter of it, less the tone.
            (800.0, 0.001, 70.0, 130.0),
            // The pattern of 73 rows and 200 stamps in a second: 19 Hz.
            (73.0, 0.005, 30.0, 11.0),
        ] {
            let (times, stamps) = on_a_grid(rate, grid);
            let own = [(tone, 1.0)];
            assert!(is_image(&times, &stamps, &own, image, tone), "{rate}");
            // The same two, both there.
            let both = [(tone, 1.0), (image, 0.5)];
            assert!(!is_image(&times, &stamps, &both, image, tone), "{rate}");
            assert!(!is_image(&times, &times, &both, image, tone), "{rate}");
            assert!(!is_image(&stamps, &stamps, &both, image, tone), "{rate}");
        }
    }

    /// 100 Hz beside 50 Hz are a part of 200 rows in a second away.
    #[test]
    fn a_tone_in_rows_at_uneven_times_is_none() {
        let mut rng = Rng::new(9);
        let times: Vec<f64> = (0..4000)
            .map(|k| (f64::from(k) + 0.25 * rng.normal().clamp(-1.6, 1.6)) / 200.0)
            .collect();
        let both = [(50.0, 1.0), (100.0, 0.4)];
        assert!(!is_image(&times, &times, &both, 100.0, 50.0));
    }

    #[test]
    fn a_missing_row_does_not_change_the_rate() {
        // Of 1, 1, 1 and 2 ms the step over a missing row is as long as two of them: it counts as
        // one.
        for (rate, grid, off) in [(80.0, 0.005, 0.5 / 80.0), (800.0, 0.001, 1.0 / 36.0)] {
            let (_, stamps) = on_a_grid(rate, grid);
            let time: Vec<f64> = (stamps.iter().enumerate())
                .filter(|(k, _)| k % 37 != 5)
                .map(|(_, t)| *t)
                .collect();
            let whole = std::iter::once(0..time.len()).collect();
            let found = Rows::new(&Frame::new(vec![], time, whole)).rate;
            assert!((found / rate - 1.0).abs() < off, "{found}");
        }
    }

    #[test]
    fn images_are_seen_where_rows_are_missing() {
        let (mut times, mut stamps) = on_a_grid(80.0, 0.005);
        for all in [&mut times, &mut stamps] {
            let mut k = 0;
            all.retain(|_| {
                k += 1;
                k % 37 != 5
            });
        }
        assert!(is_image(&times, &stamps, &[(30.0, 1.0)], 10.0, 30.0));
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
