//! What the other effects of the model leave open. An interval with all of them held would be too narrow: their nonlinear
//! parameters are estimates, and friction turns over at a reversal in a way that is not known exactly.

use crate::effects::{Context, EffectKind, Friction};
use crate::error::Error;
use crate::expr::Expr;
use crate::model::{Chosen, Fitted, Model};
use crate::problem::{Column, Problem};
use crate::scan::reach;
use crate::search::Search;
use crate::stats;
use std::sync::Arc;

/// Step of another effect's parameter for its derivative, as a share of the distance to the next values of its grid.
const STEP: f64 = 0.5;

/// Shortest and longest distance over which friction may turn over, as a share of the way between two reversals, and the number of
/// distances. Friction with memory of the path is a sum of such elements (Al-Bender, Lampaert and Swevers 2005, where each is a
/// spring that slips).
const TURNS: (f64, f64, usize) = (0.01, 0.3, 3);

/// Columns that the final model may contain beside those of the effect at `index`, none of them named: the derivatives of the
/// prediction by the nonlinear parameters of the other effects, and the ways in which their friction may turn over.
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

/// The change of the prediction with the nonlinear parameter of the effect `at`, all coefficients held. `None` if it has none.
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

/// Whether an effect is itself what a friction does at a reversal: it could not be told from the turns of another.
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

/// A column without its mean in each sequence: how friction turns over says nothing about the level of a whole run, which a drift
/// or a temperature may change.
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

#[cfg(test)]
mod tests {
    use crate::stats::Rng;
    use crate::{analyse, spec::Spec, Data};

    const LATE_S: f64 = 0.03;
    const DAMPING: f64 = 0.05;
    const FRICTION: f64 = 0.04;

    /// One row before the target is formed: the command now and when it acts, velocity, and friction that turns over gradually.
    struct Row {
        command: f64,
        late: f64,
        velocity: f64,
        turning: f64,
    }

    /// The 95 % intervals of damping and delay from six runs. The command changes when the motion does: `together` is the share of
    /// the command's slope in the velocity.
    fn intervals(only: &str, together: f64, target: impl Fn(&Row) -> f64) -> [Option<[f64; 2]>; 2] {
        let (runs, rows, dt) = (6, 1500, 0.02);
        let mut rng = Rng::new(3);
        let mut columns = vec![Vec::new(); 4];
        for run in 0..runs {
            let w = 1.0 + 0.07 * f64::from(run);
            let command = |t: f64| 3.0 + (1.1 * w * t).sin() + 0.5 * (2.9 * w * t).sin();
            let slope = |t: f64| 1.1 * w * (1.1 * w * t).cos() + 1.45 * w * (2.9 * w * t).cos();
            let (mut springs, mut angle) = ([0.0; 2], 0.0);
            for i in 0..rows {
                let t = f64::from(i) * dt;
                let velocity = together * slope(t) + (0.7 * w * t).cos() + (4.3 * w * t).sin();
                let dx: f64 = velocity * dt;
                // Two springs that slip, one far softer than the other.
                for (spring, distance) in springs.iter_mut().zip([0.05, 0.6]) {
                    *spring = f64::clamp(*spring + 2.0 * dx / distance, -1.0, 1.0);
                }
                angle += dx;
                let row = Row {
                    command: command(t),
                    late: command(t - LATE_S),
                    velocity,
                    turning: 0.5 * (springs[0] + springs[1]),
                };
                let noise = 0.03 * rng.normal();
                let values = [target(&row) + noise, row.command, velocity, angle];
                columns.iter_mut().zip(values).for_each(|(c, v)| c.push(v));
            }
        }
        let model = format!(
            "[roles]\ntime = {{ column = \"t\", unit = \"s\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
             command = {{ column = \"c\", unit = \"N\" }}\nvelocity = {{ column = \"v\", unit = \"rad/s\" }}\n\
             angle = {{ column = \"q\", unit = \"rad\" }}\n\
             [selection]\nonly = [{only}]\n\
             [[terms]]\nname = \"tension\"\nexpr = \"command\"\nfixed = 1.0\n"
        );
        let rows = rows as usize;
        let time = (0..columns[0].len()).map(|i| (i % rows) as f64 * dt);
        let names = ["target", "command", "velocity", "angle"];
        let data = Data::from_columns(time.collect(), names.into_iter().zip(columns))
            .sequences((0..runs as usize).map(|run| run * rows..(run + 1) * rows))
            .build()
            .unwrap();
        let report = analyse(&Spec::parse(&model).unwrap(), data, &mut ()).unwrap();
        ["damping", "delay"].map(|name| report.effects.iter().find_map(|e| e.ci.get(name).copied()))
    }

    fn width(interval: Option<[f64; 2]>) -> f64 {
        let [low, high] = interval.expect("the effect is found");
        high - low
    }

    /// Where the command changes with the motion, damping is known as well as the delay, and no better.
    #[test]
    fn an_interval_is_wider_where_another_effect_is_late_by_an_unknown_time() {
        let both = |together: f64| {
            let target = |r: &Row| r.late + DAMPING * r.velocity;
            intervals("\"viscous\", \"delay\"", together, target)[0]
        };
        let alone = |together: f64| {
            let target = |r: &Row| r.command + DAMPING * r.velocity;
            intervals("\"viscous\"", together, target)[0]
        };
        let apart = width(both(0.0)) / width(alone(0.0));
        let together = width(both(3.0)) / width(alone(3.0));
        assert!(apart < 1.3, "{apart}");
        assert!(together > 2.0, "{together}");
    }

    /// The catalogue of this test has friction that changes at once only.
    #[test]
    fn an_interval_allows_for_friction_that_turns_over_otherwise() {
        let target = |r: &Row| r.late + FRICTION * r.turning;
        let [_, delay] = intervals("\"coulomb\", \"delay\"", 1.0, target);
        let [low, high] = delay.expect("the delay is found");
        assert!(low <= LATE_S && LATE_S <= high, "{low} to {high}");
        assert!(high - low < 0.5 * LATE_S, "{low} to {high}");
    }
}
