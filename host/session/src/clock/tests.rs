//! Properties of the estimate: the truth is within the uncertainty, whatever clocks and delays do.

use super::*;
use proptest::prelude::*;

/// Two clocks that drift against each other, and the delays between them.
#[derive(Debug, Clone)]
struct Clocks {
    offset_ns: f64,
    /// Drift at the start.
    drift: f64,
    /// Amplitude and period (s) of its change.
    wander: (f64, f64),
    /// Shortest and longest extra delay of requests and of frames, ns.
    request_ns: (f64, f64),
    frame_ns: (f64, f64),
    seed: u64,
}

impl Clocks {
    /// Host time of a board time, ns: the truth.
    fn host_ns(&self, board_us: f64) -> f64 {
        let t_s = board_us * 1e-6;
        let (size, period_s) = self.wander;
        let rate = std::f64::consts::TAU / period_s;
        let wandered_s = size / rate * (1.0 - (rate * t_s).cos());
        board_us * 1e3 + self.offset_ns + (self.drift * t_s + wandered_s) * 1e9
    }

    /// Readings every 10 ms, each twentieth of them a reply, for some seconds.
    fn readings(&self, seconds: u64) -> Vec<Reading> {
        let mut state = self.seed | 1;
        let mut random = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / (1u64 << 31) as f64
        };
        let mut found = Vec::new();
        for n in 0..seconds * 100 {
            let board_us = 5_000_000 + n * 10_000;
            let host_ns = self.host_ns(board_us as f64);
            let mut delay = |(least, most): (f64, f64)| least + random() * (most - least);
            let before = delay(self.request_ns);
            let after = delay(self.frame_ns);
            found.push(Reading {
                board_us,
                sent_ns: n.is_multiple_of(20).then_some((host_ns - before) as u64),
                received_ns: (host_ns + after) as u64,
            });
        }
        found
    }
}

fn clocks() -> impl Strategy<Value = Clocks> {
    (
        1e9..1e12,
        -1e-2..1e-2,
        // Drift changes by 0.01 ppm/s at most: TAU / period * size.
        (0.0..1e-6f64, 700.0..3000.0f64),
        (50e3..1e6, 0.0..8e6),
        (50e3..2e6, 0.0..10e6),
        any::<u64>(),
    )
        .prop_map(|(offset_ns, drift, wander, request, frame, seed)| Clocks {
            offset_ns,
            drift,
            wander,
            request_ns: (request.0, request.0 + request.1),
            frame_ns: (frame.0, frame.0 + frame.1),
            seed,
        })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn the_truth_is_within_the_uncertainty(clocks in clocks(), at in 0.0..1.0f64) {
        let mut live = BoardClock::live();
        let mut complete = BoardClock::complete();
        let readings = clocks.readings(90);
        for reading in &readings {
            live.push(reading);
            complete.push(reading);
        }
        // A nanosecond for the rounding of the readings.
        let holds = |estimate: &Estimate, board_us: u64| {
            let error_ns = estimate.host_ns(board_us) - clocks.host_ns(board_us as f64);
            error_ns.abs() <= estimate.uncertainty_ns + 2.0
        };
        let newest = readings[readings.len() - 1].board_us;
        let now = live.at(newest).unwrap();
        prop_assert!(holds(&now, newest), "{now:?}");
        let then = 5_000_000 + (at * 89e6) as u64;
        let estimate = complete.at(then).unwrap();
        prop_assert!(holds(&estimate, then), "{estimate:?}");
        prop_assert_eq!(estimate.contradiction_ns, 0.0);
        let drift = clocks.drift + clocks.wander.0 * (std::f64::consts::TAU / clocks.wander.1 * then as f64 * 1e-6).sin();
        prop_assert!((estimate.drift - drift).abs() <= estimate.drift_uncertainty, "{estimate:?}, {drift}");
    }

    #[test]
    fn the_shortest_delays_decide(clocks in clocks()) {
        let mut clock = BoardClock::complete();
        for reading in clocks.readings(60) {
            clock.push(&reading);
        }
        let estimate = clock.at(35_000_000).unwrap();
        // Half of the shortest way there and back; a random tenth of each side's range is not
        // reached in a minute.
        let shortest = 0.5 * (clocks.request_ns.0 + clocks.frame_ns.0);
        let range = (clocks.request_ns.1 - clocks.request_ns.0) + (clocks.frame_ns.1 - clocks.frame_ns.0);
        prop_assert!(estimate.uncertainty_ns < shortest + 0.2 * range + 20e3, "{estimate:?}");
    }

    #[test]
    fn host_and_board_time_are_inverse(offset in -1e12..1e12, drift in -0.02..0.02, ahead in 0u64..100_000_000) {
        let estimate = Estimate {
            board_us: 1_000_000_000, offset_ns: offset, uncertainty_ns: 0.0, drift, drift_uncertainty: 0.0, contradiction_ns: 0.0,
        };
        let board_us = 1_000_000_000 + ahead;
        prop_assert!((estimate.board_us(estimate.host_ns(board_us)) - board_us as f64).abs() < 1e-2);
    }
}

#[test]
fn twenty_minutes_of_wandering_clocks_stay_within_a_millisecond() {
    let clocks = Clocks {
        offset_ns: 3.2e9,
        drift: 38e-6,
        wander: (1.5e-6, 1000.0),
        request_ns: (60e3, 900e3),
        frame_ns: (700e3, 10.7e6),
        seed: 5,
    };
    let mut clock = BoardClock::complete();
    for reading in clocks.readings(1200) {
        clock.push(&reading);
    }
    for s in (5..1205).step_by(5) {
        let board_us = s * 1_000_000;
        let estimate = clock.at(board_us).unwrap();
        let error_ns = estimate.host_ns(board_us) - clocks.host_ns(board_us as f64);
        assert!(error_ns.abs() < 1e6, "at {s} s: {error_ns} ns");
        assert!(error_ns.abs() <= estimate.uncertainty_ns, "{estimate:?}");
    }
}

#[test]
fn without_a_request_the_uncertainty_is_infinite_and_without_a_reading_there_is_none() {
    let mut clock = BoardClock::live();
    assert_eq!(clock.at(0), None);
    let reading = |board_us: u64, received_ns| Reading {
        board_us,
        sent_ns: None,
        received_ns,
    };
    clock.push(&reading(1000, 3_000_000));
    clock.push(&reading(2000, 3_500_000));
    let estimate = clock.at(2000).unwrap();
    assert!(estimate.uncertainty_ns.is_infinite());
    assert_eq!(estimate.offset_ns, 1_500_000.0);
}

#[test]
fn a_clock_that_jumps_is_a_contradiction() {
    let mut clock = BoardClock::complete();
    let clocks = Clocks {
        offset_ns: 1e9,
        drift: 0.0,
        wander: (0.0, 1000.0),
        request_ns: (1e5, 1e5),
        frame_ns: (1e5, 1e5),
        seed: 1,
    };
    for (n, mut reading) in clocks.readings(20).into_iter().enumerate() {
        // Both ways around the middle.
        if (900..1100).contains(&n) {
            let later = 50_000_000;
            reading.received_ns += later;
            reading.sent_ns = reading.sent_ns.map(|sent| sent + later);
        }
        clock.push(&reading);
    }
    let estimate = clock.at(15_000_000).unwrap();
    assert!(estimate.contradiction_ns > 10e6, "{estimate:?}");
    assert!(estimate.uncertainty_ns >= estimate.contradiction_ns);
}
