//! The forms that an effect offers: terms in the model's expression language, with at most one
//! nonlinear parameter.

use super::Form;

/// What a parameter is, where decisions depend on it. The effect that has the parameter says so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Nature {
    /// Nothing that a decision depends on.
    #[default]
    Other,
    /// Dry friction.
    Friction,
    /// Force per velocity.
    Damping,
    /// Force per square of the velocity.
    Drag,
    /// Force per acceleration.
    Inertia,
    /// Force per displacement.
    Stiffness,
    /// Force per displacement away from an unstable point.
    Unstable,
    /// Weight of a mass whose inertia is another parameter of the effect.
    Weight,
    /// Size of a wave.
    Amplitude,
    /// Phase of a wave.
    Phase,
    /// What comes with an effect and is not what its name says: it may be certain where the effect
    /// is not.
    Beside,
}

impl Nature {
    /// Whether all such parameters of one motion have the same sign: friction takes energy out of
    /// the motion, inertia is positive and a spring pulls back.
    pub fn has_one_sign(self) -> bool {
        use Nature::{Damping, Drag, Friction, Inertia, Stiffness};
        matches!(self, Friction | Damping | Drag | Inertia | Stiffness)
    }

    /// Whether the name of the effect is about this parameter.
    pub fn carries_the_name(self) -> bool {
        !matches!(self, Nature::Phase | Nature::Beside)
    }
}

/// One named number of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Param {
    /// Name, with the meaning in it.
    pub name: String,
    /// Value in `unit`.
    pub value: f64,
    /// Unit, as text.
    pub unit: String,
    /// What it is.
    pub nature: Nature,
}

impl Param {
    /// A number; see the fields.
    pub fn new(name: impl Into<String>, value: f64, unit: impl Into<String>) -> Param {
        Param {
            name: name.into(),
            value,
            unit: unit.into(),
            nature: Nature::Other,
        }
    }

    /// Says what it is.
    pub fn being(mut self, nature: Nature) -> Param {
        self.nature = nature;
        self
    }
}

/// A term of a variant: coefficient name and unit, expression text.
#[derive(Debug, Clone)]
pub struct Piece {
    /// Name of the coefficient.
    pub name: String,
    /// Unit of the coefficient.
    pub unit: String,
    /// The expression.
    pub text: String,
    /// What the coefficient is.
    pub nature: Nature,
}

impl Piece {
    /// A term.
    pub fn new(name: impl Into<String>, unit: impl Into<String>, text: impl Into<String>) -> Piece {
        Piece {
            name: name.into(),
            unit: unit.into(),
            text: text.into(),
            nature: Nature::Other,
        }
    }

    /// Says what the coefficient is.
    pub fn being(mut self, nature: Nature) -> Piece {
        self.nature = nature;
        self
    }

    /// The coefficient as a parameter.
    fn param(&self, value: f64) -> Param {
        Param::new(&self.name, value, &self.unit).being(self.nature)
    }
}

/// What a variant does to the model at one value of its nonlinear parameter.
#[derive(Debug, Clone)]
pub enum Build {
    /// Adds terms with free coefficients.
    Add(Vec<Piece>),
    /// Adds terms whose coefficients every sequence has for itself (phases of a free-running tone).
    Local(Vec<Piece>),
    /// Replaces columns inside the declared terms; no new coefficient.
    Swap(Vec<(String, String)>),
    /// Replaces columns inside declared terms and effects, found so far or later; no new
    /// coefficient.
    SwapAll(Vec<(String, String)>),
    /// Sends every term, declared or of an effect found so far or later, through this expression,
    /// in which `everything` stands for it; no new coefficient. It is linear and has no column.
    Through(String),
    /// Adds terms with the coefficient 1.
    Known(Vec<Piece>),
}

/// A nonlinear parameter and where to look for it.
#[derive(Debug, Clone)]
pub struct Psi {
    /// Name of the parameter.
    pub name: &'static str,
    /// Its unit.
    pub unit: String,
    /// Values tried first, ascending.
    pub grid: Vec<f64>,
    /// Whether values between grid points are worth trying.
    pub refine: bool,
    /// How far a value may be off its grid point; `None` means up to the neighbours.
    pub resolution: Option<f64>,
}

impl Psi {
    /// A parameter that is refined up to the neighbours of the best value of its grid.
    pub fn new(name: &'static str, unit: impl Into<String>, grid: Vec<f64>) -> Psi {
        Psi {
            name,
            unit: unit.into(),
            grid,
            refine: true,
            resolution: None,
        }
    }

    /// Only the values of the grid are possible.
    pub fn given(mut self) -> Psi {
        self.refine = false;
        self
    }

    /// A value may be off its grid point by the resolution.
    pub fn within(mut self, resolution: f64) -> Psi {
        self.resolution = Some(resolution);
        self
    }

    /// A value as a parameter.
    pub fn param(&self, value: f64) -> Param {
        Param::new(self.name, value, &self.unit)
    }

    /// Least and greatest value that the parameter may take: somewhat beyond the grid, or as far as
    /// its resolution beyond it.
    pub fn limits(&self) -> (f64, f64) {
        let (Some(first), Some(last)) = (self.grid.first(), self.grid.last()) else {
            return (f64::NEG_INFINITY, f64::INFINITY);
        };
        match self.resolution {
            Some(d) => (first - d, last + d),
            None => {
                let low = if *first > 0.0 { 0.7 } else { 1.4 };
                let high = if *last > 0.0 { 1.4 } else { 0.7 };
                (low * first, high * last)
            }
        }
    }
}

/// Distance from a limit, as a share of it or of the resolution, at which a value is at the limit:
/// a refinement comes near it without reaching it.
const AT_LIMIT: f64 = 0.01;

impl Psi {
    /// Whether a fitted value is at the lower and at the upper limit of the search, so that the
    /// best one may lie beyond it. A scan may refine a value to somewhat beyond a limit.
    pub fn at_limits(&self, value: f64) -> [bool; 2] {
        let (low, high) = self.limits();
        let near = |limit: f64| AT_LIMIT * self.resolution.unwrap_or(limit.abs());
        [value <= low + near(low), value >= high - near(high)].map(|at| at && self.refine)
    }
}

type Derive = fn(f64, &[f64], &[Piece], &Psi) -> Vec<Param>;

/// Whether an effect can have this nonlinear parameter and these coefficients.
type Possible = Box<dyn Fn(f64, &[f64]) -> bool + Send + Sync>;

/// One way in which an effect can show.
pub struct Variant {
    /// Label for readers, unique within the effect.
    pub label: String,
    /// What code must know of the form.
    pub form: Form,
    /// The nonlinear parameter, if it has one.
    pub psi: Option<Psi>,
    /// What it does to the model at a value of that parameter.
    pub build: Box<dyn Fn(f64) -> Build + Send + Sync>,
    /// Turns coefficients into physical parameters; by default they are listed as they are.
    pub derive: Option<Derive>,
    /// A piece that makes dry friction larger by definition: with the other sign it is no such
    /// effect.
    pub adds_to_friction: Option<usize>,
    /// A piece that is friction itself: against the other dry friction it would drive the motion.
    pub along_friction: Option<usize>,
    /// What its fitted values have to satisfy to be this effect; `None` where any do. Two effects
    /// may have the same curve with opposite signs, so one that is impossible is no candidate.
    pub possible: Option<Possible>,
    /// The nonlinear parameter as reports show it, where the search uses another form of it.
    pub shown: Option<fn(f64) -> f64>,
    /// The target itself shows the form, without any model: nothing is fitted, and no decoy has to
    /// be surpassed.
    pub observed: bool,
}

impl Variant {
    /// A variant without nonlinear parameter.
    pub fn linear(label: &str, pieces: Vec<Piece>) -> Variant {
        Variant {
            label: label.into(),
            form: Form::Other,
            psi: None,
            build: Box::new(move |_| Build::Add(pieces.clone())),
            derive: None,
            adds_to_friction: None,
            along_friction: None,
            possible: None,
            shown: None,
            observed: false,
        }
    }

    /// One whose coefficients each sequence has for itself.
    pub fn by_sequence(pieces: Vec<Piece>) -> Variant {
        Variant {
            build: Box::new(move |_| Build::Local(pieces.clone())),
            ..Variant::linear("", vec![])
        }
    }

    /// A variant with one.
    pub fn profiled(
        label: &str,
        psi: Psi,
        build: impl Fn(f64) -> Build + Send + Sync + 'static,
    ) -> Variant {
        Variant {
            psi: Some(psi),
            build: Box::new(build),
            ..Variant::linear(label, vec![])
        }
    }

    /// Sets how reports show the nonlinear parameter.
    pub fn shown_as(mut self, shown: fn(f64) -> f64) -> Variant {
        self.shown = Some(shown);
        self
    }

    /// The nonlinear parameter as reports show it.
    pub fn shown(&self, psi: f64) -> f64 {
        self.shown.map_or(psi, |f| f(psi))
    }

    /// Whether some fitted values would make it another effect.
    pub fn has_conditions(&self) -> bool {
        self.possible.is_some() || self.adds_to_friction.is_some() || self.along_friction.is_some()
    }

    /// Marks the form as one that code must distinguish from others.
    pub fn form(mut self, form: Form) -> Variant {
        self.form = form;
        self
    }

    /// Sets how coefficients become physical parameters.
    pub fn with(mut self, derive: Derive) -> Variant {
        self.derive = Some(derive);
        self
    }

    /// Marks the piece that makes dry friction larger by definition.
    pub fn adding_to_friction(mut self, piece: usize) -> Variant {
        self.adds_to_friction = Some(piece);
        self
    }

    /// Marks the piece that is friction itself and cannot act against the other friction.
    pub fn along_friction(mut self, piece: usize) -> Variant {
        self.along_friction = Some(piece);
        self
    }

    /// Sets what nonlinear parameter and coefficients have to satisfy.
    pub fn possible(
        mut self,
        holds: impl Fn(f64, &[f64]) -> bool + Send + Sync + 'static,
    ) -> Variant {
        self.possible = Some(Box::new(holds));
        self
    }

    /// The same where each coefficient lies between bounds of its own.
    pub fn between(self, bounds: &'static [(f64, f64)]) -> Variant {
        self.possible(move |_, coef| {
            let mut all = coef.iter().zip(bounds);
            all.all(|(c, (low, high))| c >= low && c <= high)
        })
    }

    /// Marks the form as one that the target itself shows.
    pub fn observed(mut self) -> Variant {
        self.observed = true;
        self
    }

    /// Number of terms with a coefficient that the form adds at `psi`.
    pub fn pieces(&self, psi: f64) -> usize {
        match (self.build)(psi) {
            Build::Add(p) | Build::Local(p) => p.len(),
            Build::Swap(_) | Build::SwapAll(_) | Build::Through(_) | Build::Known(_) => 0,
        }
    }

    /// Number of fitted parameters at `psi`, the nonlinear one included.
    pub fn parameters(&self, psi: f64) -> usize {
        self.pieces(psi) + usize::from(self.psi.as_ref().is_some_and(|p| p.refine))
    }

    /// Whether every sequence has coefficients of its own at `psi`.
    pub fn is_local(&self, psi: f64) -> bool {
        matches!((self.build)(psi), Build::Local(_))
    }

    /// Physical parameters at `psi` with coefficients `coef`.
    pub fn params(&self, psi: f64, coef: &[f64]) -> Vec<Param> {
        let pieces = match (self.build)(psi) {
            Build::Add(p) | Build::Local(p) => p,
            Build::Swap(_) | Build::SwapAll(_) | Build::Through(_) | Build::Known(_) => vec![],
        };
        if let (Some(d), Some(p)) = (self.derive, &self.psi) {
            return d(psi, coef, &pieces, p);
        }
        let shape = self.psi.iter().map(|p| p.param(psi));
        shape.chain(coefficients(coef, &pieces)).collect()
    }
}

fn coefficients<'a>(coef: &'a [f64], pieces: &'a [Piece]) -> impl Iterator<Item = Param> + 'a {
    pieces.iter().zip(coef).map(|(p, c)| p.param(*c))
}

/// The coefficients without the nonlinear parameter, for [`Variant::with`].
pub fn coefficients_alone(_: f64, coef: &[f64], pieces: &[Piece], _: &Psi) -> Vec<Param> {
    coefficients(coef, pieces).collect()
}

/// Amplitude and phase of a sine and cosine pair, for [`Variant::with`].
pub fn amplitude_phase(_: f64, coef: &[f64], pieces: &[Piece], _: &Psi) -> Vec<Param> {
    let at = |k: usize| coef.get(k).copied().unwrap_or(0.0);
    let (s, c) = (at(0), at(1));
    let unit = pieces.first().map_or("", |p| &p.unit);
    vec![
        Param::new("amplitude", s.hypot(c), unit).being(Nature::Amplitude),
        Param::new("phase", c.atan2(s), "rad").being(Nature::Phase),
    ]
}

/// The same after the nonlinear parameter.
pub fn with_amplitude_phase(psi: f64, coef: &[f64], pieces: &[Piece], p: &Psi) -> Vec<Param> {
    let mut out = vec![p.param(psi)];
    out.extend(amplitude_phase(psi, coef, pieces, p));
    out
}

/// Unit of a quotient: brackets where the lower unit is a quotient or power itself.
pub fn ratio(upper: &str, lower: &str) -> String {
    if lower.chars().all(char::is_alphabetic) {
        format!("{upper}/{lower}")
    } else {
        format!("{upper}/({lower})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_at_the_end_of_what_was_searched_is_known() {
        let psi = |grid: &[f64], resolution| Psi {
            resolution,
            ..Psi::new("time_constant", "s", grid.to_vec())
        };
        let time = psi(&[0.01, 1.0, 100.0], None);
        for (value, at) in [
            (0.007, true),
            (0.00704, true),
            (0.0075, false),
            (0.01, false),
            (100.0, false),
            (139.9, true),
        ] {
            assert_eq!(time.at_limits(value).contains(&true), at, "{value}");
        }
        let place = psi(&[0.0, 2.0], Some(0.5));
        for (value, at) in [(-0.499, true), (-0.49, false), (0.0, false), (2.5, true)] {
            assert_eq!(place.at_limits(value).contains(&true), at, "{value}");
        }
        // Only its own values are possible: none lies beyond.
        let given = Psi {
            refine: false,
            ..psi(&[1.4], None)
        };
        assert!(given.at_limits(0.98) == [false, false]);
    }
}
