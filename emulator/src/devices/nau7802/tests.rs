//! Tests of the model against the datasheet.

use super::*;

/// A chip and a clock, as a bus master without time limits sees it.
struct Bench {
    chip: Nau7802,
    t_ns: u64,
    complaints: Complaints,
    bridge: f64,
    edges: Vec<u64>,
}

impl Bench {
    fn new(seed: u64) -> Self {
        Self {
            chip: Nau7802::new(1, seed),
            t_ns: 1_000,
            complaints: Complaints::default(),
            bridge: 0.0,
            edges: Vec::new(),
        }
    }

    fn write(&mut self, register: u8, value: u8) {
        assert!(self.chip.start(false, self.t_ns, &mut self.complaints));
        assert!(self.chip.write(register, self.t_ns, &mut self.complaints));
        assert!(self.chip.write(value, self.t_ns, &mut self.complaints));
        self.chip.stop();
    }

    fn read(&mut self, register: u8, bytes: usize) -> Vec<u8> {
        assert!(self.chip.start(false, self.t_ns, &mut self.complaints));
        self.chip.write(register, self.t_ns, &mut self.complaints);
        assert!(self.chip.start(true, self.t_ns, &mut self.complaints));
        let read = (0..bytes).map(|_| self.chip.read(self.t_ns)).collect();
        self.chip.stop();
        read
    }

    fn code(&mut self) -> i32 {
        sign_extend(&self.read(0x12, 3))
    }

    fn wait(&mut self, ns: u64) {
        let end = self.t_ns + ns;
        while let Some(at) = self.chip.next_event().filter(|at| *at <= end) {
            let bridge = self.bridge;
            if self.chip.advance(at, |_, _| bridge) {
                self.edges.push(at);
            }
        }
        self.t_ns = end;
    }

    fn until_ready(&mut self) {
        for _ in 0..10_000 {
            if self.chip.drdy() == Some(true) {
                return;
            }
            self.wait(100_000);
        }
        panic!("no DRDY within a second");
    }

    /// The documented start-up at 320 SPS and gain 128.
    fn bring_up(&mut self) {
        self.write(0x00, 0x01);
        self.write(0x00, 0x00);
        self.write(0x00, 0x02);
        self.wait(400_000);
        self.write(0x00, 0x86);
        self.write(0x01, 0x2F);
        self.write(0x02, 0x70);
        self.write(0x15, 0x30);
        self.write(0x02, 0x74);
        self.wait(400_000_000);
        self.write(0x00, 0x96);
    }
}

#[test]
fn power_up_ready_takes_about_200_us_and_the_revision_a_moment_more() {
    let mut bench = Bench::new(1);
    assert_eq!(bench.read(0x1F, 1), [0]);
    bench.write(0x00, 0x02);
    bench.wait(150_000);
    assert_eq!(bench.read(0x00, 1), [0x02]);
    bench.wait(100_000);
    assert_eq!(bench.read(0x00, 1), [0x0A]);
    bench.wait(1_100_000);
    assert_eq!(bench.read(0x1F, 1), [0x0F]);
}

#[test]
fn registers_come_up_as_documented_and_auto_increment() {
    let mut bench = Bench::new(1);
    let all = bench.read(0x00, 0x12);
    let mut expected = [0u8; 0x12];
    (expected[0x07], expected[0x0E]) = (0x80, 0x80);
    assert_eq!(all, expected);
    bench.write(0x03, 0x55);
    assert_eq!(bench.read(0x7F, 2), [0x00, 0x00], "0x7F wraps to 0x00");
    assert_eq!(bench.read(0x02, 3), [0x00, 0x55, 0x00]);
}

#[test]
fn reset_is_a_level() {
    let mut bench = Bench::new(1);
    bench.write(0x01, 0x2F);
    bench.write(0x00, 0x01);
    bench.write(0x01, 0x2F);
    assert_eq!(bench.read(0x00, 2), [0x01, 0x00]);
    assert!(!bench.complaints.is_empty());
    bench.write(0x00, 0x00);
    bench.write(0x01, 0x2F);
    assert_eq!(bench.read(0x01, 1), [0x2F]);
}

#[test]
fn nothing_converts_before_cycle_start_and_six_conversions_settle() {
    let mut bench = Bench::new(3);
    bench.write(0x00, 0x86);
    bench.wait(400_000);
    bench.write(0x02, 0x70);
    bench.wait(100_000_000);
    assert!(bench.edges.is_empty());
    let start = bench.t_ns;
    bench.write(0x00, 0x96);
    bench.wait(100_000_000);
    let first = bench.edges[0] - start;
    assert!(
        (7.0 * 3.03e6..7.0 * 3.23e6).contains(&(first as f64)),
        "{first}"
    );
}

#[test]
fn drdy_stays_high_until_read_and_an_old_result_is_repeated() {
    let mut bench = Bench::new(4);
    bench.bring_up();
    bench.until_ready();
    let edges = bench.edges.len();
    bench.wait(20_000_000);
    assert_eq!(bench.chip.drdy(), Some(true));
    assert_eq!(bench.edges.len(), edges, "unread: no further edge");
    assert_eq!(bench.read(0x00, 1)[0] & 0x20, 0x20);
    let first = bench.code();
    assert_eq!(bench.chip.drdy(), Some(false));
    assert_eq!(bench.code(), first);
    assert_eq!(bench.chip.conversions_read, 1);
    assert!(bench.chip.conversions >= 6);
}

#[test]
fn the_latch_holds_all_24_bits_while_the_next_result_arrives() {
    let mut bench = Bench::new(5);
    bench.bring_up();
    bench.until_ready();
    bench.bridge = 1e-3;
    bench.chip.start(false, bench.t_ns, &mut bench.complaints);
    bench.chip.write(0x12, bench.t_ns, &mut bench.complaints);
    bench.chip.start(true, bench.t_ns, &mut bench.complaints);
    let high = bench.chip.read(bench.t_ns);
    let before = bench.chip.latch;
    bench.wait(4_000_000);
    let rest = [bench.chip.read(bench.t_ns), bench.chip.read(bench.t_ns)];
    assert_eq!(sign_extend(&[high, rest[0], rest[1]]), before);
    assert_eq!(
        bench.chip.conversions_read, 0,
        "the next one was ready first"
    );
}

#[test]
fn the_clock_is_within_three_percent_and_every_chip_has_its_own() {
    let rates: Vec<f64> = (1..=6)
        .map(|unit| {
            let mut bench = Bench::new(9);
            bench.chip = Nau7802::new(unit, 9);
            bench.bring_up();
            bench.until_ready();
            bench.edges.clear();
            for _ in 0..2_000 {
                bench.wait(500_000);
                bench.code();
            }
            (bench.edges.len() - 1) as f64
                / ((bench.edges[bench.edges.len() - 1] - bench.edges[0]) as f64 * 1e-9)
        })
        .collect();
    for (k, rate) in rates.iter().enumerate() {
        assert!((310.0..330.5).contains(rate), "unit {}: {rate}", k + 1);
        assert!(rates.iter().filter(|other| *other == rate).count() == 1);
    }
}

#[test]
fn scale_and_noise_are_the_datasheets() {
    let mut bench = Bench::new(6);
    bench.bring_up();
    assert!((bench.chip.lsb_v() - 1.397e-9).abs() < 1e-12);
    let mut mean = |bridge| {
        bench.bridge = bridge;
        let mut codes = Vec::new();
        for _ in 0..2_000 {
            bench.until_ready();
            codes.push(f64::from(bench.code()));
        }
        let mean = codes.iter().sum::<f64>() / codes.len() as f64;
        let variance = codes.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / codes.len() as f64;
        (mean, variance.sqrt() * 1.397e-9)
    };
    let (zero, noise) = mean(0.0);
    let (loaded, _) = mean(1e-3);
    assert!((noise - 300e-9).abs() < 20e-9, "{noise}");
    // 1 mV/V at 3.0 V is 3 mV: 3e-3 / 1.397e-9 codes.
    assert!((loaded - zero - 3e-3 / 1.396_983_9e-9).abs() < 50.0);
}

#[test]
fn the_result_saturates() {
    let mut bench = Bench::new(7);
    bench.bring_up();
    for (bridge, code) in [(1.0, 0x7F_FFFF), (-1.0, -0x80_0000)] {
        bench.bridge = bridge;
        bench.until_ready();
        bench.code();
        bench.until_ready();
        assert_eq!(bench.code(), code);
    }
}

#[test]
fn calibration_takes_344_ms_and_a_gain_change_spoils_it() {
    let mut bench = Bench::new(8);
    bench.write(0x00, 0x86);
    bench.wait(400_000);
    bench.write(0x01, 0x2F);
    bench.write(0x02, 0x74);
    bench.wait(300_000_000);
    assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0x04);
    bench.write(0x02, 0x70);
    assert_eq!(
        bench.read(0x02, 1)[0] & 0x04,
        0x04,
        "CALS ignores writes while set"
    );
    assert_eq!(
        bench.read(0x02, 1)[0] & 0xF3,
        0x70,
        "the other bits take them"
    );
    bench.wait(70_000_000);
    assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0x00);
    assert!(bench.chip.is_calibrated());
    bench.write(0x01, 0x2E);
    assert!(!bench.chip.is_calibrated());
    bench.write(0x02, 0x74);
    bench.write(0x01, 0x2F);
    bench.wait(400_000_000);
    assert_eq!(
        bench.read(0x02, 1)[0] & 0x0C,
        0x08,
        "gain moved under the calibration"
    );
    bench.write(0x02, 0x74);
    bench.wait(400_000_000);
    assert_eq!(
        bench.read(0x02, 1)[0] & 0x0C,
        0x00,
        "a valid calibration clears CAL_ERR"
    );
}

#[test]
fn calibrating_with_the_analog_part_off_fails() {
    let mut bench = Bench::new(8);
    bench.write(0x00, 0x02);
    bench.wait(400_000);
    bench.write(0x02, 0x74);
    bench.wait(400_000_000);
    assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0x08);
}

#[test]
fn the_adc_register_reads_back_only_without_otp_select() {
    let mut bench = Bench::new(1);
    bench.write(0x15, 0x30);
    assert_eq!(bench.read(0x15, 1), [0x30]);
    bench.write(0x1B, 0x80);
    assert_eq!(bench.read(0x15, 1), [0xFF]);
}

#[test]
fn fast_read_is_shifted_for_a_standard_controller() {
    let mut bench = Bench::new(4);
    bench.bring_up();
    bench.until_ready();
    bench.write(0x11, 0x40);
    let expected = bench.chip.result as u32 & 0xFF_FFFF;
    bench.chip.start(true, bench.t_ns, &mut bench.complaints);
    let bytes = [bench.chip.read(bench.t_ns), bench.chip.read(bench.t_ns)];
    assert_eq!(u32::from(bytes[0]), expected >> 16);
    assert_eq!(
        u32::from(bytes[1]),
        expected >> 7 & 0xFF,
        "bit 15 went into the acknowledge"
    );
    assert!(!bench.complaints.is_empty());
}

#[test]
fn an_unplugged_chip_is_silent_and_starts_over_when_plugged_in() {
    let mut bench = Bench::new(4);
    bench.bring_up();
    bench.until_ready();
    bench.chip.unplug();
    assert_eq!(bench.chip.drdy(), None);
    assert_eq!(bench.chip.next_event(), None);
    assert!(!bench.chip.start(false, bench.t_ns, &mut bench.complaints));
    bench.chip.plug();
    assert_eq!(bench.read(0x00, 3), [0, 0, 0]);
    bench.chip.nack();
    assert!(!bench.chip.start(false, bench.t_ns, &mut bench.complaints));
    bench.chip.plug();
    assert!(bench.chip.start(false, bench.t_ns, &mut bench.complaints));
}

#[test]
fn a_spike_hits_one_conversion() {
    let mut bench = Bench::new(4);
    bench.bring_up();
    bench.until_ready();
    let before = bench.code();
    bench.chip.spike(1_000_000);
    bench.until_ready();
    let hit = bench.code();
    bench.until_ready();
    let after = bench.code();
    assert!((hit - before - 1_000_000).abs() < 3_000);
    assert!((after - before).abs() < 3_000);
}

/// Settled results of a load, and of the six conversions before them where they are reported.
fn results(bench: &mut Bench, count: usize) -> Vec<i32> {
    (0..count)
        .map(|_| {
            bench.until_ready();
            bench.code()
        })
        .collect()
}

#[test]
fn unsettled_conversions_are_reported_in_the_variant_only() {
    for reports in [false, true] {
        let mut bench = Bench::new(10);
        bench.chip.defects().reports_unsettled = reports;
        // A load of some 860,000 codes, far above what a zero can miss.
        bench.bridge = 4e-4;
        bench.bring_up();
        let start = bench.t_ns;
        let codes = results(&mut bench, 9);
        let settled = f64::from(codes[8]);
        let first = (bench.edges[0] - start) as f64;
        if reports {
            assert!((3.03e6..3.23e6).contains(&first), "{first}");
            let shares = codes[..6].iter().map(|code| f64::from(*code) / settled);
            for (share, expected) in shares.zip(SETTLING) {
                // The zero of a chip is up to a fifth of this load.
                assert!(
                    (share - expected).abs() < 0.3 * (1.0 - expected) + 0.01,
                    "{codes:?}"
                );
            }
        } else {
            assert!((7.0 * 3.03e6..7.0 * 3.23e6).contains(&first), "{first}");
        }
        for code in &codes[if reports { 6 } else { 0 }..] {
            assert!((f64::from(*code) - settled).abs() < 3_000.0, "{codes:?}");
        }
        // A change of the rate settles again.
        bench.write(0x02, 0x30);
        let edges = bench.edges.len();
        bench.wait(13_000_000);
        assert_eq!(bench.edges.len() > edges, reports);
    }
}

#[test]
fn a_chip_that_runs_free_needs_no_cycle_start_and_does_not_stop() {
    let mut bench = Bench::new(11);
    bench.chip.defects().free_runs = true;
    bench.write(0x00, 0x86);
    bench.wait(400_000);
    bench.write(0x02, 0x70);
    bench.wait(25_000_000);
    assert_eq!(bench.edges.len(), 1, "DRDY with CS = 0");
    bench.code();
    bench.write(0x00, 0x96);
    bench.wait(4_000_000);
    assert_eq!(bench.edges.len(), 2, "CS starts no cycle");
    bench.code();
    bench.write(0x00, 0x86);
    bench.wait(4_000_000);
    assert_eq!(bench.edges.len(), 3, "CS = 0 stops nothing");
    bench.write(0x00, 0x82);
    bench.code();
    bench.wait(100_000_000);
    assert_eq!(
        bench.edges.len(),
        3,
        "without the analog part nothing converts"
    );
}

#[test]
fn a_calibration_writes_the_coefficients_of_the_channel_that_is_selected() {
    let mut bench = Bench::new(12);
    bench.bring_up();
    let first = bench.read(0x03, 3);
    assert_ne!(first, [0, 0, 0]);
    assert_eq!(bench.read(0x0A, 3), [0, 0, 0]);
    bench.write(0x02, 0xF0);
    bench.write(0x02, 0xF4);
    bench.wait(400_000_000);
    assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0);
    assert_eq!(bench.read(0x03, 3), first);
    assert_ne!(bench.read(0x0A, 3), [0, 0, 0]);
    // Each channel's results use its own.
    bench.write(0x02, 0x70);
    bench.until_ready();
    let code = bench.code();
    for register in 0x03..=0x05 {
        bench.write(register, 0);
    }
    bench.code();
    bench.until_ready();
    let without = bench.code();
    assert!((without - code - sign_extend(&[first[0], first[1], first[2]])).abs() < 3_000);
}

/// What published drivers do that work on silicon: the rate before the analog part, or 600 ms of
/// waiting (TRDY: five samples and 100 ms at the rate in force); the revision after PUA; ten
/// results read away before the calibration.
#[test]
fn habits_of_drivers_that_work_on_silicon_work_here() {
    for rate_first in [true, false] {
        for free_runs in [true, false] {
            let mut bench = Bench::new(13);
            bench.chip.defects().free_runs = free_runs;
            bench.write(0x00, 0x01);
            bench.write(0x00, 0x02);
            bench.wait(1_000_000);
            if rate_first {
                bench.write(0x02, 0x30);
                bench.write(0x00, 0x06);
                bench.wait(162_500_000);
            } else {
                bench.write(0x00, 0x06);
                bench.wait(600_000_000);
                bench.write(0x02, 0x30);
            }
            assert_eq!(bench.read(0x1F, 1)[0] & 0x0F, 0x0F);
            bench.write(0x01, 0x27);
            bench.write(0x00, 0x86);
            bench.write(0x15, 0x30);
            bench.write(0x1C, 0x80);
            if !free_runs {
                bench.write(0x00, 0x96);
            }
            results(&mut bench, 10);
            bench.write(0x02, 0x34);
            bench.wait(400_000_000);
            assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0);
            let zero = results(&mut bench, 1)[0];
            assert!(zero.abs() < 25_000, "{zero}");
            assert!(bench.complaints.is_empty(), "{:?}", bench.complaints);
        }
    }
}

/// The variant: each of the habits above is needed.
#[test]
fn a_chip_that_starts_slowly_calibrates_only_after_what_published_drivers_wait_for() {
    // After PUA, and after CS, ms; whether the calibration is valid. Sixteen conversions at 320 SPS
    // take 48.5 to 51.6 ms, TRDY 115.6 ms.
    for (after_power, after_start, valid) in [
        (0, 120, true),
        (0, 110, false),
        (100, 52, true),
        (200, 45, false),
    ] {
        let mut bench = Bench::new(14);
        bench.chip.defects().starts_slowly = true;
        bench.write(0x00, 0x02);
        bench.wait(2_000_000);
        assert_eq!(bench.read(0x1F, 1), [0], "without PUA");
        bench.write(0x01, 0x2F);
        bench.write(0x02, 0x70);
        bench.write(0x00, 0x86);
        assert_eq!(bench.read(0x1F, 1), [0x0F]);
        bench.wait(after_power * 1_000_000);
        bench.write(0x00, 0x96);
        bench.wait(after_start * 1_000_000);
        bench.write(0x02, 0x74);
        bench.wait(400_000_000);
        let failed = bench.read(0x02, 1)[0] & bit::CAL_ERR != 0;
        assert_eq!(failed, !valid, "{after_power} and {after_start} ms");
        // The next try needs no wait.
        bench.write(0x02, 0x74);
        bench.wait(400_000_000);
        assert_eq!(bench.read(0x02, 1)[0] & 0x0C, 0);
    }
}
