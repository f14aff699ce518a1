//! What is wrong with a rig file, with file, line, unit and key.

use std::fmt;

/// One problem of a rig file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line from 1; 0: the whole file.
    pub line: usize,
    /// Unit from 1, where it is about one.
    pub unit: Option<u8>,
    /// Key, where it is about one.
    pub key: String,
    /// What is wrong and what to do.
    pub message: String,
}

/// What is wrong with a rig file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RigFileError {
    /// Its name.
    pub file: String,
    /// Every problem, in the order of the lines.
    pub problems: Vec<Problem>,
}

impl fmt::Display for RigFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.problems.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{}", self.file)?;
            if problem.line > 0 {
                write!(f, ":{}", problem.line)?;
            }
            write!(f, ": ")?;
            if let Some(unit) = problem.unit {
                write!(f, "unit {unit}: ")?;
            }
            if !problem.key.is_empty() {
                write!(f, "`{}`: ", problem.key)?;
            }
            write!(f, "{}", problem.message)?;
        }
        Ok(())
    }
}

impl std::error::Error for RigFileError {}
