//! The stages of the superloop: connects the hardware ([`board::hw`]) to the machine
//! ([`board::machine`]).

use crate::links::{self, Link};
use board::bus::Event;
use board::clocks;
use board::hw::counters::Counters;
use board::hw::crash_record::{self, Stage};
use board::hw::registers::Registers;
use board::hw::usart::Usart;
use board::hw::usb::Usb;
use board::hw::watchdog::{Part, Watchdog};
use board::hw::{dac, gpio, pac, sensors, startup, time, usart, usb};
use board::machine::{Effects, Health, LoopFigures, Machine, LINKS};
use board::pins;
use board::telemetry::Outstanding;
use control::{AdcCode, DacCode, EncoderCounts, Fault, Micros, SystemState, UnitIndex, UNITS};
use defmt_rtt as _;
use heapless::{Deque, String};
use wire::message::{BoardInfo, FaultReport};
use wire::{BoardMessage, ABI_VERSION, SCHEMA_HASH};

defmt::timestamp!("{=u32:us}", time::now().0);

/// Period of the status frames in milliseconds.
const STATUS_MS: u32 = 50;
/// Largest number of events of one [`Board::samples`]: edge and sample of all units, twice.
const EVENTS_PER_PASS: usize = 4 * UNITS;
/// Largest number of bytes that one pass takes from USART3: more than two milliseconds of the line.
const BYTES_PER_PASS: usize = 512;
/// Capacity of the queue of fault reports.
const REPORTS: usize = 16;

/// State of the superloop.
pub struct Board {
    machine: Machine,
    events: sensors::Events,
    counters: Counters,
    /// Position of each encoder at the last DRDY edge of its unit.
    counts: [EncoderCounts; UNITS],
    outstanding: Outstanding,
    watchdog: Watchdog,
    registers: Registers,
    links: [Link; LINKS],
    usb: Option<Usb>,
    usart: Usart,
    reports: Reports,
    clock: Clock,
    status_ms: u32,
    encoder_checked: usize,
}

/// Executes the effects of the machine; fault reports wait here for the links.
#[derive(Default)]
struct Reports(Deque<FaultReport, REPORTS>);

impl Effects for Reports {
    fn start_sensor(&mut self, unit: UnitIndex) {
        sensors::start_sensor(unit);
    }

    fn stop_sensor(&mut self, unit: UnitIndex) {
        sensors::stop_sensor(unit);
    }

    fn zero_output(&mut self, unit: UnitIndex) {
        dac::write(unit, DacCode::ZERO_VOLT);
    }

    fn report(&mut self, report: FaultReport) {
        // The log waits too: it has a lock that panics, and this is called from the sample path. A
        // report that does not fit is lost; status frames show the latched fault.
        let _ = self.0.push_back(report);
    }
}

/// Time figures of the superloop.
#[derive(Default)]
struct Clock {
    pass_began: Micros,
    longest_pass: u32,
    asleep: u32,
    second_began: Micros,
    figures: LoopFigures,
}

impl Board {
    /// From reset to the first pass of the superloop.
    pub fn start() -> Self {
        // First of all: 0 V on all motors.
        gpio::hold_dacs_at_zero();
        let (Some(mut core), Some(part)) =
            (cortex_m::Peripherals::take(), pac::Peripherals::take())
        else {
            panic!("started twice");
        };
        startup::debug(&part.DBGMCU);
        gpio::configure();
        let dac_reset_pull = gpio::pull_of(pins::DAC_RST);
        let unique_id = startup::unique_id();
        let silicon = startup::revision(&part.DBGMCU);
        startup::axi_read_fix(silicon);
        let option_bytes = part.FLASH.optsr_cur().read().bits();
        startup::guards(&mut core.MPU);
        let startup::Clocks { reset_flags, hse } =
            startup::clocks(&part.RCC, &part.PWR, &part.FLASH);
        startup::caches(&mut core.SCB);
        startup::priorities(&mut core.NVIC, &mut core.SCB);
        let crash_record = crash_record::take_crash_record(reset_flags);
        crash_record::set_stage(Stage::Start);
        let watchdog = Watchdog::start(part.IWDG);
        time::start(&mut core.SYST);

        dac::start();
        let (counters, broken_counter) = Counters::start();
        let (usart, usart_queue) = usart::start(&part.USART3, &part.DMAMUX1, silicon);
        let usb_supplied = startup::usb_supply(&part.RCC, &part.PWR);
        let (usb, usb_queue) = usb::start(usb_supplied, unique_id);
        let events = sensors::start(&part.SYSCFG, &part.EXTI);

        defmt::info!(
            "force board {=str}, silicon {=u16:#x}, HSE {=bool}, reset flags {=u32:#x}, usb {=bool}",
            VERSION,
            silicon,
            hse,
            reset_flags,
            usb.is_some()
        );
        let mut board = Self {
            machine: Machine::new(BoardInfo {
                abi: ABI_VERSION,
                schema: SCHEMA_HASH,
                version: String::try_from(VERSION).unwrap_or_default(),
                core_hz: clocks::CORE_HZ,
                silicon,
                hse,
                reset_flags,
                option_bytes,
                unique_id,
                dac_reset_pull,
                crash_record,
            }),
            events,
            counters,
            counts: [EncoderCounts::default(); UNITS],
            outstanding: Outstanding::default(),
            watchdog,
            // Everything is set up.
            registers: Registers::start(silicon),
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
            encoder_checked: 0,
        };
        if let Some(chip) = broken_counter {
            board
                .machine
                .fault_board(Fault::CounterBus, chip, time::now(), &mut board.reports);
        }
        board
    }

    /// Processes the queued samples: the whole path from the I2C result to the DAC word. No panic
    /// can be reached from here; `cargo xtask inspect` checks it in the image, and therefore the
    /// function keeps its own symbol.
    #[inline(never)]
    pub fn samples(&mut self) {
        crash_record::set_stage(Stage::Samples);
        let waiting = self.events.waiting().min(usize::from(u8::MAX)) as u8;
        self.clock.figures.queue_high_water = self.clock.figures.queue_high_water.max(waiting);
        for _ in 0..EVENTS_PER_PASS {
            let Some(event) = self.events.dequeue() else {
                self.watchdog.check_in(Part::Samples);
                return;
            };
            match event {
                // During the converter's I2C read, so outside the path from its result to the DAC
                // word.
                Event::Edge { unit } => {
                    self.counts[unit as usize] = self.counters.read(unit);
                }
                Event::Sample {
                    unit,
                    code,
                    at,
                    missed,
                } => {
                    let counts = self.counts[unit as usize];
                    let code = AdcCode::new(code.counts());
                    let (word, mut pending) =
                        (self.machine).sample(unit, code, counts, at, missed, &mut self.reports);
                    dac::write(unit, word);
                    self.machine.check(&mut pending, &mut self.reports);
                    let telemetry = pending.describe();
                    if let Some((at, late)) = self.outstanding.insert(unit, at, telemetry) {
                        stream(&mut self.links, &self.machine, at, late);
                    }
                }
                other => (self.machine).bus_event(other, time::now(), &mut self.reports),
            }
        }
    }

    /// Completes the samples whose DAC words were sent, and passes them to the links.
    pub fn outputs(&mut self) {
        crash_record::set_stage(Stage::Outputs);
        let (done, at) = dac::take_done();
        for unit in done.iter() {
            if let Some((edge, sample)) = self.outstanding.complete(unit, at[unit as usize]) {
                stream(&mut self.links, &self.machine, edge, sample);
            }
        }
    }

    /// The supervisor, once a millisecond.
    pub fn supervisor(&mut self) {
        if !time::take_tick() {
            return;
        }
        crash_record::set_stage(Stage::Supervisor);
        let now = time::now();
        let register_changed = self.registers.check(&mut self.usart);
        let dac_error = dac::take_error();
        let health = Health {
            estop_closed: gpio::read(pins::E_STOP),
            estop_opened_at: sensors::estop_opened_at(),
            longest_pass_us: core::mem::take(&mut self.clock.longest_pass),
            events_lost: sensors::events_lost(),
            dac_error,
            register_changed,
        };
        for unit in self.machine.wants_encoders().iter() {
            self.machine.encoder(unit, self.counters.read(unit));
        }
        self.machine.tick(now, health, &mut self.reports);
        sensors::set_pointer_ahead(self.machine.pointer_ahead());
        // One counter a millisecond: noise at an encoder, and a chip that lost its registers, are
        // seen within six.
        self.encoder_checked = (self.encoder_checked + 1) % UNITS;
        let unit = UnitIndex::ALL[self.encoder_checked];
        let (position, lost) = self.counters.look(unit);
        self.machine.position(unit, position);
        if let Some(chip) = lost {
            (self.machine).fault_board(Fault::CounterBus, chip, now, &mut self.reports);
        }
        if let Some(flags) = self.counters.noise(unit) {
            (self.machine).encoder_noise(unit, flags, now, &mut self.reports);
        }
        let state = self.machine.system();
        if self.machine.holds_dacs() && !dac::is_held() {
            gpio::hold_dacs_at_zero();
        }
        if dac::is_held() && dac_error.is_none() && state != SystemState::Fault {
            dac::release();
        }
        gpio::write(pins::LED_OK, state == SystemState::Running);
        gpio::write(pins::LED_FAULT, self.machine.is_faulted());

        self.watchdog.check_in(Part::Tick);
        self.watchdog.check_in(Part::Supervisor);
        if dac_error.is_none() {
            self.watchdog.check_in(Part::Dac);
        }
        if let Some(missing) = self.watchdog.tick(!self.machine.withholds_alive()) {
            // The watchdog is not fed any more and resets the board soon: record the cause now.
            crash_record::write_crash_record(
                Fault::WatchdogReset,
                missing,
                0,
                "a part of the superloop did not check in",
            );
        }
        self.clock.second(now);
        self.publish_telemetry(now);
    }

    /// Sends fault reports, status and batches that are due.
    fn publish_telemetry(&mut self, now: Micros) {
        while let Some(report) = self.reports.0.pop_front() {
            defmt::warn!(
                "fault {=u16} unit {=u8} detail {=u32:#x}",
                report.code,
                report.unit,
                report.detail
            );
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
        crash_record::set_stage(Stage::Links);
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
        let mut execute = |number: usize, link: &mut Link, byte: u8| {
            if let Some(frame) = link.push(byte) {
                let response = machine.command(
                    number,
                    &frame,
                    time::now(),
                    clock.figures,
                    link.counters(),
                    reports,
                );
                if let Some(response) = response {
                    link.reply(frame.seq, response);
                }
            }
        };
        if let Some(usb) = usb {
            usb.serve(|byte| execute(links::USB, usb_link, byte));
        }
        usart.receive(BYTES_PER_PASS, |byte| {
            execute(links::USART, usart_link, byte)
        });
        usart.send(time::now());
        self.watchdog.check_in(Part::Links);
    }

    /// Sleeps until the superloop has work: a sample, a millisecond, USB. Other interrupts (about
    /// twelve I2C events per sample) run their handlers and the core sleeps again.
    pub fn sleep(&mut self) {
        crash_record::set_stage(Stage::Sleep);
        let pass = time::now().since(self.clock.pass_began);
        self.clock.longest_pass = self.clock.longest_pass.max(pass);
        while !(self.events.ready() || time::tick_waits() || usb::calls()) {
            // Interrupts are masked, so one that arrives between the check and WFI still ends the
            // sleep (WFI wakes on a pending interrupt). Its handler runs when they are unmasked.
            self.clock.asleep += cortex_m::interrupt::free(|_| {
                if self.events.ready() || time::tick_waits() || usb::calls() {
                    return 0;
                }
                let before = time::now();
                cortex_m::asm::dsb();
                cortex_m::asm::wfi();
                time::now().since(before)
            });
        }
        self.clock.pass_began = time::now();
    }
}

/// Passes a sample to the batches of both links.
fn stream(links: &mut [Link; LINKS], machine: &Machine, at: Micros, sample: wire::message::Sample) {
    for (number, link) in links.iter_mut().enumerate() {
        if let Some(batch) = link.batcher.push(at, sample, machine.decimation(number)) {
            link.send(BoardMessage::Samples(batch));
        }
    }
}

impl Clock {
    /// Updates the sleep figure once a second.
    fn second(&mut self, now: Micros) {
        let elapsed = now.since(self.second_began);
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
