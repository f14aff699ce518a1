//! The model in work: declared terms plus the effects chosen so far.

use residual_columns::error::Error;
use residual_columns::expr::Expr;
use residual_effects::{Build, EffectKind, EffectRef, Variant};
use residual_fit::problem::{through_of, Replaced};
use residual_log::spec::Spec;
use std::sync::Arc;

mod fit;
mod projector;

pub use fit::{Fit, Fitted};
pub use projector::Projector;

/// One term in work.
#[derive(Debug, Clone)]
pub struct WorkTerm {
    /// Name of the term.
    pub name: String,
    /// Its expression.
    pub expr: Expr,
    /// Unit of its coefficient.
    pub unit: String,
    /// Its coefficient, if it is not fitted.
    pub fixed: Option<f64>,
    /// Index of the chosen effect that added it; `None` for declared terms.
    pub chosen: Option<usize>,
    /// Whether every sequence has its own coefficient.
    pub local: bool,
}

/// An effect in the model.
#[derive(Clone)]
pub struct Chosen {
    /// The effect.
    pub effect: EffectRef,
    /// The form.
    pub variant: Arc<Variant>,
    /// Its nonlinear parameter; 0 without one.
    pub psi: f64,
}

impl Chosen {
    /// Number of fitted parameters.
    pub fn parameters(&self) -> usize {
        self.variant.parameters(self.psi)
    }

    /// Whether another choice is the same form of the same effect.
    pub fn is_form(&self, other: &Chosen) -> bool {
        (self.effect.kind(), &self.variant.label) == (other.effect.kind(), &other.variant.label)
    }

    /// Whether no further effect of this kind can be there.
    pub fn excludes(&self, kind: EffectKind) -> bool {
        self.effect.kind() == kind && !self.effect.repeatable()
    }
}

/// Columns and what stands in their place.
type Pairs = Vec<(String, Expr)>;

fn parsed(pairs: &[(String, String)]) -> Result<Pairs, Error> {
    pairs
        .iter()
        .map(|(n, t)| Ok((n.clone(), Expr::parse(t)?)))
        .collect()
}

fn replace(expr: &Expr, pairs: &Pairs) -> Expr {
    expr.substitute(&|n| {
        pairs
            .iter()
            .find(|(name, _)| name == n)
            .map(|(_, e)| e.clone())
    })
}

/// Terms of declared model and chosen effects.
#[derive(Debug, Clone)]
pub struct Model {
    /// The terms, declared ones first.
    pub terms: Vec<WorkTerm>,
    /// What chosen effects replaced in everything, in terms that come later as well. The terms are
    /// written without it; see [`Model::written_out`].
    pub replaced: Vec<Replaced>,
}

impl Model {
    /// The declared model.
    pub fn declared(spec: &Spec) -> Result<Model, Error> {
        let terms = spec
            .terms
            .iter()
            .map(|t| {
                Ok(WorkTerm {
                    name: t.name.clone(),
                    expr: Expr::parse(&t.expr)?,
                    unit: t.unit.clone(),
                    fixed: t.fixed,
                    chosen: None,
                    local: t.per == "sequence",
                })
            })
            .collect::<Result<_, Error>>()?;
        Ok(Model {
            terms,
            replaced: vec![],
        })
    }

    /// A term in the columns of the log, whatever was replaced.
    pub fn written_out(&self, expr: &Expr) -> Expr {
        self.replaced
            .iter()
            .rev()
            .fold(expr.clone(), |e, replaced| match replaced {
                Replaced::Columns(pairs) => replace(&e, pairs),
                Replaced::Terms(through) => through_of(through, &e),
            })
    }

    /// Adds one effect at `psi`, as choice number `index`.
    pub fn apply(&mut self, build: &Build, index: usize) -> Result<(), Error> {
        match build {
            Build::Add(pieces) | Build::Local(pieces) | Build::Known(pieces) => {
                for p in pieces {
                    self.terms.push(WorkTerm {
                        name: p.name.clone(),
                        expr: Expr::parse(&p.text)?,
                        unit: p.unit.clone(),
                        fixed: matches!(build, Build::Known(_)).then_some(1.0),
                        chosen: Some(index),
                        local: matches!(build, Build::Local(_)),
                    });
                }
            }
            Build::Swap(pairs) => {
                let pairs = parsed(pairs)?;
                for t in self.terms.iter_mut().filter(|t| t.chosen.is_none()) {
                    t.expr = replace(&t.expr, &pairs);
                }
            }
            Build::SwapAll(pairs) => self.replaced.push(Replaced::Columns(parsed(pairs)?)),
            Build::Through(text) => self.replaced.push(Replaced::Terms(Expr::parse(text)?)),
        }
        Ok(())
    }

    /// Text that is the same for equal models.
    pub fn key(&self) -> String {
        let terms = self.terms.iter();
        let replaced = self.replaced.iter();
        terms
            .map(|t| format!("{} {:?} {}\n", t.expr, t.fixed, t.local))
            .chain(replaced.map(|r| format!("{r}\n")))
            .collect()
    }

    /// The declared model with chosen effects.
    pub fn with(spec: &Spec, chosen: &[Chosen]) -> Result<Model, Error> {
        let mut m = Model::declared(spec)?;
        for (i, c) in chosen.iter().enumerate() {
            m.apply(&(c.variant.build)(c.psi), i)?;
        }
        Ok(m)
    }
}
