//! `MODEL.toml`: which column plays which role, the declared model, hold-out, hygiene, selection.
//!
//! `docs/residual/model-toml.md` is the reference for users; the types here are its single source.

mod units;

use residual_columns::error::Error;
pub use residual_columns::layout::{Action, Input, Message};
use residual_columns::units::seconds;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Largest number of folds that groups are dealt to, unless set otherwise.
pub const FOLDS: usize = 10;

/// The whole model file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Free text, shown as the report's title.
    #[serde(default)]
    pub title: String,
    /// How files are read.
    #[serde(default)]
    pub input: Input,
    /// Columns by role.
    pub roles: Roles,
    /// Which rows are fitted.
    #[serde(default)]
    pub rows: Rows,
    /// What is held out.
    #[serde(default)]
    pub holdout: Holdout,
    /// What to do about flaws of the data.
    #[serde(default)]
    pub hygiene: Hygiene,
    /// How effects are selected.
    #[serde(default)]
    pub selection: Selection,
    /// Declared terms: the prediction of the target is their sum.
    #[serde(default)]
    pub terms: Vec<Term>,
}

/// One column and its unit: value = cell * scale + offset, in `unit`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    /// Column name in the log.
    pub column: String,
    /// Unit after conversion, as text for reports.
    #[serde(default)]
    pub unit: String,
    /// Factor from cell to `unit`.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub scale: f64,
    /// Offset after the factor, in `unit`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset: f64,
    /// Velocity: magnitudes up to this are standstill, in `unit`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub deadband: f64,
    /// Target: contributions smaller than this (RMS, in `unit`) are never material.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub noise_floor: f64,
}

fn one() -> f64 {
    1.0
}
fn is_one(x: &f64) -> bool {
    *x == 1.0
}
fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

/// Columns by role. Only time and target are required; an effect whose columns are absent is not
/// looked for, and the report says so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Roles {
    /// Time, in seconds after conversion: any other unit is refused, with the scale to write.
    pub time: Column,
    /// What the model predicts.
    pub target: Column,
    /// The command, or whatever drives the target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command: Option<Column>,
    /// Velocity of the moving part (its sign is friction's).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<Column>,
    /// Angle or position of the moving part; radians for the periodic effects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<Column>,
    /// Temperature.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature: Option<Column>,
    /// Setpoint of a closed loop: exogenous, so it distinguishes cause from feedback.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setpoint: Option<Column>,
    /// Pose: joint angles or coordinates of the mechanism, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub pose: BTreeMap<String, Column>,
    /// Other channels that might couple in (neighbour units, currents), by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub channels: BTreeMap<String, Column>,
    /// Columns that only name groups or filter rows, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub groups: BTreeMap<String, Column>,
}

impl Roles {
    /// Every mapped column with the name it gets in expressions.
    pub fn all(&self) -> Vec<(String, &Column)> {
        let mut out = vec![
            ("time".to_string(), &self.time),
            ("target".to_string(), &self.target),
        ];
        for (name, c) in [
            ("command", &self.command),
            ("velocity", &self.velocity),
            ("angle", &self.angle),
            ("temperature", &self.temperature),
            ("setpoint", &self.setpoint),
        ] {
            if let Some(c) = c {
                out.push((name.to_string(), c));
            }
        }
        for map in [&self.pose, &self.channels, &self.groups] {
            out.extend(map.iter().map(|(n, c)| (n.clone(), c)));
        }
        out
    }

    /// Unit of a role or named column, or an empty text.
    pub fn unit(&self, name: &str) -> String {
        self.all()
            .into_iter()
            .find(|(n, _)| n == name)
            .map(|(_, c)| c.unit.clone())
            .unwrap_or_default()
    }
}

/// Which rows are fitted. Rows that are left out still carry the memory of operators.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Rows {
    /// Expression; rows where it is 0 are not fitted.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub keep: String,
    /// Expression; sequences where it is 0 on every row are not loaded at all.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub sequences: String,
}

/// What is held out: never random rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Holdout {
    /// Columns whose joint values name a group; `file` stands for the file. Empty: `file`, or
    /// blocks if `block_s` is given.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub by: Vec<String>,
    /// Length of a block of time, in seconds: groups are blocks of each sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub block_s: Option<f64>,
    /// At most so many folds, 2 or more; groups are dealt to folds in turn.
    #[serde(skip_serializing_if = "is_default_folds")]
    pub folds: usize,
}

impl Default for Holdout {
    fn default() -> Self {
        Holdout {
            by: vec![],
            block_s: None,
            folds: FOLDS,
        }
    }
}

fn is_default_folds(x: &usize) -> bool {
    *x == FOLDS
}

fn is_false(x: &bool) -> bool {
    !*x
}

/// What to do about flaws of the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Hygiene {
    /// Isolated target values far from both neighbours.
    pub spikes: Action,
    /// Target stuck at its largest or smallest value.
    pub clipping: Action,
    /// Rows that repeat the row before with a new time.
    pub repeats: Action,
    /// Target values 256 times too large.
    pub scale256: Action,
    /// Rows whose time does not grow: `report` refuses the file, `drop` leaves them out.
    pub time: Action,
    /// Lines that are no rows, such as a message between them or a line that was cut off: `report`
    /// refuses the file, `drop` leaves them out.
    pub text: Action,
    /// An angle that begins again after each turn, where no column has the velocity: `fix` makes it
    /// go on.
    pub wraps: Action,
    /// A gap longer than this starts a new sequence, in seconds; 0 means 20 median steps, but none
    /// in a map that is held point by point, nor where steps have every size.
    pub gap_s: f64,
}

impl Default for Hygiene {
    fn default() -> Self {
        Hygiene {
            spikes: Action::Report,
            clipping: Action::Report,
            repeats: Action::Report,
            scale256: Action::Report,
            time: Action::Report,
            text: Action::Report,
            wraps: Action::Report,
            gap_s: 0.0,
        }
    }
}

/// How effects are selected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Selection {
    /// Smallest fall of the held-out RMSE that counts, as a fraction.
    pub material: f64,
    /// Family-wise error: highest probability that any of the forms tried in one scan counts by
    /// chance. Each p value is multiplied by the number of forms (Bonferroni).
    pub familywise_error: f64,
    /// Number of decoys of the residual.
    pub decoys: usize,
    /// Whether to repeat the whole selection with each fold left out, and to report the error on
    /// the folds left out as `nested_rmse`. Costs as many analyses as there are folds.
    #[serde(skip_serializing_if = "is_false")]
    pub nested: bool,
    /// At most so many effects.
    pub max_effects: usize,
    /// Seed of decoys and bootstrap.
    pub seed: u64,
    /// Only these effects; empty means all.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub only: Vec<String>,
    /// Not these effects.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub except: Vec<String>,
}

impl Default for Selection {
    fn default() -> Self {
        Selection {
            material: 0.02,
            familywise_error: 0.05,
            decoys: 48,
            nested: false,
            max_effects: 6,
            seed: 1,
            only: vec![],
            except: vec![],
        }
    }
}

/// One term of the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// Name in reports.
    pub name: String,
    /// Expression over roles and columns.
    pub expr: String,
    /// Unit of the coefficient, as text.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// The coefficient, if it is declared rather than fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fixed: Option<f64>,
    /// `sequence` if every sequence has its own coefficient (then the held-out half of a sequence
    /// is predicted from its other half); empty for one coefficient.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub per: String,
    /// The catalogue effect that added the term; empty for declared ones.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub effect: String,
    /// The value that the analysis fitted (information only; fitted terms are fitted again).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<f64>,
}

impl Spec {
    /// The model with every coefficient fixed at its fitted value. Terms with a coefficient for
    /// each sequence have no meaning on other data and are left out.
    pub fn frozen(&self) -> Spec {
        let mut spec = self.clone();
        spec.terms.retain(|t| t.per.is_empty());
        for t in &mut spec.terms {
            t.fixed = t.fixed.or(t.fitted);
            t.fitted = None;
        }
        spec
    }

    /// Reads a model file.
    ///
    /// # Errors
    /// [`Error::Model`] or [`Error::Expression`].
    pub fn load(path: &Path) -> Result<Spec, Error> {
        let text = files::read_text(path).map_err(|e| {
            Error::model(format!(
                "{}: cannot be read ({e}); give the path of a model file, as docs/residual/model-toml.md describes it",
                path.display()
            ))
        })?;
        Spec::parse(&text).map_err(|e| match e {
            Error::Model { what } => Error::model(format!("{}: {what}", path.display())),
            Error::Expression { text, why } => Error::Expression {
                text,
                why: format!("{why}, in {}", path.display()),
            },
            other => other,
        })
    }

    /// Parses the text of a model file and checks it.
    ///
    /// # Errors
    /// [`Error::Model`] naming the key.
    pub fn parse(text: &str) -> Result<Spec, Error> {
        let spec: Spec = toml::from_str(text).map_err(|e| renamed(e.to_string()))?;
        if spec.terms.is_empty() {
            return Err(Error::model(
                "no [[terms]]: declare at least one term, even `expr = \"1\"`",
            ));
        }
        let s = &spec.selection;
        let share = |x: f64| x > 0.0 && x < 1.0;
        if !share(s.material) || !share(s.familywise_error) {
            return Err(Error::model(
                "selection.material and selection.familywise_error must lie between 0 and 1",
            ));
        }
        if s.decoys < 16 {
            return Err(Error::model(
                "selection.decoys must be at least 16, or chance cannot be distinguished from an effect",
            ));
        }
        if spec.holdout.block_s.is_some_and(|b| b.is_nan() || b <= 0.0) {
            return Err(Error::model("holdout.block_s must be positive"));
        }
        spec.check_values()?;
        for (name, c) in spec.roles.all() {
            if !(c.scale.is_finite()
                && c.scale != 0.0
                && c.offset.is_finite()
                && c.deadband >= 0.0
                && c.noise_floor >= 0.0)
            {
                return Err(Error::model(format!(
                    "role `{name}`: scale must not be 0, deadband and noise_floor not negative"
                )));
            }
        }
        for text in [&spec.rows.keep, &spec.rows.sequences] {
            if !text.is_empty() {
                residual_columns::expr::Expr::parse(text)?;
            }
        }
        for (key, text) in [
            ("rows.keep", &spec.rows.keep),
            ("rows.sequences", &spec.rows.sequences),
        ] {
            units::check(&spec.roles, key, text)?;
        }
        for t in &spec.terms {
            residual_columns::expr::Expr::parse(&t.expr)?;
            if t.effect.is_empty() {
                units::check(&spec.roles, &format!("term `{}`", t.name), &t.expr)?;
                units::check_fixed(&spec.roles, t)?;
            }
            if !matches!(t.per.as_str(), "" | "sequence") {
                return Err(Error::model(format!(
                    "term `{}`: per = \"{}\"; only \"sequence\" is known",
                    t.name, t.per
                )));
            }
            if t.fixed.is_some() && !t.per.is_empty() {
                return Err(Error::model(format!(
                    "term `{}`: `fixed` and `per` exclude each other: a fixed coefficient is one number for all sequences",
                    t.name
                )));
            }
            if t.fixed.is_some_and(|f| !f.is_finite()) {
                return Err(Error::model(format!(
                    "term `{}`: fixed must be finite",
                    t.name
                )));
            }
        }
        Ok(spec)
    }
}

/// Most terms of a model, decoys, and effects: beyond them the analysis would not end.
const MOST_TERMS: usize = 500;
const MOST_DECOYS: usize = 10_000;
const MOST_EFFECTS: usize = 50;

impl Spec {
    /// Refuses values that would lead to an answer without meaning.
    fn check_values(&self) -> Result<(), Error> {
        let refuse = |bad: bool, what: &str| if bad { Err(Error::model(what)) } else { Ok(()) };
        self.input.check()?;
        refuse(
            self.holdout.folds < 2,
            &format!(
                "holdout.folds = {} leaves nothing to fit to or to hold out; give 2 or more, or leave it out for 10",
                self.holdout.folds
            ),
        )?;
        refuse(
            !(self.hygiene.gap_s.is_finite() && self.hygiene.gap_s >= 0.0),
            "hygiene.gap_s must be a time in seconds, or 0",
        )?;
        let h = &self.hygiene;
        refuse(
            [h.spikes, h.clipping, h.repeats, h.time, h.text].contains(&Action::Fix),
            "hygiene: only scale256 and wraps can be \"fix\"; the others are \"report\" or \"drop\"",
        )?;
        refuse(
            h.wraps == Action::Drop,
            "hygiene.wraps is \"report\" or \"fix\": rows between turns cannot be left out",
        )?;
        let s = &self.selection;
        refuse(
            s.decoys > MOST_DECOYS || s.max_effects > MOST_EFFECTS,
            "selection: at most 10000 decoys and 50 effects",
        )?;
        refuse(
            self.terms.len() > MOST_TERMS,
            "more than 500 [[terms]]: fit a part of them, or declare their sum as a column",
        )?;
        self.check_time()?;
        self.check_target()
    }

    /// Time is in seconds: another unit would make every rate and delay wrong by its factor.
    fn check_time(&self) -> Result<(), Error> {
        let unit = &self.roles.time.unit;
        let scale = match seconds(unit) {
            _ if unit.trim().is_empty() => return Ok(()),
            Some(1.0) => return Ok(()),
            Some(scale) if scale < 1.0 => format!("scale = {scale:e}"),
            Some(scale) => format!("scale = {scale:?}"),
            None => "as scale the seconds in one of them, as a number".into(),
        };
        Err(Error::model(format!(
            "roles.time: unit = \"{unit}\", but time is in seconds after conversion; write unit = \"s\", {scale}"
        )))
    }

    /// The target must not predict itself: the answer would be that nothing is lacking.
    fn check_target(&self) -> Result<(), Error> {
        let target = &self.roles.target.column;
        let of_target = |(name, column): &(String, &Column)| {
            name != "target" && column.column == *target && !self.roles.groups.contains_key(name)
        };
        let all = self.roles.all();
        if let Some((role, _)) = all.iter().find(|c| of_target(c)) {
            return Err(Error::model(format!(
                "role `{role}` has the target's column `{target}`, so the target would predict itself; name another column, or leave the role out"
            )));
        }
        // Names of expressions that are the target: its own, those of groups of its column, and its
        // column's own name where that is no role's.
        let is_target = |name: &String| match all.iter().find(|(role, _)| role == name) {
            Some((role, column)) => role == "target" || column.column == *target,
            None => name == target && !MADE.contains(&name.as_str()),
        };
        for term in &self.terms {
            let names = residual_columns::expr::Expr::parse(&term.expr)?.names();
            if let Some(name) = names.iter().find(|n| is_target(n)) {
                return Err(Error::model(format!(
                    "term `{}`: its expression has `{name}`, which is the target, so the target would predict itself; write what you believe it is made of",
                    term.name
                )));
            }
        }
        Ok(())
    }
}

/// Names in expressions that are made and not logged.
pub const MADE: [&str; 4] = ["time", "elapsed", "file", "pi"];

/// A TOML error; where a key has a new name, with that.
fn renamed(what: String) -> Error {
    Error::model(if what.contains("unknown field `fdr`") {
        format!(
            "{what}\nThe key `selection.fdr` is now `selection.familywise_error`: the test was never a \
             false discovery rate. Rename it; the value keeps its meaning"
        )
    } else {
        what
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fixed_coefficient_is_none_for_each_sequence() {
        let with = |keys: &str| {
            Spec::parse(&format!(
                "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\" }}\n\
                 [[terms]]\nname = \"a\"\nexpr = \"1\"\n{keys}\n"
            ))
        };
        assert!(with("fixed = 1.0").is_ok() && with("per = \"sequence\"").is_ok());
        let error = with("fixed = 1.0\nper = \"sequence\"").unwrap_err();
        let error = error.to_string();
        assert!(error.contains("`a`: `fixed` and `per` exclude"), "{error}");
    }

    #[test]
    fn the_old_name_of_a_key_is_refused_with_the_new_one() {
        let with = |key: &str| {
            Spec::parse(&format!(
                "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\" }}\n\
                 [selection]\n{key} = 0.01\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n"
            ))
        };
        let spec = with("familywise_error").unwrap();
        assert_eq!(spec.selection.familywise_error, 0.01);
        let error = with("fdr").unwrap_err().to_string();
        assert!(error.contains("`selection.familywise_error`"), "{error}");
        let other = with("fdrx").unwrap_err().to_string();
        assert!(!other.contains("is now"), "{other}");
    }
}
