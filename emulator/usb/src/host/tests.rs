//! The host against a device that is made of register accesses by the manual's sequences.

use super::{Host, Outcome, Request, State, MS};
use crate::core::registers::{bit, *};
use crate::core::Core;

/// Device descriptor: full speed, class 2, 64 bytes, one configuration, one string.
const DEVICE: [u8; 18] = [18, 1, 0, 2, 2, 0, 0, 64, 0x09, 0x12, 1, 0, 0, 1, 0, 1, 0, 1];
/// Configuration with bulk endpoints 1.
const CONFIGURATION: [u8; 32] = [
    9, 2, 32, 0, 1, 1, 0, 0x80, 50, 9, 4, 0, 0, 2, 0xFF, 0, 0, 0, 7, 5, 0x81, 2, 64, 0, 0, 7, 5, 1,
    2, 64, 0, 0,
];

/// A device that answers the standard requests and returns what it receives.
struct Device {
    core: Core,
    setup: Option<[u8; 8]>,
    reply: Vec<u8>,
    deaf: bool,
}

impl Device {
    fn new() -> Self {
        let mut core = Core::new();
        core.write(GCCFG, bit::PWRDWN);
        core.write(GOTGCTL, bit::BVALOEN | bit::BVALOVAL);
        core.write(GRXFSIZ, 128);
        core.write(DIEPTXF0, 16 << 16 | 128);
        core.write(DIEPTXF + 4, 16 << 16 | 144);
        core.write(DCTL, 0);
        Self {
            core,
            setup: None,
            reply: Vec::new(),
            deaf: false,
        }
    }

    fn send(&mut self, number: u32, bytes: &[u8]) {
        let control = self.core.peek(DIEP + 0x20 * number).unwrap();
        self.core
            .write(DIEP + 0x20 * number + EP_TSIZ, 1 << 19 | bytes.len() as u32);
        self.core
            .write(DIEP + 0x20 * number, control | bit::EPENA | bit::CNAK);
        for chunk in bytes.chunks(4) {
            let mut word = [0; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            self.core
                .write(FIFO + FIFO_SPACING * number, u32::from_le_bytes(word));
        }
    }

    fn arm_out(&mut self, number: u32) {
        let control = self.core.peek(DOEP + 0x20 * number).unwrap();
        self.core
            .write(DOEP + 0x20 * number + EP_TSIZ, 1 << 19 | 64);
        self.core
            .write(DOEP + 0x20 * number, control | bit::EPENA | bit::CNAK);
    }

    fn poll(&mut self) {
        let core = &mut self.core;
        let events = core.read(GINTSTS);
        core.write(GINTSTS, events);
        if events & bit::ENUMDNE != 0 {
            core.write(DCFG, 3);
            core.write(GRSTCTL, bit::TXFFLSH | 0x10 << 6);
            let bulk = bit::USBAEP | 2 << 18 | 64 | bit::SD0PID;
            core.write(DIEP + 0x20, bulk | 1 << 22 | bit::SNAK);
            core.write(DOEP + 0x20, bulk);
            self.arm_out(0);
            self.arm_out(1);
        }
        while !self.deaf && self.core.read(GINTSTS) & bit::RXFLVL != 0 {
            let status = self.core.read(GRXSTSP);
            let length = (status >> 4 & 0x7FF) as usize;
            let mut bytes = Vec::new();
            for _ in 0..length.div_ceil(4) {
                bytes.extend(self.core.read(FIFO).to_le_bytes());
            }
            bytes.truncate(length);
            match (status >> 17 & 0xF, status & 0xF) {
                (6, _) => self.setup = bytes.try_into().ok(),
                (4, _) => self.answer(),
                (2, 1) => {
                    self.send(1, &bytes);
                    self.arm_out(1);
                }
                (3, 0) => self.arm_out(0),
                _ => {}
            }
        }
        let sent = self.core.read(DIEP + EP_INT);
        self.core.write(DIEP + EP_INT, sent);
        if sent & bit::XFRC != 0 && !self.reply.is_empty() {
            self.send_reply();
        }
    }

    fn send_reply(&mut self) {
        let rest = self.reply.split_off(self.reply.len().min(64));
        let packet = std::mem::replace(&mut self.reply, rest);
        self.send(0, &packet);
    }

    fn answer(&mut self) {
        let Some(setup) = self.setup.take() else {
            return;
        };
        self.arm_out(0);
        let length = usize::from(u16::from_le_bytes([setup[6], setup[7]]));
        let found: &[u8] = match (setup[0], setup[1], setup[3]) {
            (0x80, 6, 1) => &DEVICE,
            (0x80, 6, 2) => &CONFIGURATION,
            (0x80, 6, 3) if setup[2] == 0 => &[4, 3, 9, 4],
            (0x80, 6, 3) => &[6, 3, b'o', 0, b'k', 0],
            (0, 5, _) => {
                self.core.write(DCFG, 3 | u32::from(setup[2]) << 4);
                return self.send(0, &[]);
            }
            (0 | 0x21, _, _) if length == 0 => return self.send(0, &[]),
            (0x21, _, _) => return self.send(0, &[]),
            _ => {
                for at in [DIEP, DOEP] {
                    let control = self.core.peek(at).unwrap();
                    self.core.write(at, control | bit::STALL);
                }
                return;
            }
        };
        self.reply = found[..length.min(found.len())].to_vec();
        self.send_reply();
    }
}

/// Runs host and device; the device looks every 20 us.
fn run(host: &mut Host, device: &mut Device, until_ms: u64) {
    while host.now < until_ms * MS {
        let next = host.now + 20_000;
        host.advance(&mut device.core, next);
        device.poll();
    }
}

fn enumerated() -> (Host, Device) {
    let (mut host, mut device) = (Host::new(), Device::new());
    host.set_cable(&mut device.core, true);
    run(&mut host, &mut device, 300);
    (host, device)
}

#[test]
fn a_device_is_enumerated_and_its_port_opened() {
    let (mut host, mut device) = enumerated();
    assert_eq!(host.state(), State::Open, "{:?}", host.log());
    let found = host.device().unwrap();
    assert_eq!(
        (found.device.as_slice(), found.configuration.as_slice()),
        (&DEVICE[..], &CONFIGURATION[..])
    );
    assert_eq!(found.text(1).as_deref(), Some("ok"));
    // Debounce and two resets with their recovery come first.
    assert!(host.log()[1].0 > (100 + 2 * 25) * MS, "{:?}", host.log());
    let sent: Vec<u8> = (0..150).collect();
    host.write(&sent);
    run(&mut host, &mut device, 310);
    assert_eq!(host.take_read(), sent);
    assert_eq!(host.counts().packets_in, 3);
    let complaints = device.core.take_complaints();
    assert!(complaints.is_empty(), "{complaints:?}");
}

#[test]
fn what_a_device_refuses_and_what_it_never_answers() {
    let (mut host, mut device) = enumerated();
    let refused = host.request(Request::read(0, 6, 0x0600, 0, 10));
    run(&mut host, &mut device, 310);
    assert_eq!(host.take_outcome(refused), Some(Outcome::Stalled));
    assert_eq!(host.take_outcome(refused), None);
    device.deaf = true;
    let mute = host.request(Request::read(0, 6, 0x0100, 0, 18));
    run(&mut host, &mut device, 5_200);
    assert_eq!(host.take_outcome(mute), None);
    run(&mut host, &mut device, 5_400);
    assert_eq!(host.take_outcome(mute), Some(Outcome::TimedOut));
}

#[test]
fn a_device_that_never_answers_is_given_up() {
    let (mut host, mut device) = (Host::new(), Device::new());
    device.deaf = true;
    host.set_cable(&mut device.core, true);
    run(&mut host, &mut device, 16_000);
    assert_eq!(host.state(), State::Failed);
    assert_eq!(
        host.log()
            .iter()
            .filter(|(_, what)| what.contains("TimedOut"))
            .count(),
        3
    );
}

#[test]
fn an_unplugged_device_is_forgotten_and_found_again() {
    let (mut host, mut device) = enumerated();
    let waiting = host.request(Request::read(0, 6, 0x0100, 0, 18));
    host.set_cable(&mut device.core, false);
    run(&mut host, &mut device, 310);
    assert_eq!(host.state(), State::Detached);
    assert_eq!(host.take_outcome(waiting), Some(Outcome::Detached));
    // Its own pull-up holds the line idle.
    assert!(device.core.is_suspended());
    host.set_cable(&mut device.core, true);
    run(&mut host, &mut device, 600);
    assert_eq!(host.state(), State::Open, "{:?}", host.log());
    assert!(!device.core.is_suspended());
}

#[test]
fn a_suspended_bus_carries_nothing_until_it_resumes() {
    let (mut host, mut device) = enumerated();
    host.set_suspended(&mut device.core, true);
    host.write(&[1, 2, 3]);
    run(&mut host, &mut device, 302);
    assert!(!device.core.is_suspended(), "3 ms are not over");
    run(&mut host, &mut device, 310);
    assert!(device.core.is_suspended());
    assert_eq!(host.state(), State::Suspended);
    host.set_suspended(&mut device.core, false);
    run(&mut host, &mut device, 335);
    assert!(
        host.take_read().is_empty(),
        "20 ms of resume and 10 ms of recovery"
    );
    run(&mut host, &mut device, 345);
    assert_eq!(host.take_read(), [1, 2, 3]);
}

#[test]
fn a_host_that_does_not_read_is_not_sent_to() {
    let (mut host, mut device) = enumerated();
    host.set_reading(false);
    host.write_packet(&[9; 10]);
    run(&mut host, &mut device, 320);
    assert_eq!(
        (host.counts().packets_out, host.counts().packets_in),
        (1, 0)
    );
    host.set_reading(true);
    run(&mut host, &mut device, 330);
    assert_eq!(host.take_read(), [9; 10]);
}
