//! The bring-up sequence against a fake register file in virtual time, with a failure at each
//! stage.
//!
//! The fake is written from the datasheet's description, not from the driver, and keeps what a
//! caller can get wrong: RR is a level, PUR needs time, CALS ignores writes during a calibration,
//! CAL_ERR is sticky, and 0x15 reads back only while 0x1B bit 7 is 0.

use drivers::nau7802::bringup::limits;
use drivers::nau7802::{
    Action, Bringup, CalibrationMode, Cause, Channel, Config, DrdyPolarity, Event, Gain,
    LdoVoltage, Rate, Register, SequenceError, Stage,
};
use proptest::prelude::*;

const CALIBRATION_US: u64 = 344_000;

/// A converter on a bus, with scripted failures.
#[derive(Clone)]
struct Fake {
    now_us: u64,
    registers: [u8; 128],
    powered_at: Option<u64>,
    calibrating_until: Option<u64>,
    transactions: usize,
    calibrations: usize,
    cs_rises: usize,
    // Script.
    ready_after_us: u64,
    never_ready: bool,
    wrong_revisions: usize,
    revision: u8,
    failing_calibrations: usize,
    endless_calibration: bool,
    /// Bits that always read inverted, per register.
    corrupt: [u8; 128],
    /// Transactions that are not acknowledged, by index.
    nack: fn(usize) -> bool,
}

impl Fake {
    fn new() -> Self {
        Self {
            now_us: 0,
            registers: [0; 128],
            powered_at: None,
            calibrating_until: None,
            transactions: 0,
            calibrations: 0,
            cs_rises: 0,
            ready_after_us: 150,
            never_ready: false,
            wrong_revisions: 0,
            revision: 0x0F,
            failing_calibrations: 0,
            endless_calibration: false,
            corrupt: [0; 128],
            nack: |_| false,
        }
    }

    fn settle(&mut self) {
        if !self.endless_calibration && self.calibrating_until.is_some_and(|end| self.now_us >= end)
        {
            self.calibrating_until = None;
            self.registers[2] &= !0x0C;
            if self.failing_calibrations > 0 {
                self.failing_calibrations -= 1;
                self.registers[2] |= 0x08;
            }
        }
    }

    fn write(&mut self, address: u8, value: u8) {
        self.settle();
        let reset = self.registers[0] & 1 != 0;
        match address {
            0 => {
                if value & 1 != 0 {
                    self.registers = [0; 128];
                    self.powered_at = None;
                    self.calibrating_until = None;
                }
                if value & 0x10 != 0 && self.registers[0] & 0x10 == 0 {
                    self.cs_rises += 1;
                }
                if value & 2 != 0 && self.powered_at.is_none() {
                    self.powered_at = Some(self.now_us);
                }
                self.registers[0] = value & !0x28;
            }
            _ if reset => {}
            2 => {
                let busy = self.calibrating_until.is_some();
                // Gain, rate or channel that change under a calibration spoil it.
                if busy && (self.registers[2] ^ value) & !0x0C != 0 {
                    self.failing_calibrations += 1;
                }
                let kept = if busy { 0x0C } else { 0x08 };
                self.registers[2] = (self.registers[2] & kept) | (value & !kept);
                if value & 4 != 0 && !busy {
                    assert_ne!(self.registers[0] & 0x10, 0, "calibration with CS = 0");
                    self.calibrations += 1;
                    self.calibrating_until = Some(self.now_us + CALIBRATION_US);
                }
            }
            0x12..=0x14 | 0x1F => {}
            _ => self.registers[usize::from(address)] = value,
        }
    }

    fn read(&mut self, address: u8) -> u8 {
        self.settle();
        let value = match address {
            0 => {
                let ready = !self.never_ready
                    && self
                        .powered_at
                        .is_some_and(|at| self.now_us >= at + self.ready_after_us);
                self.registers[0] | if ready { 0x08 } else { 0 }
            }
            0x15 if self.registers[0x1B] & 0x80 != 0 => 0xEE,
            0x1F if self.wrong_revisions > 0 => {
                self.wrong_revisions -= 1;
                0x50
            }
            0x1F => 0xA0 | self.revision,
            _ => self.registers[usize::from(address)],
        };
        value ^ self.corrupt[usize::from(address)]
    }

    /// Performs one action in virtual time; a transaction takes 100 us.
    fn perform(&mut self, action: Action) -> Event {
        match action {
            Action::WaitUs(us) => {
                self.now_us += u64::from(us);
                Event::Waited
            }
            Action::Write(_) | Action::WriteRead(_) => {
                let index = self.transactions;
                self.transactions += 1;
                self.now_us += 100;
                if (self.nack)(index) {
                    return Event::BusFault;
                }
                match action {
                    Action::Write([address, value]) => {
                        self.write(address, value);
                        Event::Written
                    }
                    Action::WriteRead([address]) => Event::Read(self.read(address)),
                    _ => unreachable!(),
                }
            }
            Action::Done | Action::Failed(_) => panic!("nothing to perform"),
        }
    }

    fn run(&mut self, mut sequence: Bringup) -> Result<(), SequenceError> {
        let mut event = Event::Start;
        for _ in 0..10_000 {
            match sequence.next(event) {
                Action::Done => return Ok(()),
                Action::Failed(error) => return Err(error),
                action => event = self.perform(action),
            }
        }
        panic!("the sequence doesn't end");
    }
}

fn bring_up(fake: &mut Fake) -> Result<(), SequenceError> {
    fake.run(Bringup::new(Config::FORCE_UNIT))
}

#[test]
fn the_whole_sequence_in_order() {
    let mut fake = Fake::new();
    let mut sequence = Bringup::new(Config::FORCE_UNIT);
    let mut event = Event::Start;
    let mut trace = Vec::new();
    loop {
        let action = sequence.next(event);
        trace.push(action);
        if action == Action::Done {
            break;
        }
        event = fake.perform(action);
    }
    use Action::{Done, WaitUs, Write, WriteRead};
    assert_eq!(
        trace,
        [
            Write([0x00, 0x01]),
            Write([0x00, 0x00]),
            Write([0x00, 0x02]),
            WaitUs(200),
            WriteRead([0x00]),
            Write([0x01, 0x2F]), // 3.0 V, gain 128, DRDY active high
            Write([0x02, 0x70]), // 320 SPS
            Write([0x11, 0x00]),
            Write([0x1B, 0x00]),
            Write([0x1C, 0x80]),
            Write([0x15, 0x30]),
            Write([0x00, 0xAE]),
            Write([0x00, 0xBE]),
            WaitUs(250_000),
            WriteRead([0x1F]),
            WriteRead([0x00]),
            WriteRead([0x01]),
            WriteRead([0x02]),
            WriteRead([0x11]),
            WriteRead([0x1B]),
            WriteRead([0x1C]),
            WriteRead([0x15]),
            Write([0x02, 0x74]),
            WaitUs(340_000),
            WriteRead([0x02]),
            WaitUs(4_000),
            WriteRead([0x02]),
            Write([0x00, 0xAE]),
            Write([0x00, 0xBE]),
            Done,
        ]
    );
    assert!(sequence.is_over());
    assert_eq!(sequence.stage(), Stage::Finished);
    // Whatever comes later, it stays done.
    assert_eq!(sequence.next(Event::BusFault), Done);
    assert_eq!(fake.cs_rises, 2);
}

#[test]
fn every_calibration_mode_has_its_code() {
    for (mode, code) in [
        (CalibrationMode::InternalOffset, 0x74),
        (CalibrationMode::SystemOffset, 0x76),
        (CalibrationMode::SystemGain, 0x77),
    ] {
        let mut fake = Fake::new();
        bring_up(&mut fake).unwrap();
        let mut sequence = Bringup::calibrate(Config::FORCE_UNIT, mode);
        assert_eq!(sequence.next(Event::Start), Action::Write([0x00, 0xBE]));
        fake.run(Bringup::calibrate(Config::FORCE_UNIT, mode))
            .unwrap();
        assert_eq!(fake.calibrations, 2);
        assert_eq!(fake.registers[2], code & !0x04, "rate and mode survive");
    }
}

#[test]
fn settings_reach_the_registers() {
    let config = Config {
        ldo: None,
        gain: Gain::X4,
        rate: Rate::Sps40,
        channel: Channel::Two,
        drdy: DrdyPolarity::ActiveLow,
        pga_capacitor: false,
        ldo_stable: true,
        fast_read: true,
        calibration: CalibrationMode::SystemOffset,
        supply_settle_us: 7,
    };
    let mut fake = Fake::new();
    bring_up(&mut fake).unwrap();
    fake.run(Bringup::reconfigure(config)).unwrap();
    assert_eq!(fake.registers[0x00], 0x16, "no LDO, powered, converting");
    assert_eq!(fake.registers[0x01], 0x82);
    assert_eq!(fake.registers[0x02], 0xA2);
    assert_eq!(fake.registers[0x11], 0x40);
    assert_eq!(fake.registers[0x15], 0xB0);
    assert_eq!(fake.registers[0x1B], 0x40);
    assert_eq!(fake.registers[0x1C], 0x00);
    assert_eq!(
        fake.calibrations, 2,
        "a change of settings calibrates again"
    );
}

#[test]
fn power_up_timeout() {
    let mut fake = Fake::new();
    fake.never_ready = true;
    let error = bring_up(&mut fake).unwrap_err();
    assert_eq!(error.stage, Stage::PowerUpReady);
    assert_eq!(error.register, Register::PuCtrl);
    assert_eq!(error.cause, Cause::PowerUpTimeout);
    assert_eq!(error.detail(), 0x0402_0000);
    assert!(
        (50_000..200_000).contains(&fake.now_us),
        "{} us",
        fake.now_us
    );
}

#[test]
fn a_cold_part_may_need_several_looks_at_its_revision() {
    for wrong in 0..usize::from(limits::REVISION_TRIES) {
        let mut fake = Fake::new();
        fake.wrong_revisions = wrong;
        assert_eq!(bring_up(&mut fake), Ok(()), "{wrong} wrong answers");
    }
    let mut fake = Fake::new();
    fake.wrong_revisions = usize::from(limits::REVISION_TRIES);
    assert!(bring_up(&mut fake).is_err());
    assert_eq!(fake.wrong_revisions, 0, "exactly as many looks as stated");
}

#[test]
fn each_stage_has_its_own_number_of_looks() {
    let mut fake = Fake::new();
    fake.ready_after_us = 50_000;
    fake.wrong_revisions = usize::from(limits::REVISION_TRIES) - 1;
    assert_eq!(bring_up(&mut fake), Ok(()));
}

#[test]
fn another_part_is_named() {
    let mut fake = Fake::new();
    fake.revision = 0x03;
    let error = bring_up(&mut fake).unwrap_err();
    assert_eq!(error.stage, Stage::RevisionCheck);
    assert_eq!(error.cause, Cause::Revision(0x03));
    assert_eq!(error.detail(), 0x0503_1F03);
    assert_eq!(
        error.to_string(),
        "NAU7802 stage 5 (check the revision), register REVISION (0x1F): revision 0x3 where 0xF was expected; is it a NAU7802?"
    );
}

#[test]
fn every_written_register_is_verified() {
    for (register, bit, stage) in [
        (Register::PuCtrl, 0x80, Stage::VerifyPuCtrl),
        (Register::Ctrl1, 0x01, Stage::VerifyCtrl1),
        (Register::Ctrl2, 0x10, Stage::VerifyCtrl2),
        (Register::I2cCtrl, 0x02, Stage::VerifyI2cCtrl),
        (Register::Pga, 0x80, Stage::VerifyPga),
        (Register::Power, 0x80, Stage::VerifyPower),
        (Register::Adc, 0x20, Stage::VerifyAdc),
    ] {
        let mut fake = Fake::new();
        fake.corrupt[usize::from(register.address())] = bit;
        let error = bring_up(&mut fake).unwrap_err();
        assert_eq!((error.stage, error.register), (stage, register));
        let Cause::ReadBack { expected, found } = error.cause else {
            panic!("{register}: {:?}", error.cause);
        };
        assert_eq!((expected ^ found) & bit, bit, "{register}");
        assert_eq!(
            fake.calibrations, 0,
            "nothing is calibrated on wrong settings"
        );
    }
}

#[test]
fn calibration_errors_are_retried_a_bounded_number_of_times() {
    let tries = usize::from(limits::CALIBRATION_TRIES);
    for failing in 0..tries {
        let mut fake = Fake::new();
        fake.failing_calibrations = failing;
        assert_eq!(bring_up(&mut fake), Ok(()));
        assert_eq!(fake.calibrations, failing + 1);
    }
    let mut fake = Fake::new();
    fake.failing_calibrations = tries;
    let error = bring_up(&mut fake).unwrap_err();
    assert_eq!(
        (error.stage, error.cause),
        (Stage::CalibrationWait, Cause::CalibrationError)
    );
    assert_eq!(error.detail(), 0x1706_0200);
    assert_eq!(fake.calibrations, tries);
}

#[test]
fn a_restart_gives_the_calibration_all_its_tries_again() {
    let tries = usize::from(limits::CALIBRATION_TRIES);
    let mut fake = Fake::new();
    fake.failing_calibrations = 2 * (tries - 1);
    let mut sequence = Bringup::new(Config::FORCE_UNIT);
    let mut event = Event::Start;
    let mut disturbed = false;
    loop {
        match sequence.next(event) {
            Action::Done => break,
            Action::Failed(error) => panic!("{error}"),
            // The last try of the first round is lost on the bus.
            Action::Write([0x02, 0x74]) if fake.calibrations == tries - 1 && !disturbed => {
                disturbed = true;
                event = Event::BusFault;
            }
            action => event = fake.perform(action),
        }
    }
    assert!(disturbed);
    assert_eq!(fake.calibrations, 2 * (tries - 1) + 1);
}

#[test]
fn calibration_timeout() {
    let mut fake = Fake::new();
    fake.endless_calibration = true;
    let error = bring_up(&mut fake).unwrap_err();
    assert_eq!(
        (error.stage, error.cause),
        (Stage::CalibrationWait, Cause::CalibrationTimeout)
    );
    assert!(
        fake.now_us > 3 * CALIBRATION_US,
        "gives it three times the usual"
    );
    assert!(fake.now_us < 6 * CALIBRATION_US);
}

#[test]
fn an_unplugged_part_is_reported_quickly() {
    let mut fake = Fake::new();
    fake.nack = |_| true;
    let error = bring_up(&mut fake).unwrap_err();
    assert_eq!((error.stage, error.cause), (Stage::ResetAssert, Cause::Bus));
    assert_eq!(fake.transactions, 1 + usize::from(limits::BUS_RESTARTS));
    assert!(fake.now_us < 10_000);
}

/// Transactions of an undisturbed bring-up, counted by the fake.
fn transactions() -> usize {
    let mut fake = Fake::new();
    bring_up(&mut fake).unwrap();
    fake.transactions
}

#[test]
fn one_lost_transaction_anywhere_starts_over_and_succeeds() {
    // `nack` is a plain function, so the index travels in a thread-local.
    thread_local!(static LOST: std::cell::Cell<usize> = const { std::cell::Cell::new(0) });
    let all = transactions();
    for lost in 0..all {
        LOST.set(lost);
        let mut fake = Fake::new();
        fake.nack = |index| index == LOST.get();
        assert_eq!(bring_up(&mut fake), Ok(()), "transaction {lost} lost");
        // The calibration under way may end earlier or later relative to the looks at it.
        assert!(fake.transactions > lost + 20, "started over from the reset");
        assert_eq!(fake.registers[0x1C], 0x80);
    }
}

#[test]
fn a_part_that_fails_is_reported_with_the_stage_of_the_failure() {
    thread_local!(static DEAD_FROM: std::cell::Cell<usize> = const { std::cell::Cell::new(0) });
    let mut fake = Fake::new();
    DEAD_FROM.set(12);
    fake.nack = |index| index >= DEAD_FROM.get();
    let error = bring_up(&mut fake).unwrap_err();
    // After the first loss every restart fails at once, at the reset.
    assert_eq!((error.stage, error.cause), (Stage::ResetAssert, Cause::Bus));

    // A part whose configuration phase is always disturbed reports that stage.
    struct Disturbed(Fake);
    let mut disturbed = Disturbed(Fake::new());
    let mut sequence = Bringup::new(Config::FORCE_UNIT);
    let mut event = Event::Start;
    let error = loop {
        match sequence.next(event) {
            Action::Failed(error) => break error,
            Action::Write([0x1C, _]) => event = Event::BusFault,
            action => event = disturbed.0.perform(action),
        }
    };
    assert_eq!(
        (error.stage, error.register, error.cause),
        (Stage::WritePower, Register::Power, Cause::Bus)
    );
}

#[test]
fn six_calibrations_overlap() {
    let mut alone = Fake::new();
    bring_up(&mut alone).unwrap();

    // One bus: transactions take turns, waits run side by side.
    let mut parts: Vec<(Fake, Bringup, Option<Event>, u64)> = (0..6)
        .map(|_| {
            (
                Fake::new(),
                Bringup::new(Config::FORCE_UNIT),
                Some(Event::Start),
                0,
            )
        })
        .collect();
    let mut now = 0;
    while parts.iter().any(|(_, sequence, ..)| !sequence.is_over()) {
        let mut busy = false;
        for (fake, sequence, event, ready_at) in &mut parts {
            if sequence.is_over() || now < *ready_at {
                continue;
            }
            let Some(last) = event.take() else { continue };
            match sequence.next(last) {
                Action::Done => {}
                Action::Failed(error) => panic!("{error}"),
                Action::WaitUs(us) => {
                    *ready_at = now + u64::from(us);
                    *event = Some(Event::Waited);
                }
                action => {
                    fake.now_us = now;
                    *event = Some(fake.perform(action));
                    now += 100;
                    busy = true;
                }
            }
        }
        if !busy {
            now += 50;
        }
    }
    assert!(
        now * 10 < alone.now_us * 12,
        "six took {now} us, one {} us",
        alone.now_us
    );
}

#[test]
fn wrong_events_are_the_callers_error() {
    for event in [
        Event::Written,
        Event::Read(0),
        Event::Waited,
        Event::BusFault,
    ] {
        let mut sequence = Bringup::new(Config::FORCE_UNIT);
        let Action::Failed(error) = sequence.next(event) else {
            panic!("{event:?} accepted before the start");
        };
        assert_eq!(error.cause, Cause::UnexpectedEvent);
    }
    for event in [Event::Start, Event::Read(0), Event::Waited] {
        let mut sequence = Bringup::new(Config::FORCE_UNIT);
        let _ = sequence.next(Event::Start);
        assert!(
            matches!(sequence.next(event), Action::Failed(_)),
            "{event:?} accepted after a write"
        );
    }
}

#[test]
fn stages_are_found_by_their_number() {
    for stage in Stage::ALL {
        assert_eq!(Stage::from_number(stage as u8), Some(stage));
    }
    assert_eq!(Stage::from_number(0), None);
    assert_eq!(Stage::from_number(Stage::ALL.len() as u8 + 1), None);
    let descriptions: std::collections::HashSet<_> =
        Stage::ALL.iter().map(|stage| stage.description()).collect();
    assert_eq!(
        descriptions.len(),
        Stage::ALL.len(),
        "no two stages read alike"
    );
}

#[test]
fn config_scale() {
    assert_eq!(Config::FORCE_UNIT.full_scale_nv(0), 11_718_750);
    let external = Config {
        ldo: None,
        gain: Gain::X1,
        ..Config::FORCE_UNIT
    };
    assert_eq!(external.full_scale_nv(5000), 2_500_000_000);
    assert_eq!(LdoVoltage::V2_4.millivolts(), 2400);
}

fn any_event() -> impl Strategy<Value = Event> {
    prop_oneof![
        2 => Just(Event::Written),
        4 => any::<u8>().prop_map(Event::Read),
        2 => Just(Event::Waited),
        1 => Just(Event::BusFault),
    ]
}

/// Answers the action in the right form, with arbitrary content.
fn matching(action: Action, event: Event) -> Event {
    match (action, event) {
        (Action::Write(_) | Action::WriteRead(_), Event::BusFault) => Event::BusFault,
        (Action::Write(_), _) => Event::Written,
        (Action::WriteRead(_), Event::Read(byte)) => Event::Read(byte),
        (Action::WriteRead(_), _) => Event::Read(0xFF),
        _ => Event::Waited,
    }
}

proptest! {
    /// Whatever a noisy bus answers, the sequence ends, and within the bounds that the limits
    /// imply.
    #[test]
    fn ends_on_any_answers(answers in prop::collection::vec(any_event(), 1..200)) {
        let mut sequence = Bringup::new(Config::FORCE_UNIT);
        let mut action = sequence.next(Event::Start);
        let mut steps = 0u32;
        for answer in answers.iter().cycle() {
            if sequence.is_over() {
                break;
            }
            action = sequence.next(matching(action, *answer));
            steps += 1;
            prop_assert!(steps < 10_000, "doesn't end");
        }
        prop_assert!(matches!(action, Action::Done | Action::Failed(_)));
    }

    /// Any event at any time is answered without a panic.
    #[test]
    fn survives_any_events(events in prop::collection::vec(any_event(), 0..60)) {
        let mut sequence = Bringup::new(Config::FORCE_UNIT);
        let _ = sequence.next(Event::Start);
        for event in events {
            let _ = sequence.next(event);
        }
    }
}
