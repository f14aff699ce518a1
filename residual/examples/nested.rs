//! Nested evaluation of one's own data: how far the held-out figure of a report is from the error
//! on groups that took no part in the selection.
//!
//! `cargo run -p residual --example nested -- --data PATH... --model MODEL.toml`

use residual::spec::Spec;
use residual::{analyse, load, nested, num, Console, Error};
use std::path::PathBuf;
use std::process::ExitCode;

const USAGE: &str = "usage: nested --data PATH... --model MODEL.toml";

fn main() -> ExitCode {
    let Some((data, model)) = arguments() else {
        eprintln!("{USAGE}");
        return ExitCode::from(2);
    };
    match evaluate(&data, &model) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(e.exit_code())
        }
    }
}

/// Data and model; `None` where the command line is wrong.
fn arguments() -> Option<(Vec<PathBuf>, PathBuf)> {
    let (mut data, mut model) = (Vec::new(), None);
    let mut option = String::new();
    for word in std::env::args_os().skip(1) {
        match (option.as_str(), word.to_str()) {
            (_, Some(name @ ("--data" | "--model"))) => option = name.into(),
            ("--data", _) => data.push(PathBuf::from(word)),
            ("--model", _) if model.is_none() => model = Some(PathBuf::from(word)),
            _ => return None,
        }
    }
    (!data.is_empty()).then_some((data, model?))
}

fn evaluate(paths: &[PathBuf], model: &std::path::Path) -> Result<(), Error> {
    let spec = Spec::load(model)?;
    let data = load::load(paths, &spec)?;
    let console = &mut Console::default();
    let report = analyse(&spec, data.clone(), console)?;
    let nested = nested(&spec, &data, console)?;
    let u = &report.unit;
    println!("{}", report.summary());
    println!(
        "held-out RMSE, declared model: {} {u}",
        num(report.baseline.heldout_rmse)
    );
    println!(
        "held-out RMSE, report:         {} {u}",
        num(report.last.heldout_rmse)
    );
    println!("RMSE, nested:                  {} {u}", num(nested.rmse));
    for f in &nested.folds {
        let names: Vec<&str> = f.effects.iter().map(|e| e.as_str()).collect();
        println!(
            "  without {}: {}; RMSE on it {} -> {} {u}",
            f.name,
            names.join(", "),
            num(f.declared_rmse),
            num(f.rmse)
        );
    }
    Ok(())
}
