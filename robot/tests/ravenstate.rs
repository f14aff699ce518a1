//! Each trap of the Raven's `ravenstate`, by version.

use robot::kinematics::motors_from_joints;
use robot::ravenstate::{
    code_for, gearhead_torque, gearhead_torques, joint_efforts, Adapter, Ravenstate, Version,
    DEGREES,
};
use robot::state::{Clock, Frame, Meaning, Operating, RobotState};
use robot::watch::{Watch, WatchConfig};

/// What the Raven's software writes for these joints of gold, moving at these speeds.
fn message(q: [f64; 3], qd: [f64; 3], slot: usize) -> Ravenstate {
    let mut m = Ravenstate {
        stamp: (1_700_000_000, 250),
        seq: 9,
        runlevel: 3,
        dac_val: Some([0; 16]),
        ..Ravenstate::default()
    };
    let motors = motors_from_joints(qd);
    for i in 0..3 {
        // Everything goes through one conversion to degrees, metres too.
        m.jpos[8 * slot + i] = (q[i] * DEGREES) as f32;
        m.jpos_d[8 * slot + i] = (q[i] * DEGREES) as f32;
        m.mvel[8 * slot + i] = (motors[i] * DEGREES) as f32;
        // jvel divides the motor's speed by the ratio and forgets the coupling.
        m.jvel[8 * slot + i] = (motors[i] / robot::kinematics::TRANSMISSION[i] * DEGREES) as f32;
    }
    m.pos[3 * slot..3 * slot + 3].copy_from_slice(&[-77_950, -25_270, 13_230]);
    for i in [0, 4, 8] {
        m.ori[9 * slot + i] = 1.0;
    }
    m
}

const Q: [f64; 3] = [0.5, 1.5, 0.4];
const QD: [f64; 3] = [0.03, -0.05, 0.004];

fn gold(slot: usize) -> Adapter {
    Adapter::gold(Version::V2023, slot, "raven")
}

fn effort(state: &RobotState) -> (Meaning, Vec<f64>) {
    let effort = state.joints.as_ref().unwrap().effort.as_ref().unwrap();
    (effort.meaning, effort.value.clone())
}

#[test]
fn the_insertion_is_in_metres_times_57() {
    let state = gold(0).state(&message(Q, QD, 0));
    state.check().unwrap();
    let joints = state.joints.unwrap();
    for (i, q) in Q.into_iter().enumerate() {
        assert!((joints.position[i] - q).abs() < 1e-6);
        assert!((joints.setpoint.as_ref().unwrap()[i] - q).abs() < 1e-6);
    }
}

#[test]
fn an_e_stop_and_homing_stop_the_rig_and_the_pedal_does_not() {
    for (runlevel, words) in [
        (3, None),
        (2, None),
        (1, Some("DISABLED")),
        (0, Some("FAULT")),
        (-1, Some("DISABLED")),
    ] {
        let mut watch = Watch::new(WatchConfig::default());
        let mut m = message(Q, QD, 0);
        watch.state(&gold(0).state(&m), 0).unwrap();
        m.stamp.1 += 1_000_000;
        m.runlevel = runlevel;
        let usable = watch.state(&gold(0).state(&m), 1_000_000);
        match words {
            None => assert_eq!(usable, Ok(None), "{runlevel}"),
            Some(words) => {
                let event = usable.unwrap_err();
                assert!(
                    event.stops() && event.to_string().contains(words),
                    "{event}"
                );
            }
        }
    }
    // A stamp of 0: the data are not valid.
    let mut m = message(Q, QD, 0);
    m.stamp = (0, 0);
    let mut watch = Watch::new(WatchConfig::default());
    assert!(watch.state(&gold(0).state(&m), 0).unwrap_err().stops());
}

#[test]
fn velocities_have_the_coupling_that_jvel_lacks() {
    let m = message(Q, QD, 0);
    let velocity = gold(0).state(&m).joints.unwrap().velocity.unwrap();
    for (i, qd) in QD.into_iter().enumerate() {
        assert!((velocity[i] - qd).abs() < 1e-7, "{i}");
    }
    // The message's own field is off by the coupling.
    assert!((f64::from(m.jvel[1]) / DEGREES - QD[1]).abs() > 4e-3);
}

#[test]
fn efforts_come_from_the_codes_after_clipping() {
    let mut m = message(Q, QD, 0);
    // The command is four times what the clipping lets through.
    let wanted = [8.0, 0.0, 0.0];
    m.tau[0] = wanted[0] as f32;
    let clipped = code_for(wanted[0]).clamp(-2_500, 2_500);
    m.dac_val.as_mut().unwrap()[0] = clipped;
    let (meaning, value) = effort(&gold(0).state(&m));
    assert_eq!(meaning, Meaning::Commanded);
    let expected = joint_efforts([gearhead_torque(clipped), 0.0, 0.0]);
    assert_eq!(value, expected);
    assert!(value[0] < 0.1 * joint_efforts(wanted)[0]);
    // Gold's current is negative for a positive torque.
    assert!(clipped < 0 && value[0] > 0.0);
}

#[test]
fn the_old_layout_has_the_request_only() {
    let mut m = message(Q, QD, 0);
    m.dac_val = None;
    m.tau[1] = 0.5;
    let old = Adapter::gold(Version::Old, 0, "raven");
    let (meaning, value) = effort(&old.state(&m));
    assert_eq!(meaning, Meaning::Requested);
    assert!((value[1] - joint_efforts([0.0, 0.5, 0.0])[1]).abs() < 1e-6);
    // Codes in a message of the old layout are no codes.
    m.dac_val = Some([100; 16]);
    assert_eq!(effort(&old.state(&m)).1, value);
}

#[test]
fn jac_vel_and_jac_f_have_no_influence() {
    let m = message(Q, QD, 0);
    let mut other = m.clone();
    other.jac_vel = [3.0; 12];
    other.jac_f = other.jac_vel;
    assert_eq!(gold(0).state(&m), gold(0).state(&other));
    // No force is made of them.
    assert!(gold(0).state(&other).force.is_none());
}

#[test]
fn the_arm_is_in_its_boards_slot() {
    let mut m = message(Q, QD, 1);
    m.jpos[0] = 1.0;
    let joints = gold(1).state(&m).joints.unwrap();
    assert!((joints.position[0] - Q[0]).abs() < 1e-6);
    let tip = gold(1).state(&m).tip.unwrap();
    for (got, expected) in tip.position_m.iter().zip([-0.07795, -0.02527, 0.01323]) {
        assert!((got - expected).abs() < 1e-12);
    }
    assert_eq!(tip.frame, Frame::Raven0);
}

#[test]
fn torques_of_codes_are_the_published_ones() {
    // 3.01 mN·m, 2.68 mN·m, 47.7 mN a code.
    for (joint, published) in [3.01e-3, 2.68e-3, 47.7e-3].into_iter().enumerate() {
        let mut gearhead = [0.0; 3];
        gearhead[joint] = gearhead_torque(-1);
        let at_joint = joint_efforts(gearhead)[joint];
        assert!(
            (at_joint / published - 1.0).abs() < 2e-3,
            "{joint}: {at_joint}"
        );
    }
    let joint = [0.7, -0.3, 5.0];
    let back = joint_efforts(gearhead_torques(joint));
    for i in 0..3 {
        assert!((back[i] - joint[i]).abs() < 1e-12);
    }
}

#[test]
fn the_run_level_is_an_operating_state_and_the_clock_is_the_robots() {
    for (runlevel, state) in [
        (0, Operating::Fault),
        (1, Operating::Disabled),
        (2, Operating::Paused),
        (3, Operating::Enabled),
    ] {
        let mut m = message(Q, QD, 0);
        m.runlevel = runlevel;
        assert_eq!(gold(0).state(&m).operating.unwrap().state, state);
    }
    let state = gold(0).state(&message(Q, QD, 0));
    assert_eq!(state.stamp.clock, Clock::RobotUtc);
    assert_eq!(state.stamp.t_ns, 1_700_000_000_000_000_250);
}

#[test]
fn a_rotation_that_is_none_is_left_out() {
    let mut m = message(Q, QD, 0);
    m.ori = [0.0; 18];
    assert_eq!(gold(0).state(&m).tip.unwrap().orientation_xyzw, None);
}
