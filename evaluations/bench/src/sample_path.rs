//! The path of a sample from the DRDY edge to the DAC: times, losses, load, and the speed of the
//! emulation.

use crate::figures::{Figures, Goal};
use crate::rig::start;
use emulator_link::{Latency, Report};
use test_stand::{quantile, Stand};
use wire::UNITS;

/// What was recorded of a run.
struct Run {
    first: Report,
    last: Report,
    latencies: Vec<Latency>,
    /// The same while the host foretells the reels' speeds.
    foretold: Vec<Latency>,
    /// Conversions that the board missed.
    missed: u32,
    /// Telemetry frames that got lost.
    frames_lost: u64,
}

/// Begin and end of a stage of a sample, in nanoseconds.
type Stage = fn(&Latency) -> (u64, u64);

/// Six units, armed, the robot moving: latency, losses, load, speed of the emulation.
pub fn sample_path(figures: &mut Figures, seconds: u32) -> Result<(), String> {
    println!("\nsample path: six units at 320 SPS with drifting clocks, {seconds} emulated seconds, seed 1");
    let mut link = start(1)?;
    let mut stand = Stand::armed(&mut link, 4.0);
    stand.robot(true);
    stand.run(2.0);
    let first = stand.report();
    let counters = stand.session.counters();
    let before = stand.status();
    let mut latencies: Vec<Latency> = Vec::new();
    let mut last = first.clone();
    for second in 0..seconds {
        stand.run(1.0);
        stand.session.drain();
        if second % 30 == 29 || second + 1 == seconds {
            last = stand.report();
            latencies.append(&mut last.latencies);
            eprint!(
                "\r{:>4} of {seconds} s, {:.2} times real time ",
                second + 1,
                speed(&first, &last)
            );
        }
    }
    eprintln!();
    let after = stand.status();
    let missed = (0..6)
        .map(|unit| after.units[unit].missed - before.units[unit].missed)
        .sum();
    let frames_lost = stand.session.counters().frames_lost - counters.frames_lost;
    // Slow enough to be believed for good, whatever the reels do.
    stand.robot(false);
    stand.hold_foretold([4.0; UNITS], Some(500));
    stand.run(1.0);
    stand.report();
    stand.run(2.0);
    let run = Run {
        foretold: stand.report().latencies,
        first,
        last,
        latencies,
        missed,
        frames_lost,
    };
    latency(figures, &run.latencies);
    losses(figures, &run, seconds);
    load(figures, &run);
    Ok(())
}

/// Times from edge to DAC, whole and by stage.
fn latency(figures: &mut Figures, latencies: &[Latency]) {
    let ms = |stage: Stage| -> Vec<f64> {
        latencies
            .iter()
            .map(stage)
            .map(|(from, to)| to.saturating_sub(from) as f64 * 1e-6)
            .collect()
    };
    let whole = ms(|l| (l.drdy_ns, l.dac_update_ns));
    figures.add(
        "drdy_to_dac_ms_p50",
        quantile(&whole, 0.5),
        Goal::AtMost(0.20),
        "DRDY edge to DAC update, median",
    );
    figures.add(
        "drdy_to_dac_ms_p99",
        quantile(&whole, 0.99),
        Goal::AtMost(0.45),
        "the same, 99th percentile",
    );
    figures.add(
        "drdy_to_dac_ms_max",
        quantile(&whole, 1.0),
        Goal::None,
        "the same, worst",
    );
    let stages: [(&'static str, Stage, &'static str); 4] = [
        (
            "stage_wait_ms_p50",
            |l| (l.drdy_ns, l.bus_start_ns),
            "stage: DRDY edge to START, waiting for the bus",
        ),
        (
            "stage_bus_ms_p50",
            // Select and register pointer are usually sent before the edge: that time does not
            // count.
            |l| (l.bus_start_ns.max(l.drdy_ns), l.data_ns),
            "stage: START, or the edge where the bus was ahead of it, to the last data byte",
        ),
        (
            "stage_compute_ms_p50",
            |l| (l.data_ns, l.dac_word_ns),
            "stage: last byte to the DAC word",
        ),
        (
            "stage_dac_ms_p50",
            |l| (l.dac_word_ns, l.dac_update_ns),
            "stage: DAC word to the LDAC edge",
        ),
    ];
    for (key, stage, what) in stages {
        figures.add(key, quantile(&ms(stage), 0.5), Goal::None, what);
    }
    figures.add(
        "stage_wait_ms_p99",
        quantile(&ms(stages[0].1), 0.99),
        Goal::None,
        "waiting for the bus, 99th percentile",
    );
    let selects =
        latencies.iter().filter(|l| l.mux_select).count() as f64 / latencies.len().max(1) as f64;
    figures.add(
        "mux_select_fraction",
        selects,
        Goal::None,
        "samples whose multiplexer select was in the path",
    );
    // The converter's sinc4 at 320 SPS delays by two conversion periods (device facts: 6.25 ms).
    figures.add(
        "force_to_dac_ms_p50",
        6.25 + quantile(&whole, 0.5),
        Goal::None,
        "with the converter's filter (6.25 ms group delay) in it",
    );
}

/// Conversions and frames that got lost.
fn losses(figures: &mut Figures, run: &Run, seconds: u32) {
    let lost: u64 = (0..6)
        .map(|unit| {
            let made = run.last.conversions[unit] - run.first.conversions[unit];
            let read = run.last.conversions_read[unit] - run.first.conversions_read[unit];
            // One conversion may be between its edge and its reading at either end.
            made.saturating_sub(read).saturating_sub(1)
        })
        .sum();
    figures.add(
        "samples_lost",
        lost as f64 + f64::from(run.missed) + run.frames_lost as f64,
        Goal::AtMost(0.0),
        "conversions not read in time, and telemetry frames lost",
    );
    figures.add(
        "samples_taken",
        run.latencies.len() as f64,
        Goal::None,
        "samples that moved a DAC",
    );
    figures.add(
        "emulated_minutes",
        f64::from(seconds) / 60.0,
        Goal::None,
        "how long that was",
    );
}

/// Instructions, sleep and the speed of the emulation.
fn load(figures: &mut Figures, run: &Run) {
    let instructions: Vec<f64> = run
        .latencies
        .iter()
        .map(|l| l.instructions as f64)
        .collect();
    figures.add(
        "instructions_per_sample",
        quantile(&instructions, 0.5),
        Goal::AtMost(2000.0),
        "from the I2C result to the DAC word, median, interrupts in between included",
    );
    let foretold: Vec<f64> = run.foretold.iter().map(|l| l.instructions as f64).collect();
    figures.add(
        "instructions_per_sample_foretold",
        quantile(&foretold, 0.5),
        Goal::AtMost(2200.0),
        "the same while the host foretells the reels' speeds",
    );
    figures.add(
        "instructions_per_sample_p99",
        quantile(&instructions, 0.99),
        Goal::None,
        "the same, 99th percentile",
    );
    let slept = run.last.sleep_fraction * run.last.now_ns as f64
        - run.first.sleep_fraction * run.first.now_ns as f64;
    figures.add(
        "cpu_sleep_fraction",
        slept / (run.last.now_ns - run.first.now_ns) as f64,
        Goal::AtLeast(0.9),
        "time the core slept",
    );
    figures.add(
        "emulated_seconds_per_second",
        speed(&run.first, &run.last),
        Goal::AtLeast(1.0),
        "speed of the emulation (this machine)",
    );
}

/// Virtual seconds per second on the wall between two reports.
fn speed(from: &Report, to: &Report) -> f64 {
    (to.now_ns - from.now_ns) as f64 / (to.wall_ns - from.wall_ns).max(1) as f64
}
