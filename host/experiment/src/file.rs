//! The experiment file (TOML): robot, trajectories, force, trials, gates.

use nalgebra::Vector3;
use robot::source::SourceConfig;
use robot::trajectory::TrajectoryConfig;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use wire::UNITS;

use rig::Rig;

/// Version of the file's keys.
pub const SCHEMA: u32 = 1;
/// The default file: the experiment of the thesis.
pub const THESIS: &str = include_str!("../experiments/thesis-1d.toml");
/// Name by which messages call the built-in file.
pub const THESIS_NAME: &str = "built-in experiments/thesis-1d.toml";

/// Why an experiment can't be done. Nothing was driven.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {problem}")]
pub struct FileError {
    /// Which file.
    pub file: String,
    /// What is wrong, where, and what to do.
    pub problem: String,
}

/// An experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Version of the keys: 1.
    pub schema: u32,
    /// Name of the experiment.
    pub name: String,
    /// Everything random comes from it.
    pub seed: u64,
    /// Number of trials.
    pub trials: usize,
    /// Length of a trial, min.
    pub minutes: f64,
    /// Rows of the dataset per second.
    #[serde(default = "default_rate")]
    pub rate_hz: f64,
    /// How often a trial is tried at most.
    #[serde(default = "default_attempts")]
    pub attempts: u32,
    /// Whether every sample of the load cells is recorded beside the dataset.
    #[serde(default)]
    pub record_samples: bool,
    /// Where the tension loops run.
    #[serde(default, skip_serializing_if = "ControlPath::is_board")]
    pub path: ControlPath,
    /// With `path = "raven"`: delay of samples and torques on their way together, ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transport_ms: Option<u32>,
    /// Rig file; relative to this file. The built-in one where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rig: Option<PathBuf>,
    /// The robot.
    pub robot: SourceConfig,
    /// Trajectories of the virtual arm; trial n follows number n modulo their count. `duration_s`
    /// has no effect.
    #[serde(default, rename = "trajectory")]
    pub trajectories: Vec<TrajectoryConfig>,
    /// Force.
    pub force: Force,
    /// What a trial must keep.
    #[serde(default)]
    pub gates: Gates,
}

/// Where the tension loops run: the thesis's two control paths (docs/control-paths.md).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlPath {
    /// On the board (thesis 3.6.2).
    #[default]
    Board,
    /// On the host; torques in whole N·mm through the Raven's software, the board is a sensor board
    /// (thesis 3.6.1).
    Raven,
}

impl ControlPath {
    /// Whether it is the board's.
    #[must_use]
    pub fn is_board(&self) -> bool {
        *self == Self::Board
    }
}

/// Delay of the transport where the file gives none, ms: an estimate, docs/control-paths.md has
/// others.
const TRANSPORT_MS: u32 = 1;

const fn default_rate() -> f64 {
    100.0
}

const fn default_attempts() -> u32 {
    2
}

/// What the rig applies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Force {
    /// Two units pull along one axis, against each other (thesis 4.1). No feedback of the force:
    /// each unit holds its tension.
    OneAxis {
        /// Axis in the robot base frame; its length has no effect.
        axis: [f64; 3],
        /// Number of the unit that pulls towards the axis's positive end.
        toward_plus: u8,
        /// Number of the unit that pulls towards its negative end.
        toward_minus: u8,
        /// Tension that both cables have at least, N.
        pretension_n: f64,
        /// Largest force along the axis, both ways, N.
        largest_n: f64,
        /// Range of the peak rates, N/s.
        slowest_n_per_s: f64,
        /// Largest peak rate, N/s.
        fastest_n_per_s: f64,
    },
    /// All enabled units, with the force controller of the host (thesis 3.7).
    ThreeAxes {
        /// Radius of the ball from which the forces are drawn, N.
        largest_n: f64,
        /// Range of the peak rates, N/s.
        slowest_n_per_s: f64,
        /// Largest peak rate, N/s.
        fastest_n_per_s: f64,
    },
}

impl Force {
    /// Largest force, N.
    #[must_use]
    pub const fn largest_n(&self) -> f64 {
        match self {
            Self::OneAxis { largest_n, .. } | Self::ThreeAxes { largest_n, .. } => *largest_n,
        }
    }

    /// Range of the peak rates, N/s.
    #[must_use]
    pub const fn rates_n_per_s(&self) -> (f64, f64) {
        match self {
            Self::OneAxis {
                slowest_n_per_s,
                fastest_n_per_s,
                ..
            }
            | Self::ThreeAxes {
                slowest_n_per_s,
                fastest_n_per_s,
                ..
            } => (*slowest_n_per_s, *fastest_n_per_s),
        }
    }

    /// The axis of a one-axis force, unit vector.
    #[must_use]
    pub fn axis(&self) -> Option<Vector3<f64>> {
        match self {
            Self::OneAxis { axis, .. } => Vector3::from(*axis).try_normalize(1e-9),
            Self::ThreeAxes { .. } => None,
        }
    }
}

/// What a trial must keep; one that does not is marked, kept and repeated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gates {
    /// Largest RMS difference of measured and commanded force, N (one axis: along it).
    pub tracking_rms_n: f64,
    /// Largest share of the load cells' samples that are missing.
    pub samples_lost: f64,
    /// Largest share of the robot's rows that are missing.
    pub rows_lost: f64,
    /// Largest uncertainty of the time between robot and board, s.
    pub sync_error_s: f64,
    /// Largest age of a force, s: distance in time to the nearest sample of the load cell.
    pub force_age_s: f64,
    /// Largest share of samples with a unit's command at its limit.
    pub saturated: f64,
}

impl Default for Gates {
    fn default() -> Self {
        Self {
            tracking_rms_n: 0.3,
            samples_lost: 0.001,
            rows_lost: 0.001,
            sync_error_s: 0.005,
            force_age_s: 0.01,
            saturated: 0.01,
        }
    }
}

impl Experiment {
    /// The experiment of the thesis.
    ///
    /// # Errors
    /// Only where the built-in file is wrong; a test checks it.
    pub fn thesis() -> Result<Self, FileError> {
        Self::parse(THESIS_NAME, THESIS)
    }

    /// Reads and checks a file; a relative `rig` is relative to it.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let file = path.display().to_string();
        let text = files::read_text(path).map_err(|error| FileError {
            file: file.clone(),
            problem: format!(
                "cannot be read ({error}); `forcectl experiment check --print` prints an example"
            ),
        })?;
        let mut experiment = Self::parse(&file, &text)?;
        if let (Some(rig), Some(folder)) = (&mut experiment.rig, path.parent()) {
            *rig = folder.join(&*rig);
        }
        Ok(experiment)
    }

    /// Checks the text of a file; `file` is its name in messages.
    ///
    /// # Errors
    /// [`FileError`] with line or key.
    pub fn parse(file: &str, text: &str) -> Result<Self, FileError> {
        let wrong = |problem: String| FileError {
            file: file.to_owned(),
            problem,
        };
        let experiment: Self = toml::from_str(text).map_err(|error| wrong(error.to_string()))?;
        experiment.check().map_err(wrong)?;
        Ok(experiment)
    }

    /// SHA-256, in hexadecimal, of everything the file says.
    #[must_use]
    pub fn hash(&self) -> String {
        files::sha256_of(serde_json::to_vec(self).unwrap_or_default())
    }

    /// The rig file that it names, or the built-in one.
    ///
    /// # Errors
    /// Every mistake in the rig file.
    pub fn load_rig(&self) -> Result<Rig, rig::RigFileError> {
        self.rig
            .as_ref()
            .map_or_else(Rig::built_in, |path| Rig::load(path))
    }

    /// Length of a trial, s.
    #[must_use]
    pub fn trial_s(&self) -> f64 {
        self.minutes * 60.0
    }

    /// Delay of samples and torques with `path = "raven"`, ms.
    #[must_use]
    pub fn transport_ms(&self) -> u32 {
        self.transport_ms.unwrap_or(TRANSPORT_MS)
    }

    /// The same experiment as one trial of one minute.
    #[must_use]
    pub fn quick(&self) -> Self {
        Self {
            trials: 1,
            minutes: 1.0,
            ..self.clone()
        }
    }

    /// The rig file with the units enabled that the experiment uses. A one-axis experiment commands
    /// tensions itself.
    ///
    /// # Errors
    /// Which unit is not enabled.
    pub fn prepare_rig(&self, rig: &Rig) -> Result<Rig, String> {
        let mut rig = rig.clone();
        let Force::OneAxis {
            toward_plus,
            toward_minus,
            ..
        } = self.force
        else {
            return Ok(rig);
        };
        for unit in &mut rig.units {
            let used = unit.number == toward_plus || unit.number == toward_minus;
            if used && !unit.enabled {
                return Err(format!(
                    "[force] uses unit {}, which is not `enabled` in rig file `{}`",
                    unit.number, rig.name
                ));
            }
            unit.enabled = used;
        }
        Ok(rig)
    }

    fn check(&self) -> Result<(), String> {
        if self.schema != SCHEMA {
            return Err(format!(
                "schema = {}: this version reads {SCHEMA}",
                self.schema
            ));
        }
        let name_char = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.name.is_empty() || !self.name.chars().all(name_char) {
            return Err("name: use letters, digits, `-` and `_`".to_owned());
        }
        let within = |key: &str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(format!("{key} = {value}: allowed are {low} to {high}"))
            }
        };
        within("trials", self.trials as f64, 1.0, 1000.0)?;
        within("minutes", self.minutes, 0.05, 600.0)?;
        within("rate_hz", self.rate_hz, 1.0, 1000.0)?;
        if !(1000.0 / self.rate_hz).fract().eq(&0.0) {
            return Err(format!(
                "rate_hz = {}: it must divide 1000, the robot's rate, as 50, 100, 200 or 1000 do",
                self.rate_hz
            ));
        }
        within("attempts", f64::from(self.attempts), 1.0, 20.0)?;
        self.check_force()?;
        match (self.path, self.transport_ms) {
            (ControlPath::Board, Some(_)) => {
                return Err("transport_ms: it belongs to path = \"raven\"".to_owned())
            }
            (_, Some(ms)) => within("transport_ms", f64::from(ms), 0.0, 100.0)?,
            (_, None) => {}
        }
        if matches!(self.robot, SourceConfig::Virtual(_)) && self.trajectories.is_empty() {
            return Err("[[trajectory]] is missing: the virtual arm needs at least one".to_owned());
        }
        for (key, value) in [
            ("gates.tracking_rms_n", self.gates.tracking_rms_n),
            ("gates.samples_lost", self.gates.samples_lost),
            ("gates.rows_lost", self.gates.rows_lost),
            ("gates.sync_error_s", self.gates.sync_error_s),
            ("gates.force_age_s", self.gates.force_age_s),
            ("gates.saturated", self.gates.saturated),
        ] {
            within(key, value, 0.0, 1e3)?;
        }
        Ok(())
    }

    fn check_force(&self) -> Result<(), String> {
        let (slowest, fastest) = self.force.rates_n_per_s();
        if !(slowest > 0.0 && slowest <= fastest && fastest <= 100.0) {
            return Err(format!(
                "[force] slowest_n_per_s = {slowest} and fastest_n_per_s = {fastest} must be positive, in order and at most 100"
            ));
        }
        let largest = self.force.largest_n();
        if !(largest > 0.0 && largest <= 60.0) {
            return Err(format!(
                "[force] largest_n = {largest}: allowed are more than 0 and up to 60 N"
            ));
        }
        if let Force::OneAxis {
            toward_plus,
            toward_minus,
            pretension_n,
            ..
        } = self.force
        {
            for (key, unit) in [("toward_plus", toward_plus), ("toward_minus", toward_minus)] {
                if !(1..=UNITS as u8).contains(&unit) {
                    return Err(format!("[force] {key} = {unit}: units are 1 to {UNITS}"));
                }
            }
            if toward_plus == toward_minus {
                return Err("[force] toward_plus and toward_minus name one unit".to_owned());
            }
            if self.force.axis().is_none() {
                return Err("[force] axis must not be zero".to_owned());
            }
            if !(0.5..=20.0).contains(&pretension_n) {
                return Err(format!(
                    "[force] pretension_n = {pretension_n}: allowed are 0.5 to 20 N"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot::arm::ChangeConfig;

    #[test]
    fn the_kind_arm_has_the_default_experiment_but_for_the_changes() {
        let text = include_str!("../../../docs/estimation/sets/kind.toml");
        let mut kind = Experiment::parse("kind.toml", text).unwrap();
        let thesis = Experiment::thesis().unwrap();
        assert_ne!(kind.robot, thesis.robot);
        let SourceConfig::Virtual(robot) = &mut kind.robot else {
            panic!("it is virtual");
        };
        assert!(robot.arm.change.is_none());
        robot.arm.change = ChangeConfig::STANDARD;
        kind.name.clone_from(&thesis.name);
        assert_eq!(kind, thesis);
    }

    #[test]
    fn the_default_file_is_the_experiment_of_the_thesis() {
        let thesis = Experiment::thesis().unwrap();
        assert_eq!((thesis.trials, thesis.minutes), (9, 20.0));
        let Force::OneAxis {
            pretension_n,
            largest_n,
            ..
        } = thesis.force
        else {
            panic!("it is one-axis");
        };
        assert_eq!((pretension_n, largest_n), (2.0, 4.5));
        assert_eq!(thesis.force.axis().unwrap(), Vector3::y());
        // The virtual arm is not the same in every trial.
        let SourceConfig::Virtual(robot) = &thesis.robot else {
            panic!("it is virtual");
        };
        assert_eq!(robot.arm.change, ChangeConfig::STANDARD);
        let quick = thesis.quick();
        assert_eq!(quick.trials as f64 * quick.trial_s(), 60.0);
        assert_ne!(thesis.hash(), quick.hash());
        let enabled = thesis
            .prepare_rig(&Rig::built_in().unwrap())
            .unwrap()
            .units
            .map(|unit| unit.enabled);
        assert_eq!(enabled, [false, false, true, true, false, false]);
    }

    #[test]
    fn mistakes_are_named_by_key() {
        for (from, to, words) in [
            ("schema = 1", "schema = 2", "schema = 2"),
            ("trials = 9", "trials = 0", "trials = 0"),
            ("rate_hz = 100", "rate_hz = 300", "rate_hz = 300"),
            ("toward_plus = 3", "toward_plus = 4", "name one unit"),
            ("toward_plus = 3", "toward_plus = 9", "toward_plus = 9"),
            ("largest_n = 4.5", "largest_n = -1.0", "largest_n = -1"),
            ("kind = \"virtual\"", "kind = \"martian\"", "martian"),
            ("seed = 1", "sead = 1", "sead"),
            ("seed = 1", "seed = 1\npath = \"robot\"", "robot"),
            ("seed = 1", "seed = 1\ntransport_ms = 3", "transport_ms"),
            (
                "seed = 1",
                "seed = 1\npath = \"raven\"\ntransport_ms = 300",
                "transport_ms = 300",
            ),
            (
                "slowest_n_per_s = 0.1",
                "slowest_n_per_s = 9.0",
                "slowest_n_per_s = 9",
            ),
        ] {
            assert!(THESIS.contains(from), "{from}");
            let error = Experiment::parse("f.toml", &THESIS.replacen(from, to, 1)).unwrap_err();
            let text = error.to_string();
            assert!(
                text.starts_with("f.toml: ") && text.contains(words),
                "{to}: {text}"
            );
        }
    }
}
