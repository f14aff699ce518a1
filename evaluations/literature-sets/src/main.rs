//! `literature-sets`: writes synthetic sets of logs with effects from the literature.

use evaluation::clap::{self, Parser};
use literature_sets::effects::{by_name, table, Effect, CATALOGUE};
use literature_sets::excitation::Measured;
use literature_sets::random::Random;
use literature_sets::request::Request;
use literature_sets::set::Set;
use literature_sets::write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Writes synthetic logs of a force rig whose declared model lacks known effects.
#[derive(Parser)]
struct Options {
    /// Folder for the sets; each becomes DIR/set-SEED with logs/, MODEL.toml and truth.json.
    #[arg(long, value_name = "DIR", required_unless_present_any = ["list", "table"])]
    out: Option<PathBuf>,
    /// Seed of the first set.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Number of sets, with the seeds N, N+1, ...
    #[arg(long, value_name = "N", default_value_t = 1)]
    sets: u64,
    /// Effects that the model lacks; `none` for an empty set; `random` for one to three of all.
    #[arg(long, value_name = "A[,B[,C]]", default_value = "random", value_parser = effects)]
    effect: Choice,
    /// RMS of each effect after the fit of the declared model, over the RMS of the noise.
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    size: f64,
    /// Rows per second, 20 to 320.
    #[arg(long, value_name = "HZ", default_value_t = 100.0)]
    rate: f64,
    /// RMS of the noise in N, 0.001 to 0.06 (default: drawn for each set).
    #[arg(long, value_name = "N")]
    noise: Option<f64>,
    /// Logs in a set (default: drawn, 4 to 8).
    #[arg(long, value_name = "N")]
    runs: Option<usize>,
    /// Duration of each log in s (default: drawn for each log, 40 to 90).
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Take command, velocity and angle from the measured logs in this folder.
    #[arg(long, value_name = "DIR")]
    excitation: Option<PathBuf>,
    /// Do not fit other effects of the catalogue to the missing ones (faster).
    #[arg(long)]
    no_compare: bool,
    /// List the effects.
    #[arg(long)]
    list: bool,
    /// The effects with the ranges of their parameters, as Markdown.
    #[arg(long)]
    table: bool,
}

/// Which effects the sets lack.
#[derive(Clone)]
enum Choice {
    Given(Vec<&'static Effect>),
    Random,
}

evaluation::test_options!(Options);

fn main() -> ExitCode {
    evaluation::run(|options: Options| {
        match &options.out {
            _ if options.list => list(),
            _ if options.table => print!("{}", table()),
            Some(out) => sets(&options, out)?,
            None => {}
        }
        Ok(ExitCode::SUCCESS)
    })
}

fn sets(options: &Options, out: &Path) -> Result<(), String> {
    let excitation = options
        .excitation
        .as_deref()
        .map(Measured::read)
        .transpose()?;
    for seed in (0..options.sets).map(|n| options.seed.wrapping_add(n)) {
        let request = Request {
            seed,
            effects: match &options.effect {
                Choice::Given(effects) => effects.clone(),
                Choice::Random => random_effects(seed),
            },
            size: options.size,
            rate_hz: options.rate,
            noise_n: options.noise,
            runs: options.runs,
            duration_s: options.duration,
            excitation: excitation.clone(),
            compare: !options.no_compare,
        };
        let folder = out.join(format!("set-{seed}"));
        let set = Set::generate(&request).map_err(|e| format!("set with seed {seed}: {e}"))?;
        write::write(&set, &folder)?;
        println!("{}", folder.display());
    }
    Ok(())
}

/// One to three effects; one in five is from outside.
fn random_effects(seed: u64) -> Vec<&'static Effect> {
    let mut random = Random::new(seed, "effects");
    let count = random.integer(1, 3);
    let mut effects: Vec<&'static Effect> = Vec::new();
    while effects.len() < count {
        let outside = random.chance(0.2);
        let pool: Vec<&Effect> = CATALOGUE
            .iter()
            .filter(|e| e.outside == outside && !effects.contains(e))
            .collect();
        effects.push(pool[random.index(pool.len())]);
    }
    effects
}

fn effects(text: &str) -> Result<Choice, String> {
    match text {
        "none" => Ok(Choice::Given(Vec::new())),
        "random" => Ok(Choice::Random),
        names => names
            .split(',')
            .map(|name| by_name(name.trim()))
            .collect::<Result<_, _>>()
            .map(Choice::Given),
    }
}

fn list() {
    for effect in CATALOGUE {
        let mark = if effect.outside { " [outside]" } else { "" };
        println!(
            "{:20} {}{mark}\n{:20} {}\n{:20} {}",
            effect.name, effect.title, "", effect.equation, "", effect.source
        );
    }
}
