//! Checks between the values of a unit: its limits against each other, its place against the
//! workspace.

use super::section::{Found, Section};
use crate::{UnitSettings, Workspace};

/// Checks a unit's tensions and limits against each other.
pub(super) fn check_limits(
    section: &Section<'_, '_>,
    tension_min: &Found<f64>,
    tension_max: &Found<f64>,
    force_limit: &Found<f64>,
    over_tension: &Found<f64>,
) {
    if tension_min.good && tension_max.good && tension_min.value >= tension_max.value {
        section.report(
            tension_min.at,
            "tension_min_n",
            format!(
                "is {} and not below tension_max_n = {}; are the two swapped?",
                tension_min.value, tension_max.value
            ),
        );
    } else if tension_max.good && over_tension.good && over_tension.value <= tension_max.value {
        section.report(
            over_tension.at,
            "over_tension_n",
            format!("is {} and not above tension_max_n = {}; the unit would fault on a tension that is allowed", over_tension.value, tension_max.value),
        );
    }
    if tension_max.good && force_limit.good && force_limit.value < tension_max.value {
        section.report(
            force_limit.at,
            "force_limit_n",
            format!(
                "is {} and below tension_max_n = {}; the motor could not hold the tension",
                force_limit.value, tension_max.value
            ),
        );
    }
}

/// Checks a unit's position and axis against the workspace.
pub(super) fn check_geometry(
    section: &Section<'_, '_>,
    unit: &UnitSettings,
    axis_at: usize,
    exit_at: usize,
    workspace: Workspace,
) {
    let length = unit.axis.norm();
    if (length - 1.0).abs() > 1e-3 {
        let hint = match unit.axis.try_normalize(0.0) {
            Some(v) => format!("; write [{:.6}, {:.6}, {:.6}]", v.x, v.y, v.z),
            None => String::new(),
        };
        section.report(
            axis_at,
            "axis",
            format!("has length {length:.4}, a unit vector is needed{hint}"),
        );
        return;
    }
    let span = (unit.exit_m - workspace.center_m).norm();
    if span <= workspace.radius_m {
        section.report(
            exit_at,
            "exit_m",
            format!("lies {span:.3} m from the workspace's centre, inside its radius of {} m; check the unit (metres) and the signs", workspace.radius_m),
        );
        return;
    }
    let Some((_, cos)) = unit.cable_at(workspace.center_m) else {
        return;
    };
    if cos <= 0.0 {
        section.report(
            axis_at,
            "axis",
            "points away from the workspace; it has to point from the unit to the workspace: flip all three signs",
        );
    } else if cos < 0.5 {
        section.report(
            axis_at,
            "axis",
            format!("is {:.0} degrees off the cable, the load cell would hardly see it; check exit_m and axis", cos.acos().to_degrees()),
        );
    }
}
