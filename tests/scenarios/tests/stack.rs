//! The painted stack: how deep it was in a session that uses every part of the firmware, against
//! the bound that the image's machine code gives.

use control::SystemState;
use emulator_link::Injection;
use test_stand::{rig, rig_file, Stand};
use wire::Command;

#[test]
fn a_demanding_session_stays_below_the_bound_of_the_machine_code() {
    let mut link = rig(91);
    let mut stand = Stand::armed_for(&mut link, 5.0, 0.4);
    // Telemetry of every sample on the line, a moving robot, moving setpoints.
    stand.ask(&Command::Stream { decimation: 1 });
    stand.robot(true);
    for step in 0..6 {
        stand.hold([4.0 + 0.3 * f64::from(step % 4); 6]);
        stand.run(0.1);
    }
    // A recovery of the bus, a stalled stream, a register that changes: the ways that a quiet
    // session does not take.
    stand.inject(Injection::StuckSda);
    stand.inject(Injection::StallUsart);
    stand.run(0.2);
    stand.robot(false);
    stand.ask(&Command::Stop);
    stand.session.set_setpoints(None);
    stand.run(0.2);
    stand.ask(&Command::ClearFaults);
    // Every configuration sent, committed and read back.
    let configs = rig_file().units.map(|unit| unit.to_wire());
    stand
        .session
        .configure(&configs)
        .unwrap_or_else(|error| panic!("{error}"));
    stand.wait("ready again", 4.0, |status| {
        status.state == SystemState::Ready as u8
    });
    let stack = stand.report().stack.expect("the image names its stack");
    let bound = scenarios::stack_bound();
    println!(
        "stack: {} bytes were used, the machine code can take {bound} of {}",
        stack.used_bytes, stack.size_bytes
    );
    // The superloop's state alone is tens of kilobytes: a small figure would mean that nothing was
    // painted.
    assert!(stack.used_bytes > bound / 2, "{stack:?}");
    assert!(stack.used_bytes <= bound, "{stack:?}, bound {bound}");
    assert!(bound < stack.size_bytes);
}
