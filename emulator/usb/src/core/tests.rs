//! The core at its registers, by the manual's programming sequences (RM0433 rev 9 section 57.15).

use super::registers::{bit, *};
use super::{Core, Handshake, InResponse};

const SETUP: [u8; 8] = [0x80, 6, 0, 1, 0, 0, 18, 0];

fn ctl(base: u32, number: u32) -> u32 {
    base + 0x20 * number + EP_CTL
}

/// Powered, connected, reset by the host, endpoint 0 ready; bulk endpoint 2 in both directions with
/// 64 bytes.
fn ready() -> Core {
    let mut core = Core::new();
    core.set_vbus(true);
    core.write(GRSTCTL, bit::CSRST);
    core.write(GCCFG, bit::PWRDWN);
    core.write(GOTGCTL, bit::BVALOEN | bit::BVALOVAL);
    core.write(DCFG, 3);
    core.write(GRXFSIZ, 128);
    core.write(DIEPTXF0, 16 << 16 | 128);
    core.write(DIEPTXF + 8, 16 << 16 | 144);
    core.write(DCTL, 0);
    core.write(GINTSTS, u32::MAX);
    core.reset_begins();
    core.reset_ends();
    core.write(DOEP + EP_TSIZ, 3 << 29 | 1 << 19 | 64);
    core.write(ctl(DOEP, 0), bit::EPENA | bit::CNAK);
    let bulk = bit::USBAEP | 2 << 18 | 64 | bit::SD0PID;
    core.write(ctl(DIEP, 2), bulk | 2 << 22 | bit::SNAK);
    core.write(DOEP + 0x40 + EP_TSIZ, 1 << 19 | 64);
    core.write(ctl(DOEP, 2), bulk | bit::EPENA | bit::CNAK);
    core.take_complaints();
    core
}

/// Puts a packet into the FIFO of an IN endpoint and enables it.
fn send(core: &mut Core, number: u32, bytes: &[u8]) {
    core.write(DIEP + 0x20 * number + EP_TSIZ, 1 << 19 | bytes.len() as u32);
    let control = core.peek(ctl(DIEP, number)).unwrap();
    core.write(ctl(DIEP, number), control | bit::EPENA | bit::CNAK);
    for chunk in bytes.chunks(4) {
        let mut word = [0; 4];
        word[..chunk.len()].copy_from_slice(chunk);
        core.write(FIFO + FIFO_SPACING * number, u32::from_le_bytes(word));
    }
}

/// Pops an entry of the receive FIFO with its data: PKTSTS, endpoint, bytes.
fn receive(core: &mut Core) -> (u32, u32, Vec<u8>) {
    let status = core.read(GRXSTSP);
    let length = (status >> 4 & 0x7FF) as usize;
    let mut bytes = Vec::new();
    for _ in 0..length.div_ceil(4) {
        bytes.extend(core.read(FIFO).to_le_bytes());
    }
    bytes.truncate(length);
    (status >> 17 & 0xF, status & 0xF, bytes)
}

#[test]
fn reset_values_and_the_core_s_identity() {
    let mut core = Core::new();
    assert_eq!(core.read(CID), 0x2300);
    assert_eq!(core.read(GSNPSID), 0x4F54_330A);
    assert_eq!(core.read(GRSTCTL), bit::AHBIDL);
    assert_eq!(core.read(DCTL) & bit::SDIS, bit::SDIS);
    assert!(!core.pull_up() && !core.interrupt());
    assert!(core.take_complaints().is_empty());
    core.read(0x0F0);
    core.write(CID, 1);
    let places: Vec<String> = core
        .take_complaints()
        .into_iter()
        .map(|(place, _)| place)
        .collect();
    assert_eq!(places, ["OTG2_HS.0x0f0", "OTG2_HS.0x03c"]);
}

#[test]
fn the_pull_up_needs_transceiver_session_and_connection() {
    let mut core = ready();
    assert!(core.pull_up());
    for (register, value) in [
        (GCCFG, 0),
        (DCTL, bit::SDIS),
        (GOTGCTL, bit::BVALOEN),
        (GUSBCFG, bit::FHMOD),
    ] {
        let before = core.peek(register).unwrap();
        core.write(register, value);
        assert!(!core.pull_up(), "{register:#x}");
        core.write(register, before);
        assert!(core.pull_up(), "{register:#x}");
    }
    // VBUS detection in place of the override.
    core.write(GOTGCTL, 0);
    assert!(!core.pull_up());
    core.write(GCCFG, bit::PWRDWN | bit::VBDEN);
    assert!(core.pull_up());
    core.set_vbus(false);
    assert!(!core.pull_up());
}

#[test]
fn a_setup_packet_is_taken_whatever_nak_and_stall_say() {
    let mut core = ready();
    core.write(ctl(DOEP, 0), bit::SNAK | bit::STALL);
    core.write(ctl(DIEP, 0), bit::STALL);
    assert_eq!(core.in_token(0, 0), InResponse::Stall);
    assert_eq!(core.setup(0, SETUP), Handshake::Ack);
    // STALL is gone, both directions answer NAK, and a write of 0 could not have cleared STALL.
    assert_eq!(
        core.read(ctl(DIEP, 0)) & (bit::STALL | bit::NAKSTS),
        bit::NAKSTS
    );
    assert_eq!(
        core.read(ctl(DOEP, 0)) & (bit::STALL | bit::NAKSTS),
        bit::NAKSTS
    );
    assert_eq!(core.setup(3, SETUP), Handshake::Silence);
    assert_eq!(receive(&mut core), (6, 0, SETUP.to_vec()));
    // The entry that ends the SETUP stage comes with the first token of the next one.
    assert_eq!(core.read(GINTSTS) & bit::RXFLVL, 0);
    assert_eq!(core.in_token(0, 0), InResponse::Nak);
    assert_eq!(receive(&mut core), (4, 0, vec![]));
    assert_eq!(core.read(DOEP + EP_INT), bit::STUP);
    assert!(core.take_complaints().is_empty());
}

#[test]
fn stall_of_endpoint_0_is_cleared_by_setup_alone() {
    let mut core = ready();
    core.write(ctl(DIEP, 0), bit::STALL);
    core.write(ctl(DIEP, 0), 0);
    assert_eq!(core.in_token(0, 0), InResponse::Stall);
    core.write(ctl(DIEP, 2), bit::USBAEP | bit::STALL);
    assert_eq!(core.in_token(0, 2), InResponse::Stall);
    core.write(ctl(DIEP, 2), bit::USBAEP);
    assert_eq!(core.in_token(0, 2), InResponse::Nak);
}

#[test]
fn an_in_packet_goes_out_when_the_fifo_holds_all_of_it() {
    let mut core = ready();
    assert_eq!(core.in_token(0, 2), InResponse::Nak);
    core.write(DIEP + 0x40 + EP_TSIZ, 1 << 19 | 6);
    let control = core.peek(ctl(DIEP, 2)).unwrap();
    core.write(ctl(DIEP, 2), control | bit::EPENA | bit::CNAK);
    core.write(FIFO + 2 * FIFO_SPACING, 0x0403_0201);
    assert!(!core.responds_in(0, 2));
    assert_eq!(core.in_token(0, 2), InResponse::Nak);
    assert_ne!(core.read(DIEP + 0x40 + EP_INT) & bit::ITTXFE, 0);
    core.write(FIFO + 2 * FIFO_SPACING, 0x0605);
    let packet = InResponse::Data {
        data1: false,
        bytes: vec![1, 2, 3, 4, 5, 6],
    };
    // Not acknowledged: the same packet again.
    assert_eq!(core.in_token(0, 2), packet);
    assert_eq!(core.in_token(0, 2), packet);
    core.acknowledged(2, 6);
    assert_eq!(
        core.read(ctl(DIEP, 2)) & (bit::EPENA | bit::DPID),
        bit::DPID
    );
    assert_ne!(core.read(DIEP + 0x40 + EP_INT) & bit::XFRC, 0);
    assert_eq!(core.read(DIEP + 0x40 + EP_FSTS), 16);
}

#[test]
fn the_interrupt_line_follows_the_masks() {
    let mut core = ready();
    send(&mut core, 2, &[1]);
    core.in_token(0, 2);
    core.acknowledged(2, 1);
    assert!(!core.interrupt());
    for (register, value) in [
        (GINTMSK, bit::IEPINT),
        (DIEPMSK, bit::XFRC),
        (DAINTMSK, 1 << 2),
        (GAHBCFG, bit::GINT),
    ] {
        assert!(!core.interrupt(), "{register:#x}");
        core.write(register, value);
    }
    assert!(core.interrupt());
    assert_eq!(core.read(DAINT), 1 << 2);
    core.write(DIEP + 0x40 + EP_INT, bit::XFRC);
    assert!(!core.interrupt());
}

#[test]
fn an_out_transfer_ends_with_a_short_packet() {
    let mut core = ready();
    assert_eq!(core.out(0, 2, false, &[7; 5]), Handshake::Ack);
    assert_eq!(
        core.read(ctl(DOEP, 2)) & (bit::EPENA | bit::NAKSTS),
        bit::NAKSTS
    );
    assert_eq!(core.out(0, 2, true, &[8]), Handshake::Nak);
    assert_ne!(core.read(DOEP + 0x40 + EP_INT) & bit::OTEPDIS, 0);
    assert_eq!(receive(&mut core), (2, 2, vec![7; 5]));
    assert_eq!(receive(&mut core), (3, 2, vec![]));
    assert_ne!(core.read(DOEP + 0x40 + EP_INT) & bit::XFRC, 0);
    assert_eq!(core.read(DOEP + 0x40 + EP_TSIZ), 59);
    // Enabled again; a packet that the host repeats is acknowledged and dropped.
    let control = core.peek(ctl(DOEP, 2)).unwrap();
    core.write(ctl(DOEP, 2), control | bit::EPENA | bit::CNAK);
    assert_eq!(core.out(0, 2, false, &[7; 5]), Handshake::Ack);
    assert_eq!(core.read(GINTSTS) & bit::RXFLVL, 0);
    assert_eq!(core.out(0, 2, true, &[]), Handshake::Ack);
    assert_eq!(receive(&mut core), (2, 2, vec![]));
}

#[test]
fn a_full_receive_fifo_answers_nak_and_still_takes_setup() {
    let mut core = ready();
    core.write(GRXFSIZ, 47);
    let mut data1 = false;
    let mut taken = 0;
    loop {
        let control = core.peek(ctl(DOEP, 2)).unwrap();
        core.write(DOEP + 0x40 + EP_TSIZ, 1 << 19 | 64);
        core.write(ctl(DOEP, 2), control | bit::EPENA | bit::CNAK);
        if !core.responds_out(0, 2, 64) {
            break;
        }
        assert_eq!(core.out(0, 2, data1, &[1; 64]), Handshake::Ack);
        data1 = !data1;
        taken += 1;
    }
    // 17 words of data and status, one of "transfer completed", 13 kept free.
    assert_eq!(taken, 1);
    assert_eq!(core.out(0, 2, data1, &[1; 64]), Handshake::Nak);
    assert_eq!(core.setup(0, SETUP), Handshake::Ack);
    assert!(core.take_complaints().is_empty());
}

#[test]
fn an_address_is_valid_from_the_status_stage_on() {
    let mut core = ready();
    core.setup(0, [0, 5, 9, 0, 0, 0, 0, 0]);
    core.write(DCFG, 3 | 9 << 4);
    send(&mut core, 0, &[]);
    assert_eq!(core.in_token(9, 0), InResponse::Silence);
    assert!(matches!(
        core.in_token(0, 0),
        InResponse::Data { data1: true, .. }
    ));
    core.acknowledged(0, 0);
    assert_eq!(core.in_token(0, 0), InResponse::Silence);
    assert_eq!(core.in_token(9, 0), InResponse::Nak);
    // A reset of the bus leaves the register to the application.
    core.reset_begins();
    assert_eq!(core.setup(0, SETUP), Handshake::Silence);
    core.write(DCFG, 3);
    assert_eq!(core.setup(0, SETUP), Handshake::Ack);
}

#[test]
fn a_bus_reset_deactivates_endpoints_and_disables_none() {
    let mut core = ready();
    send(&mut core, 2, &[1, 2, 3, 4]);
    core.reset_begins();
    assert_eq!(
        core.read(GINTSTS) & (bit::USBRST | bit::ENUMDNE),
        bit::USBRST | bit::ENUMDNE
    );
    let control = core.read(ctl(DIEP, 2));
    assert_eq!(control & (bit::EPENA | bit::USBAEP), bit::EPENA);
    assert_eq!(core.read(DIEP + 0x40 + EP_FSTS), 15);
    assert_eq!(core.in_token(0, 2), InResponse::Silence);
    // EPDIS waits for NAK (57.15.6).
    core.write(ctl(DIEP, 2), 2 << 22 | bit::EPDIS);
    assert_eq!(
        core.read(ctl(DIEP, 2)) & (bit::EPENA | bit::EPDIS),
        bit::EPENA | bit::EPDIS
    );
    core.write(ctl(DIEP, 2), 2 << 22 | bit::SNAK);
    assert_eq!(core.read(ctl(DIEP, 2)) & (bit::EPENA | bit::EPDIS), 0);
    assert_ne!(core.read(DIEP + 0x40 + EP_INT) & bit::EPDISD, 0);
    // A flush of one FIFO, then of all.
    core.write(GRSTCTL, bit::TXFFLSH | 1 << 6);
    assert_eq!(core.read(DIEP + 0x40 + EP_FSTS), 15);
    core.write(GRSTCTL, bit::TXFFLSH | 0x10 << 6);
    assert_eq!(core.read(DIEP + 0x40 + EP_FSTS), 16);
}

#[test]
fn data_pids_change_by_packets_and_by_sd0pid_alone() {
    let mut core = ready();
    send(&mut core, 2, &[1]);
    core.in_token(0, 2);
    core.acknowledged(2, 1);
    let pid = |core: &mut Core| core.read(ctl(DIEP, 2)) & bit::DPID != 0;
    assert!(pid(&mut core));
    // Halted and released as CLEAR_FEATURE does: the PID stays unless SD0PID is written.
    core.write(ctl(DIEP, 2), bit::USBAEP | bit::STALL | 64);
    core.write(ctl(DIEP, 2), bit::USBAEP | 64);
    assert!(pid(&mut core));
    core.write(ctl(DIEP, 2), bit::USBAEP | 64 | bit::SD0PID);
    assert!(!pid(&mut core));
}

#[test]
fn suspend_and_resume_show_in_status_and_interrupts() {
    let mut core = ready();
    core.write(GINTSTS, u32::MAX);
    core.idle();
    assert_eq!(core.read(DSTS) & bit::SUSPSTS, bit::SUSPSTS);
    assert_eq!(
        core.read(GINTSTS) & (bit::ESUSP | bit::USBSUSP),
        bit::ESUSP | bit::USBSUSP
    );
    core.write(GINTSTS, bit::ESUSP | bit::USBSUSP);
    core.idle();
    assert_eq!(core.read(GINTSTS) & bit::USBSUSP, 0, "once");
    core.resume();
    assert_eq!(core.read(DSTS) & bit::SUSPSTS, 0);
    assert_eq!(core.read(GINTSTS) & bit::WKUPINT, bit::WKUPINT);
    core.frame(0x3FFF + 2);
    assert_eq!(core.read(DSTS) >> 8, 1);
}

#[test]
fn what_a_driver_must_not_do_is_reported() {
    let mut core = ready();
    core.write(ctl(DIEP, 2), bit::USBAEP | bit::CNAK | bit::SNAK);
    core.write(DIEP + 0x40 + EP_TSIZ, 1 << 19 | 8);
    core.write(FIFO + 2 * FIFO_SPACING, 0);
    core.read(GINTSTS);
    core.write(DIEP + 0x40 + EP_TSIZ, 0);
    core.write(GRSTCTL, bit::TXFFLSH | 0x10 << 6);
    core.out(0, 2, false, &[1, 2, 3]);
    core.read(GRXSTSP);
    core.read(GRXSTSP);
    core.read(FIFO);
    core.write(DIEPTXF + 8, 16 << 16 | 100);
    core.write(ctl(DIEP, 2), bit::USBAEP | 2 << 22 | bit::EPENA | bit::CNAK);
    for _ in 0..17 {
        core.write(FIFO + 2 * FIFO_SPACING, 0);
    }
    let said: Vec<String> = core
        .take_complaints()
        .into_iter()
        .map(|(_, what)| what)
        .collect();
    let words = [
        "CNAK and SNAK",
        "while a packet is written",
        "unread",
        "read beyond",
        "receive FIFO",
        "overflows",
    ];
    assert_eq!(said.len(), words.len(), "{said:?}");
    for (said, words) in said.iter().zip(words) {
        assert!(said.contains(words), "{said}");
    }
}
