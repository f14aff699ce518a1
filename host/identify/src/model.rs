//! The model of a unit for the analysis: what the rig file declares.

use control::convert::REEL_RADIUS_M;
use residual::spec::Spec;
use rig::UnitSettings;
use std::f64::consts::TAU;

/// The model of the recorded session.
pub const MODEL: &str = include_str!("../models/identify.toml");

/// The model of a unit: what its settings declare.
///
/// # Errors
/// Only where the built-in model file is wrong; a test checks it.
pub fn model(unit: &UnitSettings) -> Result<Spec, residual::Error> {
    let mut spec = Spec::parse(MODEL)?;
    spec.title = format!("Unit {}: {}", unit.number, spec.title);
    for term in &mut spec.terms {
        term.fixed = Some(match term.name.as_str() {
            "friction_gain" => unit.friction_gain,
            "friction_offset_n" => unit.friction_offset_n,
            "coulomb_n" => -unit.coulomb_n,
            _ => -unit.coulomb_per_n,
        });
    }
    let term = |name: &str, expr: String, fixed: f64| residual::spec::Term {
        name: name.to_owned(),
        expr,
        unit: String::new(),
        fixed: Some(fixed),
        per: String::new(),
        effect: String::new(),
        fitted: None,
    };
    if unit.viscous_n_s_per_m != 0.0 {
        let fixed = -unit.viscous_n_s_per_m;
        spec.terms
            .push(term("viscous_n_s_per_m", "velocity".to_owned(), fixed));
    }
    for ripple in unit.ripples.iter().filter(|r| !r.is_none()) {
        let order = TAU * REEL_RADIUS_M / ripple.period_m;
        let sine = format!("sin({order} * angle + {})", ripple.phase_rad);
        if ripple.amplitude_n != 0.0 {
            spec.terms
                .push(term("ripple", sine.clone(), ripple.amplitude_n));
        }
        if ripple.amplitude_per_n != 0.0 {
            let text = format!("command * {sine}");
            spec.terms
                .push(term("ripple by load", text, ripple.amplitude_per_n));
        }
    }
    Ok(spec)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rig::Rig;

    #[test]
    fn a_model_declares_what_the_rig_file_says() {
        let mut unit = Rig::built_in().unwrap().units[0];
        assert_eq!(model(&unit).unwrap().terms.len(), 4);
        unit.coulomb_n = 1.5;
        unit.viscous_n_s_per_m = 7.0;
        unit.ripples[1].period_m = TAU * REEL_RADIUS_M;
        unit.ripples[1].amplitude_per_n = 0.02;
        let spec = model(&unit).unwrap();
        let fixed = |name: &str| {
            let term = spec.terms.iter().find(|t| t.name == name);
            term.and_then(|t| t.fixed)
        };
        assert_eq!(fixed("coulomb_n"), Some(-1.5));
        assert_eq!(fixed("viscous_n_s_per_m"), Some(-7.0));
        assert_eq!(fixed("ripple by load"), Some(0.02));
    }
}
