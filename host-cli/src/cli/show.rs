//! Progress and tables for people.

use control::MotorState;
use host_cli::force::metrics::{Metrics, SETTLED_WITHIN_N};
use host_cli::run::{describe_reach, Outcome, Phase};
use host_cli::session::{explain_fault, explain_kept, motor_state_name, system_state_name};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fmt::Write;
use std::io::IsTerminal;
use wire::message::{BoardInfo, Status};
use wire::UNITS;

/// A line of progress on the terminal; a line for each phase where there is none.
pub struct Progress {
    bar: Option<ProgressBar>,
    phase: Option<Phase>,
    quiet: bool,
}

impl Progress {
    pub fn new(quiet: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr_with_hz(10));
            if let Ok(style) = ProgressStyle::with_template("{msg:42} {bar:30} {elapsed:>4}") {
                bar.set_style(style);
            }
            bar
        });
        Self {
            bar,
            phase: None,
            quiet,
        }
    }

    pub fn at(&mut self, phase: Phase, fraction: f64) {
        if self.phase != Some(phase) {
            self.phase = Some(phase);
            match &self.bar {
                Some(bar) => bar.set_message(phase.describe()),
                None if !self.quiet => eprintln!("{} ...", phase.describe()),
                None => {}
            }
        }
        if let Some(bar) = &self.bar {
            bar.set_position((fraction.clamp(0.0, 1.0) * 1000.0) as u64);
        }
    }

    pub fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| eprintln!("{text}")),
            None => eprintln!("{text}"),
        }
    }

    pub fn done(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Tables are strings, so that writing cannot fail.
macro_rules! row {
    ($out:expr, $($arg:tt)*) => { let _ = writeln!($out, $($arg)*); };
}

fn vector(v: [f64; 3]) -> String {
    format!("{:>9.3} {:>9.3} {:>9.3}", v[0], v[1], v[2])
}

/// The table at the end of set-force.
pub fn outcome(outcome: &Outcome) -> String {
    let mut out = String::new();
    row!(
        out,
        "rig                 {}, firmware {}",
        outcome.link,
        outcome.firmware
    );
    row!(
        out,
        "configuration       CRC {:08x}, rig file {}",
        outcome.config_crc,
        &outcome.rig_hash[..12]
    );
    match &outcome.metrics {
        Some(metrics) => table(&mut out, metrics),
        None => {
            row!(
                out,
                "\nThe force was held for less than {} s: too short for figures.",
                host_cli::force::metrics::STEADY_AFTER_S
            );
        }
    }
    if let Some(latency) = outcome.latency_ms {
        let how = if latency.measured_outside {
            "edge to DAC output, by the rig"
        } else {
            "edge to DAC word, by the firmware"
        };
        row!(
            out,
            "loop latency        {:.3} ms median, {:.3} ms 99th percentile ({how})",
            latency.p50,
            latency.p99
        );
    }
    let link = outcome.link_counters;
    row!(
        out,
        "samples             {} received, {} lost before the controller; telemetry frames lost {}, damaged {}",
        outcome.samples,
        outcome.samples_lost,
        link.frames_lost,
        link.frames_bad
    );
    if outcome.amplifiers_off_s > 0.0 {
        row!(
            out,
            "amplifiers          without power for {:.3} s",
            outcome.amplifiers_off_s
        );
    }
    if let Some(reach) = outcome.reach.filter(|reach| !reach.feasible) {
        row!(out, "out of reach        {}", describe_reach(&reach));
    }
    for fault in &outcome.faults {
        let who = fault
            .unit
            .map_or_else(|| "board".to_owned(), |unit| format!("unit {unit}"));
        row!(out, "fault at {:>6.2} s   {who}: {}", fault.t_s, fault.text);
    }
    out
}

fn table(out: &mut String, m: &Metrics) {
    let source = if m.from_truth {
        "in the plant"
    } else {
        "by load cells"
    };
    row!(out, "");
    row!(out, "force at the tip, N         x         y         z");
    row!(out, "  asked             {}", vector(m.asked_n));
    row!(
        out,
        "  applied           {}   mean, {source}",
        vector(m.applied_n)
    );
    row!(
        out,
        "  error             {}   length {:.3}, RMS {:.3}",
        vector(m.error_n),
        m.tip_force_error_n,
        m.tip_force_rms_n
    );
    let along = m.settling_along_s.map_or_else(String::new, |s| {
        format!("; along the asked direction alone after {s:.2} s")
    });
    let settled = m.settling_s.map_or_else(
        || "never".to_owned(),
        |s| {
            format!(
                "after {s:.2} s, within the band for {:.1} % of the time from then on",
                100.0 * m.within_band
            )
        },
    );
    row!(
        out,
        "  settled           {settled} (within {SETTLED_WITHIN_N} N){along}"
    );
    row!(out, "");
    row!(
        out,
        "tension, N             1       2       3       4       5       6"
    );
    let units = |values: [f64; UNITS]| values.map(|v| format!("{v:>7.3}")).join(" ");
    row!(out, "  asked          {}", units(m.tension_asked_n));
    row!(
        out,
        "  {:<14} {}",
        if m.from_truth { "true" } else { "measured" },
        units(m.tension_n)
    );
    row!(out, "  RMS error      {}", units(m.tension_rms_n));
    row!(out, "");
}

/// What `status` prints.
pub fn status(info: Option<&BoardInfo>, status: &Status) -> String {
    let mut out = String::new();
    if let Some(info) = info {
        row!(
            out,
            "firmware   {} (ABI {}), core {} MHz, reset flags {:#010x}",
            info.version,
            info.abi,
            info.core_hz / 1_000_000,
            info.reset_flags
        );
        if let Some(kept) = &info.crash_record {
            row!(out, "last run   ended with {}", explain_kept(kept));
        }
    }
    row!(
        out,
        "state      {}, E-stop {}",
        system_state_name(status.state),
        if status.estop_closed {
            "closed (may run)"
        } else {
            "OPEN"
        }
    );
    if status.fault != 0 {
        row!(
            out,
            "fault      {}",
            explain_fault(status.fault, status.fault_detail)
        );
    }
    let age = if status.setpoint_age_ms == u16::MAX {
        "none".to_owned()
    } else {
        format!("{} ms old", status.setpoint_age_ms)
    };
    row!(
        out,
        "setpoints  {age}; configuration CRC {:08x}; up {:.1} s",
        status.config_crc,
        f64::from(status.t_us) * 1e-6
    );
    row!(
        out,
        "health     asleep {:.1} %, queue at most {}, frames dropped {}, bad {}, bus recoveries {}",
        f64::from(status.sleep_permille) * 0.1,
        status.queue_high_water,
        status.frames_dropped,
        status.frames_bad,
        status.bus_recoveries
    );
    row!(
        out,
        "\nunit  state      tension N   rate 1/s   samples   missed  spikes  fault"
    );
    for (i, unit) in status.units.iter().enumerate() {
        let live =
            MotorState::from_u8(unit.state) != Some(MotorState::Offline) && unit.period_us > 0;
        let (tension, rate) = if live {
            (
                format!("{:.3}", f64::from(unit.tension_un) * 1e-6),
                format!("{:.1}", 1e6 / f64::from(unit.period_us)),
            )
        } else {
            ("-".to_owned(), "-".to_owned())
        };
        let fault = if unit.fault == 0 {
            "-".to_owned()
        } else {
            explain_fault(unit.fault, unit.fault_detail)
        };
        row!(
            out,
            "{:>4}  {:<9} {:>10} {:>10} {:>9} {:>8} {:>7}  {fault}",
            i + 1,
            motor_state_name(unit.state),
            tension,
            rate,
            unit.samples,
            unit.missed,
            unit.spikes
        );
    }
    out
}
