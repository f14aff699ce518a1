//! What the blocks of the page have in common: tables of models, parameters, folds and what is
//! left.

use residual::expr::Expr;
use residual::spec::{Spec, Term};
use residual::{num, Baseline, Data, Error, Figures, Report};

/// Coulomb friction.
pub(crate) const COULOMB: &str = "sgn(velocity, 5)";
/// Coulomb friction in proportion to the declared load.
pub(crate) const SHARE: &str = "sgn(velocity, 5) * abs(command / 0.010)";
/// Speed up to which the reel counts as at rest, deg/s; as in the model files.
pub(crate) const STANDSTILL: f64 = 5.0;

/// A Markdown table.
pub(crate) fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let mut t = format!("| {} |\n|{}\n", head.join(" | "), "---|".repeat(head.len()));
    for r in rows {
        t.push_str(&format!("| {} |\n", r.join(" | ")));
    }
    t
}

/// The held-out RMSE with its interval.
pub(crate) fn with_interval(f: &Figures) -> String {
    let [lo, hi] = f.heldout_rmse_ci;
    format!("{} ({} to {})", num(f.heldout_rmse), num(lo), num(hi))
}

/// A fraction as a percentage.
pub(crate) fn percent(x: f64) -> String {
    format!("{:.2} %", 100.0 * x)
}

/// A fitted term.
fn term(expr: &str) -> Term {
    Term {
        name: expr.into(),
        expr: expr.into(),
        unit: String::new(),
        fixed: None,
        per: String::new(),
        effect: String::new(),
        fitted: None,
    }
}

/// The model with more fitted terms declared.
pub(crate) fn declaring(spec: &Spec, terms: &[&str]) -> Spec {
    let mut spec = spec.clone();
    spec.terms.extend(terms.iter().map(|t| term(t)));
    spec
}

/// Effects in the order of the report, each on top of the ones before.
pub(crate) fn steps(r: &Report) -> Vec<Vec<String>> {
    std::iter::once(vec!["declared".to_string(), with_interval(&r.baseline)])
        .chain(r.effects.iter().enumerate().map(|(i, e)| {
            let last = i + 1 == r.effects.len();
            let name = format!(
                "{} `{}` ({})",
                if i == 0 { "with" } else { "and" },
                e.name,
                e.form
            );
            let value = if last {
                with_interval(&r.last)
            } else {
                num(e.heldout_after)
            };
            vec![name, value]
        }))
        .collect()
}

/// The parameters of the effects, and their nearest rivals.
pub(crate) fn parameters(r: &Report) -> String {
    let mut rows = Vec::new();
    for e in &r.effects {
        for (name, value) in &e.params {
            let ci =
                e.ci.get(name)
                    .map_or("-".into(), |c| format!("{} to {}", num(c[0]), num(c[1])));
            let unit = e.units.get(name).cloned().unwrap_or_default();
            rows.push(vec![
                e.name.to_string(),
                name.clone(),
                num(*value),
                ci,
                unit,
            ]);
        }
    }
    let mut out = table(
        &["effect", "parameter", "value", "95 % interval", "unit"],
        &rows,
    );
    let rivals: Vec<Vec<String>> = r
        .effects
        .iter()
        .filter_map(|e| {
            let x = e.rival.as_ref()?;
            Some(vec![
                e.name.to_string(),
                x.name.to_string(),
                num(x.heldout_rmse),
                percent(x.behind),
            ])
        })
        .collect();
    if !rivals.is_empty() {
        out.push('\n');
        out.push_str(&table(
            &[
                "effect",
                "nearest rival in its place",
                "held-out RMSE with the rival, N",
                "excess",
            ],
            &rivals,
        ));
    }
    out
}

/// The verdict, and what the analysis found beside the effects: effects that are not material and
/// unexplained structure.
pub(crate) fn rest(r: &Report) -> String {
    let mut out = format!("Verdict: `{}`. {}\n", r.verdict.word(), r.summary());
    let mut rows: Vec<Vec<String>> = r
        .seen_not_material
        .iter()
        .map(|s| vec![format!("`{}`", s.name), s.form.clone(), percent(s.gain)])
        .collect();
    rows.extend(
        r.structure
            .iter()
            .map(|s| vec!["unexplained".into(), s.depends_on.clone(), percent(s.gain)]),
    );
    if !rows.is_empty() {
        out.push('\n');
        out.push_str(&table(
            &[
                "added to the final model",
                "form",
                "further reduction of held-out RMSE",
            ],
            &rows,
        ));
    }
    for a in &r.not_identifiable {
        let names: Vec<&str> = a.effects.iter().map(|e| e.as_str()).collect();
        out.push_str(&format!("\nNot distinguishable: {}.\n", names.join(", ")));
    }
    out
}

/// Root mean square.
pub(crate) fn rmse(v: impl Iterator<Item = f64>) -> f64 {
    let (n, s) = v.fold((0usize, 0.0), |(n, s), x| (n + 1, s + x * x));
    (s / n.max(1) as f64).sqrt()
}

/// Values of an expression on the fitted rows of a baseline.
pub(crate) fn values(data: &Data, b: &Baseline, expr: &str) -> Result<Vec<f64>, Error> {
    let v = Expr::parse(expr)?.eval(data.frame())?;
    Ok(b.rows.iter().map(|i| v[*i]).collect())
}

/// Held-out RMSE of each fold, before and after.
pub(crate) fn by_fold(data: &Data, before: &Baseline, after: &Baseline) -> String {
    let rows: Vec<Vec<String>> = data
        .folds()
        .iter()
        .enumerate()
        .map(|(f, name)| {
            let of = |b: &Baseline| {
                num(rmse(
                    b.rows
                        .iter()
                        .zip(&b.held)
                        .filter(|(i, _)| data.fold()[**i] as usize == f)
                        .map(|(_, r)| *r),
                ))
            };
            vec![name.clone(), of(before), of(after)]
        })
        .collect();
    table(
        &["held out", "declared, N", "with what was found, N"],
        &rows,
    )
}
