//! `rig`: the embedded rig behind a pipe, for host programs that drive it in lock-step (crate
//! `emulator-link`).
//!
//! Requests come on standard input, responses go to standard output, messages for people to
//! standard error.

use emulator::{allowed, Options, Rig, RigError};
use emulator_link::{receive, send, Advanced, Report, Request, Response, LINK_VERSION};
use emulator_usb::host::State;
use plant::PlantConfig;
use std::io::{self, BufReader, BufWriter, ErrorKind, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

const USAGE: &str = "\
usage: rig --elf FILE [--seed N] [--run N] [--plant FILE.toml] [--usb] [--paced] [--quiet] [--rtt FILE] [--free SECONDS]

  --elf FILE       firmware image (ELF) to boot
  --seed N         seed of everything random (default 1)
  --run N          run of this rig (default 0): noise, zeros, clocks and path are drawn anew for each
  --plant FILE     plant configuration in TOML (default: the rig of the thesis)
  --usb            the link's bytes go through the board's USB socket, not through USART3
  --paced          no faster than real time
  --quiet          no progress on standard error
  --rtt FILE       write the firmware's RTT channel 0 to FILE, as it comes
  --free SECONDS   run on its own for so long, serial bytes to standard output, report to standard error

Without --free it speaks emulator-link on standard input and output.";

struct Arguments {
    elf: PathBuf,
    seed: u64,
    run: u64,
    plant: Option<PathBuf>,
    usb: bool,
    paced: bool,
    quiet: bool,
    rtt: Option<PathBuf>,
    free_s: Option<f64>,
}

fn arguments() -> Result<Option<Arguments>, String> {
    let mut words = std::env::args().skip(1);
    let mut elf = None;
    let mut found = Arguments {
        elf: PathBuf::new(),
        seed: 1,
        run: 0,
        plant: None,
        usb: false,
        paced: false,
        quiet: false,
        rtt: None,
        free_s: None,
    };
    while let Some(word) = words.next() {
        let mut value = || {
            words
                .next()
                .ok_or_else(|| format!("{word} needs a value\n{USAGE}"))
        };
        match word.as_str() {
            "--elf" => elf = Some(PathBuf::from(value()?)),
            "--seed" | "--run" => {
                let text = value()?;
                let number = text
                    .parse()
                    .map_err(|_| format!("{word} {text}: not a whole number from 0"))?;
                match word.as_str() {
                    "--seed" => found.seed = number,
                    _ => found.run = number,
                }
            }
            "--plant" => found.plant = Some(PathBuf::from(value()?)),
            "--rtt" => found.rtt = Some(PathBuf::from(value()?)),
            "--free" => {
                let text = value()?;
                let seconds = text
                    .parse::<f64>()
                    .ok()
                    .filter(|s| s.is_finite() && *s > 0.0);
                found.free_s =
                    Some(seconds.ok_or_else(|| format!("--free {text}: not a number of seconds"))?);
            }
            "--usb" => found.usb = true,
            "--paced" => found.paced = true,
            "--quiet" => found.quiet = true,
            "--help" | "-h" => return Ok(None),
            other => return Err(format!("{other} is not an option\n{USAGE}")),
        }
    }
    found.elf = elf.ok_or_else(|| format!("--elf is missing\n{USAGE}"))?;
    Ok(Some(found))
}

fn plant(path: Option<&PathBuf>) -> Result<PlantConfig, String> {
    let Some(path) = path else {
        return Ok(PlantConfig::default());
    };
    let text = std::fs::read_to_string(path).map_err(|error| {
        format!(
            "cannot read the plant's configuration {}: {error}",
            path.display()
        )
    })?;
    toml::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))
}

/// Keeps virtual time from running ahead of the wall clock.
struct RealTimeLimit {
    /// The instant at which virtual time was zero; later after each delay.
    began: Option<Instant>,
}

impl RealTimeLimit {
    /// A run that was delayed (a busy machine) goes on at real time: it does not catch up faster
    /// than its clients can follow.
    const MAX_DELAY: Duration = Duration::from_millis(20);

    fn wait(&mut self, now_ns: u64) {
        let Some(began) = &mut self.began else {
            return;
        };
        let due = Duration::from_nanos(now_ns);
        let elapsed = began.elapsed();
        match due.checked_sub(elapsed) {
            Some(early) => std::thread::sleep(early),
            None if elapsed - due > Self::MAX_DELAY => *began += elapsed - due,
            None => {}
        }
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("rig: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), String> {
    let Some(arguments) = arguments()? else {
        println!("{USAGE}");
        return Ok(());
    };
    let options = Options {
        seed: arguments.seed,
        run: arguments.run,
        plant: plant(arguments.plant.as_ref())?,
    };
    let mut rig = Rig::boot(&arguments.elf, options).map_err(|error| error.to_string())?;
    if !arguments.quiet {
        eprintln!("rig: {} on {}", arguments.elf.display(), rig.machine());
    }
    if arguments.usb {
        rig.usb(|host, core| host.set_cable(core, true));
    }
    let mut log =
        match &arguments.rtt {
            Some(path) => Some(std::fs::File::create(path).map_err(|error| {
                format!("cannot write RTT output to {}: {error}", path.display())
            })?),
            None => None,
        };
    let mut limit = RealTimeLimit {
        began: arguments.paced.then(Instant::now),
    };
    let mut keep_rtt = move |rig: &mut Rig| -> Result<(), String> {
        let bytes = rig.take_rtt();
        match &mut log {
            Some(file) => file
                .write_all(&bytes)
                .map_err(|error| format!("RTT output: {error}")),
            None => Ok(()),
        }
    };
    if let Some(seconds) = arguments.free_s {
        return free_run(&mut rig, seconds, &mut limit, &mut keep_rtt);
    }
    let mut line = if arguments.usb {
        Line::Usb { open: false }
    } else {
        Line::Serial
    };
    serve(&mut rig, &mut line, &mut limit, &mut keep_rtt)
}

type KeepRtt<'a> = &'a mut dyn FnMut(&mut Rig) -> Result<(), String>;

fn free_run(
    rig: &mut Rig,
    seconds: f64,
    limit: &mut RealTimeLimit,
    keep_rtt: KeepRtt<'_>,
) -> Result<(), String> {
    let end = (seconds * 1e9) as u64;
    let mut sent = 0;
    let mut serial = io::stdout().lock();
    let mut resets = 0;
    while rig.now_ns() < end {
        let step = (end - rig.now_ns()).min(10_000_000);
        let advanced = rig.advance(step, &[]).map_err(|error| error.to_string())?;
        keep_rtt(rig)?;
        sent += advanced.from_board.len();
        serial
            .write_all(&advanced.from_board)
            .and_then(|()| serial.flush())
            .map_err(|error| format!("serial bytes: {error}"))?;
        if advanced.resets != resets {
            resets = advanced.resets;
            let cause = rig.last_reset().unwrap_or("unknown");
            eprintln!(
                "rig: reset {resets} at {:.3} s: {cause}",
                rig.now_ns() as f64 * 1e-9
            );
        }
        limit.wait(rig.now_ns());
    }
    let report = rig.report().map_err(|error| error.to_string())?;
    print_report(&report, sent);
    Ok(())
}

fn print_report(report: &Report, sent: usize) {
    let emulated = report.now_ns as f64 * 1e-9;
    let wall = report.wall_ns as f64 * 1e-9;
    eprintln!(
        "{emulated:.3} s emulated in {wall:.3} s ({:.2} times real time)",
        emulated / wall
    );
    eprintln!(
        "{} instructions, asleep {:.1} %, alive line {:.1} Hz, {sent} bytes sent",
        report.instructions,
        100.0 * report.sleep_fraction,
        report.alive_hz
    );
    eprintln!(
        "conversions {:?}, read {:?}",
        report.conversions, report.conversions_read
    );
    let mut delays: Vec<u64> = (report.latencies.iter())
        .map(|latency| latency.dac_update_ns - latency.drdy_ns)
        .collect();
    delays.sort_unstable();
    if let (Some(median), Some(late)) = (
        delays.get(delays.len() / 2),
        delays.get(delays.len() * 99 / 100),
    ) {
        eprintln!(
            "DRDY to DAC: {} updates, median {:.1} us, 99th percentile {:.1} us",
            delays.len(),
            *median as f64 * 1e-3,
            *late as f64 * 1e-3
        );
    }
    for event in &report.register_events {
        let mark = if allowed::reason(event).is_some() {
            "allowed"
        } else {
            "NOT ALLOWED"
        };
        eprintln!("{mark}: {} x{}: {}", event.place, event.count, event.what);
    }
}

/// Which of the board's links carries the bytes.
enum Line {
    Serial,
    /// USB; whether the host had the port open after the last exchange.
    Usb {
        open: bool,
    },
}

impl Line {
    fn advance(
        &mut self,
        rig: &mut Rig,
        duration_ns: u64,
        to_board: &[u8],
    ) -> Result<Response, RigError> {
        let Self::Usb { open } = self else {
            return rig.advance(duration_ns, to_board).map(Response::Advanced);
        };
        rig.usb(|host, _| host.write(to_board));
        let advanced = rig.advance(duration_ns, &[])?;
        let (from_board, state) = rig.usb(|host, _| (host.take_read(), host.state()));
        let was_open = std::mem::replace(open, matches!(state, State::Open | State::Suspended));
        if was_open && !*open {
            return Ok(Response::Unplugged);
        }
        Ok(Response::Advanced(Advanced {
            from_board,
            ..advanced
        }))
    }
}

fn serve(
    rig: &mut Rig,
    line: &mut Line,
    limit: &mut RealTimeLimit,
    keep_rtt: KeepRtt<'_>,
) -> Result<(), String> {
    let mut from = BufReader::new(io::stdin().lock());
    let mut to = BufWriter::new(io::stdout().lock());
    loop {
        let request = match receive::<Request>(&mut from) {
            Ok(request) => request,
            // The other end has gone: that ends the run like a Quit.
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(()),
            Err(error) => return Err(format!("request: {error}")),
        };
        let quit = request == Request::Quit;
        let response = answer(rig, line, request);
        keep_rtt(rig)?;
        if let Response::Advanced(advanced) = &response {
            limit.wait(advanced.now_ns);
        }
        send(&mut to, &response).map_err(|error| format!("answer: {error}"))?;
        if quit {
            return Ok(());
        }
    }
}

fn answer(rig: &mut Rig, line: &mut Line, request: Request) -> Response {
    let done = match request {
        Request::Hello { version } => {
            if version != LINK_VERSION {
                return Response::Failed(format!(
                    "this rig speaks version {LINK_VERSION} of emulator-link, the host version {version}; build both from one tree"
                ));
            }
            return Response::Ready {
                version: LINK_VERSION,
                seed: rig.seed(),
                machine: rig.machine(),
            };
        }
        Request::Advance {
            duration_ns,
            to_board,
        } => line.advance(rig, duration_ns, &to_board),
        Request::Robot { moving } => {
            rig.set_robot_moving(moving);
            Ok(Response::Done)
        }
        Request::Inject(injection) => rig.inject(injection).map(|()| Response::Done),
        Request::Report => rig
            .report()
            .map(|report| Response::Report(Box::new(report))),
        Request::Quit => Ok(Response::Done),
    };
    done.unwrap_or_else(|error| Response::Failed(error.to_string()))
}
