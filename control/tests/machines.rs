//! Both state machines over every state and every condition, against the policy in words.

use control::motor::{self, Action};
use control::system::{self, Denied, Request};
use control::{MotorState, SystemState};

fn motor_conditions() -> impl Iterator<Item = motor::Conditions> {
    (0..8).flat_map(|bits| {
        SystemState::ALL
            .into_iter()
            .map(move |system| motor::Conditions {
                enabled: bits & 1 != 0,
                faulted: bits & 2 != 0,
                sensor_up: bits & 4 != 0,
                system,
            })
    })
}

#[test]
fn motor_follows_the_policy_everywhere() {
    for state in MotorState::ALL {
        for on in motor_conditions() {
            let to = motor::next(state, on);
            let context = format!("{state:?} on {on:?} gives {to:?}");
            // Nothing drives that is off, faulted, without a sensor, or not armed by the board.
            if !on.enabled {
                assert_eq!(to.state, MotorState::Offline, "{context}");
            } else if on.faulted {
                assert_eq!(to.state, MotorState::Faulted, "{context}");
            }
            if to.state.drives() {
                assert!(
                    on.enabled && !on.faulted && on.sensor_up && on.system.drives(),
                    "{context}"
                );
                // Only a unit that was up before the board was armed may drive.
                assert!(
                    !matches!(
                        state,
                        MotorState::Offline | MotorState::BringUp | MotorState::Faulted
                    ),
                    "{context}"
                );
            }
            if to.state == MotorState::Stopping {
                assert!(state.drives(), "nothing to ramp down: {context}");
            }
            // Leaving the drive writes 0 V at once; entering it starts from a fresh controller.
            if state.drives() && !to.state.drives() {
                assert!(
                    matches!(to.action, Action::ZeroOutput | Action::StartBringUp),
                    "{context}"
                );
            }
            if to.state == MotorState::Running && state != MotorState::Running {
                assert_eq!(to.action, Action::ResetController, "{context}");
            }
            if to.state == state {
                assert_eq!(to.action, Action::None, "{context}");
            }
            // A unit with a fault gone or newly enabled is brought up, but not in the middle of a
            // run.
            let out = matches!(state, MotorState::Offline | MotorState::Faulted);
            if on.enabled && !on.faulted && out {
                let expected = if on.system.drives() {
                    state
                } else {
                    MotorState::BringUp
                };
                assert_eq!(to.state, expected, "{context}");
            }
        }
    }
}

#[test]
fn motor_bring_up_always_starts_the_sensor() {
    for state in MotorState::ALL {
        for on in motor_conditions() {
            let to = motor::next(state, on);
            if to.state == MotorState::BringUp && state != MotorState::BringUp {
                assert_eq!(to.action, Action::StartBringUp, "{state:?} on {on:?}");
            }
        }
    }
}

#[test]
fn a_sensor_that_comes_back_in_a_run_waits_for_the_next_arming() {
    let on = motor::Conditions {
        enabled: true,
        sensor_up: true,
        system: SystemState::Running,
        faulted: false,
    };
    assert_eq!(
        motor::next(MotorState::BringUp, on).state,
        MotorState::BringUp
    );
    let after = motor::Conditions {
        system: SystemState::Ready,
        ..on
    };
    assert_eq!(
        motor::next(MotorState::BringUp, after).state,
        MotorState::Ready
    );
}

#[test]
fn a_motor_passes_through_its_states() {
    let mut on = motor::Conditions {
        enabled: true,
        system: SystemState::BringUp,
        ..Default::default()
    };
    let mut state = MotorState::Offline;
    let mut go = |on: motor::Conditions, to: MotorState, action: Action| {
        let t = motor::next(state, on);
        assert_eq!((t.state, t.action), (to, action), "from {state:?}");
        state = t.state;
    };
    go(on, MotorState::BringUp, Action::StartBringUp);
    on.sensor_up = true;
    go(on, MotorState::Ready, Action::None);
    on.system = SystemState::Zeroing;
    go(on, MotorState::Zeroing, Action::None);
    on.system = SystemState::Ready;
    go(on, MotorState::Ready, Action::None);
    on.system = SystemState::Running;
    go(on, MotorState::Running, Action::ResetController);
    on.system = SystemState::Stopping;
    go(on, MotorState::Stopping, Action::None);
    on.system = SystemState::Ready;
    go(on, MotorState::Ready, Action::ZeroOutput);
    on.system = SystemState::Running;
    go(on, MotorState::Running, Action::ResetController);
    on.faulted = true;
    go(on, MotorState::Faulted, Action::ZeroOutput);
    on.faulted = false;
    go(on, MotorState::Faulted, Action::None);
    on.system = SystemState::Ready;
    on.sensor_up = false;
    go(on, MotorState::BringUp, Action::StartBringUp);
}

fn system_conditions() -> impl Iterator<Item = system::Conditions> {
    (0..256u32).flat_map(|bits| {
        [Request::None, Request::Arm, Request::Disarm, Request::Zero]
            .into_iter()
            .map(move |request| {
                let bit = |n: u32| bits >> n & 1 != 0;
                system::Conditions {
                    booted: bit(0),
                    faulted: bit(1),
                    estop_closed: bit(2),
                    any_bringing_up: bit(3),
                    all_ready: bit(4),
                    any_usable: bit(5),
                    zero_done: bit(6),
                    ramp_done: bit(7),
                    request,
                }
            })
    })
}

#[test]
fn system_follows_the_policy_everywhere() {
    let mut cases = 0;
    for state in SystemState::ALL {
        for on in system_conditions() {
            cases += 1;
            let to = system::next(state, on);
            let context = format!("{state:?} on {on:?} gives {to:?}");
            if !on.booted {
                assert_eq!(to.state, SystemState::Boot, "{context}");
                continue;
            }
            // A latched fault wins over everything, and a fault without a latch can't be.
            assert_eq!(to.state == SystemState::Fault, on.faulted, "{context}");
            // One way into Running: requested, from Ready, all units ready, loop closed.
            if to.state == SystemState::Running && state != SystemState::Running {
                assert!(
                    state == SystemState::Ready
                        && on.request == Request::Arm
                        && on.all_ready
                        && on.estop_closed
                        && !on.any_bringing_up,
                    "{context}"
                );
            }
            // Out of Fault, a request of the same cycle is refused: clearing does not arm.
            if state == SystemState::Fault {
                assert!(!to.state.drives(), "{context}");
                assert_eq!(
                    to.denied.is_some(),
                    on.request != Request::None,
                    "{context}"
                );
            }
            // Stopping comes from Running or itself only, and disarming always leads there.
            if to.state == SystemState::Stopping {
                assert!(state.drives(), "{context}");
            }
            if state == SystemState::Running && !on.faulted {
                assert!(to.state.drives(), "{context}");
                assert_eq!(
                    to.state == SystemState::Stopping,
                    on.request == Request::Disarm || on.request == Request::None && !on.any_usable,
                    "{context}"
                );
            }
            if on.request == Request::None {
                assert_eq!(to.denied, None, "{context}");
            }
            if on.faulted && on.request != Request::None {
                assert_eq!(to.denied, Some(Denied::Faulted), "{context}");
            }
            // A request is followed or refused, never lost: Zero leads to Zeroing, Arm to Running.
            match on.request {
                Request::Zero => assert_eq!(
                    to.denied.is_none(),
                    state == SystemState::Ready && to.state == SystemState::Zeroing,
                    "{context}"
                ),
                Request::Arm => assert_eq!(
                    to.denied.is_none(),
                    to.state == SystemState::Running,
                    "{context}"
                ),
                _ => {}
            }
        }
    }
    assert_eq!(cases, 7 * 256 * 4);
}

#[test]
fn why_arming_is_refused() {
    let ready = system::Conditions {
        booted: true,
        estop_closed: true,
        all_ready: true,
        any_usable: true,
        request: Request::Arm,
        ..Default::default()
    };
    let ask = |on| system::next(SystemState::Ready, on).denied;
    assert_eq!(ask(ready), None);
    assert_eq!(
        ask(system::Conditions {
            all_ready: false,
            ..ready
        }),
        Some(Denied::UnitNotReady)
    );
    assert_eq!(
        ask(system::Conditions {
            estop_closed: false,
            ..ready
        }),
        Some(Denied::EStopOpen)
    );
    assert_eq!(
        ask(system::Conditions {
            any_bringing_up: true,
            ..ready
        }),
        Some(Denied::State)
    );
    assert_eq!(
        ask(system::Conditions {
            faulted: true,
            ..ready
        }),
        Some(Denied::Faulted)
    );
}

#[test]
fn numbers_are_stable_and_invertible() {
    let motors = [
        "offline", "bring-up", "ready", "running", "faulted", "zeroing", "stopping",
    ];
    for (number, name) in (0u8..).zip(motors) {
        assert_eq!(
            MotorState::from_u8(number).map(MotorState::name),
            Some(name)
        );
    }
    assert_eq!(MotorState::from_u8(7), None);
    let systems = [
        "boot", "bring-up", "ready", "zeroing", "running", "stopping", "fault",
    ];
    for (number, name) in (0u8..).zip(systems) {
        assert_eq!(
            SystemState::from_u8(number).map(SystemState::name),
            Some(name)
        );
        assert_eq!(SystemState::from_u8(number).map(|s| s as u8), Some(number));
    }
    assert_eq!(SystemState::from_u8(7), None);
}
