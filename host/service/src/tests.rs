//! Tests of the service with a board in memory: who may do what, what happens when someone goes
//! away.

mod refusals;
mod stops;

use super::client::{Client, Notification, ServiceError, ServiceLink};
use super::hub::CYCLE;
use super::protocol::{code, Call, CommandParams, ForceParams, HoldParams, Topics};
use super::server::{serve, ServeOptions};
use super::socket::{Listening, Socket};
use base64::prelude::{Engine as _, BASE64_STANDARD};
use known::store::Store;
use known::ZeroStore;
use rig::{Rig, DEFAULT_NAME, DEFAULT_TEXT};
use run::{ready_board, set_force, NoopObserver, Options, RunError, Zeroing};
use session::link::fake::{Behavior, FakeBoard};
use session::link::{Exchange, LinkError, RigControls, RigLink};
use session::{Session, SessionError};
use stats_alloc::{StatsAlloc, INSTRUMENTED_SYSTEM};
use std::alloc::System;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use wire::message::UnitSetpoint;
use wire::{Command, HostFrame, UNITS};

/// Longest wait for what has to come. A limit of patience, not of speed: the machine may be busy.
const PATIENCE: Duration = Duration::from_secs(60);

/// A board in memory whose time passes as fast as it can be computed; while nothing happens, at
/// most three times as fast as on the clock on the wall.
struct Paced {
    board: FakeBoard,
    last: Instant,
    factor: f64,
    bit_errors: BitErrors,
    commands: Arc<Mutex<Vec<Command>>>,
    plugged: Arc<AtomicBool>,
    no_further: Arc<AtomicU64>,
}

/// How many commands the tests look at. A day of setpoints must not count as the service's memory.
const MAX_COMMANDS: usize = 4_000;

/// Flips bits of a line at random.
#[derive(Clone, Copy)]
struct BitErrors {
    /// Part of the bits that are flipped.
    rate: f64,
    random: u64,
}

impl BitErrors {
    fn damage(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut out = bytes.to_vec();
        if self.rate == 0.0 {
            return out;
        }
        for byte in &mut out {
            for bit in 0..8 {
                self.random = self
                    .random
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                if ((self.random >> 40) as f64) < self.rate * f64::from(1_u32 << 24) {
                    *byte ^= 1 << bit;
                }
            }
        }
        out
    }
}

impl RigLink for Paced {
    fn name(&self) -> String {
        self.board.name()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        if !self.plugged.load(Ordering::SeqCst) {
            return Err(LinkError::Lost {
                name: "fake board".to_owned(),
                cause: "unplugged".to_owned(),
            });
        }
        // Not seconds ahead of an observer that the machine gives no time: time stands still, the
        // service goes on. Each cycle is a tick for the observer to read, so they come at the pace
        // of a real link.
        let duration = if self.board.now_ns > self.no_further.load(Ordering::SeqCst) {
            std::thread::sleep(duration);
            Duration::ZERO
        } else {
            duration
        };
        let to_board = self.bit_errors.damage(to_board);
        let mut exchange = self.board.exchange(&to_board, duration)?;
        exchange.from_board = self.bit_errors.damage(&exchange.from_board);
        let mut commands = self.commands.lock().unwrap();
        let room = MAX_COMMANDS.saturating_sub(commands.len());
        commands.extend(self.board.commands.drain(..).take(room));
        drop(commands);
        // A machine that is busy makes time pass slower, and never faster afterwards.
        let due = Duration::from_nanos((duration.as_nanos() as f64 / self.factor) as u64);
        std::thread::sleep(due.saturating_sub(self.last.elapsed()));
        self.last = Instant::now();
        Ok(exchange)
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        self.board.controls()
    }
}

/// An observer's link. While it is in use, the rig's time gets ahead of what it has read by
/// [`MAX_LEAD_NS`] at most.
struct Leash {
    link: ServiceLink,
    now_ns: u64,
    no_further: Arc<AtomicU64>,
}

impl RigLink for Leash {
    fn name(&self) -> String {
        self.link.name()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let limit = self.now_ns + duration.as_nanos() as u64 + MAX_LEAD_NS;
        self.no_further.store(limit, Ordering::SeqCst);
        let exchange = self.link.exchange(to_board, duration)?;
        self.now_ns = exchange.now_ns;
        Ok(exchange)
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        self.link.controls()
    }
}

/// A service with such a board.
struct KeptRig {
    _folder: tempfile::TempDir,
    path: std::path::PathBuf,
    stop: Arc<AtomicBool>,
    commands: Arc<Mutex<Vec<Command>>>,
    plugged: Arc<AtomicBool>,
    /// Link time that must not be passed yet, ns.
    no_further: Arc<AtomicU64>,
    thread: Option<std::thread::JoinHandle<bool>>,
}

impl KeptRig {
    fn start(behavior: Behavior, prepared: bool) -> Self {
        Self::with_bit_errors(behavior, prepared, 0.0)
    }

    fn with_bit_errors(behavior: Behavior, prepared: bool, rate: f64) -> Self {
        Self::of(behavior, prepared, rate, None)
    }

    /// `store`: where the rig's bring-up is kept.
    fn of(behavior: Behavior, prepared: bool, rate: f64, store: Option<Store>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.sock");
        let stop = Arc::new(AtomicBool::new(false));
        let commands = Arc::new(Mutex::new(Vec::new()));
        let plugged = Arc::new(AtomicBool::new(true));
        let no_further = Arc::new(AtomicU64::new(u64::MAX));
        let limit = no_further.clone();
        let (ready, is_ready) = std::sync::mpsc::channel();
        let (at, flag, log, plug) = (
            path.clone(),
            stop.clone(),
            commands.clone(),
            plugged.clone(),
        );
        let thread = std::thread::spawn(move || {
            let reopen_plug = plug.clone();
            let make = move |prepared: bool| {
                let mut board = FakeBoard::new(behavior);
                board.unique_id = [1, 2, 3];
                if prepared {
                    let rig = Rig::built_in().unwrap();
                    let mut session = Session::connect(&mut board).unwrap();
                    let stop = AtomicBool::new(false);
                    ready_board(
                        &mut session,
                        &rig,
                        &Zeroing::Measure,
                        &stop,
                        &mut NoopObserver,
                    )
                    .unwrap();
                }
                board.commands.clear();
                Box::new(Paced {
                    board,
                    last: Instant::now(),
                    bit_errors: BitErrors { rate, random: 1 },
                    factor: if soak_hours().is_some() { 1e6 } else { 3.0 },
                    commands: log.clone(),
                    plugged: plug.clone(),
                    no_further: limit.clone(),
                }) as Box<dyn RigLink>
            };
            let link = make(prepared);
            let options = ServeOptions {
                name: "rig".to_owned(),
                rig_file: (DEFAULT_NAME.to_owned(), DEFAULT_TEXT.to_owned()),
                terminal: true,
                store,
                reopen: Some(Box::new(move || {
                    if reopen_plug.load(Ordering::SeqCst) {
                        Ok(make(true))
                    } else {
                        Err(LinkError::Setup("not there".to_owned()))
                    }
                })),
                lockstep: true,
                stop: flag,
                ..ServeOptions::default()
            };
            let listening = Listening::bind_at(at).unwrap();
            serve(link, listening, options, |_| ready.send(()).unwrap()).is_ok()
        });
        is_ready.recv().unwrap();
        Self {
            _folder: folder,
            path,
            stop,
            commands,
            plugged,
            no_further,
            thread: Some(thread),
        }
    }

    fn client(&self, name: &str) -> Client {
        Client::connect_at(&self.path, "rig", name).unwrap()
    }

    fn commander(&self, name: &str) -> ServiceLink {
        ServiceLink::commander(self.client(name)).unwrap()
    }

    fn got(&self, command: &Command) -> usize {
        let commands = self.commands.lock().unwrap();
        commands.iter().filter(|c| *c == command).count()
    }

    /// Waits for a state of the board.
    fn wait_for(&self, state: &str) {
        let mut client = self.client("a test");
        let until = Instant::now() + PATIENCE;
        loop {
            let now = client.status().unwrap().state;
            if now == state {
                return;
            }
            assert!(Instant::now() < until, "{now}, not {state}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn end(&mut self) -> bool {
        self.no_further.store(u64::MAX, Ordering::SeqCst);
        self.stop.store(true, Ordering::SeqCst);
        self.thread
            .take()
            .is_none_or(|thread| thread.join().unwrap())
    }
}

impl Drop for KeptRig {
    fn drop(&mut self) {
        self.end();
    }
}

fn kept(hold_s: f64, stop: &Arc<AtomicBool>) -> Options {
    Options {
        zeroing: Zeroing::Keep(ZeroStore::none()),
        stop: Arc::clone(stop),
        ..Options::new([0.0, 2.0, 0.0], hold_s)
    }
}

#[test]
fn a_run_over_the_service_holds_the_force_with_others_watching() {
    let mut rig = KeptRig::start(Behavior::Good, true);
    let file = Rig::built_in().unwrap();
    let observers: Vec<_> = (0..3)
        .map(|n| {
            let link = ServiceLink::observer(rig.client(&format!("observer {n}"))).unwrap();
            std::thread::spawn(move || {
                let mut link = link;
                let mut session = Session::connect(&mut link).unwrap();
                let mut samples = 0;
                for _ in 0..200 {
                    session.exchange(Duration::from_millis(10)).unwrap();
                    samples += session.drain().samples.len();
                }
                (samples, session.counters().frames_lost)
            })
        })
        .collect();
    let mut link = rig.commander("commander");
    let stop = Arc::default();
    let outcome = set_force(&mut link, &file, &kept(3.0, &stop), &mut NoopObserver).unwrap();
    let metrics = outcome.metrics.unwrap();
    assert!(metrics.tip_force_error_n < 0.1, "{metrics:?}");
    assert_eq!(outcome.link_counters.frames_lost, 0);
    for observer in observers {
        let (samples, lost) = observer.join().unwrap();
        // 2 s of six converters at 320 SPS.
        assert!(samples > 3000, "{samples}");
        assert_eq!(lost, 0);
    }
    drop(link);
    rig.wait_for("ready");
    assert!(rig.end());
}

#[test]
fn a_commander_that_goes_away_has_the_rig_disarmed() {
    let rig = KeptRig::start(Behavior::Good, true);
    let mut client = rig.client("events");
    client
        .call(Call::Subscribe(Topics {
            events: true,
            ..Topics::default()
        }))
        .unwrap();
    {
        // Arms, and is dropped without another word, as a killed process is.
        let mut link = rig.commander("killed");
        let mut session = Session::connect(&mut link).unwrap();
        session.command(&Command::Arm).unwrap();
        rig.wait_for("running");
        link.kill();
    }
    rig.wait_for("ready");
    assert_eq!(rig.got(&Command::Disarm), 1);
    let mut texts = String::new();
    while !(texts.contains("killed") && texts.contains("is gone; the rig is disarmed")) {
        match client.next(PATIENCE).unwrap() {
            Some(Notification::Event(event)) => texts += &event.text,
            other => panic!("{other:?} after {texts}"),
        }
    }
}

#[test]
fn the_service_holds_by_itself_until_it_is_disarmed() {
    let rig = KeptRig::start(Behavior::Good, true);
    let mut client = rig.client("arm");
    client.hold(HoldParams::default()).unwrap();
    // Who asked may leave: the service holds.
    drop(client);
    std::thread::sleep(Duration::from_millis(300));
    rig.wait_for("running");
    let mut other = rig.client("another terminal");
    let status = other.status().unwrap();
    assert!(status.commander.unwrap().contains("hold for arm"));
    other.call(Call::Disarm).unwrap();
    let status = other.status().unwrap();
    assert_eq!(status.state, "ready");
    assert_eq!(status.commander, None);
    assert!(rig.got(&Command::Stop) == 0);
}

#[test]
fn a_program_without_this_library_commands_a_force() {
    let rig = KeptRig::start(Behavior::Good, true);
    let mut client = rig.client("a script");
    client
        .call(Call::Subscribe(Topics {
            telemetry: true,
            ..Topics::default()
        }))
        .unwrap();
    let force = Call::SetForce(ForceParams {
        force_n: [0.0, 2.0, 0.0],
        duration_s: 2.0,
    });
    let outcome = client.call_within(force, PATIENCE).unwrap();
    let y = outcome["metrics"]["applied_n"][1].as_f64().unwrap();
    assert!((y - 2.0).abs() < 0.1, "{y}");
    let (mut near, mut measured_near, mut named, mut last) = (0, 0, 0, None);
    while let Some(Notification::Telemetry(telemetry)) = client.next(Duration::ZERO).unwrap() {
        let force = telemetry.true_force_n.unwrap();
        near += u32::from((force[1] - 2.0).abs() < 0.3);
        if let Some(measured) = telemetry.force_n {
            measured_near += u32::from((measured[1] - 2.0).abs() < 0.3);
        }
        named += u32::from(
            telemetry
                .commander
                .as_ref()
                .is_some_and(|name| name.contains("for a script")),
        );
        last = Some(telemetry);
    }
    // What is measured, with the zeros of the board and the cables of the rig file, is what pulls.
    assert!(measured_near > 60 && named > 60, "{measured_near} {named}");
    let last = last.unwrap();
    assert_eq!(last.zeroed, [Some(true); UNITS]);
    assert!(last.clients.iter().any(|name| name.contains("a script")));
    // 50 lines a second.
    assert!(near > 60, "{near}");
}

#[test]
fn a_zero_is_kept_between_runs_whatever_friction_leaves_in_the_cables() {
    let rig = KeptRig::start(Behavior::Good, true);
    let file = Rig::built_in().unwrap();
    let stop = Arc::default();
    for _ in 0..2 {
        let mut link = rig.commander("a run");
        let outcome = set_force(&mut link, &file, &kept(2.0, &stop), &mut NoopObserver).unwrap();
        let metrics = outcome.metrics.unwrap();
        assert!(
            metrics.from_truth && metrics.tip_force_error_n < 0.1,
            "{metrics:?}"
        );
    }
    assert_eq!(
        rig.commands
            .lock()
            .unwrap()
            .iter()
            .filter(|c| matches!(c, Command::Zero { .. }))
            .count(),
        0
    );
}

#[test]
fn a_link_that_comes_back_is_used_again() {
    let rig = KeptRig::start(Behavior::Good, true);
    let file = Rig::built_in().unwrap();
    let mut link = rig.commander("a run");
    let its_file = file.clone();
    let running = std::thread::spawn(move || {
        let stop = Arc::default();
        set_force(&mut link, &its_file, &kept(60.0, &stop), &mut NoopObserver)
    });
    rig.wait_for("running");
    rig.plugged.store(false, Ordering::SeqCst);
    let error = running.join().unwrap().unwrap_err().to_string();
    assert!(error.contains("unplugged"), "{error}");
    rig.wait_for("no link");
    // Whoever watches is told, though nothing comes from the board.
    let mut watching = rig.client("a view");
    watching
        .call(Call::Subscribe(Topics {
            telemetry: true,
            ..Topics::default()
        }))
        .unwrap();
    let told = watching.next(PATIENCE).unwrap();
    let Some(Notification::Telemetry(told)) = told else {
        panic!("{told:?}");
    };
    assert_eq!(told.state, "no link");
    assert_eq!(told.tension_n, [None; UNITS]);
    let refused = rig.client("stop").call(Call::Stop).unwrap_err().to_string();
    assert!(refused.contains("is gone"), "{refused}");
    rig.plugged.store(true, Ordering::SeqCst);
    rig.wait_for("ready");
    let stop = Arc::default();
    let mut link = rig.commander("the next run");
    let outcome = set_force(&mut link, &file, &kept(2.0, &stop), &mut NoopObserver).unwrap();
    assert_eq!(outcome.ended, run::Ended::Done);
}

#[test]
fn damaged_lines_and_frames_harm_nobody_else() {
    use std::io::Write;
    let rig = KeptRig::start(Behavior::Noisy(1000), true);
    let mut bad = std::os::unix::net::UnixStream::connect(&rig.path).unwrap();
    bad.write_all(b"GET / HTTP/1.1\r\n\r\n{\"id\":1,\"method\":\"stop\"}\n\xff\xfe\n")
        .unwrap();
    // Nothing is done before hello.
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!(rig.got(&Command::Stop), 0);
    // Every thousandth byte of the board is damaged, and the run goes on.
    let file = Rig::built_in().unwrap();
    let stop = Arc::default();
    let mut link = rig.commander("a run");
    let outcome = set_force(&mut link, &file, &kept(2.0, &stop), &mut NoopObserver).unwrap();
    assert!(
        outcome.link_counters.frames_bad > 20,
        "{:?}",
        outcome.link_counters
    );
    assert!(outcome.metrics.unwrap().tip_force_error_n < 0.1);
}

#[test]
fn a_client_that_does_not_read_is_no_burden() {
    let rig = KeptRig::start(Behavior::Good, true);
    let lazy = ServiceLink::observer(rig.client("lazy")).unwrap();
    let mut client = rig.client("busy");
    for _ in 0..20 {
        std::thread::sleep(Duration::from_millis(20));
        let asked = Instant::now();
        client.call(Call::Stop).unwrap();
        // Not a limit of speed: a service that waits for the lazy client never answers.
        assert!(asked.elapsed() < PATIENCE);
    }
    drop(lazy);
}

#[test]
fn two_services_of_one_rig_are_refused_and_a_dead_socket_is_replaced() {
    let mut rig = KeptRig::start(Behavior::Good, false);
    let error = Listening::bind_at(rig.path.clone()).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::AddrInUse);
    rig.end();
    assert!(!rig.path.exists());
    drop(std::os::unix::net::UnixListener::bind(&rig.path).unwrap());
    assert!(rig.path.exists());
    assert!(Listening::bind_at(rig.path.clone()).is_ok());
}

/// Counts what is allocated. Resident memory would count what the allocator keeps after a burst as
/// well.
#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Bytes in use by this process.
fn bytes_in_use() -> usize {
    let stats = ALLOCATOR.stats();
    stats.bytes_allocated - stats.bytes_deallocated
}

/// How far the link's time may be ahead of what an observer has read, ns: less than what waits for
/// a client at most (8 s).
const MAX_LEAD_NS: u64 = 3_000_000_000;

/// How much the memory in use may grow over the test, bytes.
const MAX_GROWTH: usize = 1 << 18;

/// How long the test of memory is to last, in hours of the link's time; then it runs as fast as it
/// can.
fn soak_hours() -> Option<f64> {
    std::env::var("FORCE_SOAK_HOURS").ok()?.parse().ok()
}

/// Clients come and go while the rig is held, for `FORCE_SOAK_HOURS` of the link's time (default:
/// 20 s).
#[test]
#[allow(clippy::print_stdout)]
fn memory_stays_flat_and_nothing_is_lost_however_many_clients_come_and_go() {
    let hours = soak_hours().unwrap_or(20.0 / 3600.0);
    let rig = KeptRig::start(Behavior::Good, true);
    let mut holder = rig.client("holder");
    holder.hold(HoldParams::default()).unwrap();
    let started = holder.status().unwrap();
    let status_of = |status: &super::protocol::ServiceStatus| status.board.clone().unwrap();
    let (mut clients, mut samples) = (0_u32, 0_usize);
    // The least memory in use in each tenth of the time: what nobody's backlog of a moment is part
    // of.
    let mut least = [usize::MAX; 10];
    loop {
        // An observer for half a second of the link's time, and a client that says nothing.
        let quiet = rig.client("quiet");
        let client = rig.client("observer");
        let now_ns = holder.status().unwrap().now_ns;
        rig.no_further.store(now_ns + MAX_LEAD_NS, Ordering::SeqCst);
        let mut link = Leash {
            link: ServiceLink::observer(client).unwrap(),
            now_ns,
            no_further: rig.no_further.clone(),
        };
        let mut session = Session::connect(&mut link).unwrap();
        for _ in 0..50 {
            session.exchange(Duration::from_millis(10)).unwrap();
            samples += session.drain().samples.len();
        }
        let counters = session.counters();
        assert_eq!(
            (counters.frames_lost, counters.frames_bad),
            (0, 0),
            "client {clients}, at {} ns: {counters:?}, {:?}",
            session.now_ns(),
            holder.status().unwrap()
        );
        rig.no_further.store(u64::MAX, Ordering::SeqCst);
        drop(quiet);
        clients += 2;
        let status = holder.status().unwrap();
        let fault = status.board.as_ref().map(|board| {
            let units = board.units.map(|unit| (unit.fault, unit.fault_detail));
            (board.fault, board.fault_detail, units)
        });
        assert_eq!(status.state, "running", "client {clients}: {fault:?}");
        let passed_s = (status.now_ns - started.now_ns) as f64 * 1e-9;
        let Some(tenth) = least.get_mut((10.0 * passed_s / (hours * 3600.0)) as usize) else {
            break;
        };
        if *tenth == usize::MAX && soak_hours().is_some() {
            println!("{:.2} h of the link's time", passed_s / 3600.0);
        }
        *tenth = bytes_in_use().min(*tenth);
    }
    let status = holder.status().unwrap();
    // Those that left are gone; the job of the service and this client remain.
    let until = Instant::now() + PATIENCE;
    loop {
        let clients = holder.status().unwrap().clients;
        if clients.len() <= 2 {
            break;
        }
        assert!(Instant::now() < until, "{clients:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(status.frames_bad, 0);
    assert_eq!(
        status_of(&status).frames_dropped,
        status_of(&started).frames_dropped
    );
    if soak_hours().is_none() {
        // Other tests of this process use memory as well.
        return;
    }
    println!(
        "{:.2} h of the link's time, {clients} clients, {samples} samples, KiB in use in each tenth: {:?}",
        (status.now_ns - started.now_ns) as f64 / 3.6e12,
        least.map(|bytes| bytes / 1024)
    );
    assert!(least[9] < least[1] + MAX_GROWTH, "memory grew: {least:?}");
}

#[test]
fn a_line_with_a_bit_error_rate_of_1e_3_holds_or_ends_with_a_reason_and_never_does_anything_else() {
    let rig = KeptRig::with_bit_errors(Behavior::Good, true, 1e-3);
    let file = Rig::built_in().unwrap();
    let stop = Arc::default();
    let mut link = rig.commander("a run");
    let ended = set_force(&mut link, &file, &kept(2.0, &stop), &mut NoopObserver);
    drop(link);
    match ended {
        Ok(outcome) => {
            let counters = outcome.link_counters;
            // A frame of samples has some 1,000 bits.
            assert!(counters.frames_bad > counters.frames / 10, "{counters:?}");
            let metrics = outcome.metrics.unwrap();
            assert!(metrics.tip_force_error_n < 0.2, "{metrics:?}");
        }
        // Ten setpoints in a row were lost, or a command and its repetitions.
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    let commands = rig.commands.lock().unwrap();
    let known = |command: &Command| {
        matches!(
            command,
            Command::Hello { .. }
                | Command::Stream { .. }
                | Command::GetStatus
                | Command::GetConfig { .. }
                | Command::GetBoard
                | Command::Arm
                | Command::Setpoints { .. }
                | Command::Disarm
                | Command::Stop
        )
    };
    for command in commands.iter() {
        assert!(known(command), "{command:?} was never sent");
        if let Command::Setpoints { units, .. } = command {
            let most = file.units.map(|unit| (unit.tension_max_n * 1e6) as i32);
            assert!(units
                .iter()
                .zip(most)
                .all(|(unit, most)| unit.tension_un <= most));
        }
    }
}

#[test]
fn setpoints_that_wait_are_replaced_and_not_queued() {
    let rig = KeptRig::start(Behavior::Good, true);
    let mut link = rig.commander("a run on a slow rig");
    let setpoints = |tension_un| Command::Setpoints {
        valid_ms: 100,
        units: [UnitSetpoint {
            tension_un,
            inv_cos_q16: 65_536,
            direction_q14: [0; 3],
            reel_um_per_s: None,
        }; UNITS],
    };
    let commands = [
        setpoints(1),
        setpoints(2),
        Command::GetBoard,
        setpoints(3),
        setpoints(4),
        setpoints(5),
    ];
    let mut bytes = Vec::new();
    for (seq, command) in commands.into_iter().enumerate() {
        let mut frame = [0; wire::MAX_FRAME];
        let seq = seq as u16;
        let length = wire::encode(&HostFrame { seq, command }, &mut frame).unwrap();
        bytes.extend_from_slice(&frame[..length]);
    }
    link.exchange(&bytes, CYCLE).unwrap();
    let until = Instant::now() + PATIENCE;
    while rig.got(&setpoints(5)) == 0 {
        assert!(Instant::now() < until, "{:?}", rig.commands);
        link.exchange(&[], CYCLE).unwrap();
    }
    let seen = rig.commands.lock().unwrap();
    let sent = seen
        .iter()
        .filter(|c| matches!(c, Command::Setpoints { .. } | Command::GetBoard));
    let expected = [setpoints(2), Command::GetBoard, setpoints(5)];
    assert!(sent.eq(&expected), "{seen:?}");
}

#[test]
fn a_force_ends_with_the_client_that_asked_for_it() {
    let rig = KeptRig::start(Behavior::Good, true);
    {
        let mut client = rig.client("a script");
        let force = Call::SetForce(ForceParams {
            force_n: [0.0, 2.0, 0.0],
            duration_s: 600.0,
        });
        client.send(force, Some(77)).unwrap();
        rig.wait_for("running");
    }
    rig.wait_for("ready");
    assert_eq!(rig.got(&Command::Stop), 0);
}

#[test]
fn a_second_hold_does_not_make_the_first_one_lost() {
    let rig = KeptRig::start(Behavior::Good, true);
    let mut first = rig.client("first");
    let mut second = rig.client("second");
    // Both before the first job commands.
    first
        .send(Call::Hold(HoldParams::default()), Some(1000))
        .unwrap();
    // Requests of one client are carried out in order: the first job is ordered now, and may not
    // command yet.
    first.status().unwrap();
    let refused = second.call(Call::Hold(HoldParams::default())).unwrap_err();
    assert!(
        matches!(
            refused,
            ServiceError::Refused {
                code: code::BUSY,
                ..
            }
        ),
        "{refused}"
    );
    rig.wait_for("running");
    // Ended by whoever, as the documents say.
    second.call(Call::Disarm).unwrap();
    assert_eq!(second.status().unwrap().state, "ready");
}
