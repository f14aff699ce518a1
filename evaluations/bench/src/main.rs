//! `cargo xtask bench`: the rig's figures, printed and written as one flat JSON object.
//!
//! Times are emulated times wherever a time of the rig is meant; the only clocks on the wall are those of the
//! allocation's solve and of the emulation's speed, and both depend on the machine.

use emulator_link::Latency;
use host_cli::force::allocation::study;
use host_cli::force::metrics::Metrics;
use host_cli::link::embedded::{EmbeddedRig, Programs};
use host_cli::link::{EmbeddedOptions, RigLink};
use host_cli::rigfile::RigFile;
use host_cli::run::{self, NoopObserver, Options};
use serde_json::{Map, Value};
use std::path::PathBuf;
use std::process::{Command, ExitCode};
use test_stand::{quantile, rig_file, Stand};

/// What `--help` prints; `cargo xtask bench --help` as well.
const HELP: &str = include_str!("help.txt");

/// Seeds of the runs whose worst figure is quoted.
const SEEDS: [u64; 3] = [1, 2, 3];

/// What a figure has to be.
#[derive(Clone, Copy)]
enum Goal {
    AtMost(f64),
    AtLeast(f64),
    /// Reported beside the others.
    None,
}

struct Figure {
    key: &'static str,
    value: f64,
    goal: Goal,
    what: &'static str,
}

#[derive(Default)]
struct Figures(Vec<Figure>);

impl Figures {
    fn add(&mut self, key: &'static str, value: f64, goal: Goal, what: &'static str) {
        let figure = Figure {
            key,
            value,
            goal,
            what,
        };
        println!(
            "{:<38} {:>12}   {:<12} {}",
            figure.key,
            number(value),
            verdict(&figure),
            what
        );
        self.0.push(figure);
    }
}

/// Four significant digits, without exponent.
fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if size < 1e-3 {
        return format!("{value:.2e}");
    }
    let digits = (3 - size.log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.digits$}")
}

fn verdict(figure: &Figure) -> String {
    match figure.goal {
        Goal::AtMost(limit) if figure.value <= limit => format!("<= {limit} ok"),
        Goal::AtMost(limit) => format!("<= {limit} MISSED"),
        Goal::AtLeast(limit) if figure.value >= limit => format!(">= {limit} ok"),
        Goal::AtLeast(limit) => format!(">= {limit} MISSED"),
        Goal::None => String::new(),
    }
}

struct Arguments {
    out: PathBuf,
    markdown: Option<PathBuf>,
    quick: bool,
}

/// `None`: `--help` was asked for.
fn arguments() -> Result<Option<Arguments>, String> {
    let (mut out, mut markdown, mut quick) = (None, None, false);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut path = || {
            words
                .next()
                .map(PathBuf::from)
                .ok_or_else(|| format!("{word} needs a file\n\n{HELP}"))
        };
        match word.as_str() {
            "--out" => out = Some(path()?),
            "--markdown" => markdown = Some(path()?),
            "--quick" => quick = true,
            "-h" | "--help" => return Ok(None),
            _ => return Err(format!("{word}: no such option\n\n{HELP}")),
        }
    }
    Ok(Some(Arguments {
        out: out.ok_or_else(|| format!("--out is missing\n\n{HELP}"))?,
        markdown,
        quick,
    }))
}

fn main() -> ExitCode {
    let arguments = match arguments() {
        Ok(Some(arguments)) => arguments,
        Ok(None) => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("bench: {error}");
            return ExitCode::from(2);
        }
    };
    match bench(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("bench: {error}");
            ExitCode::FAILURE
        }
    }
}

fn bench(arguments: &Arguments) -> Result<(), String> {
    let mut figures = Figures::default();
    sample_path(&mut figures, if arguments.quick { 20 } else { 600 })?;
    fixed_point(&mut figures)?;
    holding(&mut figures)?;
    allocation(&mut figures, if arguments.quick { 5_000 } else { 100_000 })?;
    let mut object = Map::new();
    for figure in &figures.0 {
        object.insert(figure.key.to_owned(), Value::from(figure.value));
    }
    let write = |path: &PathBuf, text: String| {
        std::fs::write(path, text)
            .map_err(|error| format!("{} can't be written: {error}", path.display()))
    };
    let json = serde_json::to_string_pretty(&object).map_err(|error| error.to_string())?;
    write(&arguments.out, json + "\n")?;
    println!("written to {}", arguments.out.display());
    if let Some(path) = &arguments.markdown {
        write(path, page(&figures, arguments.quick))?;
        println!("written to {}", path.display());
    }
    Ok(())
}

fn start(seed: u64) -> Result<EmbeddedRig, String> {
    let programs = Programs::from_environment().map_err(|error| error.to_string())?;
    let options = EmbeddedOptions {
        seed: Some(seed),
        ..EmbeddedOptions::default()
    };
    EmbeddedRig::start(&programs, &options).map_err(|error| error.to_string())
}

/// Where a part of a sample's way begins and ends, in nanoseconds.
type Part = fn(&Latency) -> (u64, u64);

/// Six units, armed, the robot moving: latency, losses, load, speed of the emulation.
fn sample_path(figures: &mut Figures, seconds: u32) -> Result<(), String> {
    println!("\nsample path: six units at 320 SPS with drifting clocks, {seconds} emulated seconds, seed 1");
    let mut link = start(1)?;
    let mut stand = Stand::armed(&mut link, 4.0);
    stand.robot(true);
    stand.run(2.0);
    let first = stand.report();
    let counters = stand.session.counters();
    let before = stand.status();
    let mut latencies: Vec<Latency> = Vec::new();
    let mut last = first.clone();
    for second in 0..seconds {
        stand.run(1.0);
        stand.session.drain();
        if second % 30 == 29 || second + 1 == seconds {
            last = stand.report();
            latencies.append(&mut last.latencies);
            eprint!(
                "\r{:>4} of {seconds} s, {:.2} times real time ",
                second + 1,
                speed(&first, &last)
            );
        }
    }
    eprintln!();
    let after = stand.status();
    let ms = |part: Part| -> Vec<f64> {
        latencies
            .iter()
            .map(part)
            .map(|(from, to)| to.saturating_sub(from) as f64 * 1e-6)
            .collect()
    };
    let whole = ms(|l| (l.drdy_ns, l.dac_update_ns));
    figures.add(
        "drdy_to_dac_ms_p50",
        quantile(&whole, 0.5),
        Goal::AtMost(0.20),
        "DRDY edge to DAC update, median",
    );
    figures.add(
        "drdy_to_dac_ms_p99",
        quantile(&whole, 0.99),
        Goal::AtMost(0.45),
        "the same, 99th percentile",
    );
    figures.add(
        "drdy_to_dac_ms_max",
        quantile(&whole, 1.0),
        Goal::None,
        "the same, worst",
    );
    let stages: [(&'static str, Part, &'static str); 4] = [
        (
            "stage_wait_ms_p50",
            |l| (l.drdy_ns, l.bus_start_ns),
            "stage: DRDY edge to START, waiting for the bus",
        ),
        (
            "stage_bus_ms_p50",
            // Select and register pointer are usually ahead of the edge: that time is not the sample's.
            |l| (l.bus_start_ns.max(l.drdy_ns), l.data_ns),
            "stage: START, or the edge where the bus was ahead of it, to the last data byte",
        ),
        (
            "stage_compute_ms_p50",
            |l| (l.data_ns, l.dac_word_ns),
            "stage: last byte to the DAC word",
        ),
        (
            "stage_dac_ms_p50",
            |l| (l.dac_word_ns, l.dac_update_ns),
            "stage: DAC word to the LDAC edge",
        ),
    ];
    for (key, part, what) in stages {
        figures.add(key, quantile(&ms(part), 0.5), Goal::None, what);
    }
    figures.add(
        "stage_wait_ms_p99",
        quantile(&ms(stages[0].1), 0.99),
        Goal::None,
        "waiting for the bus, 99th percentile",
    );
    let selects =
        latencies.iter().filter(|l| l.mux_select).count() as f64 / latencies.len().max(1) as f64;
    figures.add(
        "mux_select_fraction",
        selects,
        Goal::None,
        "samples whose multiplexer select was on the way",
    );
    // The converter's sinc4 at 320 SPS delays by two conversion periods (device facts: 6.25 ms).
    figures.add(
        "force_to_dac_ms_p50",
        6.25 + quantile(&whole, 0.5),
        Goal::None,
        "with the converter's filter (6.25 ms group delay) in it",
    );
    let lost: u64 = (0..6)
        .map(|unit| {
            let made = last.conversions[unit] - first.conversions[unit];
            let read = last.conversions_read[unit] - first.conversions_read[unit];
            // One conversion may be between its edge and its reading at either end.
            made.saturating_sub(read).saturating_sub(1)
        })
        .sum();
    let missed: u32 = (0..6)
        .map(|unit| after.units[unit].missed - before.units[unit].missed)
        .sum();
    let frames = stand.session.counters().frames_lost - counters.frames_lost;
    figures.add(
        "samples_lost",
        lost as f64 + f64::from(missed) + frames as f64,
        Goal::AtMost(0.0),
        "conversions not read in time, and telemetry frames lost",
    );
    figures.add(
        "samples_taken",
        latencies.len() as f64,
        Goal::None,
        "samples that moved a DAC",
    );
    figures.add(
        "emulated_minutes",
        f64::from(seconds) / 60.0,
        Goal::None,
        "how long that was",
    );
    let instructions: Vec<f64> = latencies.iter().map(|l| l.instructions as f64).collect();
    figures.add(
        "instructions_per_sample",
        quantile(&instructions, 0.5),
        Goal::AtMost(2000.0),
        "from the I2C result to the DAC word, median, interrupts in between included",
    );
    figures.add(
        "instructions_per_sample_p99",
        quantile(&instructions, 0.99),
        Goal::None,
        "the same, 99th percentile",
    );
    let slept =
        last.sleep_fraction * last.now_ns as f64 - first.sleep_fraction * first.now_ns as f64;
    figures.add(
        "cpu_sleep_fraction",
        slept / (last.now_ns - first.now_ns) as f64,
        Goal::AtLeast(0.9),
        "time the core slept",
    );
    figures.add(
        "emulated_seconds_per_second",
        speed(&first, &last),
        Goal::AtLeast(1.0),
        "speed of the emulation (this machine)",
    );
    Ok(())
}

/// Virtual seconds per second on the wall between two reports.
fn speed(from: &emulator_link::Report, to: &emulator_link::Report) -> f64 {
    (to.now_ns - from.now_ns) as f64 / (to.wall_ns - from.wall_ns).max(1) as f64
}

/// The control core's own comparison with its f64 reference.
fn fixed_point(figures: &mut Figures) -> Result<(), String> {
    println!("\nfixed point: a million samples against the f64 reference");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args([
            "run",
            "--quiet",
            "--release",
            "--package",
            "control",
            "--example",
            "fixed_point_error",
        ])
        .args(["--", "--samples", "1000000"])
        .output()
        .map_err(|error| format!("cargo can't be started: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let value = text.lines().find_map(|line| {
        line.strip_prefix("fixed_point_error_n ")?
            .trim()
            .parse()
            .ok()
    });
    let value = value.ok_or_else(|| {
        format!(
            "no figure in its output: {text}{}",
            String::from_utf8_lossy(&output.stderr)
        )
    })?;
    figures.add(
        "fixed_point_error_n",
        value,
        Goal::AtMost(1e-3),
        "load code to DAC code, worst difference to f64",
    );
    Ok(())
}

fn hold(rig: &RigFile, seed: u64, seconds: f64) -> Result<Metrics, String> {
    let mut link = start(seed)?;
    let options = Options::new([0.0, 2.5, 0.0], seconds);
    let link: &mut dyn RigLink = &mut link;
    let outcome = run::set_force(link, rig, &options, &mut NoopObserver)
        .map_err(|error| error.to_string())?;
    outcome
        .metrics
        .ok_or_else(|| "the run was too short for figures".to_owned())
}

fn worst(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// Force held at a moving tip, with and without the friction feedforward.
fn holding(figures: &mut Figures) -> Result<(), String> {
    println!("\nholding 0 2.5 0 N for 10 s at a moving tip, seeds {SEEDS:?}, worst of all runs and cables");
    let with = rig_file();
    let mut without = rig_file();
    for unit in &mut without.units {
        unit.friction_feedforward = false;
    }
    let runs = |rig: &RigFile| {
        SEEDS
            .iter()
            .map(|seed| hold(rig, *seed, 10.0))
            .collect::<Result<Vec<_>, _>>()
    };
    let (with, without) = (runs(&with)?, runs(&without)?);
    let rms = |runs: &[Metrics]| worst(runs.iter().flat_map(|m| m.tension_rms_n));
    let mean = |runs: &[Metrics]| {
        runs.iter().flat_map(|m| m.tension_rms_n).sum::<f64>() / (runs.len() * 6) as f64
    };
    figures.add(
        "tension_rms_n",
        rms(&with),
        Goal::AtMost(0.12),
        "tension error, worst cable, RMS",
    );
    figures.add(
        "tension_rms_n_mean",
        mean(&with),
        Goal::None,
        "the same, mean of the cables",
    );
    figures.add(
        "tension_rms_n_no_feedforward",
        rms(&without),
        Goal::AtMost(0.12),
        "worst cable without friction feedforward, RMS",
    );
    figures.add(
        "tension_rms_n_no_feedforward_mean",
        mean(&without),
        Goal::None,
        "the same, mean of the cables",
    );
    figures.add(
        "tip_force_error_n",
        worst(with.iter().map(|m| m.tip_force_error_n)),
        Goal::AtMost(0.05),
        "steady error of the force at the tip",
    );
    figures.add(
        "tip_force_rms_n",
        worst(with.iter().map(|m| m.tip_force_rms_n)),
        Goal::None,
        "its RMS",
    );
    // A run that never settles counts as its whole length.
    figures.add(
        "settling_s",
        worst(with.iter().map(|m| m.settling_s.unwrap_or(10.0))),
        Goal::AtMost(0.5),
        "time until the whole force vector stays within 0.125 N for 0.5 s, friction reversals across it included",
    );
    figures.add(
        "settling_along_s",
        worst(with.iter().map(|m| m.settling_along_s.unwrap_or(10.0))),
        Goal::None,
        "the same for the force along the asked direction alone: the step response",
    );
    Ok(())
}

fn allocation(figures: &mut Figures, cases: u32) -> Result<(), String> {
    println!("\nallocation: {cases} random cases against all 3^6 active sets");
    let report = study::oracle_comparison(cases, 1).map_err(|error| error.to_string())?;
    figures.add(
        "allocation_max_error_n",
        report.max_error_n,
        Goal::AtMost(1e-5),
        "largest difference to the exact oracle",
    );
    figures.add(
        "allocation_cases",
        f64::from(report.cases),
        Goal::None,
        "cases compared",
    );
    let (median, longest) = study::solve_time(10_000, 2).map_err(|error| error.to_string())?;
    figures.add(
        "allocation_us",
        median.as_secs_f64() * 1e6,
        Goal::AtMost(100.0),
        "a solve, median (this machine)",
    );
    figures.add(
        "allocation_us_max",
        longest.as_secs_f64() * 1e6,
        Goal::None,
        "a solve, longest of 10,000 (this machine)",
    );
    let steps = study::path_steps(3).map_err(|error| error.to_string())?;
    figures.add(
        "allocation_step_n",
        steps.largest_step_n,
        Goal::None,
        "largest step between neighbours of a 400-step path",
    );
    figures.add(
        "allocation_step_n_thesis",
        steps.thesis_largest_step_n,
        Goal::None,
        "the same for the thesis's formulation, without tie-break",
    );
    Ok(())
}

/// The page docs/figures.md.
fn page(figures: &Figures, quick: bool) -> String {
    let option = if quick { " --quick" } else { "" };
    let mut text = format!(
        "# Figures\n\nPrinted by `cargo xtask bench{option} --markdown docs/figures.md`, which measures them and writes this page \
         and `target/bench/figures.json`. How each one is obtained: `evaluations/bench/src/main.rs`.\n\n\
         Times of the rig are emulated times: converters, buses and serial lines take the time they take on the part; every \
         instruction takes 4 ns, without wait states or caches. `allocation_us` and `emulated_seconds_per_second` \
         are times of the machine the bench ran on.\n\n\
         | figure | reached | asked | what it is |\n| --- | ---: | --- | --- |\n"
    );
    for figure in &figures.0 {
        text.push_str(&format!(
            "| `{}` | {} | {} | {} |\n",
            figure.key,
            number(figure.value),
            verdict(figure),
            figure.what
        ));
    }
    text
}
