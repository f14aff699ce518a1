//! docs/residual/your-own-data.md as it stands, on the public data that it names, where they are
//! present.

use residual::{run, spec::Spec, EffectKind, Options};
use std::path::PathBuf;

/// Names the folder with clones of public repositories.
const VARIABLE: &str = "RESIDUAL_PUBLIC_DATA";

const PAGE: &str = include_str!("../../docs/residual/your-own-data.md");

/// The model file on the page.
fn model() -> Spec {
    let (_, block) = PAGE.split_once("<!-- model:begin -->\n```toml\n").unwrap();
    let (text, _) = block.split_once("```\n<!-- model:end -->").unwrap();
    Spec::parse(text).unwrap()
}

/// The path after an option on the page, below a folder.
fn path(option: &str, folder: &str) -> PathBuf {
    let (_, rest) = PAGE.split_once(option).unwrap();
    PathBuf::from(folder).join(rest.split_whitespace().next().unwrap())
}

#[test]
fn the_page_names_the_effect_of_the_public_log() {
    let model = model();
    let Ok(folder) = std::env::var(VARIABLE) else {
        eprintln!("{VARIABLE} names no folder: only the model file of the page was read");
        return;
    };
    let data = path("--data ", &folder);
    assert!(data.exists(), "{VARIABLE}: {} is not there", data.display());
    let first = residual::load::guess(std::slice::from_ref(&data)).unwrap();
    assert!(
        first.contains("Iq") && first.contains("Position"),
        "{first}"
    );
    let options = Options {
        data: vec![data],
        model,
        out: None,
    };
    let check = [path("--check ", &folder)];
    let report = residual::run_checked(&options, &check, &mut ()).unwrap();
    assert_eq!(report.effects[0].name, EffectKind::PeriodicAngle);
    let check = report.check.expect("logs to check were given");
    assert!(check.found_rmse < 0.5 * check.declared_rmse, "{check:?}");
    // Without logs to check, the same effect.
    assert_eq!(
        run(&options, &mut ()).unwrap().effects[0].name,
        EffectKind::PeriodicAngle
    );
}
