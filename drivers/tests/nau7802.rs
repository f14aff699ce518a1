//! The NAU7802 blocking driver against expected bus transactions, and its codes against oracles.

use drivers::nau7802::fast_read::{self, FastReadError, FastReader};
use drivers::nau7802::{
    proto, Adc, AdcCode, CalibrationMode, Cause, Channel, Coefficients, Config, Ctrl1, Ctrl2,
    Error, Gain, GainCoefficient, LdoVoltage, Nau7802, OffsetCoefficient, Operation, PuCtrl, Rate,
    Register, Revision, Stage,
};
use embedded_hal::i2c::{ErrorKind, NoAcknowledgeSource};
use embedded_hal_mock::eh1::delay::NoopDelay;
use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as PinTransaction};
use embedded_hal_mock::eh1::i2c::{Mock as I2c, Transaction};
use proptest::prelude::*;

const ADDRESS: u8 = 0x2A;
const NACK: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address);

fn driver(transactions: &[Transaction]) -> (Nau7802<I2c>, I2c) {
    let bus = I2c::new(transactions);
    (Nau7802::new(bus.clone(), Config::FORCE_UNIT), bus)
}

fn wr(bytes: &[u8]) -> Transaction {
    Transaction::write(ADDRESS, bytes.to_vec())
}

fn rd(register: u8, answer: &[u8]) -> Transaction {
    Transaction::write_read(ADDRESS, vec![register], answer.to_vec())
}

fn calibration() -> Vec<Transaction> {
    vec![
        wr(&[0x02, 0x74]),
        rd(0x02, &[0x74]),
        rd(0x02, &[0x70]),
        wr(&[0x00, 0xAE]),
        wr(&[0x00, 0xBE]),
    ]
}

fn configuration(ctrl1: u8, ctrl2: u8, revisions: &[u8]) -> Vec<Transaction> {
    let mut all = vec![
        wr(&[0x01, ctrl1]),
        wr(&[0x02, ctrl2]),
        wr(&[0x11, 0x00]),
        wr(&[0x1B, 0x00]),
        wr(&[0x1C, 0x80]),
        wr(&[0x15, 0x30]),
        wr(&[0x00, 0xAE]),
    ];
    all.extend(start(ctrl1, ctrl2, revisions));
    all
}

/// CS, and what a calibration finds set.
fn start(ctrl1: u8, ctrl2: u8, revisions: &[u8]) -> Vec<Transaction> {
    let mut all = vec![wr(&[0x00, 0xBE])];
    all.extend(revisions.iter().map(|revision| rd(0x1F, &[*revision])));
    all.extend([
        rd(0x00, &[0x9E]),
        rd(0x01, &[ctrl1]),
        rd(0x02, &[ctrl2]),
        rd(0x11, &[0x00]),
        rd(0x1B, &[0x00]),
        rd(0x1C, &[0x80]),
        rd(0x15, &[0x30]),
    ]);
    all
}

fn bring_up() -> Vec<Transaction> {
    let mut all = vec![
        wr(&[0x00, 0x01]),
        wr(&[0x00, 0x00]),
        wr(&[0x00, 0x02]),
        rd(0x00, &[0x02]), // not ready yet
        rd(0x00, &[0x0A]),
    ];
    all.extend(configuration(0x2F, 0x70, &[0x00, 0x0F])); // cold at first
    all.extend(calibration());
    all
}

#[test]
fn brings_up() {
    let (mut adc, mut bus) = driver(&bring_up());
    adc.bring_up(&mut NoopDelay::new()).unwrap();
    bus.done();
}

#[test]
fn brings_up_after_a_nack_in_the_middle() {
    let mut all = vec![wr(&[0x00, 0x01]), wr(&[0x00, 0x00]).with_error(NACK)];
    all.extend(bring_up());
    let (mut adc, mut bus) = driver(&all);
    adc.bring_up(&mut NoopDelay::new()).unwrap();
    bus.done();
}

#[test]
fn an_absent_part_is_a_sequence_error_with_the_bus_error_inside() {
    let all = vec![wr(&[0x00, 0x01]).with_error(NACK); 4];
    let (mut adc, mut bus) = driver(&all);
    let error = adc.bring_up(&mut NoopDelay::new()).unwrap_err();
    let Error::Sequence {
        error: inner,
        source,
    } = error
    else {
        panic!("{error}");
    };
    assert_eq!(
        (inner.stage, inner.cause, source),
        (Stage::ResetAssert, Cause::Bus, Some(NACK))
    );
    assert_eq!(error.detail(), 0x0101_0000);
    assert!(error.to_string().contains("PU_CTRL (0x00)"), "{error}");
    bus.done();
}

#[test]
fn a_recovered_bus_error_is_not_the_cause_of_a_later_failure() {
    let mut all = vec![
        wr(&[0x00, 0x01]).with_error(NACK),
        wr(&[0x00, 0x01]),
        wr(&[0x00, 0x00]),
        wr(&[0x00, 0x02]),
        rd(0x00, &[0x0A]),
    ];
    all.extend(configuration(0x2F, 0x70, &[0x02; 10]));
    all.truncate(all.len() - 7); // no setting is read back
    let (mut adc, mut bus) = driver(&all);
    let error = adc.bring_up(&mut NoopDelay::new()).unwrap_err();
    assert!(
        matches!(error, Error::Sequence { error, source: None } if error.cause == Cause::Revision(2)),
        "{error}"
    );
    bus.done();
}

#[test]
fn a_change_of_gain_or_rate_calibrates() {
    let mut all = configuration(0x2E, 0x70, &[0x0F]);
    all.extend(calibration());
    all.extend(configuration(0x2E, 0x30, &[0x0F]));
    all.extend([
        wr(&[0x02, 0x34]),
        rd(0x02, &[0x30]),
        wr(&[0x00, 0xAE]),
        wr(&[0x00, 0xBE]),
    ]);
    let (mut adc, mut bus) = driver(&all);
    adc.set_gain(Gain::X64, &mut NoopDelay::new()).unwrap();
    assert_eq!(adc.config().gain, Gain::X64);
    adc.set_rate(Rate::Sps80, &mut NoopDelay::new()).unwrap();
    assert_eq!(
        (adc.config().gain, adc.config().rate),
        (Gain::X64, Rate::Sps80)
    );
    bus.done();
}

#[test]
fn a_failed_change_keeps_the_old_settings_on_record() {
    let all = vec![wr(&[0x01, 0x2E]).with_error(NACK); 4];
    let (mut adc, mut bus) = driver(&all);
    adc.set_gain(Gain::X64, &mut NoopDelay::new()).unwrap_err();
    assert_eq!(adc.config().gain, Gain::X128);
    bus.done();
}

#[test]
fn a_calibration_that_keeps_failing_is_reported() {
    let mut all = start(0x2F, 0x70, &[0x0F]);
    for _ in 0..3 {
        all.extend([wr(&[0x02, 0x77]), rd(0x02, &[0x7B])]);
    }
    let (mut adc, mut bus) = driver(&all);
    let error = adc
        .calibrate(CalibrationMode::SystemGain, &mut NoopDelay::new())
        .unwrap_err();
    assert!(
        matches!(error, Error::Sequence { error, source: None } if error.cause == Cause::CalibrationError),
        "{error}"
    );
    bus.done();
}

#[test]
fn six_results_are_discarded_after_a_calibration_a_start_and_new_coefficients() {
    let results: Vec<Transaction> = (1..=7).map(|n| rd(0x12, &[0, 0, n])).collect();
    let mut all = start(0x2F, 0x70, &[0x0F]);
    all.extend(calibration());
    all.extend(results.clone());
    all.push(wr(&[0x00, 0xBE]));
    all.extend(results.clone());
    all.push(wr(&proto::write_coefficients(
        Channel::One,
        Coefficients::default(),
    )));
    all.extend(results);
    let (mut adc, mut bus) = driver(&all);
    let only_the_seventh = |adc: &mut Nau7802<I2c>| {
        let codes: Vec<_> = (0..7).map(|_| adc.read().unwrap()).collect();
        assert_eq!(codes[..6], [None; 6]);
        assert_eq!(codes[6].map(AdcCode::counts), Some(7));
    };
    adc.calibrate(CalibrationMode::InternalOffset, &mut NoopDelay::new())
        .unwrap();
    only_the_seventh(&mut adc);
    adc.start().unwrap();
    only_the_seventh(&mut adc);
    adc.set_coefficients(Channel::One, Coefficients::default())
        .unwrap();
    only_the_seventh(&mut adc);
    bus.done();
}

#[test]
fn reads_samples_with_their_sign() {
    let (mut adc, mut bus) = driver(&[
        rd(0x12, &[0x00, 0x00, 0x01]),
        rd(0x12, &[0xFF, 0xFF, 0xFF]),
        rd(0x12, &[0x80, 0x00, 0x00]),
        rd(0x12, &[0x7F, 0xFF, 0xFF]),
        rd(0x12, &[0, 0, 0]).with_error(NACK),
    ]);
    assert_eq!(adc.read().unwrap().unwrap().counts(), 1);
    assert_eq!(adc.read().unwrap().unwrap().counts(), -1);
    assert_eq!(adc.read().unwrap().unwrap(), AdcCode::MIN);
    let top = adc.read().unwrap().unwrap();
    assert_eq!(top, AdcCode::MAX);
    assert!(top.is_saturated());
    let error = adc.read().unwrap_err();
    assert_eq!(
        error,
        Error::Bus {
            register: Register::Adco,
            operation: Operation::Read,
            source: NACK
        }
    );
    assert_eq!(error.detail(), 0x0001_1200);
    assert!(
        error
            .to_string()
            .starts_with("NAU7802 read of ADCO (0x12): bus error"),
        "{error}"
    );
    bus.done();
}

#[test]
fn coefficients_travel_in_one_burst() {
    let value = Coefficients {
        offset: OffsetCoefficient::new(0x01_02_03).unwrap(),
        gain: GainCoefficient::from_bits(0x0080_0001),
    };
    let (mut adc, mut bus) = driver(&[
        rd(0x03, &[1, 2, 3, 0x00, 0x80, 0x00, 0x01]),
        wr(&[0x0A, 1, 2, 3, 0x00, 0x80, 0x00, 0x01]),
        wr(&[0x03, 1, 2, 3, 0x00, 0x80, 0x00, 0x01]).with_error(NACK),
    ]);
    assert_eq!(adc.coefficients(Channel::One).unwrap(), value);
    adc.set_coefficients(Channel::Two, value).unwrap();
    let error = adc.set_coefficients(Channel::One, value).unwrap_err();
    assert!(
        error.to_string().contains("write of OCAL1 (0x03)"),
        "{error}"
    );
    bus.done();
}

#[test]
fn starts_stops_and_powers_down() {
    let (mut adc, mut bus) = driver(&[
        wr(&[0x00, 0xBE]),
        wr(&[0x00, 0xAE]),
        wr(&[0x00, 0x00]),
        rd(0x00, &[0xBE]),
        rd(0x1F, &[0xAF]),
    ]);
    adc.start().unwrap();
    adc.stop().unwrap();
    adc.power_down().unwrap();
    let status = adc.status().unwrap();
    assert!(status.conversion_ready() && status.cycle_start() && status.power_up_ready());
    assert!(adc.revision().unwrap().is_expected());
    bus.done();
}

#[test]
fn register_types_match_the_datasheet() {
    assert_eq!(Config::FORCE_UNIT.pu_ctrl().bits(), 0xAE);
    assert_eq!(Adc::CHOPPER_OFF.bits(), 0x30);
    assert_eq!(
        PuCtrl::from_bits(0)
            .with_avdds(true)
            .with_avdds(false)
            .bits(),
        0
    );
    let ctrl1 = Ctrl1::from_bits(0xFF)
        .with_ldo(LdoVoltage::V3_3)
        .with_gain(Gain::X2);
    assert_eq!(ctrl1.bits(), 0xE1);
    assert_eq!((ctrl1.ldo(), ctrl1.gain()), (LdoVoltage::V3_3, Gain::X2));
    assert_eq!(LdoVoltage::V4_5.millivolts(), 4500);
    assert_eq!(LdoVoltage::V3_0.millivolts(), 3000);
    assert_eq!(Gain::X128.factor(), 128);
    for code in 0..8u8 {
        assert_eq!(LdoVoltage::from_bits(code) as u8, code);
        assert_eq!(Gain::from_bits(code) as u8, code);
        let rate = Ctrl2::from_bits(code << 4).rate();
        assert_eq!(
            rate.map(|rate| rate as u8),
            [0, 1, 2, 3, 7].contains(&code).then_some(code)
        );
    }
    assert_eq!(Ctrl2::from_bits(1).calibration_mode(), None);
    assert_eq!(
        Ctrl2::from_bits(3).calibration_mode(),
        Some(CalibrationMode::SystemGain)
    );
    assert_eq!(Revision::from_bits(0x5F).bits(), 0x0F);
    assert_eq!(Rate::Sps320.hertz(), 320);
    assert_eq!(GainCoefficient::UNITY.millionths(), 1_000_000);
    assert_eq!(
        GainCoefficient::from_bits(u32::MAX).millionths(),
        511_999_999
    );
    assert_eq!(OffsetCoefficient::new(0x0100_0000), None);
    assert_eq!(proto::READ_ADC, [0x12]);
    assert_eq!(proto::READ_ADC_CLOCKS, 54);
}

#[test]
fn fast_read_is_33_clocks() {
    use fast_read::Step;
    let all: Vec<Step> = fast_read::steps().collect();
    let clocks = all
        .iter()
        .filter(|step| !matches!(step, Step::Start | Step::Stop))
        .count();
    assert_eq!(clocks, 33);
    assert_eq!(fast_read::CLOCKS, 33);
    let address: String = all[1..9]
        .iter()
        .map(|step| if *step == Step::Drive(true) { '1' } else { '0' })
        .collect();
    assert_eq!(address, "01010101", "0x2A and the read bit");
    assert_eq!(
        (all[0], all[9], all[34]),
        (Step::Start, Step::SampleAck, Step::Stop)
    );
}

/// Expected transitions of SCL and SDA for a fast read that answers with `bits`, or with no
/// acknowledge.
fn fast_read_pins(data: Option<u32>) -> (Vec<PinTransaction>, Vec<PinTransaction>) {
    let set = PinTransaction::set;
    let get = PinTransaction::get;
    let (mut scl, mut sda) = (vec![set(State::Low)], vec![set(State::Low)]);
    let mut clock = || scl.extend([set(State::High), set(State::Low)]);
    for bit in [0, 1, 0, 1, 0, 1, 0, 1] {
        let level = if bit == 1 { State::High } else { State::Low };
        sda.extend([set(level), get(level)]);
        clock();
    }
    sda.extend([
        set(State::High),
        get(if data.is_some() {
            State::Low
        } else {
            State::High
        }),
    ]);
    clock();
    if let Some(data) = data {
        for bit in (0..24).rev() {
            sda.push(get(if data & (1 << bit) != 0 {
                State::High
            } else {
                State::Low
            }));
            clock();
        }
    }
    sda.extend([set(State::Low), set(State::High)]);
    scl.push(set(State::High));
    (scl, sda)
}

#[test]
fn fast_read_on_pins() {
    for (data, expected) in [
        (Some(0x80_0001), Ok(AdcCode::new(-8_388_607).unwrap())),
        (Some(0x12_3456), Ok(AdcCode::new(0x12_3456).unwrap())),
        (None, Err(FastReadError::NoAcknowledge)),
    ] {
        let (scl, sda) = fast_read_pins(data);
        let mut reader = FastReader::new(Pin::new(&scl), Pin::new(&sda), NoopDelay::new(), 1250);
        assert_eq!(reader.read(), expected);
        let (mut scl, mut sda, _) = reader.release();
        scl.done();
        sda.done();
    }
}

proptest! {
    /// Sign extension against arithmetic that doesn't shift.
    #[test]
    fn sign_extension(bytes in any::<[u8; 3]>()) {
        let unsigned = i64::from(bytes[0]) * 65_536 + i64::from(bytes[1]) * 256 + i64::from(bytes[2]);
        let oracle = if unsigned >= 8_388_608 { unsigned - 16_777_216 } else { unsigned };
        let code = proto::decode_adc(bytes);
        prop_assert_eq!(i64::from(code.counts()), oracle);
        prop_assert_eq!(code.to_be_bytes(), bytes);
        prop_assert_eq!(AdcCode::new(code.counts()), Some(code));
    }

    /// Only 24-bit values become codes.
    #[test]
    fn codes_hold_24_bits(counts in any::<i32>()) {
        let fits = (-8_388_608..=8_388_607).contains(&counts);
        prop_assert_eq!(AdcCode::new(counts).map(AdcCode::counts), fits.then_some(counts));
    }

    /// The scale against exact wide arithmetic, over every reference and gain.
    #[test]
    fn picovolts(counts in -8_388_608i32..=8_388_607, reference in any::<u16>(), gain in 0u8..8) {
        let gain = Gain::from_bits(gain);
        let exact = i128::from(counts) * i128::from(reference) * 1_000_000_000
            / (i128::from(gain.factor()) << 24);
        prop_assert_eq!(i128::from(AdcCode::new(counts).unwrap().picovolts(reference, gain)), exact);
    }

    /// Coefficients survive the trip through the registers.
    #[test]
    fn coefficients_round_trip(bytes in any::<[u8; 7]>()) {
        prop_assert_eq!(Coefficients::from_be_bytes(bytes).to_be_bytes(), bytes);
    }
}
