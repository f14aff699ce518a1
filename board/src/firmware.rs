//! What the superloop's pieces do: joins the hardware ([`crate::hw`]) to the machine
//! ([`board::machine`]).

use crate::links::{self, Link};
use board::bus::Event;
use board::clocks;
use board::hw::counters::Counters;
use board::hw::kept::{self, Stage};
use board::hw::usart::Usart;
use board::hw::usb::Usb;
use board::hw::watchdog::{Part, Watchdog};
use board::hw::{dac, gpio, pac, sensors, startup, time, usart, usb};
use board::machine::{Effects, Health, LoopFigures, Machine, LINKS};
use board::pins;
use board::telemetry::Outstanding;
use control::{DacCode, Fault, LoadCode, SystemState};
use defmt_rtt as _;
use heapless::{Deque, String};
use wire::message::{BoardInfo, FaultReport};
use wire::{BoardMessage, ABI_VERSION, SCHEMA_HASH, UNITS};

defmt::timestamp!("{=u32:us}", time::now());

/// Milliseconds between two unasked status frames.
const STATUS_MS: u32 = 50;
/// Events that one piece takes before the next one gets its turn: edge and sample of all units, twice.
const EVENTS_A_PASS: usize = 4 * UNITS;
/// Bytes that one pass takes from USART3: more than two milliseconds of the line.
const BYTES_A_PASS: usize = 512;
/// Fault reports that may wait for the links.
const REPORTS: usize = 16;

/// Everything that the superloop owns.
pub struct Board {
    machine: Machine,
    events: sensors::Events,
    counters: Counters,
    /// Position of each encoder at the last DRDY edge of its unit.
    counts: [i64; UNITS],
    outstanding: Outstanding,
    watchdog: Watchdog,
    links: [Link; LINKS],
    usb: Option<Usb>,
    usart: Usart,
    reports: Reports,
    clock: Clock,
    status_ms: u32,
    encoder_watched: u8,
}

/// What the machine's wishes come to.
#[derive(Default)]
struct Reports(Deque<FaultReport, REPORTS>);

impl Effects for Reports {
    fn start_sensor(&mut self, unit: u8) {
        sensors::bring_up(unit);
    }

    fn stop_sensor(&mut self, unit: u8) {
        sensors::leave(unit);
    }

    fn zero_output(&mut self, unit: u8) {
        dac::write(unit, DacCode::ZERO_VOLT);
    }

    fn report(&mut self, report: FaultReport) {
        defmt::warn!(
            "fault {=u16} unit {=u8} detail {=u32:#x}",
            report.code,
            report.unit,
            report.detail
        );
        // The status frames tell of what does not fit.
        let _ = self.0.push_back(report);
    }
}

/// How the superloop spends its time.
#[derive(Default)]
struct Clock {
    pass_began: u32,
    longest_pass: u32,
    asleep: u32,
    second_began: u32,
    figures: LoopFigures,
}

impl Board {
    /// From reset to the first pass of the superloop.
    pub fn start() -> Self {
        // Before anything can go wrong.
        gpio::hold_dacs_at_zero();
        let (Some(mut core), Some(part)) =
            (cortex_m::Peripherals::take(), pac::Peripherals::take())
        else {
            panic!("started twice");
        };
        startup::debug(&part.DBGMCU);
        gpio::configure();
        let reset_flags = startup::clocks(&part.RCC, &part.PWR, &part.FLASH);
        startup::caches(&mut core.SCB);
        startup::priorities(&mut core.NVIC, &mut core.SCB);
        let crash_record = kept::take(reset_flags);
        kept::note(Stage::Start);
        let watchdog = Watchdog::start(part.IWDG);
        time::start(&mut core.SYST);

        dac::start();
        let (counters, broken_counter) = Counters::start();
        let (usart, usart_queue) = usart::start(&part.USART3, &part.DMAMUX1);
        let usb_supplied = startup::usb_supply(&part.RCC, &part.PWR);
        let (usb, usb_queue) = usb::start(usb_supplied);
        let events = sensors::start(&part.SYSCFG, &part.EXTI);

        defmt::info!(
            "force board {=str}, reset flags {=u32:#x}, usb {=bool}",
            VERSION,
            reset_flags,
            usb.is_some()
        );
        let mut board = Self {
            machine: Machine::new(BoardInfo {
                abi: ABI_VERSION,
                schema: SCHEMA_HASH,
                version: String::try_from(VERSION).unwrap_or_default(),
                core_hz: clocks::CORE_HZ,
                reset_flags,
                crash_record,
            }),
            events,
            counters,
            counts: [0; UNITS],
            outstanding: Outstanding::default(),
            watchdog,
            links: [Link::new(usb_queue), Link::new(usart_queue)],
            usb,
            usart,
            reports: Reports::default(),
            clock: Clock {
                pass_began: time::now(),
                second_began: time::now(),
                ..Clock::default()
            },
            status_ms: 0,
            encoder_watched: 0,
        };
        if let Some(chip) = broken_counter {
            board
                .machine
                .fault_board(Fault::CounterBus, chip, time::now(), &mut board.reports);
        }
        board
    }

    /// Answers every sample that waits. From the I2C result to the DAC word this is the whole path.
    pub fn samples(&mut self) {
        kept::note(Stage::Samples);
        let waiting = self.events.len().min(usize::from(u8::MAX)) as u8;
        self.clock.figures.queue_high_water = self.clock.figures.queue_high_water.max(waiting);
        for _ in 0..EVENTS_A_PASS {
            let Some(event) = self.events.dequeue() else {
                self.watchdog.sign(Part::Samples);
                return;
            };
            match event {
                // While the converter is on the bus: off the path from its result to the DAC word.
                Event::Edge { unit } => {
                    if let Some(counts) = self.counts.get_mut(usize::from(unit)) {
                        *counts = self.counters.read(unit);
                    }
                }
                Event::Sample {
                    unit,
                    code,
                    at,
                    missed,
                } => {
                    let counts = self.counts.get(usize::from(unit)).copied().unwrap_or(0);
                    let code = LoadCode::new(code.counts());
                    let (word, answered) =
                        self.machine
                            .sample(unit, code, counts, at, missed, &mut self.reports);
                    dac::write(unit, word);
                    let telemetry = answered.describe();
                    if let Some((at, late)) = self.outstanding.insert(at, telemetry) {
                        stream(&mut self.links, &self.machine, at, late);
                    }
                }
                other => self
                    .machine
                    .bus_event(other, time::now(), &mut self.reports),
            }
        }
    }

    /// Completes the samples whose DAC words are out, and hands them to the links.
    pub fn outputs(&mut self) {
        kept::note(Stage::Outputs);
        let (done, at) = dac::take_done();
        for (unit, at) in at.into_iter().enumerate() {
            if done & (1 << unit) != 0 {
                if let Some((edge, sample)) = self.outstanding.complete(unit, at) {
                    stream(&mut self.links, &self.machine, edge, sample);
                }
            }
        }
    }

    /// The supervisor, once a millisecond.
    pub fn supervisor(&mut self) {
        if !time::take_tick() {
            return;
        }
        kept::note(Stage::Supervisor);
        let now = time::now();
        let dac_error = dac::take_error();
        let health = Health {
            estop_closed: gpio::read(pins::E_STOP),
            estop_opened_at: sensors::estop_opened_at(),
            longest_pass_us: core::mem::take(&mut self.clock.longest_pass),
            events_lost: sensors::events_lost(),
            dac_error,
        };
        self.machine.tick(now, health, &mut self.reports);
        // One counter a millisecond: noise at an encoder is seen within six.
        self.encoder_watched = (self.encoder_watched + 1) % UNITS as u8;
        if let Some(flags) = self.counters.noise(self.encoder_watched) {
            self.machine
                .encoder_noise(self.encoder_watched, flags, now, &mut self.reports);
        }
        let state = self.machine.system();
        if dac::is_held() && dac_error.is_none() && state != SystemState::Fault {
            dac::release();
        }
        gpio::write(pins::LED_OK, state == SystemState::Running);
        gpio::write(pins::LED_FAULT, self.machine.is_faulted());

        self.watchdog.sign(Part::Tick);
        self.watchdog.sign(Part::Supervisor);
        if dac_error.is_none() {
            self.watchdog.sign(Part::Dac);
        }
        if let Some(missing) = self.watchdog.tick() {
            // The watchdog will bite before long: say now why.
            kept::keep(
                Fault::WatchdogReset,
                missing,
                0,
                "a part of the superloop did not check in",
            );
        }
        self.clock.second(now);
        self.tell(now);
    }

    /// Faults, status and batches that are due.
    fn tell(&mut self, now: u32) {
        while let Some(report) = self.reports.0.pop_front() {
            for link in &mut self.links {
                link.send(BoardMessage::Fault(report));
            }
        }
        self.status_ms += 1;
        let status_due = self.status_ms >= STATUS_MS;
        for link in &mut self.links {
            if status_due {
                link.send(BoardMessage::Status(self.machine.status(
                    now,
                    self.clock.figures,
                    link.counters(),
                )));
            }
            if let Some(batch) = link.batcher.flush(now) {
                link.send(BoardMessage::Samples(batch));
            }
        }
        if status_due {
            self.status_ms = 0;
            self.clock.figures.queue_high_water = 0;
        }
    }

    /// Commands in, frames out.
    pub fn links(&mut self) {
        kept::note(Stage::Links);
        let Self {
            machine,
            links,
            reports,
            clock,
            usb,
            usart,
            ..
        } = self;
        let [usb_link, usart_link] = links;
        let mut carry_out = |number: usize, link: &mut Link, byte: u8| {
            if let Some(frame) = link.push(byte) {
                let answer = machine.command(
                    number,
                    &frame,
                    time::now(),
                    clock.figures,
                    link.counters(),
                    reports,
                );
                if let Some(answer) = answer {
                    link.reply(frame.seq, answer);
                }
            }
        };
        if let Some(usb) = usb {
            usb.serve(|byte| carry_out(links::USB, usb_link, byte));
        }
        usart.receive(BYTES_A_PASS, |byte| {
            carry_out(links::USART, usart_link, byte)
        });
        usart.send();
        self.watchdog.sign(Part::Links);
    }

    /// Sleeps until there is something to do: a sample, a millisecond, USB. The many interrupts in between (a
    /// sample takes the bus a dozen) wake the core for themselves alone.
    pub fn sleep(&mut self) {
        kept::note(Stage::Sleep);
        let pass = time::now().wrapping_sub(self.clock.pass_began);
        self.clock.longest_pass = self.clock.longest_pass.max(pass);
        while !(self.events.ready() || time::tick_waits() || usb::calls()) {
            // With interrupts masked, one that comes between the look and the sleep still ends the sleep
            // (WFI wakes on a pending one), and its handler runs when they are let through again.
            self.clock.asleep += cortex_m::interrupt::free(|_| {
                if self.events.ready() || time::tick_waits() || usb::calls() {
                    return 0;
                }
                let before = time::now();
                cortex_m::asm::dsb();
                cortex_m::asm::wfi();
                time::now().wrapping_sub(before)
            });
        }
        self.clock.pass_began = time::now();
    }
}

/// Offers a sample to both links.
fn stream(links: &mut [Link; LINKS], machine: &Machine, at: u32, sample: wire::message::Sample) {
    for (number, link) in links.iter_mut().enumerate() {
        if let Some(batch) = link.batcher.push(at, sample, machine.decimation(number)) {
            link.send(BoardMessage::Samples(batch));
        }
    }
}

impl Clock {
    /// Works the sleep figure out, once a second.
    fn second(&mut self, now: u32) {
        let elapsed = now.wrapping_sub(self.second_began);
        if elapsed >= 1_000_000 {
            self.figures.sleep_permille =
                (u64::from(self.asleep) * 1_000 / u64::from(elapsed)).min(1_000) as u16;
            self.asleep = 0;
            self.second_began = now;
        }
    }
}

/// Version of the firmware.
const VERSION: &str = env!("CARGO_PKG_VERSION");
