//! `agree`: the same scenario with the same plant on the embedded rig and on Renode, compared
//! sample by sample.
//!
//! Both machines run the same image and get the same bytes at the same virtual times; nothing that
//! one of them says decides what it is told next. What they share is the plant with its seed.
//! Devices, buses and noise are two implementations, so that samples agree in the mean and not bit
//! by bit; the table gives each difference that is left with its reason, and the program fails
//! where one is larger than its reason explains.

use control::{Config, MotorState, SystemState};
use emulator_link::{receive, send, Injection, Request, Response, LINK_VERSION};
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, ExitCode, Stdio};
use wire::message::{flags, Command, HostFrame, Sample, UnitConfig, UnitSetpoint, DIRECTION_ONE};
use wire::{encode, BoardFrame, BoardMessage, Decoder, ABI_VERSION, MAX_FRAME, SCHEMA_HASH, UNITS};

const MS: u64 = 1_000_000;
/// Friction at a pull of T newtons, both ways: measured law of the rig, in DAC counts.
const COUNTS_PER_N: f64 = 282.22;
/// Cable per encoder count, as in the built-in rig file: the counters count down while a reel winds
/// in.
const TRAVEL_NM: i32 = -4_229;

const USAGE: &str = "\
usage: agree --elf FILE --rig PROGRAM --renode-rig PROGRAM [--seed N]

  --elf FILE            firmware image (ELF) to boot
  --rig PROGRAM         the embedded rig's program
  --renode-rig PROGRAM  the program that runs Renode
  --seed N              seed of everything random (default 1)
  -h, --help            print this

`cargo xtask agree` builds the programs and gives all but the seed.";

fn main() -> ExitCode {
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(why) => {
            eprintln!("agree: {why}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<bool, String> {
    let mut elf = None;
    let mut programs = [None, None];
    let mut seed = "1".to_owned();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        if ["-h", "--help"].contains(&word.as_str()) {
            println!("{USAGE}");
            return Ok(true);
        }
        let value = words
            .next()
            .ok_or_else(|| format!("{word} needs a value\n{USAGE}"))?;
        match word.as_str() {
            "--elf" => elf = Some(PathBuf::from(value)),
            "--rig" => programs[0] = Some(PathBuf::from(value)),
            "--renode-rig" => programs[1] = Some(PathBuf::from(value)),
            "--seed" => seed = value,
            _ => return Err(format!("{word}: unknown\n{USAGE}")),
        }
    }
    let elf = elf.ok_or("--elf is missing")?;
    let [Some(rig), Some(renode)] = programs else {
        return Err("--rig and --renode-rig are both needed".to_owned());
    };
    // Side by side: they share nothing.
    let other = {
        let (elf, seed) = (elf.clone(), seed.clone());
        std::thread::spawn(move || scenario(&renode, &elf, &seed))
    };
    let a = scenario(&rig, &elf, &seed)?;
    let b = other
        .join()
        .map_err(|_| "the thread that drives Renode panicked".to_owned())??;
    Ok(compare(&a, &b, &seed))
}

/// Messages of one machine during the scenario.
#[derive(Default)]
struct RunLog {
    machine: String,
    samples: Vec<(u64, Sample)>,
    states: Vec<(f64, u8)>,
    unit_states: [Vec<u8>; UNITS],
    faults: Vec<(u8, u16)>,
    refused: usize,
    damaged: usize,
}

/// The parts of the scenario in which samples are compared: name, from, to in ms, setpoint of each
/// unit in N.
const WINDOWS: [(&str, u64, u64, [f64; UNITS]); 3] = [
    ("slack", 3_900, 4_900, [0.0; UNITS]),
    ("hold 4 N", 6_000, 7_000, [4.0; UNITS]),
    ("7 and 3 N", 8_000, 9_000, [7.0, 7.0, 7.0, 3.0, 3.0, 3.0]),
];

fn scenario(program: &Path, elf: &Path, seed: &str) -> Result<RunLog, String> {
    let mut m = Machine::start(program, elf, seed)?;
    m.until(500)?;
    m.request(&Command::Hello {
        abi: ABI_VERSION,
        schema: SCHEMA_HASH,
    })?;
    m.until(550)?;
    for unit in 0..UNITS {
        let unit = u8::try_from(unit).unwrap_or(u8::MAX);
        m.request(&Command::StageConfig {
            unit,
            config: UnitConfig {
                travel_nm_per_count: TRAVEL_NM,
                ..Config::nominal()
            },
        })?;
        m.until(560 + 10 * u64::from(unit))?;
    }
    m.request(&Command::CommitConfig)?;
    m.until(650)?;
    m.request(&Command::ClearFaults)?;
    m.until(2_500)?;
    m.request(&Command::Stream { decimation: 1 })?;
    m.request(&Command::Zero { units: 0x3F })?;
    m.until(5_000)?;
    m.request(&Command::Arm)?;
    m.hold([4.0; UNITS], 7_000)?;
    m.hold([7.0, 7.0, 7.0, 3.0, 3.0, 3.0], 9_000)?;
    m.inject(Injection::UnplugSensor(3))?;
    m.hold([7.0, 7.0, 7.0, 3.0, 3.0, 3.0], 9_500)?;
    m.request(&Command::Disarm)?;
    m.until(10_000)?;
    m.inject(Injection::EStop(true))?;
    m.until(10_200)?;
    m.inject(Injection::EStop(false))?;
    m.until(10_250)?;
    m.request(&Command::ClearFaults)?;
    m.until(10_400)?;
    Ok(std::mem::take(&mut m.log))
}

/// A machine behind the lock-step link.
struct Machine {
    child: Child,
    to: BufWriter<ChildStdin>,
    from: BufReader<ChildStdout>,
    decoder: Decoder,
    seq: u16,
    now_ns: u64,
    waiting: Vec<u8>,
    log: RunLog,
}

impl Machine {
    fn start(program: &Path, elf: &Path, seed: &str) -> Result<Self, String> {
        let mut child = std::process::Command::new(program)
            .arg("--elf")
            .arg(elf)
            .args(["--seed", seed])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| format!("{}: {e}", program.display()))?;
        let (Some(to), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(format!("{}: no pipes", program.display()));
        };
        let mut machine = Self {
            child,
            to: BufWriter::new(to),
            from: BufReader::new(from),
            decoder: Decoder::new(),
            seq: 0,
            now_ns: 0,
            waiting: Vec::new(),
            log: RunLog::default(),
        };
        match machine.ask(&Request::Hello {
            version: LINK_VERSION,
        })? {
            Response::Ready {
                version,
                machine: name,
                ..
            } if version == LINK_VERSION => {
                machine.log.machine = name;
                Ok(machine)
            }
            other => Err(format!(
                "{}: no `Ready` response: {other:?}",
                program.display()
            )),
        }
    }

    fn ask(&mut self, request: &Request) -> Result<Response, String> {
        send(&mut self.to, request)
            .and_then(|()| receive(&mut self.from))
            .map_err(|e| format!("{}: {e}", self.log.machine))
    }

    fn inject(&mut self, injection: Injection) -> Result<(), String> {
        match self.ask(&Request::Inject(injection))? {
            Response::Done => Ok(()),
            other => Err(format!("{}: {injection:?}: {other:?}", self.log.machine)),
        }
    }

    /// Queues a command for the next advance.
    fn request(&mut self, command: &Command) -> Result<(), String> {
        self.seq = self.seq.wrapping_add(1);
        let frame = HostFrame {
            seq: self.seq,
            command: command.clone(),
        };
        let mut room = [0; MAX_FRAME];
        let length = encode(&frame, &mut room).map_err(|e| format!("{command:?}: {e:?}"))?;
        self.waiting.extend_from_slice(&room[..length]);
        Ok(())
    }

    fn hold(&mut self, newton: [f64; UNITS], end_ms: u64) -> Result<(), String> {
        #[allow(clippy::cast_possible_truncation)] // a few newtons
        let units = std::array::from_fn(|unit| {
            // Three pairs of opposite cables.
            let mut direction_q14 = [0; 3];
            direction_q14[unit / 2] = if unit % 2 == 0 {
                DIRECTION_ONE
            } else {
                -DIRECTION_ONE
            };
            UnitSetpoint {
                tension_un: (newton[unit] * 1e6) as i32,
                inv_cos_q16: 65_536,
                direction_q14,
                reel_um_per_s: None,
            }
        });
        while self.now_ns < end_ms * MS {
            self.request(&Command::Setpoints {
                valid_ms: 100,
                units,
            })?;
            self.until((self.now_ns / MS + 10).min(end_ms))?;
        }
        Ok(())
    }

    fn until(&mut self, at_ms: u64) -> Result<(), String> {
        let request = Request::Advance {
            duration_ns: (at_ms * MS).saturating_sub(self.now_ns),
            to_board: std::mem::take(&mut self.waiting),
        };
        let Response::Advanced(advanced) = self.ask(&request)? else {
            return Err(format!("{}: time does not pass", self.log.machine));
        };
        self.now_ns = at_ms * MS;
        for byte in advanced.from_board {
            match self.decoder.push::<BoardFrame>(byte) {
                Ok(Some(frame)) => self.log.add(frame.message),
                Ok(None) => {}
                Err(_) => self.log.damaged += 1,
            }
        }
        Ok(())
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = send(&mut self.to, &Request::Quit);
        let _ = self.child.wait();
    }
}

impl RunLog {
    fn add(&mut self, message: BoardMessage) {
        match message {
            BoardMessage::Samples(batch) => {
                for sample in batch.samples {
                    let t = u64::from(batch.t_us) + u64::from(sample.dt_us);
                    self.samples.push((t, sample));
                }
            }
            BoardMessage::Status(status) => {
                if self.states.last().is_none_or(|last| last.1 != status.state) {
                    self.states
                        .push((f64::from(status.t_us) * 1e-6, status.state));
                }
                for (known, unit) in self.unit_states.iter_mut().zip(&status.units) {
                    if known.last() != Some(&unit.state) {
                        known.push(unit.state);
                    }
                }
            }
            BoardMessage::Fault(fault) => self.faults.push((fault.unit, fault.code)),
            BoardMessage::Reply(reply) => {
                if matches!(reply.response, wire::message::Response::Rejected(_)) {
                    self.refused += 1;
                }
            }
        }
    }

    fn unit(&self, unit: usize, from_ms: u64, to_ms: u64) -> Vec<(u64, Sample)> {
        self.samples
            .iter()
            .filter(|(t, s)| {
                usize::from(s.unit) == unit && (from_ms * 1000..to_ms * 1000).contains(t)
            })
            .copied()
            .collect()
    }
}

fn board_state(number: u8) -> &'static str {
    SystemState::from_u8(number).map_or("unknown", SystemState::name)
}

fn unit_state(number: u8) -> &'static str {
    MotorState::from_u8(number).map_or("unknown", MotorState::name)
}

/// Mean and standard deviation.
fn moments(values: &[f64]) -> (f64, f64) {
    #[allow(clippy::cast_precision_loss)] // thousands
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    (mean, variance.sqrt())
}

/// Each sample of `a` with the one of `b` nearest in time, no further than half a period.
fn pairs(a: &[(u64, Sample)], b: &[(u64, Sample)]) -> Vec<(Sample, Sample)> {
    a.iter()
        .filter_map(|(t, x)| {
            let (u, y) = b.iter().min_by_key(|(u, _)| u.abs_diff(*t))?;
            (u.abs_diff(*t) <= 1_700).then_some((*x, *y))
        })
        .collect()
}

fn compare(a: &RunLog, b: &RunLog, seed: &str) -> bool {
    println!(
        "A: {}\nB: {}\nplant seed {seed}; B - A\n",
        a.machine, b.machine
    );
    let mut good = true;
    println!("window     unit   pairs  period us (A, B)   code, mean   code SD (A, B)   tension mN, mean   DAC, mean   DAC SD (A, B)");
    for (name, from, to, setpoint) in WINDOWS {
        for (unit, setpoint) in setpoint.into_iter().enumerate() {
            good &= row(a, b, (name, from, to), unit, setpoint);
        }
    }
    println!("\nlatency from DRDY to the DAC's update as the board measures it, us: median, 99th percentile, largest");
    for (tag, log) in [("A", a), ("B", b)] {
        let mut all: Vec<u16> = log
            .samples
            .iter()
            .filter(|(_, s)| s.flags & flags::ACTIVE != 0)
            .map(|(_, s)| s.latency_us)
            .collect();
        all.sort_unstable();
        if let (Some(median), Some(most), Some(last)) = (
            all.get(all.len() / 2),
            all.get(all.len() * 99 / 100),
            all.last(),
        ) {
            println!("  {tag}: {median}, {most}, {last} ({} samples)", all.len());
        }
    }
    println!("\nstates of the board");
    for (tag, log) in [("A", a), ("B", b)] {
        let line: Vec<String> = log
            .states
            .iter()
            .map(|(t, s)| format!("{} {t:.2} s", board_state(*s)))
            .collect();
        println!("  {tag}: {}", line.join(", "));
    }
    let same = |what: &str, equal: bool| {
        println!("{what}: {}", if equal { "the same" } else { "DIFFERENT" });
        equal
    };
    good &= same(
        "order of the board's states",
        a.states
            .iter()
            .map(|s| s.1)
            .eq(b.states.iter().map(|s| s.1)),
    );
    for unit in 0..UNITS {
        let names = |s: &RunLog| -> Vec<&str> {
            s.unit_states[unit].iter().map(|n| unit_state(*n)).collect()
        };
        let equal = a.unit_states[unit] == b.unit_states[unit];
        if !equal {
            println!("unit {}: A {:?}, B {:?}", unit + 1, names(a), names(b));
        }
        good &= same(
            &format!(
                "unit {}: order of states ({})",
                unit + 1,
                names(a).join(", ")
            ),
            equal,
        );
    }
    good &= same(
        &format!("faults (unit from 0, code): {:?}", a.faults),
        a.faults == b.faults,
    );
    if a.faults != b.faults {
        println!("  B: {:?}", b.faults);
    }
    println!(
        "commands refused: A {}, B {}; damaged frames: A {}, B {}",
        a.refused, b.refused, a.damaged, b.damaged
    );
    good &= a.refused == 0 && b.refused == 0 && a.damaged == 0 && b.damaged == 0;
    println!(
        "\nwhat differs, and why
  period       each machine draws its converters' RC oscillators, +-3 %, from a stream of its own
  code, mean   each calibration of the NAU7802 finds zero a little elsewhere; zeroing on the board takes it out, which
               the tensions show
  code SD      noise of the converter, drawn independently: alike in size, not in value
  tension      what is left: noise, phase of the converters, and the two implementations of the filter
  DAC          a resting reel holds any pull inside the friction band, and where the controller comes to rest in it
               depends on the noise before; larger than the band counts as a failure
  state times  a status comes every 50 ms, and bring-up waits for the converters, each at its own rate"
    );
    println!(
        "\n{}",
        if good {
            "the machines agree"
        } else {
            "the machines DISAGREE"
        }
    );
    good
}

fn row(a: &RunLog, b: &RunLog, window: (&str, u64, u64), unit: usize, setpoint: f64) -> bool {
    let (name, from, to) = window;
    let (x, y) = (a.unit(unit, from, to), b.unit(unit, from, to));
    let paired = pairs(&x, &y);
    let list = |pick: fn(&Sample) -> f64, of: &[(u64, Sample)]| -> Vec<f64> {
        of.iter().map(|(_, s)| pick(s)).collect()
    };
    let difference = |pick: fn(&Sample) -> f64| -> f64 {
        let all: Vec<f64> = paired.iter().map(|(p, q)| pick(q) - pick(p)).collect();
        moments(&all).0
    };
    #[allow(clippy::cast_precision_loss)]
    let period = |of: &[(u64, Sample)]| match (of.first(), of.last()) {
        (Some(first), Some(last)) if of.len() > 1 => {
            (last.0 - first.0) as f64 / (of.len() - 1) as f64
        }
        _ => f64::NAN,
    };
    let code = |s: &Sample| f64::from(s.adc_code);
    let dac = |s: &Sample| f64::from(s.dac_code);
    let tension = |s: &Sample| f64::from(s.tension) * 0.1;
    let (tension_mn, dac_counts) = (difference(tension), difference(dac));
    // Both ends of the friction band, the law measured on the rig (0.909 N, 0.154 N per N).
    let band = 2.0 * (0.909 + 0.154 * setpoint) * COUNTS_PER_N;
    let driven = |of: &[(u64, Sample)]| {
        of.iter()
            .all(|(_, s)| (s.flags & flags::ACTIVE != 0) == (setpoint > 0.0))
    };
    #[allow(clippy::cast_precision_loss)]
    let enough = paired.len() as f64 > 0.9 * x.len() as f64 && x.len() > 250;
    let dac_fits = if setpoint > 0.0 {
        dac_counts.abs() < band
    } else {
        dac_counts == 0.0
    };
    let findings: Vec<&str> = [
        (enough, "samples without a partner"),
        (tension_mn.abs() < 60.0, "tension"),
        (dac_fits, "DAC"),
        (driven(&x), "A's outputs not as commanded"),
        (driven(&y), "B's outputs not as commanded"),
    ]
    .into_iter()
    .filter_map(|(fits, what)| (!fits).then_some(what))
    .collect();
    println!(
        "{name:<10} {:>4} {:>7}  {:>8.1} {:>8.1} {:>12.0} {:>8.0} {:>7.0} {:>18.1} {:>11.1} {:>8.1} {:>6.1}{}",
        unit + 1,
        paired.len(),
        period(&x),
        period(&y),
        difference(code),
        moments(&list(code, &x)).1,
        moments(&list(code, &y)).1,
        tension_mn,
        dac_counts,
        moments(&list(dac, &x)).1,
        moments(&list(dac, &y)).1,
        if findings.is_empty() {
            String::new()
        } else {
            format!("   <-- {}", findings.join(", "))
        }
    );
    findings.is_empty()
}
