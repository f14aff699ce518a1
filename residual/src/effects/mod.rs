//! The catalogue: every effect the analysis can name.
//!
//! An effect offers *variants*: ways in which it can show in a log with the given roles. A variant
//! is a list of terms in the model's expression language, with at most one nonlinear parameter
//! (a time constant, an order, a width) that the search profiles. To add an effect, write one file
//! with a type that implements [`Effect`] and its test, and add one row to [`CATALOGUE`].

use crate::expr::Expr;
use crate::problem::Problem;
use crate::spec::Spec;
use crate::stats;
use serde::{Deserialize, Serialize};

mod backlash;
mod cable_stretch;
mod clock_skew;
mod cosine_misalignment;
mod coulomb;
mod creep;
mod crosstalk;
mod delay;
mod drift_temperature;
mod drift_time;
mod gain;
mod geometry;
mod gravity_angle;
mod hysteresis;
mod inertia;
mod load_dependent_coulomb;
mod offset;
mod payload;
mod periodic_angle;
pub(crate) mod presliding;
mod quadratic;
mod quantisation;
mod saturation;
pub(crate) mod spectrum;
mod stribeck;
#[cfg(test)]
pub(crate) mod testbench;
mod tone;
mod viscous;

/// Every effect, simplest explanation first within a family.
pub(crate) const CATALOGUE: &[&dyn Effect] = &[
    &offset::Offset,
    &gain::Gain,
    &quadratic::Quadratic,
    &coulomb::Coulomb,
    &load_dependent_coulomb::LoadDependentCoulomb,
    &viscous::Viscous,
    &stribeck::Stribeck,
    &presliding::Presliding,
    &hysteresis::Hysteresis,
    &backlash::Backlash,
    &periodic_angle::PeriodicAngle,
    &cable_stretch::CableStretch,
    &inertia::Inertia,
    &delay::Delay,
    &clock_skew::ClockSkew,
    &saturation::Saturation,
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

/// Names of all effects, in catalogue order.
pub fn names() -> Vec<&'static str> {
    CATALOGUE.iter().map(|e| e.name()).collect()
}

/// What an effect means, in one sentence; `None` for an unknown name.
pub fn meaning(name: &str) -> Option<&'static str> {
    CATALOGUE
        .iter()
        .find(|e| e.name() == name)
        .map(|e| e.meaning())
}

/// The experiment that shows an effect by itself; `None` for an unknown name.
pub fn experiment(name: &str) -> Option<&'static str> {
    CATALOGUE
        .iter()
        .find(|e| e.name() == name)
        .map(|e| e.experiment())
}

/// One effect of the catalogue.
pub(crate) trait Effect: Sync {
    /// Name in reports and in `selection.only`.
    fn name(&self) -> &'static str;
    /// One sentence: what it is.
    fn meaning(&self) -> &'static str;
    /// The experiment that exposes this effect and no other.
    fn experiment(&self) -> &'static str;
    /// Expression of the variable that exposes the effect, for plots.
    fn against(&self, ctx: &Context) -> String {
        ctx.load.clone()
    }
    /// Whether it can be there more than once (another tone, another channel).
    fn repeatable(&self) -> bool {
        false
    }
    /// The ways it can show in these data; empty when the roles it needs are absent.
    fn variants(&self, ctx: &Context) -> Vec<Variant>;
}

/// One named number of an effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Param {
    /// Name, with the meaning in it.
    pub name: String,
    /// Value in `unit`.
    pub value: f64,
    /// Unit, as text.
    pub unit: String,
}

/// A term of a variant: coefficient name and unit, expression text.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    pub name: String,
    pub unit: String,
    pub text: String,
}

impl Piece {
    pub fn new(name: impl Into<String>, unit: impl Into<String>, text: impl Into<String>) -> Piece {
        Piece {
            name: name.into(),
            unit: unit.into(),
            text: text.into(),
        }
    }
}

/// What a variant does to the model at one value of its nonlinear parameter.
#[derive(Debug, Clone)]
pub(crate) enum Build {
    /// Adds terms with free coefficients.
    Add(Vec<Piece>),
    /// Adds terms whose coefficients every sequence has for itself (phases of a free-running tone).
    Local(Vec<Piece>),
    /// Replaces columns inside the declared terms; no new coefficient.
    Swap(Vec<(String, String)>),
    /// Replaces columns inside declared terms and effects, found so far or later; no new coefficient.
    SwapAll(Vec<(String, String)>),
}

/// A nonlinear parameter and where to look for it.
#[derive(Debug, Clone)]
pub(crate) struct Psi {
    pub name: &'static str,
    pub unit: String,
    /// Values tried first, ascending.
    pub grid: Vec<f64>,
    /// Whether values between grid points are worth trying.
    pub refine: bool,
    /// How far a value may be off its grid point; `None` means up to the neighbours.
    pub resolution: Option<f64>,
}

type Derive = fn(f64, &[f64], &[Piece], &Psi) -> Vec<Param>;

/// One way in which an effect can show.
pub(crate) struct Variant {
    /// Label, unique within the effect.
    pub label: String,
    pub psi: Option<Psi>,
    pub build: Box<dyn Fn(f64) -> Build + Send + Sync>,
    /// Turns coefficients into physical parameters; by default they are listed as they are.
    pub derive: Option<Derive>,
}

impl Variant {
    /// A variant without nonlinear parameter.
    pub fn linear(label: &str, pieces: Vec<Piece>) -> Variant {
        Variant {
            label: label.into(),
            psi: None,
            build: Box::new(move |_| Build::Add(pieces.clone())),
            derive: None,
        }
    }

    /// A variant with one.
    pub fn profiled(
        label: &str,
        psi: Psi,
        build: impl Fn(f64) -> Build + Send + Sync + 'static,
    ) -> Variant {
        Variant {
            label: label.into(),
            psi: Some(psi),
            build: Box::new(build),
            derive: None,
        }
    }

    pub fn with(mut self, derive: Derive) -> Variant {
        self.derive = Some(derive);
        self
    }

    /// Physical parameters at `psi` with coefficients `coef`.
    pub fn params(&self, psi: f64, coef: &[f64]) -> Vec<Param> {
        let pieces = match (self.build)(psi) {
            Build::Add(p) | Build::Local(p) => p,
            Build::Swap(_) | Build::SwapAll(_) => vec![],
        };
        if let (Some(d), Some(p)) = (self.derive, &self.psi) {
            return d(psi, coef, &pieces, p);
        }
        let mut out: Vec<Param> = self
            .psi
            .iter()
            .map(|p| Param {
                name: p.name.into(),
                value: psi,
                unit: p.unit.clone(),
            })
            .collect();
        out.extend(pieces.iter().zip(coef).map(|(p, c)| Param {
            name: p.name.clone(),
            value: *c,
            unit: p.unit.clone(),
        }));
        out
    }
}

/// Amplitude and phase of a sine and cosine pair, for [`Variant::with`].
pub(crate) fn amplitude_phase(psi: f64, coef: &[f64], pieces: &[Piece], p: &Psi) -> Vec<Param> {
    let (s, c) = (
        coef.first().copied().unwrap_or(0.0),
        coef.get(1).copied().unwrap_or(0.0),
    );
    vec![
        Param {
            name: p.name.into(),
            value: psi,
            unit: p.unit.clone(),
        },
        Param {
            name: "amplitude".into(),
            value: s.hypot(c),
            unit: pieces.first().map(|p| p.unit.clone()).unwrap_or_default(),
        },
        Param {
            name: "phase".into(),
            value: c.atan2(s),
            unit: "rad".into(),
        },
    ]
}

/// What an effect may know about the data when it proposes variants.
pub(crate) struct Context<'a> {
    pub problem: &'a Problem,
    pub spec: &'a Spec,
    /// The declared model's prediction as an expression: what the rig is loaded with.
    pub load: String,
    /// Residual of the current model on fitted rows.
    pub residual: &'a [f64],
    /// Columns that the current model uses, effects found so far included.
    pub columns: Vec<String>,
    /// Whether the current model has dry friction already.
    pub friction: bool,
    /// Velocity expression (the role, or the derivative of the angle).
    pub velocity: Option<String>,
    /// Standstill band of the velocity.
    pub deadband: f64,
    /// Position expression (the angle role, or the integral of the velocity).
    pub position: Option<String>,
    /// Median step of time, s.
    pub dt: f64,
    /// Longest sequence, s.
    pub span: f64,
}

impl Context<'_> {
    /// Unit of the target.
    pub fn unit(&self) -> &str {
        &self.spec.roles.target.unit
    }

    /// `target unit / x`, for coefficients.
    pub fn per(&self, x: &str) -> String {
        if x.is_empty() {
            self.unit().to_string()
        } else if x == self.unit() {
            "1".into()
        } else {
            format!("{}/({x})", self.unit())
        }
    }

    pub fn has_command(&self) -> bool {
        self.spec.roles.command.is_some()
    }

    /// Whether enough of the fitted rows are at rest to show what friction does there.
    pub fn rests(&self) -> bool {
        let Some(v) = &self.velocity else {
            return false;
        };
        stats::mean(&self.values(&format!("sgn({v}, {}) == 0", self.deadband))) > 0.005
    }

    /// Values of an expression on fitted rows; empty if it cannot be evaluated.
    pub fn values(&self, text: &str) -> Vec<f64> {
        self.problem
            .eval_text(&self.problem.plain, text, true)
            .map_or_else(|_| vec![], |v| v.to_vec())
    }

    /// 2 % and 98 % quantiles of an expression; `None` if it is constant or cannot be evaluated.
    pub fn range(&self, text: &str) -> Option<(f64, f64)> {
        self.problem.range(text)
    }

    /// Name of the velocity's unit.
    pub fn velocity_unit(&self) -> String {
        match &self.spec.roles.velocity {
            Some(v) => v.unit.clone(),
            None => format!("{}/s", self.spec.roles.unit("angle")),
        }
    }

    /// Name of the position's unit.
    pub fn position_unit(&self) -> String {
        match &self.spec.roles.angle {
            Some(a) => a.unit.clone(),
            None => {
                let v = self.velocity_unit();
                v.strip_suffix("/s")
                    .map_or(format!("{v}·s"), str::to_string)
            }
        }
    }

    /// Radians per unit, if `unit` is an angle.
    pub fn radians(unit: &str) -> Option<f64> {
        match unit.trim() {
            "rad" | "radian" | "radians" => Some(1.0),
            "deg" | "degree" | "degrees" | "°" => Some(std::f64::consts::PI / 180.0),
            "rev" | "turn" | "turns" => Some(std::f64::consts::TAU),
            "mrad" => Some(1e-3),
            _ => None,
        }
    }

    /// Angles in the data: (name for reports, expression in radians, total range in radians).
    pub fn angles(&self) -> Vec<(String, String, f64)> {
        let mut all: Vec<(String, String)> = self
            .spec
            .roles
            .pose
            .iter()
            .map(|(n, c)| (n.clone(), c.unit.clone()))
            .collect();
        if let Some(a) = &self.spec.roles.angle {
            all.push(("angle".into(), a.unit.clone()));
        }
        all.into_iter()
            .filter_map(|(n, unit)| {
                let k = Context::radians(&unit)?;
                let (lo, hi) = self.range(&n)?;
                let text = if k == 1.0 {
                    n.clone()
                } else {
                    format!("({n} * {k})")
                };
                Some((n, text, (hi - lo) * k))
            })
            .collect()
    }

    /// Time-varying columns that the declared terms use.
    pub fn declared_columns(&self) -> Vec<String> {
        let mut out = std::collections::BTreeSet::new();
        for t in self.spec.terms.iter().filter(|t| t.effect.is_empty()) {
            if let Ok(e) = Expr::parse(&t.expr) {
                out.extend(e.names());
            }
        }
        out.into_iter()
            .filter(|n| {
                !["time", "elapsed", "file"].contains(&n.as_str()) && self.range(n).is_some()
            })
            .collect()
    }

    /// Logarithmic grid.
    pub fn log_grid(lo: f64, hi: f64, n: usize) -> Vec<f64> {
        (0..n)
            .map(|i| lo * (hi / lo).powf(i as f64 / (n - 1).max(1) as f64))
            .collect()
    }
}
