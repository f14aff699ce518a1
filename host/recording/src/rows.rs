//! The tables of a recording: samples, control cycles, the two clocks, counters, events.

use super::table::{row, table, Utc};
use force::metrics::Step;
use run::Phase;
use session::TimedSample;
use wire::message::{Sample, UnitConfig};
use wire::UNITS;

/// Topics of the samples, units 1 to 6: programs that draw a topic as a line would mix the units of
/// one.
pub const SAMPLE_TOPICS: [&str; UNITS] = [
    "/sample/unit1",
    "/sample/unit2",
    "/sample/unit3",
    "/sample/unit4",
    "/sample/unit5",
    "/sample/unit6",
];

table! {
    /// A sample of a unit: raw codes, and the same in SI units by the configuration that the row
    /// names.
    SampleRow { "/sample" as SAMPLE_TOPICS by unit, "force_rig.Sample", "samples.parquet", "one sample of one unit; the times are those of its DRDY edge" }
    configuration: i32, "", "index of the configuration that the row was converted with";
    unit: i32, "", "unit, from 1";
    adc_code: i32, "", "code of the load cell's converter";
    encoder_counts: i32, "", "position of the encoder, lowest 32 bits";
    dac_code: i32, "", "code of the DAC, 32768 is 0 V";
    flags: i32, "", "flags of the sample (docs/protocol.md)";
    latency_s: f64, "s", "DRDY edge to DAC word, board clock";
    load_cell_n: f64, "N", "force along the load cell's axis, unfiltered: (code - zero) times scale, less curve and creep of the configuration";
    travel_m: f64, "m", "cable travel since the counter's zero, positive winding in";
    dac_v: f64, "V", "output of the DAC";
    tension_n: f64, "N", "cable tension after the filter, as the board computes it";
    setpoint_n: f64, "N", "setpoint of the tension in force";
    p_n: f64, "N", "proportional term";
    i_n: f64, "N", "integral term";
    d_n: f64, "N", "derivative and damping terms";
    ff_n: f64, "N", "feedforward";
    tip_force_n: f64, "N", "length of the force at the tip, as the board computes it";
}

table! {
    /// A cycle of the host's controller.
    CycleRow { "/cycle", "force_rig.Cycle", "cycles.parquet", "one cycle of the host's controller (100 Hz); the times are those of its end" }
    configuration: i32, "", "index of the configuration in force";
    since_command_s: f64, "s", "time since the force was commanded, host clock; negative before";
    tip_m: [f64; 3], "m", "tip of the robot, robot base frame";
    commanded_n: [f64; 3], "N", "commanded force on the tip after its slew limit, robot base frame";
    estimated_n: [f64; 3], "N", "force on the tip by the measured tensions, along the surveyed cables of the cycle before, robot base frame";
    estimated_95_n: Option<f64>, "N", "radius of the ball about estimated_n that holds the force on the tip with 95 %; missing without a calibration and in the first 0.2 s";
    applied_n: Option<[f64; 3]>, "N", "force on the tip in the plant (emulated rig), robot base frame";
    tension_setpoint_n: [f64; 6], "N", "setpoints of the cable tensions, units 1 to 6";
    measured_tension_n: [f64; 6], "N", "measured tensions, units 1 to 6";
    true_tension_n: Option<[f64; 6]>, "N", "tensions in the plant (emulated rig), units 1 to 6";
}

table! {
    /// The clocks against each other, and the bounds that they were estimated from.
    ClockRow { "/clock", "force_rig.Clock", "clock.parquet", "the clocks of host and board against each other, four times a second" }
    offset_s: f64, "s", "host time minus board time";
    offset_uncertainty_s: Option<f64>, "s", "largest error of the offset; missing before the first answered request";
    drift_ppm: f64, "ppm", "change of the offset per board time";
    drift_uncertainty_ppm: f64, "ppm", "largest error of the drift";
    contradiction_s: f64, "s", "by how much the readings contradict a steady drift; 0 on a good clock";
    utc_offset_s: f64, "s", "UTC minus host time";
    request_board_us: Option<u64>, "us", "tightest reply: board time when the board read its clock";
    request_host_ns: Option<u64>, "ns", "tightest reply: host time when it was requested";
    arrival_board_us: Option<u64>, "us", "tightest arrival: board time when the board read its clock";
    arrival_host_ns: Option<u64>, "ns", "tightest arrival: host time when it had arrived";
}

table! {
    /// What was received and lost so far.
    CounterRow { "/counters", "force_rig.Counters", "counters.parquet", "what was received and lost since the link was opened or the board's boot, once a second" }
    frames: u64, "", "good telemetry frames since the link was opened";
    frames_lost: u64, "", "frames that never arrived since the link was opened";
    frames_bad: u64, "", "frames that arrived damaged since the link was opened";
    retries: u64, "", "commands sent again since the link was opened";
    board_dropped: Option<u64>, "", "frames that the board's queue had no room for since its boot";
    board_bad: Option<u64>, "", "frames from the host that arrived damaged at the board since its boot";
    conversions_missed: Option<u64>, "", "conversions that the board did not read in time since its boot, all units";
    recorder_dropped_samples: u64, "", "samples that the recorder had no room for";
    recorder_dropped_cycles: u64, "", "cycles that the recorder had no room for";
}

table! {
    /// An event, in Foxglove's form of a log message.
    EventRow { "/log", "foxglove.Log", "events.parquet", "phases, configurations, faults, notices, losses; the phase is that from this event on" }
    timestamp: Utc, "", "the same as `utc`, by the name that Foxglove expects";
    level: i32, "", "2: information, 3: warning, 4: error (foxglove.Log)";
    name: String, "", "kind: phase, configuration, fault, notice, drops, clock";
    message: String, "", "what happened";
    file: String, "", "empty (foxglove.Log)";
    line: i32, "", "0 (foxglove.Log)";
}

/// Name of a phase in a recording.
#[must_use]
pub const fn phase_name(phase: Phase) -> &'static str {
    match phase {
        Phase::Connect | Phase::BringUp | Phase::Configure => PREPARING,
        Phase::Zero => "zeroing",
        Phase::Calibrate => "calibrating",
        Phase::Tension => "arming",
        Phase::StartRobot => "moving",
        Phase::Hold | Phase::HoldTensions => "holding",
        Phase::Excite => "exciting",
        Phase::Disarm => "ramping",
    }
}

/// Name of the event of a fault. Its time is the board's, when it was latched; that of others is
/// the host's.
pub const FAULT: &str = "fault";

/// Phase of a recording that no run drives.
pub const OBSERVING: &str = "observing";

/// Phase in which the sensors are brought up.
pub const PREPARING: &str = "preparing";

/// All names of phases.
pub const PHASES: [&str; 9] = [
    OBSERVING,
    PREPARING,
    "zeroing",
    "calibrating",
    "arming",
    "moving",
    "holding",
    "exciting",
    "ramping",
];

/// Volts of a DAC7731 code at +-10 V (straight binary, 0x8000 is 0 V).
fn dac_v(code: u16) -> f64 {
    (f64::from(code) - 32_768.0) * 20.0 / 65_536.0
}

/// When a row was, and under which phase and configuration.
#[derive(Debug, Clone, Copy)]
pub(super) struct At<'a> {
    pub(super) times: super::table::Times,
    pub(super) phase: &'a str,
    pub(super) configuration: i32,
}

impl SampleRow {
    /// From a sample, the configurations that the row names, and the force on the cell, N.
    pub(super) fn new(
        at: At<'_>,
        timed: &TimedSample,
        configs: &[UnitConfig; UNITS],
        load_cell_n: f64,
    ) -> Self {
        let s: &Sample = &timed.sample;
        let config = configs.get(usize::from(s.unit));
        let travel_m = config.map_or(0.0, |c| f64::from(c.travel_nm_per_count) * 1e-9);
        let tenth_mn = |value: i32| f64::from(value) * 1e-4;
        row!(SampleRow, at, {
            configuration: at.configuration,
            unit: i32::from(s.unit) + 1,
            adc_code: s.adc_code,
            encoder_counts: s.encoder_counts,
            dac_code: i32::from(s.dac_code),
            flags: i32::from(s.flags),
            latency_s: f64::from(s.latency_us) * 1e-6,
            load_cell_n: load_cell_n,
            travel_m: f64::from(s.encoder_counts) * travel_m,
            dac_v: dac_v(s.dac_code),
            tension_n: tenth_mn(s.tension),
            setpoint_n: tenth_mn(s.setpoint),
            p_n: tenth_mn(s.p),
            i_n: tenth_mn(s.i),
            d_n: tenth_mn(s.d),
            ff_n: tenth_mn(s.ff),
            tip_force_n: f64::from(s.tip_force_mn) * 1e-3,
        })
    }
}

impl CycleRow {
    /// From a cycle, with the radius of its estimate, N.
    pub(super) fn new(at: At<'_>, step: &Step, estimated_95_n: Option<f64>) -> Self {
        row!(CycleRow, at, {
            configuration: at.configuration,
            since_command_s: step.t_s,
            tip_m: step.tip_m.into(),
            commanded_n: step.commanded_n.into(),
            estimated_n: step.estimated_n.into(),
            estimated_95_n: estimated_95_n,
            applied_n: step.applied_n.map(Into::into),
            tension_setpoint_n: step.tension_setpoint_n,
            measured_tension_n: step.measured_tension_n,
            true_tension_n: step.true_tension_n,
        })
    }
}
