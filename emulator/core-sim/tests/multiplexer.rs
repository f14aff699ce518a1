//! The driver of the converters behind another author's multiplexer driver, the crate `xca9548a`,
//! and behind ours, on the models of the chips: each converter is reached through its channel, and
//! what the driver hands out is settled in every variant of the converters.

use drivers::nau7802::{self, AdcCode, Config, Nau7802};
use drivers::tca9548::{self, ChannelMask, Tca9548};
use embedded_hal::delay::DelayNs;
use embedded_hal::digital;
use embedded_hal::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};
use emulator::board::Board;
use emulator::wiring::{self, UNITS};
use emulator_link::Injection;
use plant::{Plant, PlantConfig};
use std::cell::RefCell;
use std::convert::Infallible;
use xca9548a::{SlaveAddr, Xca9548a};

/// A byte with its acknowledge at 400 kHz, ns.
const BYTE_NS: u64 = 22_500;
/// What hangs on a cell, N.
const LOAD_N: f64 = 10.0;
/// Force of a code: 3 kg, 2 mV/V, gain 128, N.
const N_PER_CODE: f64 = 6.85e-6;
/// Five times the noise of a converter at 320 SPS (300 nV, 1.4 nV a code).
const NOISE_CODES: i32 = 1_100;

/// The board of the rig with a clock, and the DRDY lines as they stand.
struct Stand {
    board: Board,
    now_ns: u64,
    drdy: [bool; UNITS],
}

impl Stand {
    fn new(seed: u64, variant: &[Injection]) -> RefCell<Self> {
        let plant = Plant::new(PlantConfig::default(), seed).expect("a plant");
        let mut board = Board::new(plant, seed).expect("six units");
        for injection in variant {
            board.inject(*injection).expect("a variant");
        }
        RefCell::new(Self {
            board,
            now_ns: 0,
            drdy: [false; UNITS],
        })
    }

    fn pass(&mut self, ns: u64) {
        self.now_ns += ns;
        self.board.advance(self.now_ns);
        for (pin, level) in self.board.take_drives() {
            if let Some(unit) = wiring::DRDY.iter().position(|drdy| *drdy == pin) {
                self.drdy[unit] = level == Some(true);
            }
        }
    }

    fn until_ready(&mut self, unit: usize) {
        for _ in 0..10_000 {
            self.pass(10_000);
            if self.drdy[unit] {
                return;
            }
        }
        panic!("unit {} has no DRDY within 100 ms", unit + 1);
    }
}

/// The controller's bus and its waits.
struct Wires<'s>(&'s RefCell<Stand>);

impl ErrorType for Wires<'_> {
    type Error = ErrorKind;
}

impl I2c for Wires<'_> {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), ErrorKind> {
        let stand = &mut *self.0.borrow_mut();
        for operation in operations {
            let read = matches!(operation, Operation::Read(_));
            stand.board.i2c_begins(stand.now_ns, address);
            stand.pass(BYTE_NS);
            if !stand.board.i2c_start(stand.now_ns, address, read) {
                return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address));
            }
            match operation {
                Operation::Read(bytes) => {
                    for byte in bytes.iter_mut() {
                        stand.pass(BYTE_NS);
                        *byte = stand.board.i2c_read(stand.now_ns);
                    }
                }
                Operation::Write(bytes) => {
                    for byte in bytes.iter() {
                        stand.pass(BYTE_NS);
                        if !stand.board.i2c_write(stand.now_ns, *byte) {
                            stand.board.i2c_stop();
                            return Err(ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data));
                        }
                    }
                }
            }
        }
        stand.board.i2c_stop();
        stand.pass(2_500);
        Ok(())
    }
}

impl DelayNs for Wires<'_> {
    fn delay_ns(&mut self, ns: u32) {
        self.0.borrow_mut().pass(u64::from(ns));
    }
}

/// RESET of the multiplexer.
struct MuxReset<'s>(&'s RefCell<Stand>);

impl digital::ErrorType for MuxReset<'_> {
    type Error = Infallible;
}

impl digital::OutputPin for MuxReset<'_> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().board.mux_reset(true);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().board.mux_reset(false);
        Ok(())
    }
}

/// The code of the next result that the driver hands out.
fn code(adc: &mut Nau7802<impl I2c>, stand: &RefCell<Stand>, unit: usize) -> AdcCode {
    loop {
        stand.borrow_mut().until_ready(unit);
        if let Some(code) = adc.read().expect("it answers") {
            return code;
        }
    }
}

/// Brings a unit's converter up with a load on its cell; the first results that the driver hands
/// out.
fn first_codes(i2c: impl I2c, stand: &RefCell<Stand>, unit: usize, count: usize) -> Vec<i32> {
    let load = Injection::PullCable(unit as u8 + 1, LOAD_N);
    stand.borrow_mut().board.inject(load).expect("a unit");
    let mut adc = Nau7802::new(i2c, Config::FORCE_UNIT);
    adc.bring_up(&mut Wires(stand)).expect("it comes up");
    // A line that is high already shows a result from before.
    stand.borrow_mut().pass(0);
    let left_over = stand.borrow().drdy[unit];
    if left_over {
        adc.read_register(nau7802::Register::Adco)
            .expect("it answers");
    }
    let codes: Vec<i32> = (0..count)
        .map(|_| code(&mut adc, stand, unit).counts())
        .collect();
    let unload = Injection::PullCable(unit as u8 + 1, 0.0);
    stand.borrow_mut().board.inject(unload).expect("a unit");
    // The filter reaches over four conversions.
    let empty = (0..6).map(|_| code(&mut adc, stand, unit).counts()).last();
    let load = f64::from(codes[count - 1] - empty.unwrap_or(0)) * N_PER_CODE;
    assert!(
        (load.abs() / LOAD_N - 1.0).abs() < 0.1,
        "unit {}: {load} N",
        unit + 1
    );
    codes
}

fn settled(codes: &[i32], what: &str) {
    let last = codes[codes.len() - 1];
    // The last result that settles lacks 0.5 % of it.
    assert!(last.abs() > 600_000, "{what}: no load in {codes:?}");
    for code in codes {
        assert!((code - last).abs() < 2 * NOISE_CODES, "{what}: {codes:?}");
    }
}

/// The five variants that the datasheet lines at hand leave open, in all combinations.
fn variants() -> impl Iterator<Item = Vec<Injection>> {
    (0..32u8).map(|bits| {
        let on = |bit: u8| bits >> bit & 1 == 1;
        vec![
            Injection::FreeRun(on(0)),
            Injection::ReportUnsettled(on(1)),
            Injection::KeepReady(on(2)),
            Injection::LatchAtPointer(on(3)),
            Injection::StartSlowly(on(4)),
        ]
    })
}

#[test]
fn another_multiplexer_driver_reaches_every_converter() {
    let stand = Stand::new(31, &[]);
    let mux = Xca9548a::new(Wires(&stand), SlaveAddr::default());
    let parts = mux.split();
    let channels = [
        parts.i2c0, parts.i2c1, parts.i2c2, parts.i2c3, parts.i2c4, parts.i2c5,
    ];
    for (unit, channel) in channels.into_iter().enumerate() {
        let codes = first_codes(channel, &stand, unit, 4);
        settled(&codes, &format!("unit {}", unit + 1));
    }
    let complaints = stand.borrow().board.complaints();
    assert!(complaints.is_empty(), "{complaints:?}");
}

#[test]
fn the_first_results_are_settled_in_every_variant() {
    for variant in variants() {
        let stand = Stand::new(32, &variant);
        let mut mux = Xca9548a::new(Wires(&stand), SlaveAddr::default());
        mux.select_channels(0b100).expect("it answers");
        let codes = first_codes(mux, &stand, 2, 4);
        settled(&codes, &format!("{variant:?}"));
    }
}

/// Both drivers leave the same mask, and each reads the other's.
#[test]
fn our_multiplexer_driver_and_the_other_agree() {
    let stand = Stand::new(33, &[]);
    for channel in 0..8 {
        let mut other = Xca9548a::new(Wires(&stand), SlaveAddr::default());
        other.select_channels(1 << channel).expect("it answers");
        let reset = MuxReset(&stand);
        let mut ours = Tca9548::new(Wires(&stand), reset, tca9548::Address::DEFAULT);
        let mask = ChannelMask::from_bits(1 << channel);
        assert_eq!(ours.read_mask().expect("it answers"), mask);
        ours.select(mask).expect("it answers");
        assert_eq!(
            other.get_channel_status().expect("it answers"),
            1 << channel
        );
    }
}

/// A read after a repeated START gives the byte that was just written, before the STOP puts it in
/// force.
#[test]
fn a_mask_can_be_read_back_in_the_transaction_that_writes_it() {
    let stand = Stand::new(34, &[]);
    let mut wires = Wires(&stand);
    let mut mask = [0];
    wires
        .write_read(tca9548::Address::DEFAULT.get(), &[0b10], &mut mask)
        .expect("it answers");
    assert_eq!(mask, [0b10]);
}
