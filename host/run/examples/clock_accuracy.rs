//! How well the board's clock is known in host time, against the truth.
//!
//! `cargo run --release -p run --example clock_accuracy [SECONDS]`
//!
//! The rig without the emulated controller is driven through a link whose host clock drifts: by 38
//! ppm, which change by 1.5 ppm up and down in 1,000 s. The board's clock is the rig's own time, so
//! the truth is known. Prints a table for the estimate that is known while the run goes on, and for
//! the one from readings before and after.

use emulator_link::{Injection, Report};
use rig::Rig;
use run::{ready_board, NoopObserver, Zeroing};
use session::clock::{BoardClock, Estimate};
use session::link::fast::FastRig;
use session::link::{EmbeddedOptions, Exchange, LinkError, RigControls, RigLink};
use session::{Session, PERIOD};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Drift of the host's clock, and how it changes: amplitude, period in s.
const DRIFT: f64 = 38e-6;
const CHANGE: (f64, f64) = (1.5e-6, 1000.0);
/// Host time at the rig's power-on, ns.
const START_NS: f64 = 7e9;

/// Host time of a time of the rig, ns.
fn host_ns(rig_ns: f64) -> f64 {
    let rate = std::f64::consts::TAU / CHANGE.1;
    let changed_s = CHANGE.0 / rate * (1.0 - (rate * rig_ns * 1e-9).cos());
    START_NS + rig_ns * (1.0 + DRIFT) + changed_s * 1e9
}

/// A rig whose host has another clock.
struct Drifting(FastRig);

impl RigLink for Drifting {
    fn name(&self) -> String {
        self.0.name()
    }
    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let exchange = self.0.exchange(to_board, duration)?;
        Ok(Exchange {
            now_ns: host_ns(exchange.now_ns as f64) as u64,
            ..exchange
        })
    }
    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        Some(self)
    }
}

impl RigControls for Drifting {
    fn robot(&mut self, moving: bool) -> Result<(), LinkError> {
        self.0.robot(moving)
    }
    fn inject(&mut self, injection: Injection) -> Result<(), LinkError> {
        self.0.inject(injection)
    }
    fn report(&mut self) -> Result<Report, LinkError> {
        self.0.report()
    }
    fn seed(&self) -> u64 {
        self.0.seed()
    }
}

/// Errors and uncertainties of estimates, us.
#[derive(Default)]
struct Errors {
    errors: Vec<f64>,
    uncertainties: Vec<f64>,
    outside: usize,
}

impl Errors {
    fn add(&mut self, estimate: &Estimate, board_us: u64) {
        // The board's clock is the rig's.
        let error = (estimate.host_ns(board_us) - host_ns(board_us as f64 * 1e3)).abs();
        // The board's clock has steps of a microsecond.
        self.outside += usize::from(error > estimate.uncertainty_ns + 1e3);
        self.errors.push(error * 1e-3);
        self.uncertainties.push(estimate.uncertainty_ns * 1e-3);
    }

    fn print(mut self, name: &str) {
        let mut at = |share: f64| {
            let place = |values: &mut Vec<f64>| {
                values.sort_by(f64::total_cmp);
                values[((values.len() - 1) as f64 * share) as usize]
            };
            (place(&mut self.errors), place(&mut self.uncertainties))
        };
        let (median, most) = (at(0.5), at(1.0));
        println!(
            "| {name} | {} | {:.0} | {:.0} | {:.0} | {:.0} | {} |",
            self.errors.len(),
            median.0,
            most.0,
            median.1,
            most.1,
            self.outside
        );
    }
}

fn run(seconds: f64) -> Result<(), Box<dyn std::error::Error>> {
    let rig = Rig::built_in()?;
    let mut link = Drifting(FastRig::open(&EmbeddedOptions::default())?);
    let mut session = Session::connect(&mut link)?;
    ready_board(
        &mut session,
        &rig,
        &Zeroing::Measure,
        &AtomicBool::new(false),
        &mut NoopObserver,
    )?;
    session.drain();
    let (mut live, mut complete) = (BoardClock::live(), BoardClock::complete());
    let mut while_running = Errors::default();
    let mut times = Vec::new();
    let start_ns = session.now_ns();
    let mut next_ns = start_ns + 5_000_000_000;
    while ((session.now_ns() - start_ns) as f64) < seconds * 1e9 {
        session.exchange(PERIOD)?;
        let received = session.drain();
        for reading in &received.readings {
            live.push(reading);
            complete.push(reading);
        }
        if received.host_ns >= next_ns {
            next_ns += 1_000_000_000;
            let newest = received.readings.last().map(|reading| reading.board_us);
            if let Some((board_us, estimate)) = newest.and_then(|at| Some((at, live.at(at)?))) {
                while_running.add(&estimate, board_us);
                times.push(board_us);
            }
        }
    }
    let mut afterwards = Errors::default();
    for board_us in times {
        if let Some(estimate) = complete.at(board_us) {
            afterwards.add(&estimate, board_us);
        }
    }
    println!("| estimate | places | error, median, us | error, largest, us | stated bound, median, us | stated bound, largest, us | outside of the bound |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    while_running.print("while the run goes on");
    afterwards.print("from readings before and after");
    Ok(())
}

fn main() -> ExitCode {
    let seconds = std::env::args()
        .nth(1)
        .and_then(|text| text.parse().ok())
        .unwrap_or(1200.0);
    match run(seconds) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
