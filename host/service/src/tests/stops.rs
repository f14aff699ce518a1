//! Stops: anyone may stop, it is said who did, and only others clear it.

use super::*;
use crate::stop::stop;

#[test]
fn one_commands_and_anyone_stops() {
    let rig = KeptRig::start(Behavior::Good, true);
    let file = Rig::built_in().unwrap();
    let mut link = rig.commander("the first");
    let running = std::thread::spawn(move || {
        let stop = Arc::default();
        set_force(&mut link, &file, &kept(60.0, &stop), &mut NoopObserver)
    });
    rig.wait_for("running");
    // A second commander is refused and told who commands.
    let error = ServiceLink::commander(rig.client("the second")).unwrap_err();
    assert!(
        matches!(&error, ServiceError::Refused { code: code::BUSY, message } if message.contains("the first")),
        "{error}"
    );
    // Its frames are refused as well, and no command of its gets through.
    let mut observer = ServiceLink::observer(rig.client("observer")).unwrap();
    let mut session = Session::connect(&mut observer).unwrap();
    assert!(session.command(&Command::Disarm).is_err());
    assert!(session.get_status().is_ok());
    assert_eq!(rig.got(&Command::Disarm), 0);
    // But it stops the rig.
    let mut other = rig.client("anyone");
    other.call(Call::Stop).unwrap();
    assert_eq!(rig.got(&Command::Stop), 1);
    let error = running.join().unwrap().unwrap_err();
    assert!(matches!(error, RunError::Fault(_)), "{error}");
    // The run says who it was.
    let who = format!("stopped by anyone (process {}, user ", std::process::id());
    assert!(error.to_string().starts_with(&who), "{error}");
    rig.wait_for("fault");
    assert!(other.call(Call::Clear).is_ok());
    rig.wait_for("ready");
}

/// Programs that test a rig clear what their own tests latch.
#[test]
fn a_stop_from_elsewhere_is_not_cleared_by_who_was_stopped() {
    let rig = KeptRig::start(Behavior::Good, true);
    let mut link = rig.commander("bring-up");
    let mut session = Session::connect(&mut link).unwrap();
    session.command(&Command::Stop).unwrap();
    session.command(&Command::ClearFaults).unwrap();
    rig.client("a terminal").call(Call::Stop).unwrap();
    // As a program does that can't disarm any more.
    session.command(&Command::Stop).unwrap();
    for command in [Command::ClearFaults, Command::Arm] {
        let error = session.command(&command).unwrap_err();
        // The link is there: who was refused is not told that it is gone.
        let refused = matches!(
            error,
            SessionError::Link(LinkError::NotAllowed(_)) | SessionError::Refused { .. }
        );
        assert!(
            refused && error.to_string().contains("forcectl clear"),
            "{error}"
        );
    }
    let fault = session.get_status().unwrap().fault;
    assert_eq!(fault, control::Fault::HostStop.code());
    rig.client("forcectl clear").call(Call::Clear).unwrap();
    assert_eq!(session.get_status().unwrap().fault, 0);
    // From then on it clears its own again.
    session.command(&Command::Stop).unwrap();
    session.command(&Command::ClearFaults).unwrap();
}

/// A command that connects more than once learns of a stop in between, which was cleared again.
#[test]
fn stops_of_others_are_counted() {
    let rig = KeptRig::start(Behavior::Good, true);
    let seen = |name: &str| {
        let client = rig.client(name);
        let welcome = client.welcome();
        (welcome.stops, welcome.stopped_by.clone())
    };
    assert_eq!(seen("an experiment"), (0, None));
    // Its own stops, as of an attempt that failed, are none of others.
    let mut own = rig.client("an experiment");
    own.call(Call::Stop).unwrap();
    own.call(Call::Clear).unwrap();
    let name = |seen: &(u64, Option<String>)| seen.1.clone().unwrap_or_default();
    assert_eq!(seen("an experiment"), (0, None));
    let other = seen("a terminal");
    assert!(
        other.0 == 1 && name(&other).starts_with("an experiment"),
        "{other:?}"
    );
    let mut link = rig.commander("a terminal");
    let mut session = Session::connect(&mut link).unwrap();
    session.command(&Command::Stop).unwrap();
    session.command(&Command::ClearFaults).unwrap();
    let other = seen("an experiment");
    assert!(
        other.0 == 1 && name(&other).starts_with("a terminal"),
        "{other:?}"
    );
    // A clear that a stop overtakes is answered.
    let mut clears = rig.client("forcectl clear");
    let mut stops = rig.client("a person");
    for _ in 0..30 {
        let stopping = std::thread::scope(|scope| {
            let stopping = scope.spawn(|| stops.call(Call::Stop).is_ok());
            let cleared = clears.call(Call::Clear);
            let answered = matches!(&cleared, Ok(_) | Err(ServiceError::Refused { .. }));
            assert!(answered, "{cleared:?}");
            stopping.join().unwrap()
        });
        assert!(stopping);
    }
}

#[test]
fn a_stop_asks_the_service_first() {
    let rig = KeptRig::start(Behavior::Good, true);
    let socket = Socket {
        name: "rig".to_owned(),
        path: rig.path.clone(),
    };
    assert_eq!(
        socket.holder(),
        Some((std::process::id(), "fake board".to_owned()))
    );
    let stopped = stop(&socket, "a test", &|words| panic!("{words}")).unwrap();
    assert_eq!(stopped.link, "fake board");
    assert_eq!(rig.got(&Command::Stop), 1);
    // A service whose link is gone is alive, and has not stopped anything.
    rig.plugged.store(false, Ordering::SeqCst);
    rig.wait_for("no link");
    let error = stop(&socket, "a test", &|_| {}).unwrap_err().to_string();
    assert!(
        error.contains("NOT CONFIRMED") && error.contains("is gone"),
        "{error}"
    );
}
