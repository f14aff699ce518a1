//! Names that are not the law of what they explain: a free form that contains them predicts
//! better, or one curve with no more parameters predicts as well as their sum.

use super::refusal::{Against, Refusal};
use crate::leftover::nameless::{self, Nameless};
use crate::leftover::STAND_IN;
use residual_columns::error::Error;
use residual_columns::format::num;
use residual_effects::{Build, EffectKind};
use residual_fit::problem::Problem;
use residual_log::spec::Spec;
use residual_search::model::{Chosen, Fit, Fitted, Model};
use residual_search::ranking::Acceptance;
use residual_search::scan::{t_statistic, Candidate, Offer, Scan};
use residual_search::{Outcome, Search};

/// Share of what a name explains that a form must explain in its place to contain it. A polygon in
/// seven knots does that for dry friction, of which it rounds the jump.
const CONTAINS: f64 = 0.7;

/// Share of what names explain that a form which contains them must add to refuse them. Of 19
/// synthetic sets with one effect of the catalogue one had any, of 0.8 %. The root of a flow beside
/// a share of it has 3.4 %, a spring whose stiffness grows by a quarter 1.7 %.
const LACK: f64 = 0.02;

/// Share of what a form adds from which something simpler stands for it: the catalogue has curves
/// in place of polygons, and loses some to another shape.
const STANDS_FOR: f64 = 0.7;

/// Standard errors, by block, by which names must predict better than one curve. With more a spring
/// and a weight that swings by 2.6 rad to both sides, which had 4, might not be told apart.
const BETTER: f64 = 1.0;

/// Effects that may be a straight line together: a square, where it is small.
const LINES: [EffectKind; 7] = [
    EffectKind::Offset,
    EffectKind::Gain,
    EffectKind::Quadratic,
    EffectKind::Viscous,
    EffectKind::Crosstalk,
    EffectKind::DriftTime,
    EffectKind::DriftTemperature,
];

/// The rows on which forms are compared: windows where there are many.
struct Rows<'s> {
    search: &'s Search<'s>,
    problem: &'s Problem,
    /// The model file, but that small gains count: they are compared with what names explain.
    spec: Spec,
}

impl<'s> Rows<'s> {
    fn new(search: &'s Search) -> Rows<'s> {
        let mut spec = search.spec.clone();
        spec.selection.material = 0.0;
        Rows {
            search,
            problem: search.thin.as_ref().unwrap_or(&search.problem),
            spec,
        }
    }

    fn fit(&self, chosen: &[Chosen]) -> Result<Fitted, Error> {
        let model = Model::with(self.search.spec, chosen)?;
        let fit = Fit::new(self.problem, &model)?;
        Ok(Fitted { model, fit })
    }

    fn scan<'a>(&'a self, on: &'a Fitted) -> Scan<'a> {
        Scan::new(self.problem, &self.spec, &self.search.load, on)
    }

    /// The model without some effects.
    fn without(&self, chosen: &[Chosen], left_out: &[usize]) -> Result<Fitted, Error> {
        let kept = chosen.iter().enumerate();
        let kept = kept.filter(|(i, _)| !left_out.contains(i));
        self.fit(&kept.map(|(_, c)| c.clone()).collect::<Vec<_>>())
    }

    fn rmse(&self, squares: f64) -> String {
        let unit = &self.search.spec.roles.target.unit;
        let mean = squares.max(0.0) / self.problem.y.len().max(1) as f64;
        format!("{} {unit}", num(mean.sqrt()))
    }

    /// For each form the names of which it tells the law: it explains most of what each does in its
    /// place.
    fn contained(
        &self,
        chosen: &[Chosen],
        offers: &[Offer<Nameless>],
        held: f64,
    ) -> Result<Vec<Vec<usize>>, Error> {
        let mut out: Vec<Vec<usize>> = offers.iter().map(|_| vec![]).collect();
        for own in 0..chosen.len() {
            let fitted = self.without(chosen, &[own])?;
            let least = CONTAINS * (fitted.squares() - held);
            for (offer, names) in offers.iter().zip(&mut out) {
                if self.fall(offer, &fitted) > least {
                    names.push(own);
                }
            }
        }
        Ok(out)
    }

    /// The squared error that a form takes off a model.
    fn fall(&self, offer: &Offer<Nameless>, on: &Fitted) -> f64 {
        let scan = Scan {
            screening: true,
            ..self.scan(on)
        };
        let found = scan.candidates(std::slice::from_ref(offer), None).pop();
        found.map_or(f64::NEG_INFINITY, |c| c.base - c.held)
    }

    /// A form on top of a model, tested against what decoys let chance explain.
    fn tested(&self, offer: &Offer<Nameless>, on: &Fitted) -> Option<Candidate<Nameless>> {
        let scan = self.scan(on);
        let mut found = scan.candidates(std::slice::from_ref(offer), None).pop()?;
        let acceptance = Acceptance {
            selection: &self.spec.selection,
            ..self.search.acceptance()
        };
        if !acceptance.significant(found.p) {
            found.p = found.p.min(scan.retest(&found, self.problem.y.len()));
        }
        acceptance.accepts(&found).then_some(found)
    }

    /// Whether names are a straight line over an expression, to [`LACK`] of what they explain. A
    /// curve over a range to one side of zero that predicts as well is no plainer.
    fn is_line(&self, over: &str, without: &Fitted, names: &Fitted) -> bool {
        let explained = without.squares() - names.squares();
        self.fall(&nameless::line(over), without) > (1.0 - LACK) * explained
    }

    /// The curve over an expression with no more than `parameters` that predicts best in the place
    /// of names, in words, if `names` do not predict better.
    fn law(
        &self,
        over: &str,
        parameters: usize,
        without: &Fitted,
        names: &Fitted,
    ) -> Option<(String, f64)> {
        let scan = self.scan(without);
        let mut laws = nameless::laws(&scan.context(), over);
        laws.retain(|law| law.variant.parameters(0.0) <= parameters);
        let all = scan.candidates(&laws, None);
        let best = all.iter().min_by(|a, b| a.held.total_cmp(&b.held))?;
        let better = t_statistic(&best.losses, &self.scan(names).base_losses(false));
        (better < BETTER).then(|| (best.origin.depends_on.clone(), best.held))
    }
}

/// Whether an effect puts another column in the place of one, as what comes late does.
fn moves(own: &Chosen) -> bool {
    matches!(
        (own.variant.build)(own.psi),
        Build::Swap(_) | Build::SwapAll(_) | Build::Through(_)
    )
}

/// Marks names that are not the law of what they explain: those of the form that adds most.
///
/// A form that contains a name, and explains much more, shows another law, or another effect over
/// the same variables. What one effect of the catalogue adds as well is such an effect, too small
/// to be named, unless a curve with no more parameters does as well as all of them.
pub(super) fn names_of_another_law(
    why: &mut [Option<Refusal>],
    search: &Search,
    outcome: &Outcome,
) -> Result<(), Error> {
    let chosen = &outcome.chosen;
    if chosen.is_empty() || search.is_rounding(outcome.fitted.squares()) {
        return Ok(());
    }
    // Where the model file offers these names alone, it says what it is.
    let only = &search.spec.selection.only;
    let is_chosen = |name: &String| chosen.iter().any(|c| c.effect.name() == name);
    if !only.is_empty() && only.iter().all(is_chosen) {
        return Ok(());
    }
    let rows = Rows::new(search);
    let all = rows.fit(chosen)?;
    let held = all.squares();
    let offers = nameless::offers(&rows.scan(&all).context());
    let contained = rows.contained(chosen, &offers, held)?;
    let curves = offers.iter().zip(&contained);
    let curves = curves.filter(|(o, n)| n.is_empty() && o.origin.curve_over().is_some());
    // What acts over another variable adds to each form of two.
    let beside = curves.map(|(o, _)| rows.fall(o, &all)).fold(0.0, f64::max);
    let further = outcome.last.ranked.iter();
    let further = further.min_by(|a, b| a.held.total_cmp(&b.held));
    let with_further = match further {
        Some(c) => Some((rows.fit(&[&chosen[..], &[c.choose()]].concat())?, c)),
        None => None,
    };
    let mut most: Option<(f64, Vec<usize>, String)> = None;
    for (offer, names) in offers.iter().zip(&contained).filter(|(_, n)| !n.is_empty()) {
        let without = rows.without(chosen, names)?;
        // Dry friction is a model of what surfaces do: no real one follows it to a few hundredths.
        // Nor does a command that is moved in time, between its rows: a clock that gains 35 ms over
        // a log in a closed loop, where the command has the noise of the reading, lacks 2.7 % to
        // the history of the load.
        let dry = |i: &usize| chosen[*i].effect.friction().is_some();
        let is_dry = names.iter().any(dry);
        let is_moved = names.iter().any(|i| moves(&chosen[*i]));
        let share = match offer.origin.acts_beside || is_dry || is_moved {
            true => STAND_IN,
            false => LACK,
        };
        let least = share * (without.squares() - held);
        let curve = offer.origin.curve_over();
        let found = rows.tested(offer, &all);
        let fall = found.map_or(0.0, |c| c.base - c.held);
        let lacks = fall > least && (curve.is_some() || beside < STANDS_FOR * fall);
        let as_much = |(with, _): &&(Fitted, _)| held - with.squares() > STANDS_FOR * fall;
        let another = with_further.as_ref().filter(|_| lacks).filter(as_much);
        let law = match curve {
            Some(over) if !is_dry && (names.len() > 1 || another.is_some()) => {
                let own: usize = names.iter().map(|i| chosen[*i].parameters()).sum();
                let own = own + another.map_or(0, |(_, c)| c.parameters);
                let with = another.map_or(&all, |(with, _)| with);
                let lines = names.iter().map(|i| &chosen[*i].effect);
                let mut lines = lines.chain(another.map(|(_, c)| &c.origin));
                match lines.all(|e| LINES.contains(&e.kind())) && rows.is_line(over, &without, with)
                {
                    true => None,
                    false => rows.law(over, own, &without, with),
                }
            }
            _ => None,
        };
        let words = match law {
            Some((law, squares)) => format!(
                "{law} in its place, with no more parameters, predicts as well as all that the \
                 catalogue has over {}: held-out RMSE {} against {}",
                curve.unwrap_or_default(),
                rows.rmse(squares),
                rows.rmse(held)
            ),
            None if lacks && another.is_none() => format!(
                "it is not the law: {} beside it predicts better, held-out RMSE {} against {}",
                offer.origin.depends_on,
                rows.rmse(held - fall),
                rows.rmse(held)
            ),
            None => continue,
        };
        if most.as_ref().is_none_or(|(m, ..)| fall > *m) {
            most = Some((fall, names.clone(), words));
        }
    }
    if let Some((_, names, words)) = most {
        for own in names {
            why[own] = Some(Against::AsASeries.refuses(words.clone()));
        }
    }
    Ok(())
}
