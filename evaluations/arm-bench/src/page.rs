//! The figures as a page in Markdown.

use crate::psm::{self, MOUNTS, SPEEDS, WEIGHTS_KG};
use crate::ur10e::{self, Results};
use estimator::metrics::half_width;
use std::fmt::Write as _;

const G: f64 = 9.81;
/// Text between generated parts.
const HEAD: &str = include_str!("page/head.txt");
const PSM: &str = include_str!("page/psm.txt");
const TAIL: &str = include_str!("page/tail.txt");

/// The page.
#[must_use]
pub fn page(ur10e: &Results, psm: &[psm::Model]) -> String {
    let mut out = HEAD.replace("{UR10E}", ur10e::SOURCE);
    of_ur10e(&mut out, ur10e);
    out += &PSM.replace("{PSM}", psm::SOURCE);
    of_psm(&mut out, psm);
    out += TAIL;
    out
}

fn list(values: &[f64], digits: usize) -> String {
    let values: Vec<String> = values.iter().map(|v| format!("{v:.digits$}")).collect();
    values.join(", ")
}

fn of_ur10e(out: &mut String, results: &Results) {
    let _ = writeln!(
        out,
        "\nTorque per current of joints 1 to 6: {} N·m/A.",
        list(&results.gains, 2)
    );
    for (name, rows) in &results.dropped {
        let _ = writeln!(out, "`{name}`: {rows} rows were dropped.");
    }
    *out += "\n| model | torque left on logs that were left out, joints 1 to 6, N·m RMS | force where there is none, N |\n| --- | --- | --- |\n";
    for model in &results.models {
        let (mean, half) = model.none_n;
        let half = half.map_or(String::new(), |half| format!(" ± {half:.1}"));
        let _ = writeln!(
            out,
            "| {} | {} | {mean:.1}{half} |",
            model.name,
            list(&model.left, 2)
        );
    }
    *out += "\n| log | mass, kg | model | error of x, y, z: MAE, N | weighed, kg | of the weight |\n| --- | --- | --- | --- | --- | --- |\n";
    let first = results.models.first();
    for (n, log) in first.map_or(&[][..], |m| &m.loaded).iter().enumerate() {
        let mass = log.mass_kg.map_or("not told".into(), |kg| format!("{kg}"));
        let row = |model: &str, mae: Option<[f64; 3]>, weighed: Option<f64>| {
            let mae = mae.map_or("-".into(), |mae| list(&mae, 2));
            let share = weighed.zip(log.mass_kg).map_or("-".into(), |(kg, mass)| {
                format!("{:.0} %", 100.0 * kg / mass)
            });
            let weighed = weighed.map_or("-".into(), |kg| format!("{kg:.2}"));
            format!(
                "| `{}` | {mass} | {model} | {mae} | {weighed} | {share} |\n",
                log.name
            )
        };
        if log.mass_kg.is_some() {
            *out += &row("always 0", log.zero_n, None);
        }
        for model in results.models.iter().rev() {
            let of = &model.loaded[n];
            *out += &row(model.name, of.mae_n, Some(of.weighed_kg));
        }
    }
}

fn of_psm(out: &mut String, models: &[psm::Model]) {
    *out += "\n| model | effort left on logs that were left out: yaw, pitch, N·m; insertion, N | static moment where there is no weight, kg·m |\n| --- | --- | --- |\n";
    for model in models {
        let _ = writeln!(
            out,
            "| {} | {} | {} |",
            model.name,
            list(&model.left, 3),
            list(&model.none_kg_m, 3)
        );
    }
    *out += "\n| mount | speed | weight, kg | model | left: yaw, pitch, insertion | insertion carries, kg | static moment, kg·m | lever, m | weight, N | estimated, N | error, N |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n";
    let count = models.first().map_or(0, |m| m.loaded.len());
    for n in 0..count {
        for model in models.iter().rev() {
            let of = &model.loaded[n];
            let kg = WEIGHTS_KG[of.weight];
            let estimated = of.moment_kg_m / of.lever_m() * G;
            let _ = writeln!(
                out,
                "| {} | {} | {kg} | {} | {} | {:.3} | {:.4} | {:.3} | {:.2} | {estimated:.2} | {:+.2} |",
                MOUNTS[of.mount],
                SPEEDS[of.speed].0,
                model.name,
                list(&of.left, 3),
                of.carried_kg,
                of.moment_kg_m,
                of.lever_m(),
                kg * G,
                estimated - kg * G,
            );
        }
    }
    for model in models {
        for (mount, name) in MOUNTS.iter().enumerate() {
            let of = |l: &&psm::Loaded| l.mount == mount;
            let errors: Vec<f64> = (model.loaded.iter().filter(of))
                .map(|l| (l.moment_kg_m / l.lever_m() - WEIGHTS_KG[l.weight]).abs() * G)
                .collect();
            let zero = WEIGHTS_KG.iter().sum::<f64>() / WEIGHTS_KG.len() as f64 * G;
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            let half = half_width(&errors).map_or(String::new(), |half| format!(" ± {half:.2}"));
            let _ = writeln!(
                out,
                "{}`{}`, {name}: mean absolute error over {} logs {mean:.2}{half} N; always 0 N: {zero:.2} N.",
                if mount == 0 { "\n" } else { "" },
                model.name,
                errors.len()
            );
        }
    }
}
