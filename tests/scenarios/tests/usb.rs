//! The board as a USB device: enumeration, descriptors, and hosts that do not behave.

use emulator::allowed;
use emulator_usb::host::{Outcome, Request, State};
use scenarios::descriptors::{check_configuration, check_device};
use scenarios::usb::UsbRig;

/// Class request to the communications interface.
const CLASS: u8 = 0x21;
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;
const SET_CONTROL_LINE_STATE: u8 = 0x22;
/// 2,000,000 baud, one stop bit, no parity, eight bits (PSTN 1.2 table 17).
const CODING: [u8; 7] = [0x80, 0x84, 0x1E, 0, 0, 0, 8];

/// Nothing the core does not allow, and the device still answers.
fn is_sound(rig: &mut UsbRig) {
    let Outcome::Done(device) = rig.descriptor(1, 0, 18) else {
        panic!("the device descriptor is gone");
    };
    assert_eq!(device.len(), 18);
    let unexpected = allowed::unexpected(&rig.report().register_events);
    assert!(unexpected.is_empty(), "{unexpected:#?}");
}

#[test]
fn a_host_enumerates_the_board_and_opens_its_port() {
    let mut rig = UsbRig::open(61);
    let (log, device) = rig.usb(|host, _| (host.log().to_vec(), host.device().cloned().unwrap()));
    let words: Vec<&str> = log.iter().map(|(_, what)| what.as_str()).collect();
    assert_eq!(words, ["attached", "configured", "port open"]);
    check_device(&device.device).unwrap_or_else(|mistakes| panic!("{mistakes}"));
    let port =
        check_configuration(&device.configuration).unwrap_or_else(|mistakes| panic!("{mistakes}"));
    // PSTN 1.2 table 4, D1: the device takes SET_LINE_CODING and SET_CONTROL_LINE_STATE, so it has
    // to say so.
    assert_eq!(
        port.capabilities & 2,
        2,
        "bmCapabilities {:#04x}",
        port.capabilities
    );
    // The board has its own supply (docs/wiring.md); the bus feeds nothing but VDD33USB's detector.
    assert_eq!(device.configuration[7] & 0x40, 0x40, "bmAttributes");
    assert_eq!(device.text(1).as_deref(), Some("force rig"));
    assert_eq!(device.text(2).as_deref(), Some("force board"));
    // The emulated controller's unique number is zero.
    assert_eq!(device.text(3), Some("0".repeat(24)));
    is_sound(&mut rig);
}

#[test]
fn descriptors_come_in_the_length_that_is_asked_for() {
    let mut rig = UsbRig::open(62);
    let Outcome::Done(whole) = rig.descriptor(2, 0, 255) else {
        panic!("no configuration descriptor");
    };
    assert_eq!(
        usize::from(u16::from_le_bytes([whole[2], whole[3]])),
        whole.len()
    );
    for length in [1, 8, 9, 18, 63, 64, 65, whole.len() as u16, 512] {
        let Outcome::Done(part) = rig.descriptor(2, 0, length) else {
            panic!("{length} bytes of the configuration descriptor");
        };
        assert_eq!(part, whole[..usize::from(length).min(whole.len())]);
    }
    assert_eq!(rig.descriptor(3, 0, 255), Outcome::Done(vec![4, 3, 9, 4]));
    is_sound(&mut rig);
}

#[test]
fn wrong_control_requests_are_refused_and_change_nothing() {
    let mut rig = UsbRig::open(63);
    let wrong = [
        // Descriptors that a full-speed device does not have: qualifier, other speed, a second
        // configuration, string 99.
        Request::read(0, 6, 0x0600, 0, 10),
        Request::read(0, 6, 0x0700, 0, 9),
        Request::read(0, 6, 0x0201, 0, 9),
        Request::read(0, 6, 0x0363, 0x409, 255),
        // A configuration that is not there, an unknown standard request, vendor requests.
        Request::write(0, 9, 7, 0, &[]),
        Request::write(0, 0x33, 0, 0, &[]),
        Request::write(0x40, 1, 0, 0, &[1, 2, 3]),
        Request::read(0x40, 1, 0, 0, 64),
        // Class requests: unknown, to the wrong interface, line coding that is too short or too
        // long to be one.
        Request::write(CLASS, 0x55, 0, 0, &[]),
        Request::write(CLASS, SET_LINE_CODING, 0, 1, &CODING),
        Request::write(CLASS, SET_LINE_CODING, 0, 0, &CODING[..3]),
        Request::read(CLASS, GET_LINE_CODING, 0, 0, 3),
    ];
    for request in wrong {
        let outcome = rig.control(request.clone());
        assert_eq!(outcome, Outcome::Stalled, "{request:?}");
    }
    let coding = rig.control(Request::read(CLASS, GET_LINE_CODING, 0, 0, 7));
    assert_eq!(coding, Outcome::Done(CODING.to_vec()));
    assert_eq!(rig.usb(|host, _| host.state()), State::Open);
    is_sound(&mut rig);
}

/// Data that `usb-device` does not expect at endpoint 0 stay in the driver's buffer: without a
/// correction USB is dead until the controller is reset.
#[test]
fn a_data_stage_that_is_too_long_is_refused_and_usb_goes_on() {
    let mut rig = UsbRig::open(70);
    for length in [129, 512, 8, 4_000] {
        let long = Request::write(CLASS, SET_LINE_CODING, 0, 1, &vec![0; length]);
        assert_eq!(rig.control(long), Outcome::Stalled, "{length} bytes");
        let coding = rig.control(Request::read(CLASS, GET_LINE_CODING, 0, 0, 7));
        assert_eq!(coding, Outcome::Done(CODING.to_vec()));
    }
    is_sound(&mut rig);
}

#[test]
fn transfers_that_the_host_abandons_leave_nothing_behind() {
    let mut rig = UsbRig::open(64);
    for _ in 0..20 {
        let mut read = Request::read(0, 6, 0x0200, 0, 255);
        read.abandon_after = Some(24);
        assert_eq!(rig.control(read), Outcome::Abandoned);
        let mut write = Request::write(CLASS, SET_LINE_CODING, 0, 0, &CODING);
        write.abandon_after = Some(7);
        assert_eq!(rig.control(write), Outcome::Abandoned);
        // Read to its end right after a descriptor that was not: no byte is the descriptor's.
        let mut read = Request::read(0, 6, 0x0200, 0, 255);
        read.abandon_after = Some(0);
        assert_eq!(rig.control(read), Outcome::Abandoned);
        let coding = rig.control(Request::read(CLASS, GET_LINE_CODING, 0, 0, 7));
        assert_eq!(coding, Outcome::Done(CODING.to_vec()));
    }
    is_sound(&mut rig);
    let state = Request::write(CLASS, SET_CONTROL_LINE_STATE, 3, 0, &[]);
    assert_eq!(rig.control(state), Outcome::Done(vec![]));
}

#[test]
fn every_standard_request_of_chapter_9_is_answered() {
    let mut rig = UsbRig::open(65);
    // GET_STATUS of device (self-powered), interface and an endpoint; GET_CONFIGURATION;
    // GET_INTERFACE.
    assert_eq!(
        rig.control(Request::read(0, 0, 0, 0, 2)),
        Outcome::Done(vec![1, 0])
    );
    assert_eq!(
        rig.control(Request::read(1, 0, 0, 0, 2)),
        Outcome::Done(vec![0, 0])
    );
    assert_eq!(
        rig.control(Request::read(0, 8, 0, 0, 1)),
        Outcome::Done(vec![1])
    );
    assert_eq!(
        rig.control(Request::read(1, 10, 0, 1, 1)),
        Outcome::Done(vec![0])
    );
    let bulk = bulk_in(&mut rig);
    // Halt and its end: the status shows it, the pipe stalls.
    let halt = |request: u8| Request::write(2, request, 0, u16::from(bulk), &[]);
    assert_eq!(rig.control(halt(3)), Outcome::Done(vec![]));
    assert_eq!(
        rig.control(Request::read(2, 0, 0, bulk.into(), 2)),
        Outcome::Done(vec![1, 0])
    );
    assert_eq!(rig.control(halt(1)), Outcome::Done(vec![]));
    assert_eq!(
        rig.control(Request::read(2, 0, 0, bulk.into(), 2)),
        Outcome::Done(vec![0, 0])
    );
    is_sound(&mut rig);
}

/// Address of the bulk IN endpoint.
fn bulk_in(rig: &mut UsbRig) -> u8 {
    let configuration = rig.usb(|host, _| host.device().unwrap().configuration.clone());
    check_configuration(&configuration).unwrap().bulk[0].0
}

/// Address of the bulk OUT endpoint.
fn bulk_out(rig: &mut UsbRig) -> u8 {
    let configuration = rig.usb(|host, _| host.device().unwrap().configuration.clone());
    check_configuration(&configuration).unwrap().bulk[1].0
}

/// CLEAR_FEATURE(ENDPOINT_HALT) sets the data PID to DATA0 on both sides (USB 2.0 section 9.4.5).
/// Linux and macOS send it when they open a port of some devices. A device that keeps its PID loses
/// one packet.
#[test]
fn a_cleared_halt_starts_with_data0() {
    let mut rig = UsbRig::open(66);
    let hello = wire::Command::GetStatus;
    let mut frame = [0; wire::MAX_FRAME];
    for round in 0..6 {
        // An odd number of packets moves the PID to DATA1.
        let length = wire::encode(
            &wire::HostFrame {
                seq: round,
                command: hello.clone(),
            },
            &mut frame,
        )
        .unwrap();
        rig.usb(|host, _| host.write_packet(&frame[..length]));
        rig.run(20);
        for address in [bulk_in(&mut rig), bulk_out(&mut rig)] {
            assert_eq!(
                rig.control(Request::write(2, 1, 0, address.into(), &[])),
                Outcome::Done(vec![])
            );
        }
        rig.run(20);
    }
    let counts = rig.usb(|host, _| host.counts());
    assert!(counts.packets_in > 5, "{counts:?}");
    assert_eq!(
        counts.repeated_in, 0,
        "packets with the PID of the one before: {counts:?}"
    );
    // Each request was answered: none was taken for a repetition.
    assert_eq!(counts.packets_out, 6);
    let answers = replies(&mut rig);
    assert_eq!(answers, 6, "requests were lost");
}

/// SET_CONFIGURATION resets all data PIDs, even to the configuration in force (section 9.1.1.5).
#[test]
fn a_repeated_set_configuration_starts_with_data0() {
    let mut rig = UsbRig::open(67);
    let mut frame = [0; wire::MAX_FRAME];
    for seq in 0..5 {
        let command = wire::Command::GetStatus;
        let length = wire::encode(&wire::HostFrame { seq, command }, &mut frame).unwrap();
        rig.usb(|host, _| host.write_packet(&frame[..length]));
        rig.run(20);
        assert_eq!(
            rig.control(Request::write(0, 9, 1, 0, &[])),
            Outcome::Done(vec![])
        );
        rig.run(20);
    }
    let counts = rig.usb(|host, _| host.counts());
    assert_eq!(
        (counts.repeated_in, replies(&mut rig)),
        (0, 5),
        "{counts:?}"
    );
}

/// Responses among the bytes that came by USB.
fn replies(rig: &mut UsbRig) -> usize {
    let mut decoder = wire::Decoder::new();
    let bytes = rig.usb(|host, _| host.take_read());
    let frames = bytes
        .into_iter()
        .filter_map(|byte| decoder.push(byte).ok().flatten());
    frames
        .filter(|frame: &wire::BoardFrame| matches!(frame.message, wire::BoardMessage::Reply(_)))
        .count()
}

#[test]
fn packets_of_any_length_are_one_stream_of_bytes() {
    let mut rig = UsbRig::open(68);
    let mut frame = [0; wire::MAX_FRAME];
    let mut expected = 0;
    for (seq, cut) in [1, 2, 3, 5, 8, 13, 63, 64].into_iter().enumerate() {
        let command = wire::Command::GetStatus;
        let length = wire::encode(
            &wire::HostFrame {
                seq: seq as u16,
                command,
            },
            &mut frame,
        )
        .unwrap();
        rig.usb(|host, _| {
            // Packets of length zero between the pieces carry nothing.
            host.write_packet(&[]);
            for piece in frame[..length].chunks(cut) {
                host.write_packet(piece);
                host.write_packet(&[]);
            }
        });
        expected += 1;
        rig.run(20);
    }
    assert_eq!(rig.usb(|host, _| host.waiting_to_device()), 0);
    assert_eq!(replies(&mut rig), expected);
    is_sound(&mut rig);
}

#[test]
fn resets_by_the_host_at_any_time_end_in_an_open_port() {
    let mut rig = UsbRig::boot(69);
    rig.plug(true);
    // During debounce, address, descriptors, traffic.
    for ms in [60, 131, 27, 152, 155, 158, 161, 170, 300, 3] {
        rig.run(ms);
        rig.usb(|host, core| host.reset_bus(core));
    }
    rig.wait_state(State::Open, 1_000);
    rig.run(100);
    assert!(rig.usb(|host, _| host.counts().packets_in) > 0);
    is_sound(&mut rig);
}
