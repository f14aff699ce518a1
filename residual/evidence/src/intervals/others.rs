//! What the other effects of the model leave open. An interval with all of them held would be too
//! narrow: their nonlinear parameters are estimates, and friction turns over at a reversal in a way
//! that is not known exactly.

use residual_columns::error::Error;
use residual_columns::expr::Expr;
use residual_columns::stats;
use residual_effects::{Context, EffectKind, Friction};
use residual_fit::problem::{Column, Problem};
use residual_search::model::{Chosen, Fitted, Model};
use residual_search::scan::reach;
use residual_search::Search;
use std::sync::Arc;

/// Step of another effect's parameter for its derivative, as a share of the distance to the next
/// values of its grid.
const STEP: f64 = 0.5;

/// Shortest and longest distance over which friction may turn over, as a share of the way between
/// two reversals, and the number of distances. Friction with memory of the path is a sum of such
/// elements (Al-Bender, Lampaert and Swevers 2005, where each is a spring that slips).
const TURNS: (f64, f64, usize) = (0.01, 0.3, 3);

/// Columns that the final model may contain beside those of the effect at `index`, none of them
/// named: the derivatives of the prediction by the nonlinear parameters of the other effects, and
/// the ways in which their friction may turn over.
pub(super) fn columns(
    search: &Search,
    chosen: &[Chosen],
    index: usize,
) -> Result<Vec<Column>, Error> {
    let fitted = search.fit(chosen)?;
    let mut out = Vec::new();
    for other in (0..chosen.len()).filter(|k| *k != index) {
        if let Some(column) = derivative(search, chosen, other, &fitted)? {
            out.push(Arc::new(column));
        }
    }
    if !turns_over(chosen[index].effect.kind()) {
        let friction = chosen.iter().enumerate().filter(|(k, _)| *k != index);
        out.extend(turns(search, friction.map(|(_, c)| c), &fitted)?);
    }
    Ok(out)
}

/// The change of the prediction with the nonlinear parameter of the effect `at`, all coefficients
/// held. `None` if it has none.
fn derivative(
    search: &Search,
    chosen: &[Chosen],
    at: usize,
    fitted: &Fitted,
) -> Result<Option<Vec<f64>>, Error> {
    let own = &chosen[at];
    let psi = own.variant.psi.as_ref();
    let Some(psi) = psi.filter(|p| p.refine && !own.variant.observed) else {
        return Ok(None);
    };
    let (low, high) = reach(psi.resolution, &psi.grid, own.psi);
    let mut out = vec![0.0; search.problem.y.len()];
    for (end, sign) in [(high, 1.0), (low, -1.0)] {
        let mut moved = chosen.to_vec();
        moved[at].psi += STEP * (end - own.psi);
        let model = Model::with(search.spec, &moved)?;
        let rows = fitted.fit.with_coefficients(&search.problem, &model)?;
        out.iter_mut().zip(rows).for_each(|(o, r)| *o += sign * r);
    }
    if let Some(projector) = &fitted.fit.projector {
        projector.take_out(&mut out);
    }
    Ok(Some(out))
}

/// Whether an effect is itself what a friction does at a reversal: it could not be told from the
/// turns of another.
fn turns_over(kind: EffectKind) -> bool {
    use EffectKind as Kind;
    matches!(
        kind,
        Kind::Coulomb
            | Kind::LoadDependentCoulomb
            | Kind::AngleFriction
            | Kind::Stribeck
            | Kind::Presliding
            | Kind::Hysteresis
            | Kind::Backlash
    )
}

/// The dry friction of some effects, turning over at several distances after each reversal.
fn turns<'a>(
    search: &Search,
    effects: impl Iterator<Item = &'a Chosen>,
    fitted: &Fitted,
) -> Result<Vec<Column>, Error> {
    let (mut plain, mut with_load) = (false, false);
    for c in effects {
        plain |= c.effect.friction().is_some() || c.effect.kind() == EffectKind::Hysteresis;
        with_load |= c.effect.friction() == Some(Friction::WithLoad);
    }
    if !plain {
        return Ok(vec![]);
    }
    let ctx = search.scan_on(fitted).context();
    let Some(x) = &ctx.position else {
        return Ok(vec![]);
    };
    let position = search.problem.eval(&fitted.fit.view, &Expr::parse(x)?)?;
    let way = between_reversals(&search.problem, &position);
    if way <= 0.0 {
        return Ok(vec![]);
    }
    let (shortest, longest, count) = TURNS;
    let load = ctx.measure().text;
    let mut out = Vec::new();
    for distance in Context::log_grid(shortest * way, longest * way, count) {
        let turn = format!("dahl({x}, {distance})");
        let texts = [
            Some(turn.clone()),
            with_load.then(|| format!("{turn} * {load}")),
        ];
        for text in texts.into_iter().flatten() {
            let column = search
                .problem
                .eval(&fitted.fit.view, &Expr::parse(&text)?)?;
            let column = about_means(&search.problem, &column);
            out.push(match &fitted.fit.projector {
                None => Arc::new(column),
                Some(projector) => projector.rest(&Arc::new(column)),
            });
        }
    }
    Ok(out)
}

/// A column without its mean in each sequence: how friction turns over says nothing about the level
/// of a whole run, which a drift or a temperature may change.
fn about_means(p: &Problem, column: &[f64]) -> Vec<f64> {
    let mut out = column.to_vec();
    for rows in p.rows_of_runs() {
        let own = &mut out[rows];
        let mean = stats::mean(own);
        own.iter_mut().for_each(|x| *x -= mean);
    }
    out
}

/// The usual way between two reversals: half of all that is travelled is travelled on longer ones.
fn between_reversals(p: &Problem, position: &[f64]) -> f64 {
    let mut ways = Vec::new();
    for rows in p.rows_of_runs() {
        let mut way = 0.0f64;
        for pair in position[rows].windows(2) {
            let step = pair[1] - pair[0];
            if step * way < 0.0 {
                ways.push(way.abs());
                way = 0.0;
            }
            way += step;
        }
        ways.push(way.abs());
    }
    ways.sort_unstable_by(f64::total_cmp);
    let half = 0.5 * ways.iter().sum::<f64>();
    let mut travelled = 0.0;
    let longer = ways.into_iter().find(|way| {
        travelled += way;
        travelled >= half
    });
    longer.unwrap_or(0.0)
}
