//! A rig file: what its cables can do.

use crate::{background, floats, refused, usage};
use calibrate::workspace::{self, Feasible};
use calibration::workspace::map::PoseReport;
use force::allocation::{Allocator, Problem};
use force::controller::{problem, Cables, Reach};
use nalgebra::Vector3;
use pyo3::prelude::*;
use rig::{PoseChoice, RigText};
use serde_json::json;
use std::path::PathBuf;

/// A checked rig file.
#[pyclass(frozen, module = "forcerig._native")]
pub struct Rig(rig::Rig);

#[pymethods]
impl Rig {
    /// Reads a rig file; without one, the built-in example.
    #[staticmethod]
    #[pyo3(signature = (path=None))]
    fn load(path: Option<PathBuf>) -> PyResult<Self> {
        let text = RigText::read(path.as_deref()).map_err(|error| refused(3, error))?;
        text.parse().map(Self).map_err(|error| refused(3, error))
    }

    /// Checks the text of a rig file; `name` stands for it in errors.
    #[staticmethod]
    fn parse(name: &str, text: &str) -> PyResult<Self> {
        rig::Rig::parse(name, text)
            .map(Self)
            .map_err(|error| refused(3, error))
    }

    /// Everything that the file says, with its hash.
    fn json(&self) -> String {
        json!({"hash": self.0.hash(), "rig": self.0}).to_string()
    }

    /// Tensions for a force at a tip.
    #[pyo3(signature = (force_n, tip_m=None, available=None))]
    fn allocate(
        &self,
        force_n: [f64; 3],
        tip_m: Option<[f64; 3]>,
        available: Option<[bool; 6]>,
    ) -> PyResult<String> {
        let rig = &self.0;
        let force_n = Vector3::from(force_n);
        rig.check_force(force_n).map_err(usage)?;
        let tip_m = tip_m.map_or_else(|| self.usual_tip(), Vector3::from);
        // A unit that is switched off takes no part, whatever is available.
        let available: [bool; 6] = std::array::from_fn(|i| {
            rig.units[i].enabled && available.is_none_or(|available| available[i])
        });
        let cables = Cables::at(rig, tip_m, &available).map_err(usage)?;
        let problem = Problem {
            force_n,
            ..problem(rig, &cables, &available)
        };
        let found = Allocator::new()
            .and_then(|mut allocator| allocator.solve(&problem))
            .map_err(usage)?;
        let reach = Reach {
            feasible: found.feasible,
            residual_n: found.residual_n,
            fraction: found.fraction,
        };
        Ok(json!({
            "tension_n": found.tension_n, "lower_n": problem.lower_n, "upper_n": problem.upper_n,
            "direction": problem.directions, "force_n": found.force_n, "residual_n": found.residual_n,
            "feasible": found.feasible, "fraction": found.fraction, "tip_m": tip_m, "text": reach.describe(),
        })
        .to_string())
    }

    /// Feasible forces over the workspace, as `forcectl workspace` finds them.
    #[pyo3(signature = (radius_m=None, across=9))]
    fn workspace(&self, py: Python<'_>, radius_m: Option<f64>, across: i64) -> PyResult<String> {
        let rig = &self.0;
        let radius_m = radius_m.unwrap_or(0.5 * rig.workspace.radius_m);
        if !(radius_m.is_finite() && radius_m > 0.0 && radius_m < 5.0) {
            return Err(usage("radius_m has to be above 0 and below 5 m"));
        }
        // The range of `--across`.
        let across = usize::try_from(across)
            .ok()
            .filter(|across| (3..=41).contains(across))
            .ok_or_else(|| usage(format!("across is {across}, and has to be 3 to 41")))?;
        let options = workspace::Options { radius_m, across };
        let poses = workspace::poses(rig, &options);
        let found = Feasible::of(&interruptible(py, rig, &poses)?);
        Ok(json!({"poses": found.poses, "least_n": found.least_n, "mean_n": found.mean_n, "along_n": found.along_n})
            .to_string())
    }

    /// What is feasible at each of these tips (x, y, z, x, ...).
    fn feasible(&self, py: Python<'_>, tips_m: &[u8]) -> PyResult<String> {
        let rig = &self.0;
        let tips: Vec<Vector3<f64>> = floats(tips_m)
            .chunks_exact(3)
            .map(Vector3::from_column_slice)
            .collect();
        if let Some(at) = tips
            .iter()
            .position(|tip| !tip.iter().all(|v| v.is_finite()))
        {
            return Err(usage(format!(
                "tip {at} is not finite: give positions in m"
            )));
        }
        let found = interruptible(py, rig, &tips)?;
        let rows: Vec<_> = found
            .iter()
            .map(|at| json!({"radius_n": at.radius_n, "along_n": at.along_n, "volume_n3": at.volume_n3}))
            .collect();
        Ok(json!(rows).to_string())
    }
}

/// Tips between two looks for Ctrl-C: some milliseconds.
const TIPS_AT_ONCE: usize = 16;

/// What is feasible at each of these tips, m; Ctrl-C ends it.
fn interruptible(
    py: Python<'_>,
    rig: &rig::Rig,
    tips: &[Vector3<f64>],
) -> PyResult<Vec<PoseReport>> {
    let found = background::run(py, None, |watch| {
        if tips.is_empty() {
            // Refused as the crate refuses it.
            return workspace::at(rig, tips);
        }
        let mut found = Vec::new();
        for some in tips.chunks(TIPS_AT_ONCE) {
            watch.check();
            found.extend(workspace::at(rig, some)?);
        }
        Ok(found)
    })?;
    found.map_err(usage)
}

impl Rig {
    /// The clamped tip, else the middle of the workspace.
    fn usual_tip(&self) -> Vector3<f64> {
        match self.0.pose {
            PoseChoice::Static { position_m } => position_m,
            _ => self.0.workspace.center_m,
        }
    }
}
