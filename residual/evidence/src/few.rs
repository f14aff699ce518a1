//! Few rows that carry most of the squared error: whatever was found or not found beside them is
//! about them.

use residual_columns::format::{num, percent};
use residual_log::data::Data;
use residual_log::finding::Finding;
use residual_log::hygiene::FEW_ROWS;

/// Share of the squared error that few rows carry. In noise of a normal distribution half a percent
/// of the rows carry 5 %, in one with tails as those of Student's t with three degrees of freedom
/// 25 %.
const MOST: f64 = 0.5;

/// Share of the rows that are few.
const FEW: f64 = 0.005;

/// The same for rows that the checks of the data have seen already.
const SUSPECTS: f64 = 0.25;

/// What is said of few rows of the data that carry most of the squared error of `residual`, which
/// has a value for each row that is fitted.
pub fn few_rows(residual: &[f64], data: &Data) -> Option<Finding> {
    let rows = data.kept_rows();
    let total: f64 = residual.iter().map(|r| r * r).sum();
    if rows.len() != residual.len() || total <= 0.0 {
        return None;
    }
    let mut worst: Vec<usize> = (0..rows.len()).collect();
    worst.sort_unstable_by(|a, b| residual[*b].abs().total_cmp(&residual[*a].abs()));
    let carried = |some: &[usize]| some.iter().map(|k| residual[*k].powi(2)).sum::<f64>() / total;
    let few = &worst[..((FEW * rows.len() as f64) as usize).max(1).min(rows.len())];
    let seen: Vec<usize> = (0..rows.len())
        .filter(|k| data.suspects().binary_search(&rows[*k]).is_ok())
        .collect();
    let (count, share, remedy) = if carried(&seen) >= SUSPECTS {
        let remedy = "the checks of the data name them; hygiene.spikes = \"drop\" leaves them out";
        (seen.len(), carried(&seen), remedy)
    } else if carried(few) >= MOST {
        // The fewest that carry as much.
        let mut sum = 0.0;
        let least = few.iter().take_while(|k| {
            let more = sum < MOST;
            sum += residual[**k].powi(2) / total;
            more
        });
        let least = least.count();
        let remedy =
            "look at them first, and leave them out with rows.keep where they are no measurement";
        (least, carried(&worst[..least]), remedy)
    } else {
        return None;
    };
    let first = rows[*worst.first()?];
    let file = data.frame().column("file").map(|f| f[first] as usize);
    let file = file.and_then(|f| data.file_names().get(f).cloned());
    let file = file.map_or(String::new(), |f| format!("{f}, "));
    let target = data.frame().column("target").map_or(f64::NAN, |y| y[first]);
    let first = format!("{file}time {} s", num(data.frame().time()[first]));
    Some(Finding {
        check: FEW_ROWS.into(),
        count,
        what: format!(
            "{count} of {} rows carry {} of the squared error (the worst: {first}, target {}): {remedy}",
            rows.len(),
            percent(share),
            num(target)
        ),
        first,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_columns::stats::Rng;

    /// A residual with `bad` rows that are `times` as large as the others.
    fn residual(bad: usize, times: f64) -> Vec<f64> {
        let mut rng = Rng::new(3);
        let of = |i: usize| {
            if i % 997 == 5 && i < 997 * bad {
                times
            } else {
                1.0
            }
        };
        (0..9000).map(|i| rng.normal() * of(i)).collect()
    }

    fn said(residual: &[f64]) -> Option<Finding> {
        let time = (0..residual.len()).map(|i| i as f64).collect();
        let data = Data::from_columns(time, [("target", residual.to_vec())])
            .groups((0..residual.len()).map(|i| i / 900).collect())
            .build()
            .unwrap();
        few_rows(residual, &data)
    }

    #[test]
    fn few_rows_that_carry_the_error_are_counted() {
        let found = said(&residual(3, 2000.0)).unwrap();
        assert!(found.count <= 3, "{found:?}");
        assert!(found.what.contains("of 9000 rows carry"), "{found:?}");
        assert_eq!(said(&residual(0, 1.0)), None);
        assert_eq!(said(&residual(3, 8.0)), None);
    }
}
