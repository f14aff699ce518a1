//! The units of a rig file: each `[[unit]]` with `[defaults]` behind it.

use super::check::{check_geometry, check_limits};
use super::section::Section;
use crate::{CellSettings, Filter, RippleSettings, UnitChecks, UnitSettings, Workspace};
use control::config::{field, Field};
use nalgebra::Vector3;
use std::cell::RefCell;
use std::collections::BTreeSet;
use toml::de::DeTable;
use wire::UNITS;

/// The six units, from their tables and `[defaults]`.
pub(super) fn read_units(root: &Section<'_, '_>, workspace: Workspace) -> [UnitSettings; UNITS] {
    let defaults = root.section("defaults");
    let mut units: [Option<UnitSettings>; UNITS] = [None; UNITS];
    let mut known = BTreeSet::new();
    let mut last = root.at;
    let entries = match root.get("unit") {
        None => &[][..],
        Some((value, span)) => match value.as_array() {
            Some(array) => array,
            None => {
                root.report(
                    span.start,
                    "unit",
                    "has to be a list: begin each unit with [[unit]]",
                );
                &[][..]
            }
        },
    };
    for entry in entries {
        let at = entry.span().start;
        last = at;
        let Some(table) = entry.get_ref().as_table() else {
            root.report(
                at,
                "unit",
                "has to be a list of tables: begin each unit with [[unit]]",
            );
            continue;
        };
        let mut section = Section {
            context: root.context,
            name: "unit".to_owned(),
            unit: None,
            at,
            table: Some(table),
            fallback: defaults.table,
            known: RefCell::default(),
        };
        let number = section.number("number", 1.0..=UNITS as f64, "1");
        if !number.good {
            continue;
        }
        if number.value.fract() != 0.0 {
            section.report(
                number.at,
                "number",
                format!("is {}, a whole number is needed", number.value),
            );
            continue;
        }
        let index = number.value as usize - 1;
        section.unit = Some(number.value as u8);
        let unit = read_unit(&section, workspace);
        section.finish();
        known.append(&mut section.known.borrow_mut());
        match units.get_mut(index) {
            Some(slot @ None) => *slot = Some(unit),
            _ => section.report(
                number.at,
                "number",
                "is used twice; number the units 1 to 6, each once",
            ),
        }
    }
    let read = units.iter().flatten();
    if read.clone().count() == UNITS && !read.clone().any(|unit| unit.enabled) {
        // The first place that says so.
        let at = enabled_at(defaults.table)
            .into_iter()
            .chain(
                entries
                    .iter()
                    .filter_map(|entry| enabled_at(entry.get_ref().as_table())),
            )
            .min()
            .unwrap_or(last);
        root.report(
            at,
            "enabled",
            "no unit is enabled, so there is nothing to drive; set `enabled = true` for the units that are there",
        );
    }
    // [defaults] knows the keys of a unit but for those that are its own.
    for own in ["number", "exit_m", "axis"] {
        known.remove(own);
    }
    if !entries.is_empty() {
        *defaults.known.borrow_mut() = known;
        defaults.finish();
    }
    core::array::from_fn(|i| {
        units[i].unwrap_or_else(|| {
            let number = i as u8 + 1;
            root.context.report(
                last,
                Some(number),
                "",
                format!("is missing; add a [[unit]] with `number = {number}` (and `enabled = false` where the unit isn't there)"),
            );
            stand_in(number)
        })
    })
}

/// Where a table has the key `enabled`, bytes.
fn enabled_at(table: Option<&DeTable<'_>>) -> Option<usize> {
    table?
        .iter()
        .find(|(name, _)| name.get_ref() == "enabled")
        .map(|(name, _)| name.span().start)
}

/// Fills the place of a unit that was reported missing; never leaves this module.
fn stand_in(number: u8) -> UnitSettings {
    UnitSettings {
        number,
        enabled: false,
        exit_m: Vector3::zeros(),
        axis: Vector3::x(),
        scale_n_per_count: 0.0,
        tension_min_n: 0.0,
        tension_max_n: 0.0,
        filter: Filter::MovingAverage(1),
        spike_limit_n: 0.0,
        kp: 0.0,
        ki_per_s: 0.0,
        leaky_ki_per_s: 0.0,
        kd_s: 0.0,
        damping_n_s_per_m: 0.0,
        friction_feedforward: false,
        friction_offset_n: 0.0,
        friction_gain: 0.0,
        coulomb_n: 0.0,
        coulomb_per_n: 0.0,
        reversal_m: 0.0,
        travel_m_per_count: 0.0,
        dac_codes_per_n: 0.0,
        force_limit_n: 0.0,
        slew_n_per_s: 0.0,
        over_tension_n: 0.0,
        viscous_n_s_per_m: 0.0,
        checks: UnitChecks::default(),
        ripples: Default::default(),
        cell: CellSettings::default(),
    }
}

/// Ripple `n` (from 0): keys `ripple_...` and `ripple2_...`. Without an amplitude there is none.
fn read_ripple(section: &Section<'_, '_>, n: usize) -> RippleSettings {
    let prefix = ["ripple", "ripple2"][n.min(1)];
    let amplitude_key = format!("{prefix}_amplitude_n");
    let amplitude = section.optional(&amplitude_key, field::RIPPLE_AMPLITUDE.range(), 0.0);
    let per_n = section.optional(
        &format!("{prefix}_amplitude_per_n"),
        field::RIPPLE_LOAD.range(),
        0.0,
    );
    let period_key = format!("{prefix}_period_m");
    let period = section.optional(&period_key, 5e-4..=1.0, 0.0);
    let ripple = RippleSettings {
        period_m: period.value,
        amplitude_n: amplitude.value,
        amplitude_per_n: per_n.value,
        phase_rad: section
            .optional(&format!("{prefix}_phase_rad"), -1e3..=1e3, 0.0)
            .value,
    };
    if !ripple.is_none() && period.good && ripple.period_m == 0.0 {
        section.report(
            amplitude.at,
            &period_key,
            format!("is missing beside {prefix}'s amplitude; add the cable travel of a period, as in `{period_key} = 0.0169`"),
        );
    }
    ripple
}

fn read_unit(section: &Section<'_, '_>, workspace: Workspace) -> UnitSettings {
    let n = |key, field: &Field, example| section.number(key, field.range(), example);
    let exit = section.vector("exit_m", 10.0, "[0.335, 0.045, -0.110]");
    let axis = section.vector("axis", 2.0, "[-1.0, 0.0, 0.0]");
    let scale = n("scale_n_per_count", &field::SCALE, "6.85e-6");
    if scale.good && scale.value.abs() < field::SCALE.least_size {
        section.report(
            scale.at,
            "scale_n_per_count",
            format!(
                "is {}, too small to be a load cell's; calibrate the unit (nominal 6.85e-6)",
                scale.value
            ),
        );
    }
    let tension_min = section.number("tension_min_n", 0.1..=60.0, "2.0");
    let tension_max = section.number("tension_max_n", 0.1..=60.0, "12.0");
    let most = *field::FORCE_LIMIT.range().end();
    let force_limit = section.number("force_limit_n", 0.1..=most, "16.0");
    let over_tension = n("over_tension_n", &field::OVER_TENSION, "20.0");
    let travel = n("travel_m_per_count", &field::TRAVEL, "-4.229e-6");
    if travel.good && travel.value.abs() < field::TRAVEL.least_size {
        section.report(travel.at, "travel_m_per_count", "is (nearly) zero; nominal is 2 pi 10 mm / (4000 * 26 / 7) = 4.229e-6, negative where winding in counts down");
    }
    let dac = n("dac_codes_per_n", &field::DAC_SCALE, "282.2");
    if dac.good && dac.value.abs() < field::DAC_SCALE.least_size {
        section.report(dac.at, "dac_codes_per_n", "is (nearly) zero; nominal is 282.2, negative where the motor turns the other way round");
    }
    let unit = UnitSettings {
        number: section.unit.unwrap_or(0),
        enabled: section.flag("enabled", Some(true)),
        exit_m: exit.value,
        axis: axis.value,
        scale_n_per_count: scale.value,
        tension_min_n: tension_min.value,
        tension_max_n: tension_max.value,
        filter: read_filter(section),
        spike_limit_n: n("spike_limit_n", &field::SPIKE_LIMIT, "1.0").value,
        kp: n("kp", &field::KP, "0.3").value,
        ki_per_s: n("ki_per_s", &field::KI, "20.0").value,
        leaky_ki_per_s: section
            .optional("leaky_ki_per_s", field::LEAKY_KI.range(), 0.0)
            .value,
        kd_s: n("kd_s", &field::KD, "0.0").value,
        damping_n_s_per_m: n("damping_n_s_per_m", &field::DAMPING, "110.0").value,
        friction_feedforward: section.flag("friction_feedforward", None),
        friction_offset_n: n("friction_offset_n", &field::OFFSET, "0.155").value,
        friction_gain: n("friction_gain", &field::GAIN, "1.018").value,
        coulomb_n: n("coulomb_n", &field::COULOMB, "0.909").value,
        coulomb_per_n: n("coulomb_per_n", &field::COULOMB_LOAD, "0.154").value,
        reversal_m: n("reversal_m", &field::REVERSAL, "1e-4").value,
        travel_m_per_count: travel.value,
        dac_codes_per_n: dac.value,
        force_limit_n: force_limit.value,
        slew_n_per_s: n("slew_n_per_s", &field::SLEW, "400.0").value,
        over_tension_n: over_tension.value,
        viscous_n_s_per_m: section
            .optional("viscous_n_s_per_m", field::VISCOUS.range(), 0.0)
            .value,
        checks: read_checks(section),
        ripples: core::array::from_fn(|n| read_ripple(section, n)),
        cell: read_cell(section),
    };
    check_limits(
        section,
        &tension_min,
        &tension_max,
        &force_limit,
        &over_tension,
    );
    // The board's own check, so that nothing is refused only once it is connected.
    if section.context.problems.borrow().is_empty() {
        if let Err(error) = control::Config::from_wire(&unit.to_wire()) {
            section.report(
                section.at,
                error.field.name,
                format!("the board would refuse it: {error}"),
            );
        }
    }
    if exit.good && axis.good {
        check_geometry(section, &unit, axis.at, exit.at, workspace);
    }
    unit
}

/// Curve and creep of the load cell; none unless given.
fn read_cell(section: &Section<'_, '_>) -> CellSettings {
    let default = CellSettings::default();
    let n = |key, field: &Field, or| section.optional(key, field.range(), or).value;
    CellSettings {
        curve_per_n: n("cell_curve_per_n", &field::CELL_CURVE, default.curve_per_n),
        creep: n("cell_creep", &field::CELL_CREEP, default.creep),
        creep_s: n("cell_creep_s", &field::CELL_CREEP_TIME, default.creep_s),
    }
}

fn read_checks(section: &Section<'_, '_>) -> UnitChecks {
    let default = UnitChecks::default();
    let n = |key, field: &Field, or| section.optional(key, field.range(), or).value;
    UnitChecks {
        zero_code: n("zero_code", &field::STORED_ZERO, default.zero_code),
        zero_deviation_n: n(
            "zero_deviation_n",
            &field::ZERO_DEVIATION,
            default.zero_deviation_n,
        ),
        authority_n: n("authority_n", &field::AUTHORITY, default.authority_n),
        plausible_n: n("plausible_n", &field::PLAUSIBLE, default.plausible_n),
    }
}

fn read_filter(section: &Section<'_, '_>) -> Filter {
    let kind = section.text("filter", "low_pass");
    // Both keys are known, so that the one not in use may stay in [defaults].
    let corner = |s: &Section<'_, '_>| {
        s.number("filter_corner_hz", field::FILTER.range(), "100.0")
            .value
    };
    let samples =
        |s: &Section<'_, '_>| s.number("filter_samples", field::FILTER_SAMPLES.range(), "4");
    match kind.value.as_str() {
        "low_pass" => {
            section
                .known
                .borrow_mut()
                .insert("filter_samples".to_owned());
            Filter::LowPass(corner(section))
        }
        "moving_average" => {
            section
                .known
                .borrow_mut()
                .insert("filter_corner_hz".to_owned());
            let n = samples(section);
            if n.value.fract() != 0.0 {
                section.report(
                    n.at,
                    "filter_samples",
                    format!("is {}, a whole number is needed", n.value),
                );
            }
            Filter::MovingAverage(n.value as u8)
        }
        other => {
            if kind.good {
                section.report(
                    kind.at,
                    "filter",
                    format!("`{other}` is not a filter; use \"low_pass\" or \"moving_average\""),
                );
            }
            Filter::MovingAverage(1)
        }
    }
}
