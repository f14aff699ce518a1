//! The LS7266R1 driver against a model of the part, its pin-level bus, and the 64-bit position.

use drivers::ls7266r1::proto::{self, BusOp};
use drivers::ls7266r1::{
    Axis, Cmr, Config, CounterValue, Direction, Error, Flags, GpioBus, GpioBusError, Idr, Ior,
    Ls7266r1, OpenDrainPort, ParallelBus, Port, PositionTracker, QuadratureMode, Rld, Stage,
    Target,
};
use embedded_hal_mock::eh1::delay::NoopDelay;
use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction};
use proptest::prelude::*;

/// One axis as the datasheet describes it.
#[derive(Clone, Copy, Default)]
struct AxisModel {
    preset: [u8; 3],
    latch: [u8; 3],
    pointer: usize,
    counter: u32,
    prescaler: u8,
    mode: u8,
    io: u8,
    index: u8,
    flags: u8,
}

impl AxisModel {
    fn control(&mut self, byte: u8) {
        let value = byte & 0x1F;
        match byte >> 5 & 3 {
            0 => {
                if value & 1 != 0 {
                    self.pointer = 0;
                }
                match value >> 1 & 3 {
                    1 => self.counter = 0,
                    2 => self.flags &= !0x0F,
                    3 => self.flags &= !0x10,
                    _ => {}
                }
                match value >> 3 & 3 {
                    1 => {
                        self.counter =
                            u32::from_le_bytes([self.preset[0], self.preset[1], self.preset[2], 0])
                    }
                    2 => self.latch.copy_from_slice(&self.counter.to_le_bytes()[..3]),
                    3 => self.prescaler = self.preset[0],
                    _ => {}
                }
            }
            1 => self.mode = value,
            2 => self.io = value,
            _ => self.index = value,
        }
    }

    /// A move of the encoder, counted only with the inputs on.
    fn turn(&mut self, counts: i32) {
        if self.io & 1 != 0 {
            self.counter = self.counter.wrapping_add_signed(counts) & 0xFF_FFFF;
        }
    }
}

#[derive(Debug, PartialEq, Eq)]
struct Stuck;

/// Three chips on one bus, with faults.
#[derive(Default)]
struct Model {
    chips: [[AxisModel; 2]; 3],
    /// Data lines that always read 1.
    stuck_high: u8,
    /// Cycles until the bus fails.
    fails_at: Option<usize>,
    cycles: usize,
}

impl Model {
    fn cycle(&mut self) -> Result<(), Stuck> {
        self.cycles += 1;
        if self.fails_at == Some(self.cycles - 1) {
            return Err(Stuck);
        }
        Ok(())
    }
}

impl ParallelBus for Model {
    type Error = Stuck;

    fn write(&mut self, target: Target, port: Port, byte: u8) -> Result<(), Stuck> {
        self.cycle()?;
        let chip = &mut self.chips[usize::from(target.chip)];
        match port {
            Port::Control if byte & 0x80 != 0 => {
                chip.iter_mut().for_each(|axis| axis.control(byte))
            }
            Port::Control => chip[target.axis as usize].control(byte),
            Port::Data => {
                let axis = &mut chip[target.axis as usize];
                axis.preset[axis.pointer % 3] = byte;
                axis.pointer += 1;
            }
        }
        Ok(())
    }

    fn read(&mut self, target: Target, port: Port) -> Result<u8, Stuck> {
        self.cycle()?;
        let axis = &mut self.chips[usize::from(target.chip)][target.axis as usize];
        let byte = match port {
            Port::Control => axis.flags,
            Port::Data => {
                axis.pointer += 1;
                axis.latch[(axis.pointer - 1) % 3]
            }
        };
        Ok(byte | self.stuck_high)
    }
}

const ALL: [Target; 6] = {
    const fn target(chip: u8, axis: Axis) -> Target {
        Target { chip, axis }
    }
    [
        target(0, Axis::X),
        target(0, Axis::Y),
        target(1, Axis::X),
        target(1, Axis::Y),
        target(2, Axis::X),
        target(2, Axis::Y),
    ]
};

fn value(count: u32) -> CounterValue {
    CounterValue::new(count).unwrap()
}

#[test]
fn six_axes_come_up_independently() {
    let mut model = Model::default();
    // Left over from before: a byte pointer in the middle, and flags.
    for chip in &mut model.chips {
        for axis in chip {
            axis.pointer = 1;
            axis.flags = 0x1F;
            axis.counter = 77;
        }
    }
    let mut counters = Ls7266r1::new(&mut model);
    let config = Config {
        prescaler: 3,
        ..Config::MOTOR_ENCODER
    };
    for target in ALL {
        counters.init(target, config).unwrap();
        assert_eq!(counters.read(target).unwrap(), CounterValue::ZERO);
        assert_eq!(counters.flags(target).unwrap(), Flags::default());
    }
    for chip in &model.chips {
        for axis in chip {
            assert_eq!(
                (axis.mode, axis.io, axis.index, axis.prescaler),
                (0x18, 0x01, 0x00, 3)
            );
        }
    }
}

#[test]
fn reads_follow_the_right_axis() {
    let mut model = Model::default();
    for target in ALL {
        Ls7266r1::new(&mut model)
            .init(target, Config::MOTOR_ENCODER)
            .unwrap();
    }
    for (number, target) in ALL.iter().enumerate() {
        model.chips[usize::from(target.chip)][target.axis as usize].turn(-1 - number as i32);
    }
    let mut counters = Ls7266r1::new(&mut model);
    for (number, target) in ALL.iter().enumerate() {
        assert_eq!(
            counters.read(*target).unwrap(),
            value(0xFF_FFFF - number as u32)
        );
    }
    for chip in 0..3 {
        let first = 0xFF_FFFF - 2 * u32::from(chip);
        assert_eq!(
            counters.read_both(chip).unwrap(),
            (value(first), value(first - 1))
        );
    }
}

#[test]
fn a_read_of_both_latches_at_one_instant() {
    let mut writes = 0;
    for op in proto::READ_BOTH_COUNTERS {
        if let BusOp::WriteControl(_, byte) = op {
            writes += 1;
            assert_eq!(byte, 0x91);
        }
    }
    assert_eq!(writes, 1);
}

#[test]
fn loads_and_flags() {
    let mut model = Model::default();
    model.chips[1][1].flags = 0x75;
    let mut counters = Ls7266r1::new(&mut model);
    let target = ALL[3];
    counters.load(target, value(0x12_3456)).unwrap();
    assert_eq!(counters.read(target).unwrap(), value(0x12_3456));
    let flags = counters.flags(target).unwrap();
    assert!(
        flags.borrow_toggle() && !flags.carry_toggle() && flags.compare_toggle() && !flags.sign()
    );
    assert!(flags.noise() && flags.counting_up() && flags.index());
    counters.clear_noise_flag(target).unwrap();
    assert_eq!(counters.flags(target).unwrap().bits(), 0x65);
}

#[test]
fn a_stuck_data_line_is_found_and_named() {
    for line in 0..8u8 {
        let mut model = Model {
            stuck_high: 1 << line,
            ..Model::default()
        };
        let error = Ls7266r1::new(&mut model)
            .init(ALL[4], Config::MOTOR_ENCODER)
            .unwrap_err();
        assert!(
            matches!(error, Error::SelfTest { target, .. } if target == ALL[4]),
            "{error}"
        );
        assert_eq!(error.detail(), 0x0202_0000 | (1 << line));
        assert_eq!(model.chips[2][0].io & 1, 0, "inputs stay off");
    }
}

#[test]
fn an_absent_chip_is_found() {
    struct Absent;
    impl ParallelBus for Absent {
        type Error = Stuck;
        fn write(&mut self, _: Target, _: Port, _: u8) -> Result<(), Stuck> {
            Ok(())
        }
        fn read(&mut self, _: Target, _: Port) -> Result<u8, Stuck> {
            Ok(0xFF)
        }
    }
    let error = Ls7266r1::new(Absent)
        .init(ALL[0], Config::MOTOR_ENCODER)
        .unwrap_err();
    assert!(
        error.to_string().contains("wrote 0xC35AA5, read 0xFFFFFF"),
        "{error}"
    );
}

#[test]
fn every_bus_failure_carries_its_stage() {
    let mut stages = Vec::new();
    for cycle in 0.. {
        let mut model = Model {
            fails_at: Some(cycle),
            ..Model::default()
        };
        match Ls7266r1::new(&mut model).init(ALL[5], Config::MOTOR_ENCODER) {
            Ok(()) => break,
            Err(Error::Bus {
                target,
                stage,
                source,
            }) => {
                assert_eq!((target, source), (ALL[5], Stuck));
                stages.push(stage);
            }
            Err(error) => panic!("{error}"),
        }
    }
    let count = |stage_of| stages.iter().filter(|stage| **stage == stage_of).count();
    assert_eq!(count(Stage::Configure), 6);
    assert_eq!(count(Stage::SelfTest), 2 * (5 + 4));
    assert_eq!(count(Stage::Start), 4);
    let error: Error<Stuck> = Error::Bus {
        target: ALL[5],
        stage: Stage::ReadCounter,
        source: Stuck,
    };
    assert_eq!(error.detail(), 0x0402_0100);
    assert!(error.to_string().contains("chip 2 axis Y, OL"), "{error}");
}

#[test]
fn control_bytes_match_the_datasheet() {
    assert_eq!(Rld::LATCH_FOR_READ.control_byte(), 0x11);
    assert_eq!(Rld::LATCH_FOR_READ.on_both_axes().control_byte(), 0x91);
    assert_eq!(Cmr::free_running(QuadratureMode::X4).control_byte(), 0x38);
    assert_eq!(
        Cmr::free_running(QuadratureMode::NonQuadrature).control_byte(),
        0x20
    );
    assert_eq!(Ior::INPUTS_ON.control_byte(), 0x41);
    assert_eq!(Ior::INPUTS_OFF.control_byte(), 0x40);
    assert_eq!(Idr::DISABLED.control_byte(), 0x60);
    assert_eq!(Flags::from_bits(0xFF).bits(), 0x7F);
    assert_eq!(CounterValue::new(1 << 24), None);
}

/// Lines of a GPIO bus with what is expected of each: data byte driven or answered, D0 first.
fn gpio(
    data: [Vec<Transaction>; 8],
    control: State,
    axis: State,
    read: bool,
) -> GpioBus<OpenDrainPort<Pin>, Pin, 2, NoopDelay> {
    let set = Transaction::set;
    let strobe = vec![set(State::Low), set(State::High)];
    let idle = vec![set(State::High)];
    GpioBus {
        data: OpenDrainPort(data.map(|expected| Pin::new(&expected))),
        control: Pin::new(&[set(control)]),
        axis: Pin::new(&[set(axis)]),
        read: Pin::new(if read { &strobe } else { &idle }),
        // A write strobe rises before the data lines are released, and idle is asserted once more.
        write: if read {
            Pin::new(&idle)
        } else {
            Pin::new(&[set(State::Low), set(State::High), set(State::High)])
        },
        chips: [Pin::new(&[]), Pin::new(&strobe)],
        delay: NoopDelay::new(),
    }
}

fn done(mut bus: GpioBus<OpenDrainPort<Pin>, Pin, 2, NoopDelay>) {
    bus.data.0.iter_mut().for_each(Pin::done);
    bus.chips.iter_mut().for_each(Pin::done);
    for pin in [
        &mut bus.control,
        &mut bus.axis,
        &mut bus.read,
        &mut bus.write,
    ] {
        pin.done();
    }
}

fn level(byte: u8, bit: usize) -> State {
    if byte & (1 << bit) != 0 {
        State::High
    } else {
        State::Low
    }
}

#[test]
fn gpio_cycles() {
    let target = Target {
        chip: 1,
        axis: Axis::Y,
    };
    let driven = core::array::from_fn(|bit| {
        vec![
            Transaction::set(level(0x91, bit)),
            Transaction::set(State::High),
        ]
    });
    let mut bus = gpio(driven, State::High, State::High, false);
    bus.write(target, Port::Control, 0x91).unwrap();
    done(bus);

    let answered = core::array::from_fn(|bit| {
        vec![
            Transaction::set(State::High),
            Transaction::get(level(0x5C, bit)),
            Transaction::set(State::High),
        ]
    });
    let mut bus = gpio(answered, State::Low, State::Low, true);
    let read = bus
        .read(
            Target {
                chip: 1,
                axis: Axis::X,
            },
            Port::Data,
        )
        .unwrap();
    assert_eq!(read, 0x5C);
    done(bus);
}

#[test]
fn gpio_without_that_chip() {
    let none = || Pin::new(&[]);
    let mut bus: GpioBus<_, _, 2, _> = GpioBus {
        data: OpenDrainPort(core::array::from_fn(|_| none())),
        control: none(),
        axis: none(),
        read: none(),
        write: none(),
        chips: [none(), none()],
        delay: NoopDelay::new(),
    };
    let target = Target {
        chip: 2,
        axis: Axis::X,
    };
    assert_eq!(
        bus.read(target, Port::Data),
        Err(GpioBusError::NoSuchChip(2))
    );
    done(bus);
}

proptest! {
    /// The tracked position against an oracle that never wraps.
    #[test]
    fn position_follows_the_encoder(
        start in 0u32..(1 << 24),
        moves in prop::collection::vec(-(1i64 << 23)..(1i64 << 23), 0..200),
        negated in any::<bool>(),
    ) {
        let (direction, sign) = if negated { (Direction::Negated, -1) } else { (Direction::Normal, 1) };
        let mut tracker = PositionTracker::new(direction);
        prop_assert_eq!(tracker.update(value(start)), 0);
        let mut oracle: i128 = 0;
        for counts in moves {
            oracle += i128::from(counts);
            let wrapped = (i128::from(start) + oracle).rem_euclid(1 << 24) as u32;
            prop_assert_eq!(i128::from(tracker.update(value(wrapped))), sign * oracle);
        }
    }

    /// The short way round, against wide arithmetic.
    #[test]
    fn differences(from in 0u32..(1 << 24), to in 0u32..(1 << 24)) {
        let forward = (i128::from(to) - i128::from(from)).rem_euclid(1 << 24);
        let oracle = if forward >= 1 << 23 { forward - (1 << 24) } else { forward };
        prop_assert_eq!(i128::from(value(to).counts_since(value(from))), oracle);
    }

    /// Bytes on the bus and counts are the same thing.
    #[test]
    fn counter_bytes(bytes in any::<[u8; 3]>()) {
        let count = proto::decode_counter(bytes);
        prop_assert_eq!(count.to_le_bytes(), bytes);
        prop_assert_eq!(
            count.get(),
            u32::from(bytes[0]) + 256 * u32::from(bytes[1]) + 65_536 * u32::from(bytes[2])
        );
    }

    /// A reload of the counter doesn't move the position if the tracker is informed.
    #[test]
    fn reload_without_a_jump(before in 0u32..(1 << 24), after in 0u32..(1 << 24), step in -1000i32..1000) {
        let mut tracker = PositionTracker::new(Direction::Normal);
        tracker.update(value(before));
        tracker.set_position(123);
        tracker.forget_last();
        prop_assert_eq!(tracker.update(value(after)), 123);
        let moved = value((after.wrapping_add_signed(step)) & 0xFF_FFFF);
        prop_assert_eq!(tracker.update(moved), 123 + i64::from(step));
        prop_assert_eq!(tracker.position(), 123 + i64::from(step));
    }
}
