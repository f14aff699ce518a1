//! From TOML text to a checked [`Rig`]: every value by hand, so that each message can name the
//! line.
//!
//! | part | file |
//! | --- | --- |
//! | values of a section, and their problems | `section` |
//! | the units | `units` |
//! | checks between values | `check` |

mod check;
mod section;
#[cfg(test)]
mod tests;
mod units;

use super::{
    AllocationSettings, ControllerSettings, PoseChoice, Problem, Reference, Rig, Workspace, SCHEMA,
    TIP_FORCE_LIMIT_N,
};
use section::{Context, Section};
use std::cell::RefCell;
use std::collections::BTreeSet;
use toml::de::DeTable;
use toml::Spanned;
use units::read_units;
use wire::UNITS;

/// Parses and checks.
pub(super) fn parse(text: &str) -> Result<Rig, Vec<Problem>> {
    let context = Context {
        text,
        problems: RefCell::default(),
    };
    let table = match DeTable::parse(text) {
        Ok(table) => table,
        Err(error) => {
            let at = error.span().map_or(0, |span| span.start);
            context.report(at, None, "", format!("not TOML: {}", error.message()));
            return Err(context.problems.into_inner());
        }
    };
    let rig = read_root(&context, &table);
    let mut problems = context.problems.into_inner();
    if problems.is_empty() {
        return Ok(rig);
    }
    merge_units(&mut problems);
    problems.sort_by_key(|problem| problem.line);
    Err(problems)
}

/// Makes one problem of a key that is missing in every unit.
fn merge_units(problems: &mut Vec<Problem>) {
    let alike = |a: &Problem, b: &Problem| a.key == b.key && a.message == b.message;
    let common: Vec<Problem> = problems
        .iter()
        .filter(|first| {
            let units: BTreeSet<u8> = problems
                .iter()
                .filter(|other| alike(first, other))
                .filter_map(|other| other.unit)
                .collect();
            units.len() == UNITS && first.unit == Some(1) && first.message.starts_with("is missing")
        })
        .cloned()
        .collect();
    for one in common {
        problems.retain(|other| !alike(&one, other));
        problems.push(Problem {
            unit: None,
            message: format!("{} (all {UNITS} units)", one.message),
            ..one
        });
    }
}

fn read_root<'c, 't>(context: &'c Context<'t>, table: &'c Spanned<DeTable<'t>>) -> Rig {
    let root = Section {
        context,
        name: String::new(),
        unit: None,
        at: 0,
        table: Some(table.get_ref()),
        fallback: None,
        known: RefCell::default(),
    };
    let schema = root.number("schema", 0.0..=1e6, "1");
    if schema.good && schema.value != SCHEMA as f64 {
        root.report(
            schema.at,
            "schema",
            format!("is {}, this forcectl reads schema {SCHEMA}; use a forcectl of that time or bring the file up to date", schema.value),
        );
    }
    let name = root.text("name", "my-rig").value;
    let link = read_link(&root);
    let (pose, pose_sd_m) = read_pose(&root);
    let workspace = read_workspace(&root);
    let controller = read_controller(&root);
    let allocation = read_allocation(&root);
    let units = read_units(&root, workspace);
    root.finish();
    Rig {
        name,
        link,
        pose,
        pose_sd_m,
        workspace,
        controller,
        allocation,
        units,
        calibration: None,
    }
}

fn read_link(root: &Section<'_, '_>) -> super::LinkChoice {
    let section = root.section("link");
    let rig = section.text("rig", "embedded");
    let link = rig.value.parse().unwrap_or_else(|message: String| {
        if rig.good {
            section.report(rig.at, "rig", message);
        }
        super::LinkChoice::Embedded
    });
    section.finish();
    link
}

/// The source, and the standard deviation of its poses, m.
fn read_pose(root: &Section<'_, '_>) -> (PoseChoice, f64) {
    let section = root.section("pose");
    let source = section.text("source", "rig");
    let pose = match source.value.as_str() {
        "rig" => PoseChoice::Rig,
        "udp" => {
            let listen = section.text("listen", "127.0.0.1:4711");
            if listen.good && listen.value.parse::<std::net::SocketAddr>().is_err() {
                section.report(
                    listen.at,
                    "listen",
                    format!(
                        "`{}` is not an address with a port, for example \"127.0.0.1:4711\"",
                        listen.value
                    ),
                );
            }
            PoseChoice::Udp {
                listen: listen.value,
                max_age_s: section.number("max_age_s", 0.005..=1.0, "0.1").value,
            }
        }
        "static" => PoseChoice::Static {
            position_m: section.vector("position_m", 10.0, "[0.0, 0.0, 0.0]").value,
        },
        other => {
            if source.good {
                section.report(
                    source.at,
                    "source",
                    format!("`{other}` is not a pose source; use \"rig\", \"udp\" or \"static\""),
                );
            }
            PoseChoice::Rig
        }
    };
    let usual = 1e3 * pose.usual_sd_m();
    let sd_mm = section.optional("position_sd_mm", 0.0..=50.0, usual).value;
    section.finish();
    (pose, 1e-3 * sd_mm)
}

fn read_workspace(root: &Section<'_, '_>) -> Workspace {
    let section = root.section("workspace");
    let workspace = Workspace {
        center_m: section
            .vector("center_m", 10.0, "[-0.08, 0.025, -0.14]")
            .value,
        radius_m: section.number("radius_m", 1e-3..=1.0, "0.10").value,
    };
    section.finish();
    workspace
}

fn read_controller(root: &Section<'_, '_>) -> ControllerSettings {
    let section = root.section("controller");
    let controller = ControllerSettings {
        kp: section.number("kp", 0.0..=10.0, "0.2").value,
        ki_per_s: section.number("ki_per_s", 0.0..=100.0, "2.0").value,
        integral_limit_n: section.number("integral_limit_n", 0.0..=20.0, "1.5").value,
        slew_n_per_s: section.number("slew_n_per_s", 0.1..=1000.0, "20.0").value,
        force_limit_n: section.number("force_limit_n", 0.1..=60.0, "12.0").value,
        tip_force_limit_n: section
            .optional("tip_force_limit_n", 1.0..=100.0, TIP_FORCE_LIMIT_N)
            .value,
        pointer_ahead: section.flag("pointer_ahead", Some(true)),
        preview: section.flag("preview", Some(true)),
    };
    section.finish();
    controller
}

fn read_allocation(root: &Section<'_, '_>) -> AllocationSettings {
    let section = root.section("allocation");
    let reference = section.text("reference", "lower");
    let allocation = AllocationSettings {
        reference: match reference.value.as_str() {
            "lower" => Reference::Lower,
            "middle" => Reference::Middle,
            other => {
                if reference.good {
                    section.report(
                        reference.at,
                        "reference",
                        format!("`{other}` is not a policy; use \"lower\" (least load on robot and motors) or \"middle\" (far from slack)"),
                    );
                }
                Reference::Lower
            }
        },
        tie_break: section.number("tie_break", 1e-6..=1.0, "1e-4").value,
    };
    section.finish();
    allocation
}
