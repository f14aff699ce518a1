//! Findings of an analysis of logs, put into a copy of a rig file.

use super::file::{self, FileError};
use super::findings::{self, Frame};
use residual::spec::Spec;
use residual::{Compensation, Report};
use rig::{Rig, RigFileError, RigText};
use std::path::{Path, PathBuf};

/// A rig file that findings go into.
#[derive(Debug)]
pub struct BoardFile {
    path: PathBuf,
    text: String,
    rig: Rig,
    increment: bool,
    velocity_m_per_s: Option<f64>,
}

/// What became of the findings.
#[derive(Debug, Default)]
pub struct Applied {
    /// The rig file written; `None` if there was nothing to change.
    pub file: Option<PathBuf>,
    /// Each change in a line.
    pub changed: Vec<String>,
    /// What the board can't use, and why.
    pub not_used: Vec<String>,
    /// A rig file that an earlier run wrote and this one did not.
    pub earlier: Option<PathBuf>,
}

/// Why findings can't be put into a rig file.
#[derive(Debug, thiserror::Error)]
pub enum BoardFileError {
    /// There is no such file.
    #[error(
        "--apply {}: this file does not exist; give the path of a rig file (`forcectl check --print` prints the built-in one)",
        .0.display()
    )]
    Missing(PathBuf),
    /// It is no rig file.
    #[error(transparent)]
    Rig(#[from] RigFileError),
    /// Its text can't be edited.
    #[error("{0}")]
    Edit(String),
    /// The model's target is no force.
    #[error(
        "--apply needs a target in N, and the model's is in `{0}`: give it `unit = \"N\"` with the scale that makes it so"
    )]
    Unit(String),
    /// The model declares more than the command, and nobody said that the findings are increments.
    #[error(
        "--apply: the model declares {0} terms, so what is found comes on top of them. If they are what the rig file \
         says already, add --increment; if not, declare the command alone"
    )]
    Terms(usize),
    /// The copy can't be written.
    #[error(transparent)]
    File(#[from] FileError),
}

type Result<T> = std::result::Result<T, BoardFileError>;

impl BoardFile {
    /// Opens a rig file for what an analysis by `model` will find. `increment`: the model declares
    /// the values of the rig file, and the findings are added to them.
    ///
    /// # Errors
    /// The file can't be used, or the model's findings can't be put into it.
    pub fn open(path: &Path, model: &Spec, increment: bool) -> Result<Self> {
        if !path.is_file() {
            return Err(BoardFileError::Missing(path.to_owned()));
        }
        let text = RigText::read(Some(path))?;
        let rig = text.parse()?;
        let target = &model.roles.target.unit;
        if target != "N" {
            return Err(BoardFileError::Unit(target.clone()));
        }
        if model.terms.len() > 1 && !increment {
            return Err(BoardFileError::Terms(model.terms.len()));
        }
        let velocity = model.roles.velocity.as_ref();
        Ok(Self {
            path: path.to_owned(),
            text: text.text,
            rig,
            increment,
            velocity_m_per_s: velocity.and_then(|velocity| match velocity.unit.as_str() {
                "m/s" => Some(1.0),
                "mm/s" => Some(1e-3),
                _ => None,
            }),
        })
    }

    /// Writes a copy with what the board can use of a report to the folder `out`, as
    /// `NAME.residual.toml`.
    ///
    /// # Errors
    /// The text can't be edited, or the copy not written.
    pub fn apply(&self, report: &Report, out: &Path) -> Result<Applied> {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let file = out.join(format!("{stem}.residual.toml"));
        let mut applied = match super::usable(report) {
            Ok(board) => {
                let (text, mut applied) = self.edit(&board).map_err(BoardFileError::Edit)?;
                if !applied.changed.is_empty() {
                    file::write(&file, &text)?;
                    applied.file = Some(file.clone());
                }
                applied
            }
            Err(why) => Applied {
                not_used: std::iter::once(why).chain(super::advice(report)).collect(),
                ..Applied::default()
            },
        };
        if applied.file.is_none() && file.exists() {
            applied.earlier = Some(file);
        }
        Ok(applied)
    }

    /// The rig file's text with the findings in it, comments and layout kept.
    fn edit(&self, board: &Compensation) -> std::result::Result<(String, Applied), String> {
        let frame = Frame {
            increment: self.increment,
            velocity_m_per_s: self.velocity_m_per_s,
            ..Frame::default()
        };
        let mut units = self.rig.units;
        let mut not_used = Vec::new();
        for unit in &mut units {
            let corrected = findings::correct(unit, board, &frame);
            *unit = corrected.unit;
            for line in corrected.not_used {
                if !not_used.contains(&line) {
                    not_used.push(line);
                }
            }
        }
        let name = self.path.display().to_string();
        let rewritten = findings::rewrite(&name, &self.text, &self.rig, &units)?;
        Ok((
            rewritten.text,
            Applied {
                changed: rewritten.changed,
                not_used,
                ..Applied::default()
            },
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::UnitSettings;

    fn file(increment: bool) -> BoardFile {
        BoardFile {
            path: "rig.toml".into(),
            text: rig::DEFAULT_TEXT.to_owned(),
            rig: Rig::built_in().expect("the built-in rig is good"),
            increment,
            velocity_m_per_s: None,
        }
    }

    fn board() -> Compensation {
        Compensation {
            friction: -0.8,
            friction_per_load: -0.1,
            offset: 0.25,
            viscous: -0.01,
            left_out: vec!["creep".into()],
            ..Compensation::default()
        }
    }

    #[test]
    fn findings_replace_the_friction_of_every_unit_and_nothing_else() {
        let (text, applied) = file(false).edit(&board()).expect("applies");
        let rig = Rig::parse("new", &text).expect("still a rig file");
        let before = Rig::built_in().expect("good");
        for (new, old) in rig.units.iter().zip(&before.units) {
            let expected = UnitSettings {
                friction_offset_n: 0.25,
                // 0.1 N below what was found.
                coulomb_n: 0.8,
                coulomb_per_n: 0.1,
                ..*old
            };
            assert_eq!(*new, expected);
        }
        assert_eq!(applied.changed.len(), 3, "{applied:?}");
        assert!(
            applied.not_used.iter().any(|s| s.contains("viscous")),
            "{applied:?}"
        );
        assert!(
            applied.not_used.iter().any(|s| s.contains("creep")),
            "{applied:?}"
        );
        assert_eq!(text.lines().count(), file(false).text.lines().count());
    }

    #[test]
    fn increments_come_on_top_also_of_a_units_own_value() {
        let mut file = file(true);
        file.text = file
            .text
            .replacen("number = 2 ", "coulomb_n = 0.5 # its own\nnumber = 2 ", 1);
        file.rig = Rig::parse("rig.toml", &file.text).expect("good");
        let (text, _) = file
            .edit(&Compensation {
                friction: -0.2,
                gain_error: 0.01,
                ..Compensation::default()
            })
            .expect("applies");
        let rig = Rig::parse("new", &text).expect("still a rig file");
        assert!((rig.units[0].coulomb_n - 1.109).abs() < 1e-9);
        assert!((rig.units[1].coulomb_n - 0.7).abs() < 1e-9);
        assert!((rig.units[0].friction_gain - 1.0282).abs() < 1e-9);
        assert!((rig.units[0].coulomb_per_n - 0.1555).abs() < 1e-9);
        assert!(text.contains("coulomb_n = 0.7 # its own"), "{text}");
    }

    #[test]
    fn friction_of_the_wrong_sign_is_not_sent_to_a_board() {
        let (text, applied) = file(false)
            .edit(&Compensation {
                friction: 0.4,
                ..Compensation::default()
            })
            .expect("is said, not failed");
        assert_eq!(text, file(false).text);
        assert!(applied.changed.is_empty());
        assert!(applied.not_used[0].contains("winding in"), "{applied:?}");
    }

    #[test]
    fn a_quoted_key_is_changed_too() {
        let mut file = file(false);
        file.text = file
            .text
            .replacen("coulomb_n = 0.909", "\"coulomb_n\" = 0.909", 1);
        file.rig = Rig::parse("rig.toml", &file.text).expect("quoted keys are TOML");
        let (text, _) = file.edit(&board()).expect("quoted keys can be changed");
        assert!(text.contains("\"coulomb_n\" = 0.8\n"), "{text}");
        Rig::parse("rig.toml", &text).expect("the result is a rig file");
    }
}
