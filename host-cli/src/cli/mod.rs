//! From arguments to exit code.

mod args;
#[cfg(feature = "residual")]
mod identify;
#[cfg(feature = "residual")]
mod residual;
mod show;

use args::{Cli, Command, Global, SetForce};
use clap::{CommandFactory, Parser};
use control::{Fault, SystemState};
use host_cli::force::metrics::Step;
use host_cli::link::{self, EmbeddedOptions, RigLink};
use host_cli::plot;
use host_cli::rigfile::{self, LinkChoice, RigFile};
use host_cli::run::{self, Ended, Observer, Options, Phase, RunError};
use host_cli::session::{Session, SessionError, TimedSample, PERIOD};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::Duration;
use wire::message::UnitConfig;
use wire::{Command as Ask, UNITS};

/// How long `monitor` and `record` run on the embedded rig where no time is given, s.
const EMBEDDED_WATCH_S: f64 = 3.0;
/// A second Ctrl-C ends the program at once: the board stops by itself.
const INTERRUPTED: u8 = 130;

/// Why a command failed: exit code and message.
struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    fn new(code: u8, message: impl ToString) -> Self {
        Self {
            code,
            message: message.to_string(),
        }
    }

    fn file(path: &Path, error: impl std::fmt::Display) -> Self {
        Self::new(7, format!("{} can't be written: {error}", path.display()))
    }
}

impl From<link::LinkError> for Failure {
    fn from(error: link::LinkError) -> Self {
        Self::new(4, error)
    }
}

impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        let code = match &error {
            SessionError::Link(_)
            | SessionError::NoBoard { .. }
            | SessionError::Version { .. }
            | SessionError::NoAnswer { .. } => 4,
            SessionError::Refused { .. }
            | SessionError::Reset { .. }
            | SessionError::Fault(_)
            | SessionError::TooLong(_) => 5,
        };
        Self::new(code, error)
    }
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Session(error) => error.into(),
            RunError::Argument(_) => Self::new(2, error),
            RunError::Interrupted => Self::new(INTERRUPTED, error),
            RunError::Control(_) | RunError::Pose(_) | RunError::Fault(_) => Self::new(5, error),
        }
    }
}

#[cfg(feature = "record")]
impl From<host_cli::record::RecordError> for Failure {
    fn from(error: host_cli::record::RecordError) -> Self {
        Self::new(7, error)
    }
}

type Result<T> = std::result::Result<T, Failure>;

/// Runs the command line.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let json = cli.global.json;
    match run(cli) {
        Ok(code) => ExitCode::from(code),
        Err(failure) => {
            if json {
                println!(
                    "{}",
                    serde_json::json!({"error": failure.message, "exit_code": failure.code})
                );
            }
            eprintln!("forcectl: {}", failure.message);
            ExitCode::from(failure.code)
        }
    }
}

fn run(cli: Cli) -> Result<u8> {
    match &cli.command {
        Command::Explain { number } => return explain(*number, cli.global.json),
        Command::Check { file, print } => return check(file.as_deref(), *print, cli.global.json),
        #[cfg(feature = "residual")]
        Command::Residual(arguments) => return residual::residual(arguments, cli.global.json),
        Command::Completions { shell } => {
            clap_complete::generate(
                *shell,
                &mut Cli::command(),
                "forcectl",
                &mut std::io::stdout(),
            );
            return Ok(0);
        }
        _ => {}
    }
    let rig = load(&cli.global)?;
    let stop = stop_on_ctrl_c()?;
    if let Command::SetForce(arguments) = &cli.command {
        return set_force(&cli.global, &rig, arguments, stop);
    }
    #[cfg(feature = "residual")]
    if let Command::Identify(arguments) = &cli.command {
        return identify::identify(&cli.global, &rig, arguments, stop);
    }
    let mut link = open(&cli.global, &rig)?;
    let embedded = link.controls().is_some();
    let mut session = Session::connect(link.as_mut())?;
    let json = cli.global.json;
    match cli.command {
        Command::Status => status(&mut session, &rig, embedded, json),
        Command::Monitor { seconds } => {
            wake(&mut session, &rig, embedded)?;
            let seconds = seconds.or(embedded.then_some(EMBEDDED_WATCH_S));
            monitor(&mut session, seconds, json, &stop)
        }
        Command::Zero => {
            let mut watch = Watch::new(json);
            let prepared = run::prepare_board(&mut session, &rig, &stop, &mut watch)?;
            watch.progress.done();
            zeros(&prepared, json);
            Ok(0)
        }
        Command::Arm => arm(&mut session, &rig, &stop, json),
        Command::Disarm => {
            session.command(&Ask::Disarm)?;
            session.wait_for(Duration::from_secs(3), "disarming", |s| {
                !SystemState::from_u8(s.state).is_some_and(SystemState::drives)
            })?;
            said(json, "disarmed");
            Ok(0)
        }
        Command::Stop => {
            session.command(&Ask::Stop)?;
            said(
                json,
                "stopped: all motors at 0 V; `forcectl clear` before arming again",
            );
            Ok(0)
        }
        Command::Clear => clear(&mut session, json),
        #[cfg(feature = "record")]
        Command::Record { folder, seconds } => {
            wake(&mut session, &rig, embedded)?;
            let seconds = seconds.or(embedded.then_some(EMBEDDED_WATCH_S));
            record(&mut session, &rig, &folder, seconds, json, &stop)
        }
        Command::SetForce(_)
        | Command::Explain { .. }
        | Command::Check { .. }
        | Command::Completions { .. } => Ok(0),
        #[cfg(feature = "residual")]
        Command::Residual(_) | Command::Identify(_) => Ok(0),
    }
}

fn said(json: bool, text: &str) {
    if json {
        println!("{}", serde_json::json!({"done": text}));
    } else {
        println!("{text}");
    }
}

fn load(global: &Global) -> Result<RigFile> {
    match &global.config {
        Some(path) => RigFile::load(path),
        None => RigFile::built_in(),
    }
    .map_err(|error| Failure::new(3, error))
}

fn open(global: &Global, rig: &RigFile) -> Result<Box<dyn RigLink>> {
    let choice = global.rig.as_ref().unwrap_or(&rig.link);
    let options = EmbeddedOptions {
        seed: global.seed,
        paced: global.paced,
        plant: global.plant.clone(),
    };
    if *choice != LinkChoice::Embedded
        && (options.seed.is_some() || options.paced || options.plant.is_some())
    {
        return Err(Failure::new(
            2,
            "--seed, --plant and --paced belong to the embedded rig",
        ));
    }
    Ok(link::open(choice, &options)?)
}

fn stop_on_ctrl_c() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let pressed = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if pressed.swap(true, Ordering::Relaxed) {
            // The second time at once: without setpoints the board goes to 0 V by itself.
            std::process::exit(i32::from(INTERRUPTED));
        }
        eprintln!(
            "\nCtrl-C: putting the rig down (again: end at once, the board stops within 100 ms)"
        );
    })
    .map_err(|error| Failure::new(7, format!("Ctrl-C can't be handled: {error}")))?;
    Ok(stop)
}

/// Shows what a run is doing, and records it where asked.
struct Watch {
    progress: show::Progress,
    json: bool,
    #[cfg(feature = "record")]
    recorder: Option<host_cli::record::Recorder>,
    #[cfg(feature = "record")]
    record_error: Option<host_cli::record::RecordError>,
}

impl Watch {
    fn new(json: bool) -> Self {
        Self {
            progress: show::Progress::new(json),
            json,
            #[cfg(feature = "record")]
            recorder: None,
            #[cfg(feature = "record")]
            record_error: None,
        }
    }

    /// Records something; a disk that fails ends the recording and not the run.
    #[cfg(feature = "record")]
    fn record(
        &mut self,
        write: impl FnOnce(
            &mut host_cli::record::Recorder,
        ) -> std::result::Result<(), host_cli::record::RecordError>,
    ) {
        if let Some(recorder) = &mut self.recorder {
            if let Err(error) = write(recorder) {
                self.progress
                    .say(&format!("{error}; the run goes on without"));
                self.recorder = None;
                self.record_error = Some(error);
            }
        }
    }

    #[cfg(feature = "record")]
    fn finish_recording(&mut self) -> Result<()> {
        if let Some(recorder) = self.recorder.take() {
            recorder.finish()?;
        }
        self.record_error
            .take()
            .map_or(Ok(()), |error| Err(error.into()))
    }
}

impl Observer for Watch {
    fn progress(&mut self, phase: Phase, fraction: f64) {
        self.progress.at(phase, fraction);
    }

    fn notice(&mut self, text: &str) {
        if !self.json {
            self.progress.say(text);
        }
    }

    #[cfg(feature = "record")]
    fn configured(&mut self, configs: &[UnitConfig; UNITS]) {
        self.record(|recorder| {
            recorder.configured(configs);
            Ok(())
        });
    }

    #[cfg(feature = "record")]
    fn samples(&mut self, samples: &[TimedSample]) {
        self.record(|recorder| recorder.samples(samples));
    }

    #[cfg(feature = "record")]
    fn step(&mut self, step: &Step) {
        self.record(|recorder| recorder.cycle(step));
    }
}

fn set_force(
    global: &Global,
    rig: &RigFile,
    arguments: &SetForce,
    stop: Arc<AtomicBool>,
) -> Result<u8> {
    let options = Options {
        robot_moves: !arguments.still,
        injections: arguments.inject.clone(),
        stop,
        ..Options::new([arguments.x, arguments.y, arguments.z], arguments.seconds)
    };
    // Before anything is opened, and so before anything can be driven.
    rig.check_force(options.force_n)
        .map_err(|why| Failure::new(2, why))?;
    let out = &arguments.out;
    std::fs::create_dir_all(out).map_err(|error| Failure::file(out, error))?;
    let mut watch = Watch::new(global.json);
    #[cfg(feature = "record")]
    if let Some(folder) = &arguments.record {
        watch.recorder = Some(host_cli::record::Recorder::create(folder, rig)?);
    }
    let mut link = open(global, rig)?;
    let outcome = run::set_force(link.as_mut(), rig, &options, &mut watch);
    watch.progress.done();
    // What was recorded up to an error is worth keeping.
    #[cfg(feature = "record")]
    let recorded = watch.finish_recording();
    let outcome = outcome?;
    let scene = plot::draw(&outcome);
    let (svg, figures) = (out.join("set-force.svg"), out.join("set-force.json"));
    std::fs::write(&svg, scene.to_svg()).map_err(|error| Failure::file(&svg, error))?;
    let mut json =
        serde_json::to_value(&outcome).map_err(|error| Failure::file(&figures, error))?;
    json["plot_svg"] = svg.display().to_string().into();
    let text =
        serde_json::to_string_pretty(&json).map_err(|error| Failure::file(&figures, error))?;
    std::fs::write(&figures, &text).map_err(|error| Failure::file(&figures, error))?;
    if global.json {
        println!("{text}");
    } else {
        print!("{}", show::outcome(&outcome));
        println!(
            "plot                {}, figures in {}",
            svg.display(),
            figures.display()
        );
    }
    #[cfg(feature = "record")]
    {
        recorded?;
        if let (Some(folder), false) = (&arguments.record, global.json) {
            println!("recording           {}", folder.display());
        }
    }
    Ok(match outcome.ended {
        Ended::Done => 0,
        Ended::Degraded => 6,
        Ended::Interrupted => INTERRUPTED,
    })
}

/// A freshly booted embedded rig has no units configured: it is given the rig file, so that there is
/// something to see. A real board is left as it is.
fn wake(session: &mut Session<'_>, rig: &RigFile, embedded: bool) -> Result<()> {
    if embedded {
        session.configure(&rig.units.map(|unit| unit.to_wire()))?;
        session.wait_for(Duration::from_secs(15), "bringing up the sensors", |s| {
            s.state == SystemState::Ready as u8
        })?;
    }
    Ok(())
}

fn status(session: &mut Session<'_>, rig: &RigFile, embedded: bool, json: bool) -> Result<u8> {
    wake(session, rig, embedded)?;
    let status = session.get_status()?;
    if json {
        let info = session.info().cloned();
        let text = serde_json::json!({"link": session.link().name(), "board": info, "status": status, "state": host_cli::session::system_state_name(status.state)});
        println!("{text}");
    } else {
        println!("link       {}", session.link().name());
        print!("{}", show::status(session.info(), &status));
    }
    Ok(
        if status.fault == 0 && status.units.iter().all(|unit| unit.fault == 0) {
            0
        } else {
            5
        },
    )
}

fn over(session: &Session<'_>, start_ns: u64, seconds: Option<f64>, stop: &AtomicBool) -> bool {
    let waited_s = (session.now_ns() - start_ns) as f64 * 1e-9;
    stop.load(Ordering::Relaxed) || seconds.is_some_and(|s| waited_s >= s)
}

fn monitor(
    session: &mut Session<'_>,
    seconds: Option<f64>,
    json: bool,
    stop: &AtomicBool,
) -> Result<u8> {
    session.command(&Ask::Stream { decimation: 1 })?;
    let start_ns = session.now_ns();
    if !json {
        println!(
            "{:>9}  {}   (N)",
            "t s",
            (1..=UNITS)
                .map(|n| format!("{:>8}", format!("unit {n}")))
                .collect::<String>()
        );
    }
    let mut cycle = 0_u32;
    while !over(session, start_ns, seconds, stop) {
        session.advance(PERIOD)?;
        let received = session.drain();
        for fault in &received.faults {
            eprintln!(
                "{}",
                host_cli::session::explain_fault(fault.code, fault.detail)
            );
        }
        cycle += 1;
        // Ten lines a second.
        if cycle.is_multiple_of(10) {
            let t_s = (session.now_ns() - start_ns) as f64 * 1e-9;
            let tensions = session.tension_n().map(|t| t.map(|(tension, _)| tension));
            if json {
                println!("{}", serde_json::json!({"t_s": t_s, "tension_n": tensions}));
            } else {
                let cells = tensions
                    .map(|t| t.map_or_else(|| format!("{:>8}", "-"), |t| format!("{t:>8.3}")));
                println!("{t_s:>9.2}  {}", cells.join(""));
            }
        }
    }
    Ok(if stop.load(Ordering::Relaxed) {
        INTERRUPTED
    } else {
        0
    })
}

#[cfg(feature = "record")]
fn record(
    session: &mut Session<'_>,
    rig: &RigFile,
    folder: &Path,
    seconds: Option<f64>,
    json: bool,
    stop: &AtomicBool,
) -> Result<u8> {
    let mut recorder = host_cli::record::Recorder::create(folder, rig)?;
    recorder.configured(&session.get_configs()?);
    session.command(&Ask::Stream { decimation: 1 })?;
    session.drain();
    let mut progress = show::Progress::new(json);
    let start_ns = session.now_ns();
    let mut lost = None;
    while !over(session, start_ns, seconds, stop) {
        // A lost link ends the recording; what is there is kept.
        if let Err(error) = session.advance(PERIOD) {
            lost = Some(error);
            break;
        }
        recorder.samples(&session.drain().samples)?;
        let waited_s = (session.now_ns() - start_ns) as f64 * 1e-9;
        progress.at(Phase::Hold, seconds.map_or(0.0, |s| waited_s / s));
    }
    progress.done();
    let rows = recorder.finish()?;
    let counters = session.counters();
    if json {
        println!(
            "{}",
            serde_json::json!({"samples": rows, "folder": folder, "link": counters})
        );
    } else {
        println!(
            "{rows} samples in {}; telemetry frames lost {}, damaged {}",
            folder.display(),
            counters.frames_lost,
            counters.frames_bad
        );
    }
    match lost {
        Some(error) => Err(error.into()),
        None => Ok(0),
    }
}

fn zeros(prepared: &run::Prepared, json: bool) {
    if json {
        println!(
            "{}",
            serde_json::json!({"zero_codes": prepared.configs.map(|c| c.zero_code), "available": prepared.available})
        );
        return;
    }
    println!("unit   zero code   zero N");
    for (i, config) in prepared.configs.iter().enumerate() {
        let zero_n = f64::from(config.zero_code) * f64::from(config.scale_pn_per_count) * 1e-12;
        let state = if prepared.available[i] {
            ""
        } else {
            "   left out"
        };
        println!("{:>4} {:>11} {zero_n:>8.3}{state}", i + 1, config.zero_code);
    }
}

fn arm(session: &mut Session<'_>, rig: &RigFile, stop: &Arc<AtomicBool>, json: bool) -> Result<u8> {
    // Apart from the zeros, which the board has taken itself.
    let wanted = rig.units.map(|unit| unit.to_wire());
    let mut there = session.get_configs()?;
    for config in &mut there {
        config.zero_code = 0;
    }
    if there != wanted {
        let mut watch = Watch::new(json);
        watch
            .notice("the board does not hold this rig file: sending it and zeroing (cables slack)");
        run::prepare_board(session, rig, stop, &mut watch)?;
        watch.progress.done();
    }
    session.command(&Ask::Arm)?;
    said(json, "armed; the motors act on setpoints while a program sends them (`forcectl set-force`), and stop when it ceases");
    Ok(0)
}

fn clear(session: &mut Session<'_>, json: bool) -> Result<u8> {
    session.command(&Ask::ClearFaults)?;
    // Sensors that were down are brought up again.
    for _ in 0..20 {
        session.advance(PERIOD)?;
    }
    let status = session.get_status()?;
    if status.fault == 0 && status.units.iter().all(|unit| unit.fault == 0) {
        said(json, "clear: no fault is latched; nothing is armed");
        return Ok(0);
    }
    let mut left = Vec::new();
    if status.fault != 0 {
        left.push(host_cli::session::explain_fault(
            status.fault,
            status.fault_detail,
        ));
    }
    for (i, unit) in status
        .units
        .iter()
        .enumerate()
        .filter(|(_, unit)| unit.fault != 0)
    {
        left.push(format!(
            "unit {}: {}",
            i + 1,
            host_cli::session::explain_fault(unit.fault, unit.fault_detail)
        ));
    }
    Err(Failure::new(
        5,
        format!(
            "still latched, its cause is still there: {}",
            left.join("\n")
        ),
    ))
}

fn explain(number: Option<u16>, json: bool) -> Result<u8> {
    let page = |fault: Fault| {
        let scope = match fault.scope() {
            control::faults::Scope::Board => "board",
            control::faults::Scope::Unit => "unit",
        };
        (fault.code(), fault.name(), scope)
    };
    let Some(number) = number else {
        for fault in Fault::ALL {
            let (code, name, scope) = page(*fault);
            if json {
                println!(
                    "{}",
                    serde_json::json!({"fault": code, "name": name, "scope": scope})
                );
            } else {
                println!("{code:>3}  {scope:<5}  {name}");
            }
        }
        return Ok(0);
    };
    let fault = Fault::from_code(number).ok_or_else(|| {
        Failure::new(
            2,
            format!("there is no fault {number}; `forcectl explain` lists all"),
        )
    })?;
    let (code, name, scope) = page(fault);
    if json {
        println!(
            "{}",
            serde_json::json!({"fault": code, "name": name, "scope": scope, "meaning": fault.meaning(), "what_to_do": fault.what_to_do(), "detail": fault.detail_meaning()})
        );
    } else {
        let stops = if scope == "board" {
            "all six motors"
        } else {
            "one unit; the others carry on"
        };
        println!("fault {code}: {name}\n\nstops       {stops}\nmeaning     {}\nwhat to do  {}\ndetail      {}", fault.meaning(), fault.what_to_do(), fault.detail_meaning());
    }
    Ok(0)
}

fn check(file: Option<&Path>, print: bool, json: bool) -> Result<u8> {
    let Some(file) = file else {
        if print {
            print!("{}", rigfile::DEFAULT_TEXT);
        }
        return Ok(0);
    };
    let rig = RigFile::load(file).map_err(|error| Failure::new(3, error))?;
    if json {
        println!(
            "{}",
            serde_json::json!({"file": file, "name": rig.name, "hash": rig.hash(), "rig": rig})
        );
    } else {
        let there = rig.units.iter().filter(|unit| unit.enabled).count();
        println!(
            "{}: good. Rig `{}`, {there} units enabled, hash {}",
            file.display(),
            rig.name,
            rig.hash()
        );
    }
    Ok(0)
}
