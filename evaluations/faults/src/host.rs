//! The host on the serial line: setpoints that move, every 10 ms, and what becomes of its frames.
//! It foretells the reels' speeds as `forcectl` does where a rig file says nothing else.

use crate::injection::Injection as I;
use crate::random::Random;
use control::geometry::{cable_direction, cos_cell_angle, direction_q14, inv_cos_q16};
use control::unit::REEL_SPEED_MAX_UM_PER_S;
use nalgebra::Vector3;
use plant::Plant;
use robot::motion::Foretold;
use std::collections::VecDeque;
use wire::message::{Command, Response, UnitSetpoint};
use wire::{
    encode, BoardFrame, BoardMessage, Decoder, HostFrame, ABI_VERSION, MAX_FRAME, SCHEMA_HASH,
    UNITS,
};

/// Period of the host, in milliseconds.
const PERIOD_MS: u64 = 10;
/// Validity of its setpoints, in milliseconds.
const VALID_MS: u16 = 100;
/// The phase of the wave of its setpoints where it begins to hold, as though it had run for so many
/// milliseconds. The expected faults were written for a wave that ran from power-on and a host that
/// began to hold after 1.12 s.
const WAVE_MS: u64 = 1_120;
/// Swing of its setpoints around the tensions that it holds, N.
pub const SWING_N: f64 = 0.6;
/// How long it holds before it foretells the reels' speeds, in milliseconds: as `forcectl
/// set-force`, which waits until slack is taken up.
const FORETELLS_AFTER_MS: u64 = 1_000;
/// Frames that it remembers, to send one again.
const REMEMBERED: usize = 50;

/// A step of what the host does besides its setpoints.
#[derive(Debug, Clone)]
pub enum Step {
    /// Sends a command. A refusal, or no answer, ends everything: the host sends nothing any more.
    Must(Command),
    /// Sends a command and goes on whatever comes of it.
    Try(Command),
    /// Waits until the board is ready and its motors have power, at most so many milliseconds; then
    /// it ends everything.
    Ready(u64),
    /// Waits for so many milliseconds.
    Wait(u64),
    /// Holds these tensions from now on, N; `None`: none.
    Hold(Option<[f64; UNITS]>),
}

/// Longest time for an answer, in milliseconds.
const ANSWER_MS: u64 = 20;

/// See the module's page.
#[derive(Clone)]
pub struct Host {
    /// What it is to do, the present step first, and since when it has done that, in milliseconds.
    steps: VecDeque<Step>,
    since_ms: Option<u64>,
    /// Tensions that it holds, N, and since when, in milliseconds; `None`: it sends nothing.
    hold: Option<([f64; UNITS], u64)>,
    /// What it knows of the robot's motion while it holds.
    foretold: Foretold,
    /// Everything random on its side.
    pub random: Random,
    seq: u16,
    /// The command that is to be answered.
    asked: u16,
    next_ms: u64,
    /// It pauses until then.
    paused: bool,
    old_frames: VecDeque<Vec<u8>>,
    decoder: Decoder,
    /// What is injected, and how often it may still act.
    active: Vec<(I, u32)>,
}

impl Host {
    /// A host that sends nothing yet.
    #[must_use]
    pub fn new(random: Random) -> Self {
        Self {
            steps: VecDeque::new(),
            since_ms: None,
            hold: None,
            foretold: Foretold::default(),
            random,
            seq: 0,
            asked: 0,
            next_ms: 0,
            paused: false,
            old_frames: VecDeque::new(),
            decoder: Decoder::new(),
            active: Vec::new(),
        }
    }

    /// What it does next, in place of what it was to do.
    pub fn plan(&mut self, steps: impl IntoIterator<Item = Step>) {
        self.steps = steps.into_iter().collect();
        self.since_ms = None;
    }

    /// Steps that are left.
    #[must_use]
    pub fn steps_left(&self) -> usize {
        self.steps.len()
    }

    fn next_step(&mut self) {
        self.steps.pop_front();
        self.since_ms = None;
    }

    /// A millisecond of its steps: bytes for the line. `ready`: the board is ready, and its motors
    /// have power.
    pub fn act(&mut self, now_ms: u64, ready: bool) -> Vec<u8> {
        if now_ms < self.next_ms && self.paused {
            return Vec::new();
        }
        let Some(step) = self.steps.front().cloned() else {
            return Vec::new();
        };
        let first = self.since_ms.is_none();
        let waited_ms = now_ms - *self.since_ms.get_or_insert(now_ms);
        match step {
            Step::Must(command) | Step::Try(command) if first => {
                let frame = self.frame(command);
                return self.on_the_line(frame);
            }
            Step::Try(_) if waited_ms >= ANSWER_MS => self.next_step(),
            Step::Must(_) if waited_ms >= ANSWER_MS => self.give_up(),
            Step::Ready(_) if ready && waited_ms > 1 => self.next_step(),
            Step::Ready(ms) if waited_ms >= ms => self.give_up(),
            Step::Wait(ms) if waited_ms >= ms => self.next_step(),
            Step::Hold(tensions_n) => {
                self.hold = tensions_n.map(|tensions_n| (tensions_n, now_ms));
                self.foretold = Foretold::default();
                self.next_step();
            }
            Step::Must(_) | Step::Try(_) | Step::Ready(_) | Step::Wait(_) => {}
        }
        Vec::new()
    }

    /// What the board has sent.
    pub fn hear(&mut self, bytes: &[u8]) {
        let Some(response) = self.response(bytes) else {
            return;
        };
        match (self.steps.front(), response) {
            (Some(Step::Must(_)), Response::Rejected(_)) => self.give_up(),
            (Some(Step::Must(_) | Step::Try(_)), _) => self.next_step(),
            _ => {}
        }
    }

    fn give_up(&mut self) {
        self.steps.clear();
        self.since_ms = None;
        self.hold = None;
    }

    /// Puts an injection in force at `now_ms`.
    pub fn inject(&mut self, what: I, now_ms: u64) {
        let often = match what {
            I::FrameBit(_, n) | I::FrameCut(n) | I::Replay(n) | I::Garbage(n) => n,
            _ => u32::MAX,
        };
        match what {
            I::HostStops => self.give_up(),
            I::HostPauses(ms) => {
                self.next_ms = now_ms + u64::from(ms);
                self.paused = true;
            }
            _ => {}
        }
        self.active.push((what, often));
    }

    fn find<T>(&self, pick: impl Fn(&I) -> Option<T>) -> Option<T> {
        self.active.iter().find_map(|(what, _)| pick(what))
    }

    fn is(&self, what: I) -> bool {
        self.active.iter().any(|(active, _)| *active == what)
    }

    /// As [`Self::find`], for what acts a limited number of times; a find uses one of them up.
    fn take<T>(&mut self, pick: impl Fn(&I) -> Option<T>) -> Option<T> {
        let (what, left) =
            (self.active.iter_mut()).find(|(what, left)| *left > 0 && pick(what).is_some())?;
        *left -= u32::from(*left != u32::MAX);
        pick(what)
    }

    /// A command as a frame.
    pub fn frame(&mut self, command: Command) -> Vec<u8> {
        self.seq = self.seq.wrapping_add(1);
        if !matches!(command, Command::Setpoints { .. }) {
            self.asked = self.seq;
        }
        let frame = HostFrame {
            seq: self.seq,
            command,
        };
        let mut room = [0; MAX_FRAME];
        let length = encode(&frame, &mut room).expect("fits");
        room[..length].to_vec()
    }

    /// The response to the last command, where the board's bytes have it.
    pub fn response(&mut self, bytes: &[u8]) -> Option<Response> {
        let mut found = None;
        for byte in bytes {
            if let Ok(Some(frame)) = self.decoder.push::<BoardFrame>(*byte) {
                match frame.message {
                    BoardMessage::Reply(reply) if reply.seq == self.asked => {
                        found = Some(reply.response);
                    }
                    _ => {}
                }
            }
        }
        found
    }

    /// What another program sends over the other link at `now_ms`.
    pub fn elsewhere(&self, now_ms: u64) -> Vec<Command> {
        if now_ms < self.next_ms || !self.is(I::StatusElsewhere) {
            return Vec::new();
        }
        let hello = Command::Hello {
            abi: ABI_VERSION,
            schema: SCHEMA_HASH,
        };
        vec![hello, Command::GetStatus, Command::Disarm]
    }

    /// The bytes that reach the line at `now_ms`.
    pub fn send(&mut self, now_ms: u64, plant: &Plant) -> Vec<u8> {
        if now_ms < self.next_ms {
            return Vec::new();
        }
        self.paused = false;
        let slow = self.find(|what| match what {
            I::HostSlow(ms) => Some(u64::from(*ms)),
            _ => None,
        });
        self.next_ms = now_ms + slow.unwrap_or(PERIOD_MS);
        let Some((hold_n, since_ms)) = self.hold else {
            return Vec::new();
        };
        let held_ms = now_ms - since_ms;
        let velocity = (held_ms >= FORETELLS_AFTER_MS)
            .then(|| {
                let now_s = now_ms as f64 * 1e-3;
                let tip_m = plant.tip_position_m().into();
                self.foretold.see(now_s, tip_m, now_s)
            })
            .flatten();
        let command = self.setpoints(hold_n, (held_ms + WAVE_MS) as f64 * 1e-3, plant, velocity);
        let frame = self.frame(command);
        self.on_the_line(frame)
    }

    /// `velocity`: of the tip, m/s, where it is told.
    fn setpoints(
        &self,
        hold_n: [f64; UNITS],
        t_s: f64,
        plant: &Plant,
        velocity: Option<Vector3<f64>>,
    ) -> Command {
        let offset = self.find(|what| match what {
            I::SetpointOffset(n) => Some(*n),
            _ => None,
        });
        let tip = plant.tip_position_m().into();
        let units = std::array::from_fn(|unit| {
            let parameters = plant.parameters(unit);
            let direction = cable_direction(parameters.position_m.into(), tip);
            let axis: Vector3<f64> = parameters.axis.into();
            let cos = direction.and_then(|direction| cos_cell_angle(direction, -axis));
            let factor = self.find(|what| match what {
                I::WrongCosine(u, factor) if *u == unit => Some(*factor),
                _ => None,
            });
            let inv_cos = cos.and_then(inv_cos_q16).unwrap_or(65_536);
            let out_of_range = self.find(|what| match what {
                I::SetpointRange(u, value) if *u == unit => Some(*value),
                _ => None,
            });
            let wave = SWING_N * (6.0 * t_s + unit as f64).sin();
            let tension_n = hold_n[unit] + wave + offset.unwrap_or(0.0);
            let told = if self.is(I::WrongDirections) {
                Some(Vector3::z())
            } else {
                direction
            };
            UnitSetpoint {
                tension_un: out_of_range.unwrap_or((tension_n.max(0.0) * 1e6) as i32),
                inv_cos_q16: (f64::from(inv_cos) * factor.unwrap_or(1.0)) as i32,
                direction_q14: told.map_or([0; 3], |d| direction_q14(&d)),
                reel_um_per_s: velocity
                    .zip(told)
                    .map(|(velocity, direction)| (direction.dot(&velocity) * 1e6).round() as i32)
                    .filter(|speed| speed.abs() <= REEL_SPEED_MAX_UM_PER_S),
            }
        });
        Command::Setpoints {
            valid_ms: VALID_MS,
            units,
        }
    }

    /// What arrives of a frame.
    fn on_the_line(&mut self, mut frame: Vec<u8>) -> Vec<u8> {
        self.old_frames.push_back(frame.clone());
        if self.old_frames.len() > REMEMBERED {
            self.old_frames.pop_front();
        }
        if let Some(bit) = self.take(|what| match what {
            I::FrameBit(bit, _) => Some(*bit as usize),
            _ => None,
        }) {
            let bit = bit % (8 * frame.len());
            frame[bit / 8] ^= 1 << (bit % 8);
        }
        if self
            .take(|what| matches!(what, I::FrameCut(_)).then_some(()))
            .is_some()
        {
            frame.truncate(frame.len() / 2);
        }
        if self
            .take(|what| matches!(what, I::Replay(_)).then_some(()))
            .is_some()
        {
            frame = self.old_frames.front().cloned().unwrap_or(frame);
        }
        if self
            .take(|what| matches!(what, I::Garbage(_)).then_some(()))
            .is_some()
        {
            let noise = (0..20).map(|_| self.random.bits() as u8).collect();
            frame = [noise, frame].concat();
        }
        frame
    }
}
