//! The catalogue: every effect the analysis can name.
//!
//! An effect offers *variants*: ways in which it can show in a log with the given roles. A variant
//! is a list of terms in the model's expression language, with at most one nonlinear parameter (a
//! time constant, an order, a width) that the search profiles. To add an effect, write one file
//! with a type that implements [`Effect`], one with its test in `residual/tests/analysis/effects`,
//! and add one row to [`CATALOGUE`] and one [`EffectKind`].

mod angle_friction;
mod backlash;
mod cable_stretch;
mod clock_skew;
mod context;
mod cosine_misalignment;
mod coulomb;
mod creep;
mod crosstalk;
mod delay;
mod drift_temperature;
mod drift_time;
mod estimate;
mod gain;
mod geometry;
mod gravity_angle;
mod hysteresis;
mod inertia;
mod kind;
mod kink;
mod load_dependent_coulomb;
mod offset;
mod payload;
mod periodic_angle;
mod presliding;
mod quadratic;
mod quantisation;
mod saturation;
mod sensor_lag;
mod slew_limit;
mod spectrum;
mod stribeck;
mod tone;
mod variant;
mod viscous;

pub use angle_friction::sector_of;
pub use context::Context;
pub use estimate::Estimate;
pub use kind::{EffectKind, Form};
pub use kind::{Found, Friction, Remedy, Setting};
pub use tone::lines_of_inputs;
use variant::{amplitude_phase, coefficients_alone, with_amplitude_phase};
pub use variant::{ratio, Build, Nature, Param, Piece, Psi, Variant};

/// Every effect, simplest explanation first within a family.
pub const CATALOGUE: &[&dyn Effect] = &[
    &offset::Offset,
    &gain::Gain,
    &quadratic::Quadratic,
    &kink::Kink,
    &coulomb::Coulomb,
    &load_dependent_coulomb::LoadDependentCoulomb,
    &viscous::Viscous,
    &angle_friction::AngleFriction,
    &stribeck::Stribeck,
    &presliding::Presliding,
    &hysteresis::Hysteresis,
    &backlash::Backlash,
    &periodic_angle::PeriodicAngle,
    &cable_stretch::CableStretch,
    &inertia::Inertia,
    &delay::Delay,
    &sensor_lag::SensorLag,
    &clock_skew::ClockSkew,
    &saturation::Saturation,
    &slew_limit::SlewLimit,
    &quantisation::Quantisation,
    &drift_time::DriftTime,
    &drift_temperature::DriftTemperature,
    &creep::Creep,
    &crosstalk::Crosstalk,
    &tone::Tone,
    &cosine_misalignment::CosineMisalignment,
    &geometry::Geometry,
    &gravity_angle::GravityAngle,
    &payload::Payload,
];

/// An effect of the catalogue by reference: what the search handles.
pub type EffectRef = &'static dyn Effect;

/// The effect of a kind.
pub fn effect(kind: EffectKind) -> EffectRef {
    let found = CATALOGUE.iter().find(|e| e.kind() == kind);
    // A test holds the catalogue against the kinds.
    *found.unwrap_or(&CATALOGUE[0])
}

/// Names of all effects, in catalogue order.
pub fn names() -> Vec<&'static str> {
    EffectKind::ALL.iter().map(|k| k.as_str()).collect()
}

/// What an effect means, in one sentence; `None` for an unknown name.
pub fn meaning(name: &str) -> Option<&'static str> {
    EffectKind::named(name).map(EffectKind::meaning)
}

/// The experiment that shows an effect by itself; `None` for an unknown name.
pub fn experiment(name: &str) -> Option<&'static str> {
    EffectKind::named(name).map(EffectKind::experiment)
}

/// A form of another effect that looks like an effect in some data.
pub struct Lookalike {
    /// The other effect.
    pub kind: EffectKind,
    /// Its form.
    pub form: Variant,
    /// Standard errors by which it must predict worse to be excluded.
    pub excluded_from: f64,
    /// Whether it may be meant though its name was refused: what the data are too few to show under
    /// its name they do not show under another name either.
    pub though_refused: bool,
}

impl Lookalike {
    /// The forms of effects in the catalogue.
    fn of(kinds: &[EffectKind], excluded_from: f64, ctx: &Context) -> Vec<Lookalike> {
        let forms = |kind: &EffectKind| {
            let kind = *kind;
            let forms = effect(kind).variants(ctx).into_iter();
            forms.map(move |form| Lookalike {
                kind,
                form,
                excluded_from,
                though_refused: false,
            })
        };
        kinds.iter().flat_map(forms).collect()
    }
}

/// One effect of the catalogue.
pub trait Effect: Sync {
    /// Which effect it is.
    fn kind(&self) -> EffectKind;
    /// Name in reports and in `selection.only`.
    fn name(&self) -> &'static str {
        self.kind().as_str()
    }
    /// Expression of the variable that exposes the effect, for plots.
    fn against(&self, ctx: &Context) -> String {
        ctx.load.clone()
    }
    /// A chosen form at the value of its nonlinear parameter, with the sine and cosine of any order
    /// of its angle, as a ripple has; `None` where it has none. A weight and a cosine have order 1.
    fn of_any_order(&self, _form: &Variant, _psi: f64, _ctx: &Context) -> Option<Variant> {
        None
    }
    /// Expressions of the variables that can expose one of its forms. The plot takes the one that
    /// shows the most.
    fn axes(&self, _form: &Variant, _psi: f64, ctx: &Context) -> Vec<String> {
        vec![self.against(ctx)]
    }
    /// Another effect that has the same curve in a form with this label, whatever the data; `None`
    /// for most.
    fn twin(&self, _label: &str) -> Option<EffectKind> {
        None
    }
    /// Forms of other effects that look like this one where the data hold too little of what
    /// distinguishes them. Unless the data exclude such a form, they do not tell which of the two
    /// it is. Empty for most.
    fn lookalikes(&self, _ctx: &Context) -> Vec<Lookalike> {
        vec![]
    }
    /// Whether it can be there more than once (another tone, another channel).
    fn repeatable(&self) -> bool {
        false
    }
    /// Whether it has a witness besides the command, so that feedback in a closed loop cannot
    /// imitate it although it is built from the command.
    fn has_witness(&self) -> bool {
        false
    }
    /// Which kind of dry friction it is; `None` for everything else.
    fn friction(&self) -> Option<Friction> {
        None
    }
    /// The setting of a board that it shares with other effects, if any.
    fn setting(&self) -> Option<Setting> {
        None
    }
    /// What a board can compensate of it; empty if it cannot.
    fn remedies(&self, _found: &Found) -> Vec<Remedy> {
        vec![]
    }
    /// Why these parameters cannot be this effect: physics forbids them, or they lie below the
    /// resolution of the data. `None` if they can.
    fn impossible(&self, _estimate: &Estimate, _ctx: &Context) -> Option<String> {
        None
    }
    /// Simpler forms that must explain less than this one with the value `psi` of its parameter, at
    /// each value of their own grids: else the name says more than the data. Empty for most.
    fn must_surpass(&self, _form: &Variant, _psi: f64, _ctx: &Context) -> Vec<Variant> {
        vec![]
    }
    /// Whether the nonlinear parameter of a form may lie at the lower and at the upper end of the
    /// range in which it is looked for. Most that do are another effect.
    fn may_be_at_end(&self, _form: &Variant) -> [bool; 2] {
        [false; 2]
    }
    /// The ways it can show in these data; empty when the roles it needs are absent.
    fn variants(&self, ctx: &Context) -> Vec<Variant>;
}
