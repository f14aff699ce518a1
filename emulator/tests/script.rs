//! The rig from power-on to the motor, without the firmware: a script interpreter of a few Thumb
//! instructions stands in for an image, so that these tests need no ARM toolchain and know every
//! register access they make.

use emulator::image::{Image, FLASH_BASE};
use emulator::{allowed, Options, Rig};
use emulator_link::{Advanced, Injection};
use std::path::Path;

/// One step of a script: operation, address, value.
type Step = [u32; 3];

const fn put(address: u32, value: u32) -> Step {
    [0, address, value]
}

/// Polls until one of the bits of `mask` is set.
const fn until(address: u32, mask: u32) -> Step {
    [1, address, mask]
}

const fn copy(from: u32, to: u32) -> Step {
    [3, from, to]
}

/// Two instructions, 8 ns, a turn.
const fn turns(count: u32) -> Step {
    [4, 0, count]
}

const fn sleep() -> Step {
    [5, 0, 0]
}

const SCRIPT: u32 = FLASH_BASE + 0x100;

/// The interpreter: `r4` walks the script; `r0` to `r2` are the step.
fn interpreter() -> Vec<u16> {
    let branch = |condition: bool, at: i32, to: i32| -> u16 {
        let offset = to - at - 2;
        if condition {
            0xD000 | (offset & 0xFF) as u16
        } else {
            0xE000 | (offset & 0x7FF) as u16
        }
    };
    let (next, wait, jump, copy, delay, sleep) = (5, 19, 23, 25, 28, 31);
    let mut code = vec![
        0xB672, // cpsid i
        0x2408, // movs r4, #8
        0x0624, // lsls r4, r4, #24
        0x34FF, // adds r4, #255
        0x3401, // adds r4, #1
        0xCC07, // next: ldmia r4!, {r0, r1, r2}
    ];
    for (operation, target) in [(1, wait), (2, jump), (3, copy), (4, delay), (5, sleep)] {
        code.push(0x2800 | operation); // cmp r0, #operation
        code.push(branch(true, code.len() as i32, target));
    }
    code.push(0x600A); // str r2, [r1]
    code.push(branch(false, code.len() as i32, next));
    code.push(0xBF00); // nop
    assert_eq!(code.len() as i32, wait);
    code.push(0x680B); // wait: ldr r3, [r1]
    code.push(0x4213); // tst r3, r2
    code.push(0xD000 | 0xFC); // beq wait
    code.push(branch(false, code.len() as i32, next));
    code.push(0x460C); // jump: mov r4, r1
    code.push(branch(false, code.len() as i32, next));
    code.push(0x680B); // copy: ldr r3, [r1]
    code.push(0x6013); // str r3, [r2]
    code.push(branch(false, code.len() as i32, next));
    code.push(0x3A01); // delay: subs r2, #1
    code.push(0xD100 | 0xFD); // bne delay
    code.push(branch(false, code.len() as i32, next));
    assert_eq!(code.len() as i32, sleep);
    code.push(0xBF30); // sleep: wfi
    code.push(branch(false, code.len() as i32, next));
    code
}

/// An ELF image of the interpreter with `script`, which starts over at step `again` when it ends.
fn image(script: &[Step], again: usize) -> Image {
    let mut flash = vec![0u8; 0x100];
    flash[..4].copy_from_slice(&0x2002_0000u32.to_le_bytes());
    flash[4..8].copy_from_slice(&(FLASH_BASE + 9).to_le_bytes());
    for (n, half) in interpreter().into_iter().enumerate() {
        flash[8 + 2 * n..10 + 2 * n].copy_from_slice(&half.to_le_bytes());
    }
    let end = [2, SCRIPT + 12 * again as u32, 0];
    for word in script.iter().chain([&end]).flatten() {
        flash.extend(word.to_le_bytes());
    }
    let mut file = vec![0x7F, b'E', b'L', b'F', 1, 1, 1];
    file.resize(16, 0);
    let halves = |file: &mut Vec<u8>, halves: &[u16]| {
        halves
            .iter()
            .for_each(|half| file.extend(half.to_le_bytes()));
    };
    let words = |file: &mut Vec<u8>, words: &[u32]| {
        words
            .iter()
            .for_each(|word| file.extend(word.to_le_bytes()));
    };
    halves(&mut file, &[2, 40]);
    words(&mut file, &[1, FLASH_BASE + 9, 52, 0, 0x0500_0400]);
    halves(&mut file, &[52, 32, 1, 40, 0, 0]);
    let size = flash.len() as u32;
    words(
        &mut file,
        &[1, 84, FLASH_BASE, FLASH_BASE, size, size, 5, 4],
    );
    file.extend(flash);
    Image::new(Path::new("script"), file).expect("a bootable image")
}

const RCC: u32 = 0x5802_4400;
const I2C1: u32 = 0x4000_5400;
const SPI1: u32 = 0x4001_3000;
const USART3: u32 = 0x4000_4800;
const IWDG: u32 = 0x5800_4800;
const EXTI: u32 = 0x5800_0000;
const ICPR: u32 = 0xE000_E280;

const fn port(letter: char) -> u32 {
    0x5802_0000 + 0x400 * (letter as u32 - 'A' as u32)
}

/// Clocks on, pins and buses as in docs/wiring.md, on the 64 MHz of the internal oscillator.
fn set_up() -> Vec<Step> {
    vec![
        put(RCC + 0xE0, 0x7F),              // AHB4ENR: ports A to G
        put(RCC + 0xE8, 1 << 18 | 1 << 21), // APB1LENR: USART3, I2C1
        put(RCC + 0xF0, 1 << 12),           // APB2ENR: SPI1
        put(RCC + 0x50, 4 << 12),           // D2CCIP1R: SPI1 on per_ck
        // Port F: MUX_RST, LDAC, RST high; PF0 input with pull-down.
        put(port('F') + 0x18, 0xD000),
        put(port('F') + 0x0C, 0x0000_0AAA),
        put(port('F'), 0x5100_0000),
        // Port G: all selects high.
        put(port('G') + 0x18, 0x3F),
        put(port('G'), 0x0000_0555),
        // PA5, PB5: SPI1. PB8, PB9: I2C1, open drain. PD8, PD9: USART3.
        put(port('A') + 0x20, 5 << 20),
        put(port('A'), 0xABFF_FBFF),
        put(port('B') + 0x20, 5 << 20),
        put(port('B') + 0x24, 0x44),
        put(port('B') + 0x04, 0x300),
        put(port('B'), 0xFFFA_FABF & !(1 << 10)),
        put(port('D') + 0x24, 0x77),
        put(port('D'), 0xFFFA_FFFF),
        put(USART3 + 0x0C, 32), // 64 MHz / 2 Mbaud
        put(USART3, 1 << 29 | 0xD),
        put(I2C1 + 0x10, 0x1030_1D2F),
        put(I2C1, 1),
        // SPI1: 32 bits (a script stores words; the DAC keeps the last 16), mode 3, transmit only,
        // pins kept.
        put(SPI1 + 0x08, 3 << 28 | 31),
        put(SPI1, 1 << 12),
        put(
            SPI1 + 0x0C,
            1 << 31 | 1 << 26 | 1 << 25 | 1 << 24 | 1 << 22 | 1 << 17,
        ),
        put(SPI1, 1 << 12 | 1),
        put(SPI1, 1 << 12 | 1 | 1 << 9),
    ]
}

/// A write of `bytes`, with the automatic stop.
fn i2c_write(address: u32, bytes: &[u8]) -> Vec<Step> {
    let mut steps = vec![put(
        I2C1 + 4,
        address << 1 | (bytes.len() as u32) << 16 | 1 << 25 | 1 << 13,
    )];
    for byte in bytes {
        steps.push(until(I2C1 + 0x18, 2));
        steps.push(put(I2C1 + 0x28, (*byte).into()));
    }
    steps.extend([until(I2C1 + 0x18, 0x20), put(I2C1 + 0x1C, 0x20)]);
    steps
}

/// Unit 1 converts at 320 SPS; its DRDY wakes the core.
fn unit_1() -> Vec<Step> {
    let mut steps = i2c_write(0x70, &[0x01]);
    steps.extend(i2c_write(0x2A, &[0x00, 0x02]));
    steps.push(turns(40_000));
    steps.extend(i2c_write(0x2A, &[0x00, 0x86]));
    steps.extend(i2c_write(0x2A, &[0x01, 0x2F, 0x70]));
    steps.extend(i2c_write(0x2A, &[0x15, 0x30]));
    steps.extend([
        put(RCC + 0xF4, 2),       // APB4ENR: SYSCFG
        put(0x5800_0408, 0x5),    // EXTICR1: line 0 from port F
        put(EXTI, 1),             // RTSR1
        put(EXTI + 0x80, 1),      // CPUIMR1
        put(0xE000_E100, 1 << 6), // ISER0: EXTI0
    ]);
    steps.extend(i2c_write(0x2A, &[0x00, 0x96]));
    steps
}

/// Sleeps until DRDY, sends the result's three bytes on the serial line, moves DAC 1.
fn sample() -> Vec<Step> {
    let mut steps = vec![
        sleep(),
        put(EXTI + 0x88, 1),
        put(ICPR, 1 << 6),
        put(I2C1 + 4, 0x2A << 1 | 1 << 16 | 1 << 13),
        until(I2C1 + 0x18, 2),
        put(I2C1 + 0x28, 0x12),
        until(I2C1 + 0x18, 0x40),
        put(I2C1 + 4, 0x2A << 1 | 3 << 16 | 1 << 25 | 1 << 13 | 1 << 10),
    ];
    for _ in 0..3 {
        steps.extend([until(I2C1 + 0x18, 4), copy(I2C1 + 0x24, USART3 + 0x28)]);
    }
    steps.extend([
        until(I2C1 + 0x18, 0x20),
        put(I2C1 + 0x1C, 0x20),
        put(port('G') + 0x18, 1 << 16),
        put(SPI1 + 0x20, 0x8A00),
        turns(20),
        until(SPI1 + 0x14, 0x1000),
        put(port('G') + 0x18, 1),
        put(port('F') + 0x18, 1 << 30),
        put(port('F') + 0x18, 1 << 14),
    ]);
    steps
}

fn sampling_image() -> Image {
    let mut script = set_up();
    script.extend(unit_1());
    let again = script.len();
    script.extend(sample());
    image(&script, again)
}

fn boot(image: &Image, seed: u64) -> Rig {
    let options = Options {
        seed,
        ..Options::default()
    };
    Rig::boot_image(image, options).expect("boots")
}

fn run(rig: &mut Rig, milliseconds: u64) -> Advanced {
    rig.advance(milliseconds * 1_000_000, &[]).expect("runs")
}

#[test]
fn a_sample_goes_from_the_bridge_to_the_motor() {
    let mut rig = boot(&sampling_image(), 1);
    let advanced = run(&mut rig, 100);
    let report = rig.report().expect("reports");
    assert_eq!(
        report.register_events,
        [],
        "nothing refused, nothing misused"
    );
    assert!(report.conversions[0] > 20, "{:?}", report.conversions);
    assert!(report.conversions[0] - report.conversions_read[0] <= 1);
    assert_eq!(report.conversions[1..], [0; 5]);
    assert_eq!(
        advanced.from_board.len() as u64,
        3 * report.conversions_read[0]
    );
    assert!(report.sleep_fraction > 0.9, "{}", report.sleep_fraction);

    let code = i32::from_be_bytes([
        advanced.from_board[0],
        advanced.from_board[1],
        advanced.from_board[2],
        0,
    ]) >> 8;
    assert!(code != 0 && code.abs() < 1 << 22, "{code}");

    assert_eq!(report.latencies.len() as u64, report.conversions_read[0]);
    for latency in &report.latencies {
        let stamps = [
            latency.drdy_ns,
            latency.bus_start_ns,
            latency.data_ns,
            latency.dac_word_ns,
            latency.dac_update_ns,
        ];
        assert!(
            stamps.windows(2).all(|pair| pair[0] < pair[1]),
            "{stamps:?}"
        );
        // Plain read at 400 kHz: 54 clocks less the last acknowledge.
        let bus = latency.data_ns - latency.bus_start_ns;
        assert!((120_000..160_000).contains(&bus), "{bus}");
        assert_eq!(latency.unit, 1);
        assert!(!latency.mux_select);
    }
    let last = advanced.truth.last().expect("rows of truth");
    assert_eq!(last.t_ns, 100_000_000);
    assert_eq!(advanced.truth.len(), 100);
    assert_eq!(last.dac_v[0], 10.0 * f64::from(0x0A00) / 32_768.0);
    assert_eq!(last.dac_v[1..], [0.0; 5]);
    assert!(!last.amplifier_on, "the alive line never toggled");
}

#[test]
fn one_seed_is_one_run_and_another_seed_another() {
    let image = sampling_image();
    let whole = |seed, pieces: &[u64]| {
        let mut rig = boot(&image, seed);
        let (mut bytes, mut truth) = (Vec::new(), Vec::new());
        rig.set_robot_moving(true);
        for piece in pieces {
            let advanced = run(&mut rig, *piece);
            bytes.extend(advanced.from_board);
            truth.extend(advanced.truth);
        }
        (bytes, truth, rig.report().expect("reports").latencies)
    };
    let first = whole(7, &[60]);
    assert!(!first.0.is_empty());
    assert!(first == whole(7, &[60]), "the same run twice");
    assert!(first == whole(7, &[10, 1, 49]), "however it is sliced");
    let other = whole(8, &[60]);
    assert_ne!(first.0, other.0);
    assert_ne!(first.1, other.1);
}

#[test]
fn bytes_to_the_board_cross_at_line_rate() {
    let mut script = set_up();
    let again = script.len();
    script.extend([
        until(USART3 + 0x1C, 0x20),
        copy(USART3 + 0x24, USART3 + 0x28),
    ]);
    let mut rig = boot(&image(&script, again), 1);
    run(&mut rig, 1);
    let sent: Vec<u8> = (0..200).collect();
    let echoed = rig.advance(500_000, &sent).expect("runs").from_board;
    // 10 bits at 2 Mbaud are 5 us: 100 bytes in half a millisecond, less those on the wire.
    assert!((96..=100).contains(&echoed.len()), "{}", echoed.len());
    let rest = rig.advance(2_000_000, &[]).expect("runs").from_board;
    assert_eq!([echoed, rest].concat(), sent);
    assert_eq!(rig.report().expect("reports").register_events, []);
}

#[test]
fn a_hung_core_is_reset_by_the_watchdog_and_can_see_why() {
    let mut script = set_up();
    script.extend([
        copy(RCC + 0xD0 + 2, USART3 + 0x28),
        put(IWDG, 0xCCCC),
        put(IWDG, 0x5555),
        put(IWDG + 4, 0),
        put(IWDG + 8, 80),
        turns(100_000),
        put(IWDG, 0xAAAA),
    ]);
    let again = script.len();
    script.push(turns(1_000));
    let mut rig = boot(&image(&script, again), 1);
    let advanced = run(&mut rig, 25);
    // 81 counts of 4 / 32 kHz are 10.1 ms, behind 0.8 ms of set-up.
    assert_eq!(advanced.resets, 2);
    // RSR bits 23 to 16 at boot: a power-on, then IWDG1RSTF (bit 26) beside it. The copy reads the
    // upper half.
    assert_eq!(advanced.from_board.len(), 3);
    assert_eq!(rig.last_reset(), Some("Model(\"IWDG\")"));
    let cause = rig.read_memory(RCC + 0xD0, 4);
    assert!(cause.is_err(), "registers are no memory");
}

#[test]
fn accesses_that_the_part_refuses_are_reported() {
    let script = [
        put(USART3 + 0x0C, 32),   // clock gate shut
        put(0x4000_0000 - 4, 1),  // nothing there
        put(RCC + 0xE8, 1 << 21), // I2C1 on
        put(I2C1, 1),
        put(I2C1 + 0x10, 0x1234), // TIMINGR with PE set
        put(RCC + 0xF4, 1 << 16),
        put(0x5800_4000, 1), // RTC: no model behind it
    ];
    let mut rig = boot(&image(&script, script.len()), 1);
    run(&mut rig, 1);
    let events = rig.report().expect("reports").register_events;
    let find = |place: &str| {
        (events.iter().find(|event| event.place.starts_with(place)))
            .unwrap_or_else(|| panic!("{place} in {events:?}"))
            .what
            .clone()
    };
    assert!(find("USART3.BRR").contains("gated"));
    assert!(find("0x3ffffffc").contains("no register"));
    assert!(find("I2C1.TIMINGR").contains("RM0433"));
    assert_eq!(allowed::unexpected(&events).len(), events.len());
}

#[test]
fn a_held_sda_keeps_the_start_from_leaving_until_nine_clocks() {
    let mut script = set_up();
    let scl = |level: u32| put(port('B') + 0x18, if level == 1 { 1 << 8 } else { 1 << 24 });
    script.push(turns(250_000)); // 2 ms: SDA gets held meanwhile
    script.push(put(I2C1 + 4, 0x70 << 1 | 1 << 16 | 1 << 25 | 1 << 13));
    script.push(turns(25_000)); // 0.2 ms: an address would long be through
    script.push(copy(I2C1 + 0x18, USART3 + 0x28)); // ISR
    script.push(put(I2C1, 0));
    script.push(put(port('B') + 0x18, 0x300));
    script.push(put(port('B'), 0xFFF5_FABF & !(1 << 10))); // PB8, PB9 as outputs
    for _ in 0..9 {
        script.extend([scl(0), turns(300), scl(1), turns(300)]);
    }
    script.push(put(port('B'), 0xFFFA_FABF & !(1 << 10)));
    script.push(put(I2C1, 1));
    script.extend(i2c_write(0x70, &[0x01]));
    script.push(put(USART3 + 0x28, 0x5A));
    let again = script.len();
    script.push(turns(1_000));
    let mut rig = boot(&image(&script, again), 1);
    run(&mut rig, 1);
    rig.inject(Injection::StuckSda).expect("holds SDA");
    let advanced = run(&mut rig, 4);
    // TXE alone in the low byte: no TXIS, no NACKF, no STOPF; then the transfer after the nine
    // clocks.
    assert_eq!(advanced.from_board, [0x01, 0x5A]);
}

#[test]
fn injections_that_make_no_sense_are_refused() {
    let mut rig = boot(&sampling_image(), 1);
    run(&mut rig, 1);
    for (injection, reason) in [
        (Injection::UnplugSensor(9), "units are 1 to 6"),
        (Injection::FlipBit(0x2400_0000, 8), "bits are 0 to 7"),
        (Injection::FlipBit(0x6000_0000, 0), "no memory"),
    ] {
        let error = rig.inject(injection).expect_err("refused").to_string();
        assert!(error.contains(reason), "{error}");
    }
    rig.inject(Injection::FlipBit(0x2400_0000, 3)).expect("RAM");
    assert_eq!(rig.read_memory(0x2400_0000, 1).expect("RAM"), [0x08]);
}
