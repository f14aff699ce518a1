//! All that is true about a set, as JSON.

use crate::log::file_name;
use crate::set::Set;
use serde_json::{json, Value};

impl Set {
    /// All that is true about the set, for `truth.json`.
    pub fn truth(&self) -> Value {
        let over_noise = |rms_n: f64| rms_n / self.noise_rms_n;
        let missing: Vec<Value> = self
            .missing
            .iter()
            .map(|m| {
                json!({
                    "name": m.effect.name,
                    "title": m.effect.title,
                    "equation": m.effect.equation,
                    "source": m.effect.source,
                    "outside": m.effect.outside,
                    "size": over_noise(m.rms_n),
                    "rms_n": m.rms_n,
                    "rms_before_fit_n": m.raw_rms_n,
                    "size_beside_other_effects": over_noise(m.marginal_rms_n),
                    "size_distinct_from_other_effects": over_noise(m.distinct_rms_n),
                    "parameters": m.parameters.to_json(),
                    "equivalences": m.effect.equivalences.iter().map(|e| json!({
                        "names": e.names, "kind": e.kind, "reason": e.reason,
                    })).collect::<Vec<_>>(),
                    "compared_on_this_data": m.alike.iter().map(|a| json!({
                        "name": a.effect.name,
                        "left_over_noise": a.left_over_noise,
                        "left_over_effect": a.left_over_effect,
                    })).collect::<Vec<_>>(),
                })
            })
            .collect();
        json!({
            "format": 1,
            "seed": self.request.seed,
            "rate_hz": self.request.rate_hz,
            "size_requested": self.request.size,
            "empty": self.missing.is_empty(),
            "missing": missing,
            "size_of_all_together": over_noise(self.joint_rms_n),
            "declared": self.terms.iter().map(|t| json!({
                "name": t.name, "expr": t.expr, "unit": t.unit, "fixed": t.fixed, "coefficient": t.coefficient,
            })).collect::<Vec<_>>(),
            "noise": {
                "rms_n": self.noise_rms_n,
                "shares_of_variance": self.colour.to_json(self.request.rate_hz),
                "quantum_n": self.quantum_n,
                "jitter_rms_s": self.jitter_s,
                "speed_rms_rad_s": self.speed_noise_rad_s,
            },
            "also_present": self.also_present(),
            "runs": self.runs.iter().enumerate().map(|(i, run)| json!({
                "file": file_name(i),
                "rows": run.rows.len(),
                "rows_lost": run.rows_lost,
                "rows_out_of_range": run.rows_out_of_range,
                "motion_and_command_from": run.excitation,
            })).collect::<Vec<_>>(),
        })
    }

    /// Things in the noise that a careful analysis may name without being wrong.
    fn also_present(&self) -> Vec<Value> {
        let mut present = Vec::new();
        if self.colour.tone > 0.0 {
            present.push(json!({
                "name": "mains",
                "size": self.colour.tone.sqrt(),
                "reason": "the noise has a tone",
            }));
        }
        if self.colour.flicker > 0.0 {
            present.push(json!({
                "name": "drift",
                "size": self.colour.flicker.sqrt(),
                "reason": "the noise has a 1/f part, which wanders within a run and differs from run to run",
            }));
        }
        present
    }
}
