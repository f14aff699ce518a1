//! What the service refuses, and what the board refuses through it: each client hears it in words.

use super::*;
use crate::client::Notification;
use bring_up::record::{path, write, Identity, Record};
use known::store::Store;
use std::fs::File;
use std::io::{Read as _, Write as _};
use wire::message::{CommandError, Response};
use wire::{BoardFrame, BoardMessage, Decoder};

/// The number of the tests' board ([`KeptRig`]).
const NUMBER: &str = "000000010000000200000003";

/// A store whose bring-up was done with this board.
fn tested_with(folder: &std::path::Path, board: &str) -> Store {
    let store = Store::at(folder);
    let identity = Identity {
        board: board.to_owned(),
        ..Identity::default()
    };
    let record = Record::new(&Rig::built_in().unwrap(), identity);
    write(&store, &record).unwrap();
    store
}

/// Frames of a client that is none of this library.
fn frames(commands: &[Command]) -> Vec<u8> {
    let mut bytes = vec![0];
    for (seq, command) in (1..).zip(commands) {
        let mut out = [0; wire::MAX_FRAME];
        let command = command.clone();
        let length = wire::encode(&HostFrame { seq, command }, &mut out).unwrap();
        bytes.extend_from_slice(&out[..length]);
    }
    bytes
}

/// Whether these bytes of the board refuse frame `seq`.
fn refuses(decoder: &mut Decoder, bytes: &[u8], wanted: u16) -> bool {
    bytes.iter().any(|byte| {
        let frame = decoder.push::<BoardFrame>(*byte).ok().flatten();
        matches!(
            frame.map(|frame| frame.message),
            Some(BoardMessage::Reply(reply)) if reply.seq == wanted
                && matches!(reply.response, Response::Rejected(CommandError::State(_)))
        )
    })
}

const HELLO: Command = Command::Hello {
    abi: wire::ABI_VERSION,
    schema: wire::SCHEMA_HASH,
};

#[test]
fn a_rig_of_which_the_board_was_exchanged_is_driven_by_no_client() {
    let folder = tempfile::tempdir().unwrap();
    let store = tested_with(folder.path(), "OTHER");
    let rig = KeptRig::of(Behavior::Good, true, 0.0, Some(store.clone()));
    let what = format!("since the bring-up of this rig the board was OTHER and is {NUMBER}");
    // The service's own jobs: what `forcectl arm`, the page and programs ask for.
    let force = ForceParams {
        force_n: [0.0, 1.0, 0.0],
        duration_s: 1.0,
    };
    for call in [Call::Hold(HoldParams::default()), Call::SetForce(force)] {
        let error = rig.client("a page").call_within(call, PATIENCE);
        match error.unwrap_err() {
            ServiceError::Refused { code, message } => {
                assert_eq!(code, code::EXCHANGED, "{message}");
                assert!(message.starts_with(&what), "{message}");
            }
            other => panic!("{other}"),
        }
    }
    // Programs of this library that command by themselves.
    for command in [Command::Arm, Command::Zero { units: 0x3f }] {
        let mut link = rig.commander("a run");
        let mut session = Session::connect(&mut link).unwrap();
        let error = session.command(&command).unwrap_err().to_string();
        assert!(error.starts_with(&what), "{error}");
    }
    // Programs with frames of their own, over the socket and over the pseudo-terminal.
    let mut script = rig.client("a script");
    let ticks = Topics {
        ticks: true,
        ..Topics::default()
    };
    script.call(Call::Subscribe(ticks)).unwrap();
    let bytes = frames(&[HELLO, Command::Arm]);
    script
        .send(Call::Bytes(BASE64_STANDARD.encode(&bytes)), None)
        .unwrap();
    let (mut told, mut refused, mut decoder) = (false, false, Decoder::new());
    while !(told && refused) {
        match script.next(PATIENCE).unwrap().expect("a refusal") {
            Notification::Refused(why) => told = why.starts_with(&what),
            Notification::Tick(tick) => {
                let bytes = BASE64_STANDARD.decode(&tick.bytes).unwrap();
                refused |= refuses(&mut decoder, &bytes, 2);
            }
            other => panic!("{other:?}"),
        }
    }
    let terminal = script.welcome().terminal.clone().unwrap();
    drop(script);
    let mut program = File::options()
        .read(true)
        .write(true)
        .open(terminal)
        .unwrap();
    let (mut chunk, mut decoder) = ([0; 4096], Decoder::new());
    let (began, mut asked) = (Instant::now(), None::<Instant>);
    loop {
        // As a program does: an answer may not have fitted beside the samples, or the script that
        // left may command still.
        if asked.is_none_or(|at| at.elapsed() > Duration::from_millis(100)) {
            assert!(began.elapsed() < PATIENCE, "no refusal");
            program.write_all(&bytes).unwrap();
            asked = Some(Instant::now());
        }
        let length = program.read(&mut chunk).unwrap();
        if refuses(&mut decoder, &chunk[..length], 2) {
            break;
        }
    }
    drop(program);
    for command in [Command::Arm, Command::Zero { units: 0x3f }] {
        assert_eq!(rig.got(&command), 0, "{command:?}");
    }
    // Who commands next is asked again: the record is read each time.
    std::fs::write(path(&store), "{").unwrap();
    let error = rig.client("arm").hold(HoldParams::default()).unwrap_err();
    assert!(error.to_string().contains("bring-up.json"), "{error}");
    tested_with(folder.path(), NUMBER);
    rig.client("arm").hold(HoldParams::default()).unwrap();
    rig.wait_for("running");
}

/// A bring-up drives the rig with its new part; nobody else does, nor it by a job.
#[test]
fn only_a_bring_up_drives_a_rig_with_a_new_part() {
    let folder = tempfile::tempdir().unwrap();
    let store = tested_with(folder.path(), "OTHER");
    let rig = KeptRig::of(Behavior::Good, true, 0.0, Some(store));
    let mut link = ServiceLink::tester(rig.client("bring-up")).unwrap();
    let mut session = Session::connect(&mut link).unwrap();
    session.command(&Command::Arm).unwrap();
    rig.wait_for("running");
    drop(session);
    drop(link);
    rig.wait_for("ready");
    assert_eq!(rig.got(&Command::Arm), 1);
    // Frames make their sender the commander, and no tester of it.
    let mut script = rig.client("a script");
    let bytes = BASE64_STANDARD.encode(frames(&[HELLO, Command::Arm]));
    script.send(Call::Bytes(bytes), None).unwrap();
    let told = script.next(PATIENCE).unwrap();
    assert!(matches!(told, Some(Notification::Refused(_))), "{told:?}");
    drop(script);
    let mut link = rig.commander("a run");
    let mut session = Session::connect(&mut link).unwrap();
    assert!(session.command(&Command::Arm).is_err());
    drop(session);
    drop(link);
    let mut client = rig.client("bring-up");
    client
        .call(Call::Command(CommandParams { tests: true }))
        .unwrap();
    let error = client.hold(HoldParams::default()).unwrap_err();
    assert!(error.to_string().contains("OTHER"), "{error}");
    assert_eq!(rig.got(&Command::Arm), 1);
}

/// Setpoints that the board refuses.
fn too_large() -> [UnitSetpoint; UNITS] {
    let mut units = [UnitSetpoint {
        tension_un: 2_000_000,
        inv_cos_q16: 1 << 16,
        direction_q14: [0; 3],
        reel_um_per_s: None,
    }; UNITS];
    units[3].tension_un = 900_000_000;
    units
}

/// Sends setpoints until they are refused: why.
fn refused(link: &mut dyn RigLink, units: [UnitSetpoint; UNITS]) -> String {
    let mut session = Session::connect(link).unwrap();
    session.set_setpoints(Some(units));
    // A second: a setpoint that nobody refuses is no reason to wait for ever.
    let error = (0..100).find_map(|_| session.exchange(Duration::from_millis(10)).err());
    error.expect("it is refused").to_string()
}

#[test]
fn refused_setpoints_are_told_through_the_service_as_without_one() {
    let mut board = FakeBoard::new(Behavior::Good);
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
    let direct = refused(&mut board, too_large());
    assert!(
        direct.contains("`setpoints`: unit 4: a tension of 900.00 N"),
        "{direct}"
    );
    let rig = KeptRig::start(Behavior::Good, true);
    let mut observer = ServiceLink::observer(rig.client("an observer")).unwrap();
    let mut watching = Session::connect(&mut observer).unwrap();
    let mut link = rig.commander("a run");
    assert_eq!(refused(&mut link, too_large()), direct);
    // It was no affair of others.
    for _ in 0..20 {
        watching.exchange(Duration::from_millis(10)).unwrap();
    }
}

#[test]
fn setpoints_of_a_client_that_does_not_command_are_told_to_be_refused() {
    /// Ends the first client's work, also where the test fails.
    struct Ends<'a>(&'a AtomicBool);
    impl Drop for Ends<'_> {
        fn drop(&mut self) {
            self.0.store(true, Ordering::SeqCst);
        }
    }
    let rig = KeptRig::start(Behavior::Good, true);
    let mut first = rig.commander("the first");
    let mut second = ServiceLink::observer(rig.client("the second")).unwrap();
    let end = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // One that is silent for a second may be relieved of its command.
        scope.spawn(|| {
            let mut session = Session::connect(&mut first).unwrap();
            while !end.load(Ordering::SeqCst) {
                session.get_status().unwrap();
            }
        });
        let _ends = Ends(&end);
        let error = refused(&mut second, too_large());
        assert!(
            error.starts_with("the first (process") && error.contains("commands this rig"),
            "{error}"
        );
    });
}

/// A setting that a test judged by is no longer what was tested; another one is told.
#[test]
fn a_changed_rig_file_drives_nothing_or_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let rig_file = Rig::built_in().unwrap();
    let tested = |change: fn(&mut Identity)| {
        let mut identity = Identity::of(&rig_file, &store, Some(NUMBER.to_owned())).unwrap();
        change(&mut identity);
        write(&store, &Record::new(&rig_file, identity)).unwrap();
    };
    let rig = KeptRig::of(Behavior::Good, true, 0.0, Some(store.clone()));
    let mut page = rig.client("a page");
    let events = Topics {
        events: true,
        ..Topics::default()
    };
    page.call(Call::Subscribe(events)).unwrap();
    tested(|identity| {
        identity.settings[2].insert("travel_m_per_count".to_owned(), 1.0);
    });
    let error = page.hold(HoldParams::default()).unwrap_err().to_string();
    assert!(
        error.contains("travel_m_per_count of unit 3 was 1 and is "),
        "{error}"
    );
    assert_eq!(rig.got(&Command::Arm), 0);
    tested(|identity| identity.rig_hash = "another".to_owned());
    page.hold(HoldParams::default()).unwrap();
    loop {
        match page.next(PATIENCE).unwrap().expect("the event") {
            Notification::Event(event) if event.text.contains("has another content") => break,
            _ => {}
        }
    }
    page.call(Call::Disarm).unwrap();
}
