//! The declared model before any search: its fit, its errors, its prediction as an expression.

use crate::figures::{figures, Figures};
use crate::model::{Fit, Fitted, Model, WorkTerm};
use residual_columns::error::Error;
use residual_columns::expr::Expr;
use residual_columns::nan;
use residual_effects::EffectKind;
use residual_fit::diagnostics::correlation_rows;
use residual_fit::problem::Problem;
use residual_log::data::{largest, Data};
use residual_log::spec::{Selection, Spec};
use serde::{Deserialize, Serialize};

/// A declared term of the model, as fitted before any effect was added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DeclaredTerm {
    /// Name in the model file.
    pub name: String,
    /// Its coefficient, in `unit`.
    #[serde(deserialize_with = "nan::from_null")]
    pub coefficient: f64,
    /// Unit of the coefficient, as in the model file.
    pub unit: String,
    /// Whether the model file fixes the coefficient; else it was fitted.
    pub fixed: bool,
    /// Whether each sequence has a coefficient of its own; then `coefficient` is their RMS.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub per_sequence: bool,
}

/// The declared model alone, without a search.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Baseline {
    /// Its errors.
    pub figures: Figures,
    /// Its terms.
    pub terms: Vec<DeclaredTerm>,
    /// Rows of the frame that were fitted.
    pub rows: Vec<usize>,
    /// Residual on those rows when their group is held out.
    pub held: Vec<f64>,
}

/// The regression problem on data.
pub fn problem(data: &Data, selection: &Selection) -> Problem {
    let mut problem = Problem::new(
        data.frame().clone(),
        data.keep(),
        data.fold(),
        selection.decoys,
        selection.seed,
    )
    .with_parts(data.parts());
    problem.values_per_s = data.values_per_s();
    problem
}

/// Fits the declared model and holds out each group; looks for nothing.
///
/// # Errors
/// [`Error::Data`], [`Error::RankDeficient`] or [`Error::Model`].
pub fn baseline(spec: &Spec, data: &Data) -> Result<Baseline, Error> {
    check_selection(spec)?;
    let mut problem = problem(data, &spec.selection);
    let declared = fit_declared(&mut problem, spec)?;
    Ok(Baseline {
        figures: figures(&problem, &declared.fit, spec.selection.seed),
        terms: terms(&declared),
        rows: data.kept_rows(),
        held: declared.fit.held,
    })
}

/// Refuses names in `selection` that are no effects.
pub fn check_selection(spec: &Spec) -> Result<(), Error> {
    let selection = &spec.selection;
    match selection
        .only
        .iter()
        .chain(&selection.except)
        .find(|name| EffectKind::named(name).is_none())
    {
        None => Ok(()),
        Some(name) => Err(Error::model(format!(
            "selection names `{name}`, which is no effect; known are {}",
            residual_effects::names().join(", ")
        ))),
    }
}

/// Target less prediction, row by row, of a model whose coefficients are all fixed; a term without
/// one counts nothing.
pub fn residual_of_fixed(p: &Problem, model: &Model) -> Result<Vec<f64>, Error> {
    let mut out = p.y.to_vec();
    for (term, k) in model.terms.iter().filter_map(|t| Some((t, t.fixed?))) {
        let values = p.eval(&p.plain, &term.expr)?;
        out.iter_mut()
            .zip(values.iter())
            .for_each(|(o, v)| *o -= k * v);
    }
    Ok(out)
}

/// Checks that the data can be analysed, fits the declared model, and cuts the blocks to the colour
/// of its residual.
pub fn fit_declared(problem: &mut Problem, spec: &Spec) -> Result<Fitted, Error> {
    check_excitation(problem, spec)?;
    check_terms(problem, spec)?;
    let model = Model::declared(spec)?;
    let first = Fit::new(problem, &model)?;
    if first.dropped.iter().any(|d| *d) {
        let terms = first
            .free
            .iter()
            .zip(&first.dropped)
            .filter(|(_, d)| **d)
            .map(|(i, _)| model.terms[*i].name.clone())
            .collect();
        return Err(Error::RankDeficient { terms });
    }
    problem.cut_blocks(
        correlation_rows(problem, &first.residual),
        spec.selection.decoys,
    );
    let fit = Fit::new(problem, &model)?;
    Ok(Fitted { model, fit })
}

/// Refuses terms whose values are too large to be squared and summed: no coefficient could be
/// fitted to them.
fn check_terms(p: &Problem, spec: &Spec) -> Result<(), Error> {
    for term in &spec.terms {
        let values = p.eval(&p.plain, &Expr::parse(&term.expr)?)?;
        let largest = largest("target");
        if let Some(bad) = values.iter().find(|v| v.abs() > largest) {
            return Err(Error::data(
                format!(
                    "the declared term `{}` is {bad:e} on a row that is fitted, beyond {largest:e}: it cannot be squared and summed",
                    term.name
                ),
                "Correct its expression, the scale of its columns, or rows.keep",
            ));
        }
    }
    Ok(())
}

/// Refuses data on which no answer would mean anything.
fn check_excitation(p: &Problem, spec: &Spec) -> Result<(), Error> {
    let varies = |v: &[f64]| {
        v.iter()
            .any(|x| (x - v[0]).abs() > 1e-12 * v[0].abs().max(1e-300))
    };
    if !varies(&p.y) {
        return Err(Error::data(
            "the target is constant on all fitted rows",
            "Check roles.target and rows.keep",
        ));
    }
    let inputs: Vec<String> = spec
        .roles
        .all()
        .into_iter()
        .map(|(n, _)| n)
        .filter(|n| !["time", "target"].contains(&n.as_str()) && !spec.roles.groups.contains_key(n))
        .collect();
    if !inputs.is_empty()
        && !inputs.iter().any(|n| {
            p.frame
                .column(n)
                .is_some_and(|c| varies(&p.gather(c.to_vec())))
        })
    {
        return Err(Error::data(
            format!("constant excitation: {} never change on the fitted rows", inputs.join(", ")),
            "No effect can be told from another without motion or varying load; record an experiment that varies them",
        ));
    }
    Ok(())
}

/// Global terms of a model with their coefficients.
fn coefficients(fitted: &Fitted) -> Vec<(&WorkTerm, f64)> {
    let mut k = fitted.fit.theta.iter();
    let global = fitted.model.terms.iter().filter(|t| !t.local);
    global
        .map(|t| {
            (
                t,
                t.fixed.unwrap_or_else(|| k.next().copied().unwrap_or(0.0)),
            )
        })
        .collect()
}

/// The prediction of a model's declared terms with their coefficients written in, as an expression.
/// The load is what the drive imposes: where terms of the command are declared, the others are no
/// load.
pub fn load_expression(fitted: &Fitted) -> String {
    load_of(coefficients(fitted))
}

/// The load with the coefficients that the declared terms have beside the effects of a fitted
/// model: of the `declared` terms as they are, and with the columns that effects replace. Both are
/// the same where no effect replaces a column.
pub fn load_expressions(declared: &Fitted, fitted: &Fitted) -> Vec<String> {
    let mut replaced = coefficients(fitted);
    replaced.retain(|(t, _)| t.chosen.is_none());
    let mut plain = coefficients(declared);
    for ((_, own), (_, other)) in plain.iter_mut().zip(&replaced) {
        *own = *other;
    }
    let mut loads = vec![load_of(plain), load_of(replaced)];
    loads.dedup();
    loads
}

fn load_of(mut parts: Vec<(&WorkTerm, f64)>) -> String {
    parts.retain(|(_, a)| *a != 0.0);
    let of_command = |(t, _): &(&WorkTerm, f64)| t.expr.names().contains("command");
    if parts.iter().any(of_command) {
        parts.retain(of_command);
    }
    written(&parts)
}

/// The declared model's whole prediction with its coefficients written in, as an expression.
pub fn prediction_expression(declared: &Fitted) -> String {
    written(&coefficients(declared))
}

fn written(parts: &[(&WorkTerm, f64)]) -> String {
    let text: Vec<String> = parts
        .iter()
        .map(|(t, a)| Expr::Num(*a).op("*", t.expr.clone()).to_string())
        .collect();
    if text.is_empty() {
        "0".into()
    } else {
        format!("({})", text.join(" + "))
    }
}

/// Declared terms for reports.
pub fn terms(declared: &Fitted) -> Vec<DeclaredTerm> {
    let global = coefficients(declared)
        .into_iter()
        .map(|(t, a)| (t, a, false));
    // A coefficient for each sequence is given by its size over the sequences.
    let local = declared
        .fit
        .local
        .iter()
        .map(|(i, size)| (&declared.model.terms[*i], *size, true));
    global
        .chain(local)
        .map(|(t, coefficient, per_sequence)| DeclaredTerm {
            name: t.name.clone(),
            coefficient,
            unit: t.unit.clone(),
            fixed: t.fixed.is_some(),
            per_sequence,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_is_no_effect_is_refused() {
        let with = |names: &str| {
            let spec = Spec::parse(&format!(
                "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\" }}\n\
                 [selection]\n{names}\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n"
            ));
            check_selection(&spec.unwrap())
        };
        assert_eq!(with("only = [\"coulomb\"]\nexcept = [\"delay\"]"), Ok(()));
        for names in ["only = [\"gremlins\"]", "except = [\"gremlins\"]"] {
            let error = with(names).unwrap_err().to_string();
            assert!(
                error.contains("`gremlins`") && error.contains("payload"),
                "{error}"
            );
        }
    }
    #[test]
    fn a_term_that_cannot_be_squared_is_refused() {
        let spec = Spec::parse(
            "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
             command = { column = \"c\" }\n[[terms]]\nname = \"gain\"\nexpr = \"1e150 * command\"\n",
        );
        let column = |a: f64| (0..60).map(|i| (a * f64::from(i)).sin()).collect();
        let time = (0..60).map(|i| f64::from(i % 30)).collect();
        let data = Data::from_columns(time, [("command", column(1.0)), ("target", column(0.7))])
            .sequences([0..30, 30..60])
            .build();
        let says = baseline(&spec.unwrap(), &data.unwrap()).unwrap_err();
        assert!(says.to_string().contains("term `gain` is"), "{says}");
    }
}
