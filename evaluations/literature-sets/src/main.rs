//! `literature-sets`: writes synthetic sets of logs with effects from the literature.

use lexopt::prelude::*;
use literature_sets::effects::{by_name, table, Effect, CATALOGUE};
use literature_sets::excitation::Measured;
use literature_sets::random::Random;
use literature_sets::request::Request;
use literature_sets::set::Set;
use literature_sets::write;
use std::path::PathBuf;
use std::process::ExitCode;

const HELP: &str = "\
Writes synthetic logs of a force rig whose declared model lacks known effects.

Usage: literature-sets --out DIR [options]
       literature-sets --list

  --out DIR          folder for the sets; each becomes DIR/set-SEED with logs/, MODEL.toml and truth.json
  --seed N           seed of the first set (default 1)
  --sets N           number of sets, with the seeds N, N+1, ... (default 1)
  --effect A[,B[,C]] effects that the model lacks; `none` for an empty set; `random` for one to three of all
                     (default random)
  --size X           RMS of each effect after the fit of the declared model, over the RMS of the noise (default 1.0)
  --rate HZ          rows per second, 20 to 320 (default 100)
  --noise N          RMS of the noise in N, 0.001 to 0.06 (default: drawn for each set)
  --runs N           logs in a set (default: drawn, 4 to 8)
  --duration S       duration of each log in s (default: drawn for each log, 40 to 90)
  --excitation DIR   take command, velocity and angle from the measured logs in this folder
  --no-compare       do not fit other effects of the catalogue to the missing ones (faster)
  --list             list the effects
  --table            the effects with the ranges of their parameters, as Markdown
  --help             this text
";

/// Which effects the sets lack.
enum Choice {
    Given(Vec<&'static Effect>),
    Random,
}

struct Options {
    out: PathBuf,
    sets: u64,
    choice: Choice,
    request: Request,
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let Some(options) = options(lexopt::Parser::from_env())? else {
        return Ok(());
    };
    for seed in (0..options.sets).map(|n| options.request.seed.wrapping_add(n)) {
        let effects = match &options.choice {
            Choice::Given(effects) => effects.clone(),
            Choice::Random => random_effects(seed),
        };
        let request = Request {
            seed,
            effects,
            ..options.request.clone()
        };
        let folder = options.out.join(format!("set-{seed}"));
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

/// The options; `None` if the work is done with a text.
fn options(mut parser: lexopt::Parser) -> Result<Option<Options>, String> {
    let mut out = None;
    let mut sets = 1;
    let mut choice = Choice::Random;
    let mut request = Request::new(1, Vec::new(), 1.0, 100.0);
    while let Some(argument) = parser.next().map_err(|e| e.to_string())? {
        let name = match argument {
            Long(name) => name.to_string(),
            Short('h') => "help".to_string(),
            other => return Err(format!("{}; see --help", other.unexpected())),
        };
        match name.as_str() {
            "help" => {
                print!("{HELP}");
                return Ok(None);
            }
            "list" => {
                list();
                return Ok(None);
            }
            "table" => {
                print!("{}", table());
                return Ok(None);
            }
            "no-compare" => {
                request.compare = false;
                continue;
            }
            "out" | "seed" | "sets" | "effect" | "size" | "rate" | "noise" | "runs"
            | "duration" | "excitation" => {}
            _ => return Err(format!("no option --{name}; see --help")),
        }
        let value = parser.value().map_err(|e| format!("{e}; see --help"))?;
        let text = value.to_string_lossy().into_owned();
        match name.as_str() {
            "out" => out = Some(PathBuf::from(&value)),
            "seed" => request.seed = number(&name, &text)?,
            "sets" => sets = number(&name, &text)?,
            "effect" => choice = effects(&text)?,
            "size" => request.size = number(&name, &text)?,
            "rate" => request.rate_hz = number(&name, &text)?,
            "noise" => request.noise_n = Some(number(&name, &text)?),
            "runs" => request.runs = Some(number(&name, &text)?),
            "duration" => request.duration_s = Some(number(&name, &text)?),
            _ => request.excitation = Some(Measured::read(&PathBuf::from(&value))?),
        }
    }
    let out = out.ok_or("no --out; give the folder for the sets, or see --help")?;
    Ok(Some(Options {
        out,
        sets,
        choice,
        request,
    }))
}

fn number<T: std::str::FromStr>(name: &str, text: &str) -> Result<T, String> {
    text.parse()
        .map_err(|_| format!("--{name} {text}: not a number of the right kind; see --help"))
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
