//! How fast any terminal stops a rig whose commander hangs.

use crate::figures::{Figures, Goal};
use crate::rig;
use ::rig::{DEFAULT_NAME, DEFAULT_TEXT};
use run::{ready_board, NoopObserver, Zeroing};
use service::client::ServiceLink;
use service::protocol::Call;
use service::socket::Listening;
use service::{serve, Client, ServeOptions};
use session::link::RigLink;
use session::Session;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};
use test_stand::rig_file;
use wire::message::UnitSetpoint;
use wire::{Command, UNITS};

/// Stops that are measured.
const STOPS: usize = 20;

/// Time from the request of a client to the board's confirmation of 0 V, with a commander that
/// hangs while it drives.
pub fn stopping(figures: &mut Figures) -> Result<(), String> {
    println!("\n{STOPS} stops from a second terminal, in the middle of a drive whose commander hangs; clock on the wall");
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let path = folder.path().join("rig.sock");
    let stop = Arc::new(AtomicBool::new(false));
    let (ready, is_ready) = std::sync::mpsc::channel();
    let (socket, flag) = (path.clone(), Arc::clone(&stop));
    let service = std::thread::spawn(move || -> Result<(), String> {
        let link = prepared()?;
        let options = ServeOptions {
            name: "bench".to_owned(),
            rig_file: (DEFAULT_NAME.to_owned(), DEFAULT_TEXT.to_owned()),
            stop: flag,
            ..ServeOptions::default()
        };
        let listening = Listening::bind_at(socket).map_err(|error| error.to_string())?;
        serve(link, listening, options, |_| {
            let _ = ready.send(());
        })
        .map_err(|error| error.to_string())
    });
    let mut times_ms = if is_ready.recv().is_ok() {
        (0..STOPS)
            .map(|_| one_stop(&path))
            .collect::<Result<Vec<f64>, _>>()?
    } else {
        Vec::new()
    };
    stop.store(true, Ordering::SeqCst);
    service
        .join()
        .map_err(|_| "the service panicked".to_owned())??;
    times_ms.sort_by(f64::total_cmp);
    let last = times_ms.last().copied().unwrap_or(f64::NAN);
    figures.add(
        "stop_ms_median",
        times_ms.get(STOPS / 2).copied().unwrap_or(f64::NAN),
        Goal::None,
        "stop from a second terminal until the board confirms 0 V, commander hanging, median",
    );
    figures.add("stop_ms_max", last, Goal::AtMost(20.0), "the same, longest");
    Ok(())
}

/// An embedded rig in real time, ready to be armed.
fn prepared() -> Result<Box<dyn RigLink>, String> {
    let mut link: Box<dyn RigLink> = Box::new(rig::start_paced(1)?);
    let mut session = Session::connect(link.as_mut()).map_err(|error| error.to_string())?;
    let never = AtomicBool::new(false);
    ready_board(
        &mut session,
        &rig_file(),
        &Zeroing::Measure,
        &never,
        &mut NoopObserver,
    )
    .map_err(|error| error.to_string())?;
    Ok(link)
}

/// Drives for half a second, hangs, and stops from another client. Returns the time of the stop,
/// ms.
fn one_stop(path: &Path) -> Result<f64, String> {
    let words = |error: &dyn std::fmt::Display| error.to_string();
    let client = |name| Client::connect_at(path, "bench", name).map_err(|error| words(&error));
    let mut link = ServiceLink::commander(client("commander")?).map_err(|error| words(&error))?;
    let mut session = Session::connect(&mut link).map_err(|error| words(&error))?;
    session
        .command(&Command::Arm)
        .map_err(|error| words(&error))?;
    let setpoints = [UnitSetpoint {
        tension_un: 2_000_000,
        inv_cos_q16: 65_536,
        ..UnitSetpoint::default()
    }; UNITS];
    session
        .send_setpoints(setpoints, Duration::from_millis(500))
        .map_err(|error| words(&error))?;
    let mut other = client("another terminal")?;
    // From here the commander neither sends nor reads.
    let asked = Instant::now();
    other.call(Call::Stop).map_err(|error| words(&error))?;
    let time_ms = asked.elapsed().as_secs_f64() * 1e3;
    drop(link);
    other.call(Call::Clear).map_err(|error| words(&error))?;
    std::thread::sleep(Duration::from_millis(200));
    Ok(time_ms)
}
