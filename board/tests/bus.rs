//! The bus scheduler against a model of the bus in virtual time: six converters with clocks of
//! their own, the bit times of 400 kHz, and the failures of a cable.

use board::bus::{Bus, Event, Sink, Transfer, TransferError, Work, STUCK_AFTER};
use board::clocks::{I2C_DEADLINE_US, RECOVERY_STEP_US};
use control::{Micros, UnitIndex, UnitSet, UNITS};
use drivers::nau7802::AdcCode;

#[derive(Default)]
struct Received(Vec<Event>);

impl Sink for Received {
    fn event(&mut self, event: Event) {
        self.0.push(event);
    }
}

/// A converter: its registers as far as a bring-up reads them back, its clock, its line.
#[derive(Clone)]
struct Chip {
    pointer: usize,
    registers: [u8; 0x20],
    period: u32,
    next: Micros,
    drdy: bool,
    running: bool,
    answers: bool,
    calibrated_at: Option<Micros>,
    conversions: u32,
    /// What a read of the result gives.
    latched: u32,
}

/// The hardware half's job, done by the book, with a bus that can be held.
struct Bench {
    bus: Bus,
    received: Received,
    chips: Vec<Chip>,
    now: Micros,
    mask: u8,
    mux_answers: bool,
    /// Masks to come that arrive as another unit's.
    flips: u32,
    flipped: bool,
    /// End of what is on the bus: a transaction or a recovery step.
    ends: Option<(Micros, End)>,
    /// SDA is held until so many clocks have come; a reset of the multiplexer frees it too.
    held: Option<u32>,
    reset_frees: bool,
    scl: bool,
    clocks: u32,
    mux_resets: u32,
    selects: u32,
    on_gpio: bool,
    blind: UnitSet,
    latencies: Vec<u32>,
    /// Edges of DRDY while a mask is read back.
    read_back_at_edge: u32,
    /// Variants of the converters: the six conversions that settle come with DRDY; the result is
    /// latched when the pointer is set.
    reports_unsettled: bool,
    latches_at_pointer: bool,
}

enum End {
    Transfer(Transfer),
    Step,
    Never,
}

impl Bench {
    fn new() -> Self {
        let chip = |n: u32| Chip {
            pointer: 0,
            registers: [0; 0x20],
            // 310 to 330 a second, none like the other.
            period: 3_030 + n * 39,
            next: Micros(0),
            drdy: false,
            running: false,
            answers: true,
            calibrated_at: None,
            conversions: 0,
            latched: 0,
        };
        Self {
            bus: Bus::new(),
            received: Received::default(),
            chips: (0..UNITS as u32).map(chip).collect(),
            now: Micros(0xFFFF_0000), // the clock wraps early in every test
            mask: 0,
            mux_answers: true,
            flips: 0,
            flipped: false,
            ends: None,
            held: None,
            reset_frees: true,
            scl: true,
            clocks: 0,
            mux_resets: 0,
            selects: 0,
            on_gpio: false,
            blind: UnitSet::default(),
            latencies: Vec::new(),
            read_back_at_edge: 0,
            reports_unsettled: false,
            latches_at_pointer: false,
        }
    }

    fn work(&mut self) {
        for _ in 0..4 {
            let Some(work) = self.bus.next(self.now, &mut self.received) else {
                return;
            };
            match work {
                Work::Transfer(transfer) => {
                    assert!(!self.on_gpio, "a transaction while the lines are GPIO");
                    assert!(self.ends.is_none(), "two things at once on the bus");
                    let phase = |bytes: u8| {
                        if bytes > 0 {
                            9 * (1 + u32::from(bytes))
                        } else {
                            0
                        }
                    };
                    let bits = phase(transfer.write_len) + phase(transfer.read_len);
                    let end = if self.held.is_some() {
                        End::Never
                    } else {
                        End::Transfer(transfer)
                    };
                    self.ends = Some((self.now.plus(bits * 5 / 2 + 5), end));
                    return;
                }
                Work::TakeLines => {
                    self.on_gpio = true;
                    self.ends = None;
                    self.scl = true;
                }
                Work::Lines { scl, .. } => {
                    assert!(self.on_gpio);
                    if scl && !self.scl {
                        self.clocks += 1;
                        self.held = self
                            .held
                            .and_then(|left| left.checked_sub(1))
                            .filter(|left| *left > 0);
                    }
                    self.scl = scl;
                    self.ends = Some((self.now.plus(RECOVERY_STEP_US), End::Step));
                    return;
                }
                Work::MuxReset { low } => {
                    if low {
                        self.mux_resets += 1;
                        self.mask = 0;
                        if self.reset_frees {
                            self.held = None;
                        }
                    }
                    self.ends = Some((self.now.plus(RECOVERY_STEP_US), End::Step));
                    return;
                }
                Work::GiveLines => self.on_gpio = false,
            }
        }
        panic!("the bus switches its lines for ever");
    }

    fn transact(&mut self, transfer: Transfer) -> Result<[u8; 3], TransferError> {
        if transfer.address == 0x70 {
            if !self.mux_answers {
                self.selects += 1;
                return Err(TransferError::Nack);
            }
            if transfer.write_len > 0 {
                self.selects += 1;
                self.mask = transfer.write[0];
                if self.flips > 0 {
                    self.flips -= 1;
                    self.flipped = true;
                    self.mask = self.mask.rotate_left(1);
                }
            }
            // A mask that is read back is known, and with it what was read through it: after this
            // no sample is read from elsewhere.
            self.flipped &= transfer.write_len > 0;
            return Ok([self.mask, 0, 0]);
        }
        assert_eq!(self.mask.count_ones(), 1, "one channel at a time");
        let now = self.now;
        // Behind a mask that changed nobody may be, or a converter whose pointer is elsewhere.
        let flipped = self.flipped;
        let settling = if self.reports_unsettled { 0 } else { 6 };
        let latches_at_pointer = self.latches_at_pointer;
        let Some(chip) = self.chips.get_mut(self.mask.trailing_zeros() as usize) else {
            return Err(TransferError::Nack);
        };
        if !chip.answers {
            return Err(TransferError::Nack);
        }
        if transfer.write_len > 0 {
            chip.pointer = usize::from(transfer.write[0]);
            chip.latched = chip.conversions;
        }
        let register = chip.pointer;
        if transfer.write_len == 2 {
            chip.registers[register] = transfer.write[1];
            match register {
                0x00 => {
                    chip.running = transfer.write[1] & 0x10 != 0;
                    chip.next = now.plus(chip.period * (1 + settling));
                    chip.drdy = false;
                }
                0x02 if transfer.write[1] & 0x04 != 0 => {
                    chip.calibrated_at = Some(now.plus(344_000))
                }
                _ => {}
            }
            return Ok([0; 3]);
        }
        if transfer.read_len == 3 {
            assert!(register == 0x12 || flipped, "a sample that is none");
            chip.pointer += 3;
            chip.drdy = false;
            if !latches_at_pointer {
                chip.latched = chip.conversions;
            }
            let [_, a, b, c] = chip.latched.to_be_bytes();
            return Ok([a, b, c]);
        }
        if transfer.read_len == 0 {
            return Ok([0; 3]);
        }
        let value = match register {
            0x00 => chip.registers[0] | 0x08,
            0x02 => {
                if chip.calibrated_at.is_some_and(|at| at.until(now) >= 0) {
                    chip.registers[2] &= !0x04;
                }
                chip.registers[2]
            }
            0x1F => 0x0F,
            other => chip.registers[other],
        };
        Ok([value, 0, 0])
    }

    /// Lets time pass, microsecond by microsecond.
    fn run(&mut self, us: u32) {
        for _ in 0..us {
            self.now = self.now.plus(1);
            for unit in UnitIndex::ALL {
                let chip = &mut self.chips[unit as usize];
                if chip.running && chip.answers && chip.next == self.now {
                    if let Some((_, End::Transfer(transfer))) = &self.ends {
                        let read_back = transfer.address == 0x70 && transfer.write_len == 0;
                        self.read_back_at_edge += u32::from(read_back);
                    }
                    chip.next = self.now.plus(chip.period);
                    chip.conversions += 1;
                    if !chip.drdy {
                        chip.drdy = true;
                        if !self.blind.contains(unit) {
                            self.bus.drdy(unit, self.now, &mut self.received);
                            self.work();
                        }
                    }
                }
            }
            if self.ends.as_ref().is_some_and(|(at, _)| *at == self.now) {
                match self.ends.take() {
                    Some((_, End::Transfer(transfer))) => {
                        let result = self.transact(transfer);
                        let before = self.received.0.len();
                        self.bus.finished(result, self.now, &mut self.received);
                        if let Some(Event::Sample { at, .. }) = self.received.0.get(before) {
                            self.latencies.push(self.now.since(*at));
                        }
                    }
                    Some((_, End::Step)) => self.bus.stepped(self.held.is_none()),
                    Some((_, End::Never)) | None => {}
                }
                self.work();
            }
            if self.now.0.is_multiple_of(1_000) {
                let high = UnitIndex::zip(&self.chips)
                    .filter_map(|(unit, chip)| chip.drdy.then_some(unit))
                    .collect();
                self.bus.tick(self.now, high, &mut self.received);
                self.work();
            }
        }
    }

    fn start(&mut self, units: impl IntoIterator<Item = UnitIndex>) {
        for unit in units {
            self.bus.start(unit, self.now);
        }
    }

    /// All six up and streaming.
    fn streaming() -> Self {
        let mut bench = Self::new();
        bench.start(UnitIndex::ALL);
        bench.run(750_000);
        let up = bench
            .received
            .0
            .iter()
            .filter(|event| matches!(event, Event::Up { .. }))
            .count();
        assert_eq!(up, UNITS, "{:?}", bench.received.0);
        bench.received.0.clear();
        bench.latencies.clear();
        bench
    }

    fn samples(&self, of: UnitIndex) -> Vec<(AdcCode, u8)> {
        self.received
            .0
            .iter()
            .filter_map(|event| match event {
                Event::Sample {
                    unit, code, missed, ..
                } if *unit == of => Some((*code, *missed)),
                _ => None,
            })
            .collect()
    }

    /// Asserts that a unit's samples follow each other without a gap.
    fn gapless(&self, unit: UnitIndex) {
        let samples = self.samples(unit);
        assert!(samples.len() > 10, "{unit:?} has {} samples", samples.len());
        for pair in samples.windows(2) {
            assert_eq!(
                pair[1].0.counts() - pair[0].0.counts(),
                1,
                "{unit:?} lost a conversion"
            );
            assert_eq!(pair[1].1, 0, "{unit:?} claims a loss");
        }
    }
}

/// Whether a converter announces the six conversions that settle is open, and so is when it latches
/// a result.
#[test]
fn six_results_after_a_bring_up_are_no_samples() {
    for (reports_unsettled, latches_at_pointer) in
        [(false, false), (false, true), (true, false), (true, true)]
    {
        let mut bench = Bench::new();
        bench.reports_unsettled = reports_unsettled;
        bench.latches_at_pointer = latches_at_pointer;
        bench.start(UnitIndex::ALL);
        let mut before = [None; UNITS];
        for _ in 0..7_600 {
            bench.run(100);
            for (n, chip) in bench.chips.iter().enumerate() {
                let up = |event: &Event| matches!(event, Event::Up { unit } if *unit as usize == n);
                if before[n].is_none() && bench.received.0.iter().any(up) {
                    before[n] = Some(chip.conversions);
                }
            }
        }
        for unit in UnitIndex::ALL {
            let before = before[unit as usize].expect("it came up");
            let samples = bench.samples(unit);
            let (first, missed) = samples.first().expect("it streams");
            let conversion = first.counts() as u32 - before;
            assert_eq!(
                (conversion, *missed),
                (7, 0),
                "{unit:?}, unsettled {reports_unsettled}, latch at the pointer {latches_at_pointer}"
            );
        }
    }
}

#[test]
fn six_bring_ups_overlap_and_all_units_stream_without_loss() {
    let mut bench = Bench::streaming(); // 0.75 s for what takes 0.62 s alone
    bench.run(2_000_000);
    for unit in UnitIndex::ALL {
        bench.gapless(unit);
        let expected = 2_000_000 / bench.chips[unit as usize].period;
        assert!(bench.samples(unit).len() as u32 >= expected - 1);
    }
    assert!(!bench
        .received
        .0
        .iter()
        .any(|event| matches!(event, Event::Recovery | Event::ReadFailed { .. })));
}

#[test]
fn most_samples_need_neither_select_nor_pointer() {
    let mut bench = Bench::streaming();
    bench.run(3_000_000);
    bench.latencies.sort_unstable();
    let median = bench.latencies[bench.latencies.len() / 2];
    // A read without select and pointer: 36 clocks and STOP, 95 us. With both it would be 190.
    assert!(median <= 100, "median {median} us");
    let p99 = bench.latencies[bench.latencies.len() * 99 / 100];
    // Two others ahead of it: 95 + 145 + 145 us.
    assert!(p99 <= 420, "99th percentile {p99} us");
    assert!(
        *bench.latencies.last().unwrap() < 2_900,
        "a unit was starved"
    );
}

#[test]
fn a_unit_that_vanishes_does_not_disturb_the_others() {
    let mut bench = Bench::streaming();
    bench.run(100_000);
    bench.chips[2].answers = false;
    bench.chips[2].drdy = true; // its last edge; then the converter is gone
    bench
        .bus
        .drdy(UnitIndex::Unit3, bench.now, &mut bench.received);
    bench.work();
    bench.run(500_000);
    for unit in UnitIndex::ALL
        .into_iter()
        .filter(|unit| *unit != UnitIndex::Unit3)
    {
        bench.gapless(unit);
    }
    let failed = bench
        .received
        .0
        .iter()
        .filter(|event| {
            matches!(
                event,
                Event::ReadFailed {
                    unit: UnitIndex::Unit3,
                    ..
                }
            )
        })
        .count();
    assert!(failed >= 2, "one retry at least");
    assert!(
        !bench.received.0.contains(&Event::Recovery),
        "a NACK is no reason to touch the bus"
    );
}

#[test]
fn a_unit_comes_back_while_the_others_stream() {
    let mut bench = Bench::streaming();
    bench.chips[4].answers = false;
    bench.bus.stop(UnitIndex::Unit5);
    bench.start([UnitIndex::Unit5]);
    bench.run(100_000);
    assert!(
        bench.received.0.iter().any(|event| matches!(
            event,
            Event::BringUpFailed {
                unit: UnitIndex::Unit5,
                ..
            }
        )),
        "an empty socket is reported"
    );
    bench.chips[4].answers = true;
    bench.start([UnitIndex::Unit5]);
    bench.run(900_000);
    assert!(bench.received.0.contains(&Event::Up {
        unit: UnitIndex::Unit5
    }));
    for unit in UnitIndex::ALL {
        bench.gapless(unit);
    }
}

#[test]
fn a_held_sda_is_clocked_free_within_a_sample_period() {
    for clocks in 1..=8 {
        let mut bench = Bench::streaming();
        bench.run(50_000);
        bench.held = Some(clocks);
        bench.run(200_000);
        assert!(bench.received.0.contains(&Event::Recovery));
        assert!(bench.clocks >= clocks && bench.mux_resets == 0, "{clocks}");
        for unit in UnitIndex::ALL {
            bench.gapless(unit);
        }
    }
}

#[test]
fn what_clocks_do_not_free_the_multiplexers_reset_does() {
    let mut bench = Bench::streaming();
    bench.held = Some(1_000);
    bench.run(200_000);
    assert_eq!(bench.mux_resets, 1);
    for unit in UnitIndex::ALL {
        bench.gapless(unit);
    }
}

#[test]
fn a_bus_that_stays_held_is_reported_and_taken_up_again_when_it_is_free() {
    let mut bench = Bench::streaming();
    bench.held = Some(u32::MAX);
    bench.reset_frees = false;
    bench.run(300_000);
    let stuck = bench
        .received
        .0
        .iter()
        .filter_map(|event| match event {
            Event::Stuck { rounds, sda_low } => Some((*rounds, *sda_low)),
            _ => None,
        })
        .collect::<Vec<_>>();
    assert_eq!(stuck.first(), Some(&(STUCK_AFTER, true)));
    assert!(
        stuck.len() < 20,
        "it must pause between rounds, or it loads the core"
    );
    assert!(
        !bench
            .received
            .0
            .iter()
            .any(|event| matches!(event, Event::MuxSilent { .. })),
        "a blocked line is no evidence of a silent multiplexer"
    );
    bench.held = None;
    bench.received.0.clear();
    bench.run(300_000);
    let losses: u32 = UnitIndex::ALL
        .into_iter()
        .map(|unit| {
            bench
                .samples(unit)
                .iter()
                .map(|(_, missed)| u32::from(*missed))
                .sum::<u32>()
        })
        .sum();
    assert!(
        losses > 6 * 50,
        "what was lost meanwhile is counted: {losses}"
    );
    for unit in UnitIndex::ALL {
        assert!(bench.samples(unit).len() > 80, "{unit:?} streams again");
    }
}

#[test]
fn a_silent_multiplexer_is_reset_and_reported() {
    let mut bench = Bench::streaming();
    bench.mux_answers = false;
    bench.run(100_000);
    assert!(bench
        .received
        .0
        .iter()
        .any(|event| matches!(event, Event::MuxSilent { .. })));
    assert!(bench.mux_resets >= 1);
    bench.mux_answers = true;
    bench.received.0.clear();
    bench.run(200_000);
    for unit in UnitIndex::ALL {
        assert!(bench.samples(unit).len() > 30);
    }
}

#[test]
fn an_edge_that_was_never_seen_is_found_by_its_level() {
    let mut bench = Bench::streaming();
    bench.run(50_000);
    bench.blind.insert(UnitIndex::Unit4);
    bench.run(10_000);
    bench.blind = UnitSet::default();
    bench.run(100_000);
    let samples = bench.samples(UnitIndex::Unit4);
    assert!(
        samples.len() > 40,
        "the unit fell silent after a lost edge: {}",
        samples.len()
    );
    assert!(samples.iter().any(|(_, missed)| *missed > 0));
}

/// A line stays high while its result is read. A dip in it looks like an edge, and its level says
/// that a result is there.
#[test]
fn a_dip_in_a_high_line_is_no_conversion() {
    let mut bench = Bench::streaming();
    let (mut dips, mut beside) = (0, 0);
    for _ in 0..10_000 {
        bench.run(20);
        for unit in UnitIndex::ALL {
            if bench.chips[unit as usize].drdy {
                dips += 1;
                bench.bus.drdy(unit, bench.now, &mut bench.received);
                bench.work();
            }
        }
        beside += usize::from(bench.chips.iter().any(|chip| chip.drdy));
    }
    assert!(dips > 500 && beside > 500, "{dips} {beside}");
    for unit in UnitIndex::ALL {
        bench.gapless(unit);
        let edges = |event: &&Event| matches!(event, Event::Edge { unit: of } if *of == unit);
        let edges = bench.received.0.iter().filter(edges).count();
        let samples = bench.samples(unit).len();
        assert!(
            edges.abs_diff(samples) <= 1,
            "{edges} edges, {samples} samples"
        );
    }
}

#[test]
fn an_unread_conversion_is_counted() {
    let mut bench = Bench::streaming();
    bench.run(50_000);
    // Three periods of silence on one line, as a stalled core would leave it.
    let at = bench.now.plus(20_000);
    bench.chips[1].next = at;
    bench.run(60_000);
    let most = bench
        .samples(UnitIndex::Unit2)
        .iter()
        .map(|(_, missed)| *missed)
        .max();
    assert!(most >= Some(5), "{most:?}");
}

#[test]
fn the_deadline_leaves_room_for_the_longest_transaction() {
    const { assert!(I2C_DEADLINE_US > 2 * 140) };
}

/// A mask that arrives as another unit's is read back, and written again, before a sample is read
/// through it.
#[test]
fn a_mask_that_changed_on_its_way_is_written_again() {
    for unit in UnitIndex::ALL {
        let mut bench = Bench::new();
        bench.flips = 1;
        bench.start([unit]);
        bench.run(750_000);
        assert_eq!(bench.flips, 0);
        // Only its own converter was touched.
        for other in UnitIndex::ALL {
            assert_eq!(bench.chips[other as usize].running, other == unit);
        }
        bench.gapless(unit);
        // While all stream, wherever it hits: at most the sample that was read at once is another
        // unit's.
        let mut bench = Bench::streaming();
        for _ in 0..40 {
            bench.flips = 1;
            bench.run(7_300);
        }
        let wrong = (bench.samples(unit).windows(2))
            .filter(|pair| pair[1].0.counts() - pair[0].0.counts() != 1)
            .count();
        assert!(wrong <= 20, "{wrong} of unit {unit:?}");
        assert!(!bench
            .received
            .0
            .iter()
            .any(|event| matches!(event, Event::MuxSilent { .. })));
    }
}

/// A sample never waits for a mask that is read back.
#[test]
fn a_mask_is_read_back_only_where_no_sample_is_due() {
    let mut bench = Bench::streaming();
    // The averages of the periods settle.
    bench.run(300_000);
    bench.read_back_at_edge = 0;
    bench.run(3_000_000);
    assert_eq!(bench.read_back_at_edge, 0);
}

#[test]
fn a_multiplexer_that_keeps_another_mask_is_reported_with_it() {
    let mut bench = Bench::streaming();
    bench.flips = u32::MAX;
    bench.run(20_000);
    let event = bench.received.0.iter().find_map(|event| match event {
        Event::MuxSilent { mask, found } => Some((*mask, *found)),
        _ => None,
    });
    let (mask, found) = event.expect("a report");
    assert_eq!(found, mask.rotate_left(1));
}
