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
    /// A piece that makes dry friction larger by definition: with the other sign it is no such effect.
    pub adds_to_friction: Option<usize>,
}

impl Variant {
    /// A variant without nonlinear parameter.
    pub fn linear(label: &str, pieces: Vec<Piece>) -> Variant {
        Variant {
            label: label.into(),
            psi: None,
            build: Box::new(move |_| Build::Add(pieces.clone())),
            derive: None,
            adds_to_friction: None,
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
            adds_to_friction: None,
        }
    }

    pub fn with(mut self, derive: Derive) -> Variant {
        self.derive = Some(derive);
        self
    }

    pub fn adding_to_friction(mut self, piece: usize) -> Variant {
        self.adds_to_friction = Some(piece);
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

/// Unit of a quotient: brackets where the lower unit is a quotient or power itself.
pub(crate) fn ratio(upper: &str, lower: &str) -> String {
    if lower.chars().all(char::is_alphabetic) {
        format!("{upper}/{lower}")
    } else {
        format!("{upper}/({lower})")
    }
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
            ratio(self.unit(), x)
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

/// `docs/residual/effects.md` says what the catalogue offers, in the catalogue's own words.
#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Frame;
    use crate::model::{Fit, Model};
    use std::collections::BTreeMap;

    const PAGE: &str = include_str!("../../../docs/residual/effects.md");

    /// Logs that show everything: motion with stops, loads of both signs, a ripple, a tone, a target in steps,
    /// one run long after the other.
    fn problem(amplitude: f64) -> Problem {
        let (rows, dt) = (1200, 0.02);
        let n = 2 * rows;
        let time: Vec<f64> = (0..n)
            .map(|i| (i % rows) as f64 * dt + (i / rows) as f64 * 100.0)
            .collect();
        let elapsed: Vec<f64> = (0..n).map(|i| (i % rows) as f64 * dt).collect();
        let of = |f: &dyn Fn(f64) -> f64| elapsed.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let velocity = of(&|t| {
            if t < 0.3 || (0.7 * t).sin() > 0.8 {
                0.0
            } else {
                amplitude * ((1.3 * t).sin() + 0.4 * (2.9 * t).cos())
            }
        });
        let mut angle = Vec::new();
        let mut at = 0.0;
        for v in &velocity {
            at += 8.0 * v * dt / amplitude;
            angle.push(at);
        }
        let command = of(&|t| 2.0 * (0.9 * t).sin() + (0.31 * t).cos());
        let pose = of(&|t| (0.4 * t).sin());
        let mut rng = stats::Rng::new(1);
        let target: Vec<f64> = (0..n)
            .map(|i| {
                let y = command[i]
                    + 0.3 * (5.0 * angle[i]).sin() * (1.0 + command[i])
                    + 0.2 * (std::f64::consts::TAU * 7.3 * time[i]).sin()
                    + 0.05 * rng.normal();
                (y / 0.01).round() * 0.01
            })
            .collect();
        let columns = vec![
            ("target".to_string(), target),
            ("command".into(), command),
            ("velocity".into(), velocity),
            ("angle".into(), angle),
            ("temperature".into(), of(&|t| 20.0 + (0.2 * t).sin())),
            ("POSE".into(), pose.clone()),
            ("OTHER".into(), of(&|t| (0.23 * t).cos())),
            ("CHANNEL".into(), of(&|t| (1.7 * t).cos())),
        ];
        let frame = Frame::new(columns, time, vec![0..rows, rows..n]);
        let fold: Vec<u32> = (0..n).map(|i| (i / rows) as u32).collect();
        Problem::new(frame, &vec![true; n], &fold, 16, 1)
    }

    /// Forms on offer for one model: parameters with their units by effect and form, in catalogue order.
    fn offered(velocity: &str, terms: &str, out: &mut BTreeMap<(usize, String), Vec<String>>) {
        let spec = Spec::parse(&format!(
            "[roles]\ntime = {{ column = \"t\", unit = \"s\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
             command = {{ column = \"c\", unit = \"N\" }}\n{velocity}\
             temperature = {{ column = \"T\", unit = \"K\" }}\n\
             pose.POSE = {{ column = \"p\", unit = \"rad\" }}\npose.OTHER = {{ column = \"o\", unit = \"rad\" }}\n\
             channels.CHANNEL = {{ column = \"n\", unit = \"V\" }}\n{terms}"
        ))
        .unwrap();
        let problem = problem(if velocity.contains("m/s") { 1.0 } else { 3.0 });
        let model = Model::declared(&spec).unwrap();
        let fit = Fit::new(&problem, &model).unwrap();
        let context = crate::search::context(&problem, &spec, "command", &model, &fit);
        for (i, effect) in CATALOGUE.iter().enumerate() {
            for variant in effect.variants(&context) {
                if variant.label.contains("OTHER") {
                    continue;
                }
                let psi = variant
                    .psi
                    .as_ref()
                    .map_or(0.0, |p| p.grid[p.grid.len() / 2]);
                let count = match (variant.build)(psi) {
                    Build::Add(p) | Build::Local(p) => p.len(),
                    Build::Swap(_) | Build::SwapAll(_) => 0,
                };
                let known = out.entry((i, variant.label.clone())).or_default();
                for p in variant.params(psi, &vec![1.0; count]) {
                    let text = format!("`{}` {}", p.name, p.unit);
                    if !p.name.contains("OTHER") && !known.contains(&text) {
                        known.push(text);
                    }
                }
            }
        }
    }

    #[test]
    fn the_page_names_every_effect_form_and_parameter_and_no_other() {
        let rotating = "velocity = { column = \"v\", unit = \"rad/s\", deadband = 0.01 }\n\
                        angle = { column = \"a\", unit = \"rad\" }\n";
        let straight = "velocity = { column = \"v\", unit = \"m/s\", deadband = 0.01 }\n";
        let term =
            |expr: &str| format!("[[terms]]\nname = \"{expr}\"\nexpr = \"{expr}\"\nfixed = 1.0\n");
        let mut forms = BTreeMap::new();
        offered(rotating, &term("command"), &mut forms);
        // With friction declared, with the angle in the model, and without the command in it.
        offered(
            rotating,
            &(term("command") + &term("sgn(velocity, 0.01)")),
            &mut forms,
        );
        offered(rotating, &(term("command") + &term("angle")), &mut forms);
        offered(rotating, &term("POSE"), &mut forms);
        // Only what a straight motion adds: the units of all else are those of the turning one.
        let mut more = BTreeMap::new();
        offered(straight, &term("command"), &mut more);
        for (form, parameters) in more {
            forms.entry(form).or_insert(parameters);
        }
        let mut wanted: Vec<String> = CATALOGUE
            .iter()
            .map(|e| format!("| `{}` | {} | {} |", e.name(), e.meaning(), e.experiment()))
            .collect();
        for (i, effect) in CATALOGUE.iter().enumerate() {
            let own: Vec<_> = forms.iter().filter(|((k, _), _)| *k == i).collect();
            assert!(
                !own.is_empty(),
                "these logs offer nothing for {}",
                effect.name()
            );
            for ((_, label), parameters) in own {
                wanted.push(format!(
                    "| `{}` | {label} | {} |",
                    effect.name(),
                    parameters.join(", ")
                ));
            }
        }
        let page: Vec<&str> = PAGE.lines().filter(|l| l.starts_with("| `")).collect();
        assert!(
            page == wanted,
            "the rows of docs/residual/effects.md that start with an effect should be\n{}",
            wanted.join("\n")
        );
    }
}
