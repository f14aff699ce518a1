//! Why a name is not supported, and what its own parameters say against it.

use crate::intervals::Parameters;
use residual_columns::error::Error;
use residual_columns::format::num;
use residual_effects::{Context, Estimate};
use residual_search::model::Chosen;
use residual_search::{without, Outcome, Search};

/// Why a name is not supported.
#[derive(Clone)]
pub(super) struct Refusal {
    pub(super) why: String,
    pub(super) against: Against,
}

/// What stands against a name.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Against {
    /// Its own parameters.
    Itself,
    /// What it makes together with others of its kind: all of them go at once.
    AsASeries,
    /// The check data: the error with it over that without it.
    Check(f64),
    /// Other effects, or what is left: without them it may be supported.
    Others,
}

impl Against {
    pub(super) fn refuses(self, why: String) -> Refusal {
        Refusal { why, against: self }
    }

    /// Whether no other effect or data can support the name.
    pub(super) fn is_final(self) -> bool {
        matches!(self, Against::Itself | Against::AsASeries)
    }

    /// In which order effects are taken away; of equal ones the weakest is first.
    pub(super) fn order(self) -> f64 {
        match self {
            Against::Itself | Against::AsASeries => f64::INFINITY,
            Against::Check(harm) => harm,
            Against::Others => f64::NEG_INFINITY,
        }
    }
}

/// Why an effect with these parameters is impossible, if it is.
pub(super) fn impossible(
    ctx: &Context,
    outcome: &Outcome,
    index: usize,
    parameters: &Parameters,
) -> Option<String> {
    let own = &outcome.chosen[index];
    let estimate = Estimate {
        form: own.variant.form,
        label: &own.variant.label,
        params: &parameters.0,
        intervals: &parameters.1,
    };
    own.effect.impossible(&estimate, ctx)
}

/// Why an effect cannot be what its name says beside the others, if it cannot. The search saw to it
/// when the effect was chosen; effects that were chosen later may have changed it.
pub(super) fn contrary(
    search: &Search,
    ctx: &Context,
    chosen: &[Chosen],
    index: usize,
) -> Result<Option<String>, Error> {
    let (own, rest) = without(chosen, index);
    let simpler = own.effect.must_surpass(&own.variant, own.psi, ctx);
    if !own.variant.has_conditions() && simpler.is_empty() {
        return Ok(None);
    }
    let fitted = search.fit(&rest)?;
    let scan = search.scan_on(&fitted);
    if !scan.possible(&own.variant, own.psi) {
        return Ok(Some(
            "beside the other effects its coefficients are not possible for such an effect, as of friction that acts with the motion"
                .to_string(),
        ));
    }
    if simpler.is_empty() {
        return Ok(None);
    }
    let most = scan.in_sample(&(own.variant.build)(own.psi));
    let as_good = simpler.iter().find_map(|simpler| {
        let psi = simpler.psi.as_ref()?;
        let surpassed = |x: &&f64| scan.in_sample(&(simpler.build)(**x)) > most;
        let x = psi.grid.iter().find(|x| !surpassed(x))?;
        Some((simpler, *x, psi))
    });
    Ok(as_good.map(|(simpler, x, psi)| {
        format!(
            "{} of {} {} explains as much",
            simpler.label,
            num(x),
            psi.unit
        )
    }))
}

/// Why the nonlinear parameter of an effect says nothing, if it lies at the end of the range in
/// which it was looked for.
pub(super) fn at_end(own: &Chosen) -> Option<String> {
    let psi = own.variant.psi.as_ref()?;
    let [low, high] = psi.at_limits(own.psi);
    let [low_counts, high_counts] = own.effect.may_be_at_end(&own.variant);
    let beyond = (low && !low_counts) || (high && !high_counts);
    beyond.then(|| {
        format!(
            "{} {} lies at the end of the range in which such an effect is looked for: beyond it it is another one",
            psi.name,
            num(own.variant.shown(own.psi))
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use residual_effects::{effect, Build, EffectKind, Form, Piece, Psi, Variant};

    /// Beyond the longest distance of a presliding friction it is a hysteresis; below the shortest
    /// it holds at rest all the same.
    #[test]
    fn a_parameter_at_the_end_of_its_range_says_nothing() {
        let chosen = |kind, form, psi| {
            let range = Psi::new("distance", "rad", vec![0.01, 0.1, 1.0]);
            let build = |_| Build::Add(vec![Piece::new("friction", "N", "velocity")]);
            Chosen {
                effect: effect(kind),
                variant: std::sync::Arc::new(Variant::profiled("", range, build).form(form)),
                psi,
            }
        };
        let ends = |kind, form| {
            [0.006, 0.007, 0.0072, 1.2, 1.4, 1.5]
                .map(|psi| at_end(&chosen(kind, form, psi)).is_some())
        };
        let own = ends(EffectKind::Presliding, Form::ElasticTurn);
        assert_eq!(own, [false, false, false, false, true, true]);
        let own = ends(EffectKind::Creep, Form::Other);
        assert_eq!(own, [true, true, false, false, true, true]);
        // An order of a ripple is one of a spectrum's proposals.
        let own = ends(EffectKind::PeriodicAngle, Form::ShareOfLoad);
        assert_eq!(own, [false; 6]);
        // A drift that warms through at once is the plain one.
        let own = ends(EffectKind::DriftTemperature, Form::Other);
        assert_eq!(own, [false, false, false, false, true, true]);
    }
}
