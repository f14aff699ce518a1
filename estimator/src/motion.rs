//! What the motion of the joints tells about friction: the state that rows of positions, velocities
//! and efforts leave behind.
//!
//! Friction depends on where a contact has been, not on where it is. A contact that has just turned
//! round is bent elastically (presliding) until it slides. A *stop operator* with threshold r
//! follows the position, but never by more than r: its value over r runs from -1 to 1 within a
//! travel of 2 r after a reversal. A bank of them with different thresholds spans every hysteresis
//! of this kind (Prandtl, Ishlinskii); how much of each there is, a fit finds.
//!
//! All filters are causal. A first-order filter with time constant T delays a slow signal by T.
//!
//! Where a stream begins, nobody knows how far the contacts are bent. Two more stop operators,
//! begun at both ends, enclose each: once they meet, which a travel of 2 r in one direction brings
//! about, the past before the start has no more influence. A contact that begins to move is taken
//! to have slid in that direction before. Across a gap the operators go on with what the positions
//! moved in it, and the bounds open by what the joint could have gone back and forth.

use robot::kinematics::COUPLING;

/// Inputs of a row: positions, velocities, efforts of the first three joints.
pub const INPUTS: usize = 9;
/// Names of the inputs, as the dataset's columns have them.
pub const INPUT_NAMES: [&str; INPUTS] = [
    "joint_position_1",
    "joint_position_2",
    "joint_position_3",
    "joint_velocity_1",
    "joint_velocity_2",
    "joint_velocity_3",
    "joint_effort_1",
    "joint_effort_2",
    "joint_effort_3",
];
/// Thresholds of the stop operators: rad, rad, m. From twice a count of the encoder to the travel
/// in which the arm's own position controller builds up the torque of full friction.
pub const THRESHOLDS: [[f64; LEVELS]; 3] = [
    [1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3, 3.2e-3],
    [1e-4, 2e-4, 4e-4, 8e-4, 1.6e-3, 3.2e-3],
    [1.5e-5, 3e-5, 6e-5, 1.2e-4, 2.5e-4, 5e-4],
];
/// Thresholds of a joint.
pub const LEVELS: usize = 6;
/// Places that stop operators follow: three motors, two links, and the same links with stretched
/// cables. The shoulder's link moves with its motor.
pub const PLACES: usize = 7;
/// Stop operators.
pub const STOPS: usize = PLACES * LEVELS;
/// Joints whose thresholds the stop operators of a place have.
const BANKS: [usize; PLACES] = [0, 1, 2, 1, 2, 1, 2];
/// Share of a place's friction that may be unknown where its state counts as known.
const KNOWN: f64 = 0.02;
/// Time after a start or a gap in which filters run in, s: twice the longest time constant of the
/// estimate's memories but those of a tip that stands (0.5 s).
const RUN_IN_S: f64 = 1.0;
/// Gap after which nothing of before is used, s: the joints can have been anywhere.
pub const LONGEST_GAP_S: f64 = 10.0;
/// Speed in a gap per the speed before it: what was not seen may have been faster. Estimate.
const FASTER: f64 = 1.5;
/// Stiffness of the cables at the joints, N·m/rad, N·m/rad, N/m (raven2_sim). It need not be exact:
/// with half or twice the elbow's the residual of its balance was the same within 1 %.
const CABLE_STIFFNESS: [f64; 3] = [5_700.0, 1_000.0, 18_500.0];
/// Part of a motor's Coulomb friction that is before its cable, for the stretch alone. It need not
/// be exact either.
const BEFORE_CABLE: f64 = 0.5;
/// Stop operator that stands for the direction of that friction.
const STRETCH_LEVEL: usize = 3;
/// Time constant of the filters of efforts, velocities and stop operators, s. All have the same
/// delay, so they stay in step.
pub const FILTER_S: f64 = 0.05;
/// Time over which velocities are taken from positions, s.
const RATE_S: f64 = 0.1;
/// Time constants of the slow references, s.
const SLOW_S: [f64; 2] = [0.5, 2.0];
/// Speeds at which the excess of breakaway fades, per joint: rad/s, rad/s, m/s.
pub const FADE: [[f64; 3]; 3] = [[0.003, 0.01, 0.03], [0.003, 0.01, 0.03], [3e-4, 1e-3, 3e-3]];

/// A first-order low-pass filter that begins at its first value.
#[derive(Debug, Clone, Copy)]
pub struct LowPass {
    share: f64,
    value: Option<f64>,
}

/// Share of a first-order filter after `steps` steps with the same value, from that of one step.
#[must_use]
pub fn share_after(share: f64, steps: f64) -> f64 {
    if steps == 1.0 {
        share
    } else {
        1.0 - (1.0 - share).powf(steps)
    }
}

impl LowPass {
    /// A filter with time constant `time_s` for rows of `step_s`.
    #[must_use]
    pub fn new(time_s: f64, step_s: f64) -> Self {
        Self {
            share: step_s / (time_s + step_s),
            value: None,
        }
    }

    /// Takes a value, gives the filtered one.
    pub fn step(&mut self, x: f64) -> f64 {
        self.step_after(x, 1.0)
    }

    /// Takes a value that comes `steps` rows after the one before it, gives the filtered one.
    pub fn step_after(&mut self, x: f64, steps: f64) -> f64 {
        let share = share_after(self.share, steps);
        let value = self.value.map_or(x, |before| before + share * (x - before));
        self.value = Some(value);
        value
    }
}

/// A stop operator whose state at the start is not known.
#[derive(Debug, Clone, Copy)]
struct Stop {
    threshold: f64,
    /// Travel from the start that tells its direction.
    tells: f64,
    bent: f64,
    /// Least and most that it can be bent.
    least: f64,
    most: f64,
    at: Option<f64>,
    /// Position at the start, until the direction of the first motion is known.
    start: Option<f64>,
}

impl Stop {
    const fn new(threshold: f64, tells: f64) -> Self {
        Self {
            threshold,
            tells,
            bent: 0.0,
            least: -threshold,
            most: threshold,
            at: None,
            start: None,
        }
    }

    /// Takes a position that was reached with up to `unseen` of travel beyond it and back; gives
    /// the state, -1 to 1.
    fn step(&mut self, x: f64, unseen: f64) -> f64 {
        let r = self.threshold;
        let Some(at) = self.at.replace(x) else {
            self.start = Some(x);
            return 0.0;
        };
        let travel = x - at;
        let bend = |bent: f64, travel: f64| (bent + travel).clamp(-r, r);
        self.bent = bend(self.bent, travel);
        self.least = bend(bend(self.least, travel + unseen), -unseen);
        self.most = bend(bend(self.most, travel - unseen), unseen);
        if let Some(start) = self.start {
            // It has slid this way before, as a contact in motion mostly has.
            let began = x - start;
            if began.abs() >= self.tells {
                self.bent = if began > 0.0 { self.most } else { self.least };
                self.start = None;
            }
        }
        self.bent / r
    }

    /// Share of its range in which its state may be, 0 to 1.
    fn unknown(&self) -> f64 {
        (self.most - self.least) / (2.0 * self.threshold)
    }
}

/// What is known at a row.
#[derive(Debug, Clone, Copy)]
pub struct Moment {
    /// Joint positions: rad, rad, m.
    pub joints: [f64; 3],
    /// Travel of the motors in the joints' units.
    pub motors: [f64; 3],
    /// Torque of the motors in the joints' units, filtered: N·m, N·m, N.
    pub torque: [f64; 3],
    /// Published velocity of the motors, filtered like the torque: rad/s, rad/s, m/s.
    pub speed: [f64; 3],
    /// Velocity of the motors from positions over 0.1 s.
    pub rate: [f64; 3],
    /// Velocity of the joints from positions over 0.1 s.
    pub joint_rate: [f64; 3],
    /// Velocity of the motors from one row to the next, filtered like the torque: rad/s, rad/s,
    /// m/s.
    pub flow: [f64; 3],
    /// Acceleration of the motors, filtered like the torque: rad/s², rad/s², m/s².
    pub acceleration: [f64; 3],
    /// Velocity of links 2 and 3 from one row to the next, filtered like the torque, then of the
    /// same with stretched cables: rad/s, m/s, rad/s, m/s.
    pub link_flow: [f64; 4],
    /// Stop operators, filtered, -1 to 1: motors 1 to 3, then links 2 and 3, then these with
    /// stretched cables, each from the smallest threshold.
    pub stops: [f64; STOPS],
    /// Rates of the stop operators, filtered, 1/s: zero where a contact slides, its velocity per
    /// threshold where it bends.
    pub stop_rates: [f64; STOPS],
    /// Torque less its slow references, N·m, N·m, N.
    pub torque_change: [[f64; 3]; 2],
    /// Motor travel less its slow references, rad, rad, m.
    pub travel_change: [[f64; 3]; 2],
    /// How much of the friction's state a start or a gap has left unknown, 0 to 1, filtered: motors
    /// 1 to 3, links 2 and 3, these with stretched cables. Mean over the thresholds.
    pub unknown: [f64; PLACES],
    /// Time since the last start or gap, s.
    pub age_s: f64,
    /// Size of the force across the tool's shaft, N: see [`Motion::lateral`].
    pub lateral_n: f64,
}

// By hand: the standard library has no default of so many stop operators.
impl Default for Moment {
    fn default() -> Self {
        Self {
            joints: [0.0; 3],
            motors: [0.0; 3],
            torque: [0.0; 3],
            speed: [0.0; 3],
            rate: [0.0; 3],
            joint_rate: [0.0; 3],
            flow: [0.0; 3],
            acceleration: [0.0; 3],
            link_flow: [0.0; 4],
            stops: [0.0; STOPS],
            stop_rates: [0.0; STOPS],
            torque_change: [[0.0; 3]; 2],
            travel_change: [[0.0; 3]; 2],
            unknown: [1.0; PLACES],
            age_s: 0.0,
            lateral_n: 0.0,
        }
    }
}

impl Moment {
    /// Largest share that is unknown of the friction that motor `i` and its link feel.
    #[must_use]
    pub fn unknown_at(&self, i: usize) -> f64 {
        let links = if i == 0 {
            [0.0; 2]
        } else {
            [self.unknown[2 + i], self.unknown[4 + i]]
        };
        links.into_iter().fold(self.unknown[i], f64::max)
    }

    /// Whether the past before the last start or gap has no more influence: filters have run in,
    /// and the friction's state is known.
    #[must_use]
    pub fn settled(&self) -> bool {
        self.age_s >= RUN_IN_S - 1e-9 && self.friction_known()
    }

    /// Whether the state of all friction is known.
    #[must_use]
    pub fn friction_known(&self) -> bool {
        self.unknown.iter().all(|share| *share <= KNOWN)
    }

    /// Stop operator of a motor.
    #[must_use]
    pub const fn motor_stop(&self, joint: usize, level: usize) -> f64 {
        self.stops[joint * LEVELS + level]
    }

    /// Stop operator of link 2 or 3: `link` 0 or 1, with stretched cables 2 or 3.
    #[must_use]
    pub const fn link_stop(&self, link: usize, level: usize) -> f64 {
        self.stops[(3 + link) * LEVELS + level]
    }
}

/// A position with filtered velocity and acceleration, both from one row to the next. Differences
/// of a filtered position: so they have the delay of the filtered torque, and a balance does not
/// mix two times.
#[derive(Debug, Clone, Copy)]
struct Track {
    filter: LowPass,
    /// Filtered position and velocity at the row before.
    before: Option<(f64, f64)>,
}

impl Track {
    /// Takes a position, gives velocity and acceleration.
    fn step(&mut self, x: f64, step_s: f64) -> (f64, f64) {
        let filtered = self.filter.step(x);
        let (at, velocity) = self.before.unwrap_or((filtered, 0.0));
        let now = (filtered - at) / step_s;
        self.before = Some((filtered, now));
        (now, (now - velocity) / step_s)
    }

    /// Takes a position as if it had been reached with this velocity, without acceleration.
    fn moving(&mut self, x: f64, velocity: f64, step_s: f64) -> (f64, f64) {
        // So much a filtered position is behind.
        let share = self.filter.share;
        let filtered = x - velocity * step_s * (1.0 - share) / share;
        self.filter.value = Some(filtered);
        self.before = Some((filtered, velocity));
        (velocity, 0.0)
    }
}

/// The state that rows leave behind.
#[derive(Debug, Clone)]
pub struct Motion {
    step_s: f64,
    torque: [LowPass; 3],
    speed: [LowPass; 3],
    stops: Vec<(Stop, LowPass)>,
    /// Positions that the stop operators follow, with their filters.
    tracks: [Track; PLACES],
    /// Positions of the row before, as the stop operators follow them; `None` at a start.
    places: Option<[f64; PLACES]>,
    unknown: [LowPass; PLACES],
    /// Time from the row before to the next one where rows are missing between them, s.
    gap_s: Option<f64>,
    /// Rows since the start.
    rows: usize,
    /// Coulomb friction at the motors in training, N·m, N·m, N: for the stretch of the cables.
    coulomb: [f64; 3],
    /// Friction of each joint per that of training.
    times: [f64; 3],
    slow_torque: [[LowPass; 3]; 2],
    slow_travel: [[LowPass; 3]; 2],
    /// Positions of the last rows, a ring: motors, joints.
    past: Vec<([f64; 3], [f64; 3])>,
    next: usize,
    moment: Moment,
}

/// Velocities and positions of joints at the motors, in the joints' units: C q.
#[must_use]
pub fn at_motors(q: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| (0..3).map(|k| COUPLING[i][k] * q[k]).sum())
}

/// Positions at the motors as positions of the joints, in the joints' units: C, inverted.
#[must_use]
pub fn at_joints(motors: [f64; 3]) -> [f64; 3] {
    let second = motors[1] - COUPLING[1][0] * motors[0];
    [
        motors[0],
        second,
        motors[2] - COUPLING[2][0] * motors[0] - COUPLING[2][1] * second,
    ]
}

/// Torques at the joints as torques at the motors, in the joints' units: the transpose of C,
/// inverted.
#[must_use]
pub fn torques_at_motors(joint: [f64; 3]) -> [f64; 3] {
    let third = joint[2];
    let second = joint[1] - COUPLING[2][1] * third;
    [
        joint[0] - COUPLING[1][0] * second - COUPLING[2][0] * third,
        second,
        third,
    ]
}

impl Motion {
    /// No past, for rows of `step_s`, without friction before the cables.
    #[must_use]
    pub fn new(step_s: f64) -> Self {
        Self::with_friction(step_s, [0.0; 3], [1.0; 3])
    }

    /// No past, for rows of `step_s`, and motors with this Coulomb friction in training, N·m, N·m,
    /// N, and now `times` as much. Contacts are as stiff as they were, so they bend farther before
    /// they slide, by as much as the friction is more.
    #[must_use]
    pub fn with_friction(step_s: f64, coulomb: [f64; 3], times: [f64; 3]) -> Self {
        let low = |time_s| LowPass::new(time_s, step_s);
        Self {
            step_s,
            torque: [low(FILTER_S); 3],
            speed: [low(FILTER_S); 3],
            stops: BANKS
                .iter()
                .flat_map(|joint| {
                    THRESHOLDS[*joint].map(|r| (r * times[*joint], THRESHOLDS[*joint][0]))
                })
                .map(|(threshold, tells)| (Stop::new(threshold, tells), low(FILTER_S)))
                .collect(),
            tracks: [Track {
                filter: low(FILTER_S),
                before: None,
            }; PLACES],
            places: None,
            unknown: [low(FILTER_S); PLACES],
            gap_s: None,
            rows: 0,
            coulomb,
            times,
            slow_torque: SLOW_S.map(|time_s| [low(time_s); 3]),
            slow_travel: SLOW_S.map(|time_s| [low(time_s); 3]),
            past: Vec::with_capacity(rate_rows(step_s)),
            next: 0,
            moment: Moment::default(),
        }
    }

    /// What is known at the last row.
    #[must_use]
    pub const fn moment(&self) -> &Moment {
        &self.moment
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        *self = Self::with_friction(self.step_s, self.coulomb, self.times);
    }

    /// The next row comes `elapsed_s` after the one before it: rows are missing between them.
    pub fn gap(&mut self, elapsed_s: f64) {
        if elapsed_s > LONGEST_GAP_S {
            self.reset();
        } else if self.rows > 0 && elapsed_s > self.step_s {
            self.gap_s = Some(elapsed_s);
        }
    }

    /// What is known of the size of the force across the tool's shaft at the next row, N. Motion
    /// and torque do not tell it.
    pub const fn lateral(&mut self, lateral_n: f64) {
        self.moment.lateral_n = lateral_n;
    }

    /// Takes a row of [`INPUTS`] values: rad, rad, m; per second; N·m, N·m, N.
    pub fn step(&mut self, input: &[f32]) -> &Moment {
        let three = |from: usize| core::array::from_fn(|i| f64::from(input[from + i]));
        let joints: [f64; 3] = three(0);
        let motors = at_motors(joints);
        let speed = at_motors(three(3));
        let torque = torques_at_motors(three(6));
        let gap_s = self.gap_s.take();
        let steps = gap_s.map_or(1.0, |gap_s| gap_s / self.step_s);
        let m = &mut self.moment;
        m.age_s = if self.rows == 0 || gap_s.is_some() {
            0.0
        } else {
            m.age_s + self.step_s
        };
        self.rows += 1;
        if let Some(gap_s) = gap_s {
            // Velocities in the gap are those of its ends.
            m.rate = core::array::from_fn(|i| (motors[i] - m.motors[i]) / gap_s);
            m.joint_rate = core::array::from_fn(|i| (joints[i] - m.joints[i]) / gap_s);
            self.past.clear();
            self.next = 0;
        }
        m.joints = joints;
        m.motors = motors;
        let (before, time_s) = if self.past.len() < rate_rows(self.step_s) {
            self.past.push((motors, joints));
            (self.past[0], self.step_s * (self.past.len() - 1) as f64)
        } else {
            let oldest = std::mem::replace(&mut self.past[self.next], (motors, joints));
            self.next = (self.next + 1) % self.past.len();
            (oldest, self.step_s * self.past.len() as f64)
        };
        for i in 0..3 {
            m.torque[i] = self.torque[i].step_after(torque[i], steps);
            m.speed[i] = self.speed[i].step_after(speed[i], steps);
            if time_s > 0.0 {
                m.rate[i] = (motors[i] - before.0[i]) / time_s;
                m.joint_rate[i] = (joints[i] - before.1[i]) / time_s;
            }
            for s in 0..SLOW_S.len() {
                let slow = self.slow_torque[s][i].step_after(m.torque[i], steps);
                m.torque_change[s][i] = m.torque[i] - slow;
                m.travel_change[s][i] =
                    motors[i] - self.slow_travel[s][i].step_after(motors[i], steps);
            }
        }
        // The cable carries what the motor's friction leaves. The friction's direction is that of
        // the row before.
        let stretched = at_joints(core::array::from_fn(|i| {
            let coulomb = BEFORE_CABLE * self.coulomb[i] * self.times[i];
            let friction = coulomb * m.stops[i * LEVELS + STRETCH_LEVEL];
            motors[i] - (m.torque[i] - friction) / CABLE_STIFFNESS[i]
        }));
        let at = [
            motors[0],
            motors[1],
            motors[2],
            joints[1],
            joints[2],
            stretched[1],
            stretched[2],
        ];
        // Travel back and forth in a gap, beyond that between its ends.
        let unseen: [f64; PLACES] = core::array::from_fn(|k| match (gap_s, self.places) {
            (Some(gap_s), Some(places)) => {
                let before = self.tracks[k].before.map_or(0.0, |(_, v)| v.abs());
                let travel = (at[k] - places[k]).abs();
                let fastest = FASTER * before.max(travel / gap_s);
                (0.5 * (fastest * gap_s - travel)).max(0.0)
            }
            _ => 0.0,
        });
        let mut unknown = [0.0; PLACES];
        for (k, (stop, low)) in self.stops.iter_mut().enumerate() {
            let before = low.value;
            let place = k / LEVELS;
            m.stops[k] = low.step_after(stop.step(at[place], unseen[place]), steps);
            // Damping follows the bending, not its share of a threshold that has changed.
            m.stop_rates[k] = match (before, gap_s) {
                (Some(before), None) => {
                    (m.stops[k] - before) / self.step_s * self.times[BANKS[place]]
                }
                _ => 0.0,
            };
            unknown[place] += stop.unknown() / LEVELS as f64;
        }
        for (k, filter) in self.unknown.iter_mut().enumerate() {
            m.unknown[k] = filter.step_after(unknown[k], steps);
        }
        let places = self.places.replace(at);
        for (k, (track, x)) in self.tracks.iter_mut().zip(at).enumerate() {
            let (velocity, acceleration) = match (places, gap_s) {
                (Some(before), Some(gap_s)) => {
                    track.moving(x, (x - before[k]) / gap_s, self.step_s)
                }
                // The second row is the first to tell a velocity.
                (Some(before), None) if self.rows == 2 => {
                    track.moving(x, (x - before[k]) / self.step_s, self.step_s)
                }
                _ => track.step(x, self.step_s),
            };
            if k < 3 {
                m.flow[k] = velocity;
                m.acceleration[k] = acceleration;
            } else {
                m.link_flow[k - 3] = velocity;
            }
        }
        &self.moment
    }
}

/// Rows of the ring from which velocities are taken.
fn rate_rows(step_s: f64) -> usize {
    ((RATE_S / step_s).round() as usize).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(q: f64, effort: f64) -> [f32; INPUTS] {
        let (q, effort) = (q as f32, effort as f32);
        [q, 1.0, 0.4, 0.0, 0.0, 0.0, effort, 0.0, 0.0]
    }

    #[test]
    fn a_stop_follows_for_twice_its_threshold_after_a_reversal() {
        let mut stop = Stop::new(0.5, 0.45);
        let values: Vec<f64> = [0.0, 0.4, 2.0, 1.6, 1.0, -3.0]
            .into_iter()
            .map(|x| stop.step(x, 0.0))
            .collect();
        assert_eq!(values[1], 0.8);
        assert_eq!(values[2], 1.0);
        assert!((values[3] - 0.2).abs() < 1e-12);
        assert!((values[4] + 1.0).abs() < 1e-12);
        assert_eq!(values[5], -1.0);
    }

    #[test]
    fn contacts_with_less_friction_slide_earlier() {
        // With half the friction half the travel bends a contact as far.
        let states = |times: f64, per_row: f64| -> Vec<f64> {
            let mut motion = Motion::with_friction(0.02, [1.0, 0.0, 0.0], [times, 1.0, 1.0]);
            let travel = |n: i32| per_row * f64::from(if n < 20 { n } else { 40 - n });
            (0..60)
                .map(|n| motion.step(&row(0.3 + travel(n), 0.0)).motor_stop(0, 4))
                .collect()
        };
        let plain = states(1.0, 4e-4);
        assert!(plain.iter().any(|state| *state > 0.9) && plain.iter().any(|state| *state < -0.9));
        for (less, all) in states(0.5, 2e-4).iter().zip(&plain) {
            assert!((less - all).abs() < 1e-3, "{less} {all}");
        }
        let mut motion = Motion::with_friction(0.02, [1.0; 3], [0.5; 3]);
        motion.reset();
        assert_eq!(motion.times, [0.5; 3]);
    }

    /// A stop operator that was bent to `bent` before, as a plain one goes on.
    fn plain(bent: f64, threshold: f64, path: &[f64]) -> Vec<f64> {
        let mut bent = bent;
        let step = |x: &[f64]| {
            bent = (bent + x[1] - x[0]).clamp(-threshold, threshold);
            bent / threshold
        };
        path.windows(2).map(step).collect()
    }

    #[test]
    fn the_bounds_of_a_stop_hold_every_past_and_meet_after_twice_its_threshold() {
        let path: Vec<f64> = (0..200).map(|n| (f64::from(n) * 0.05).sin()).collect();
        for (first, tells) in [(0, 0.1), (20, 0.1), (35, 0.3)] {
            let mut stop = Stop::new(0.4, tells);
            let path = &path[first..];
            let mut least = [path[0]; 2];
            for (n, x) in path.iter().enumerate() {
                let value = stop.step(*x, 0.0) * 0.4;
                least = [least[0].min(*x), least[1].max(*x)];
                assert!(stop.least - 1e-12 <= value && value <= stop.most + 1e-12);
                for past in [-0.4, -0.1, 0.25, 0.4] {
                    if n > 0 {
                        let true_bent = 0.4 * plain(past, 0.4, &path[..=n])[n - 1];
                        let within = stop.least - 1e-9..=stop.most + 1e-9;
                        assert!(within.contains(&true_bent), "row {n} from {past}");
                    }
                }
                let known = least[1] - least[0] >= 0.8;
                assert_eq!(stop.unknown() < 1e-9, known, "row {n} of {first}");
            }
        }
    }

    #[test]
    fn what_moved_in_a_gap_moves_the_stops_and_opens_their_bounds() {
        // All joints at a steady speed, so that the bounds have met before the gap.
        let at = |n: u16| {
            let travel = 4e-4 * f32::from(n);
            [
                0.3 + travel,
                1.0 + travel,
                0.4 + 0.1 * travel,
                0.0,
                0.0,
                0.0,
                1.0,
                0.0,
                0.0,
            ]
        };
        let mut motion = Motion::new(0.02);
        for n in 0..100 {
            motion.step(&at(n));
        }
        assert!(motion.moment.settled(), "{:?}", motion.moment.unknown);
        motion.gap(0.3);
        let after = *motion.step(&at(114));
        assert_eq!(after.age_s, 0.0);
        assert!(after.motor_stop(0, 5) > 0.9, "{after:?}");
        // Up to half as fast again as it was: 1.4 mrad back and forth, of which the small
        // thresholds forget all and the largest a fifth.
        assert!(
            after.unknown[0] > 0.3 && after.unknown[0] < 0.95,
            "{after:?}"
        );
        assert!((after.flow[0] - 0.02).abs() < 1e-4 && after.acceleration[0] == 0.0);
        let mut last = after;
        for n in 115..180 {
            last = *motion.step(&at(n));
        }
        assert!(last.settled(), "{last:?}");
        // Too long: begun anew.
        motion.gap(LONGEST_GAP_S + 1.0);
        let anew = motion.step(&at(0)).unknown;
        assert!(anew.iter().all(|u| *u > 0.999_999), "{anew:?}");
    }

    #[test]
    fn a_start_in_motion_has_its_velocity_at_the_second_row_and_a_start_at_rest_stays_unknown() {
        let mut motion = Motion::new(0.02);
        let at = |n: u16| row(0.3 + 4e-4 * f64::from(n), 0.0);
        motion.step(&at(0));
        for n in 1..60 {
            let m = *motion.step(&at(n));
            assert!((m.flow[0] - 0.02).abs() < 1e-4, "row {n}: {:?}", m.flow);
            assert!(m.acceleration[0].abs() < 1e-2, "row {n}: {m:?}");
        }
        let mut resting = Motion::new(0.02);
        for _ in 0..500 {
            resting.step(&row(0.3, 0.0));
        }
        assert!(!resting.moment.settled());
        assert!(resting.moment.unknown.iter().all(|u| *u > 0.999_999));
    }

    #[test]
    fn velocities_are_those_of_the_positions() {
        let mut motion = Motion::new(0.02);
        let mut last = Moment::default();
        for n in 0..100 {
            last = *motion.step(&row(0.3 + 1e-3 * f64::from(n), 0.0));
        }
        assert!(
            (last.joint_rate[0] - 0.05).abs() < 1e-5,
            "{:?}",
            last.joint_rate
        );
        // The second motor turns with the shoulder too.
        assert!((last.rate[1] - 0.05 * COUPLING[1][0]).abs() < 1e-5);
        assert!(last.motor_stop(0, 5) > 0.99);
    }

    #[test]
    fn velocities_and_accelerations_have_the_delay_of_the_torque() {
        // Position and effort have the same shape: so do their filtered rates.
        let (step_s, mut motion) = (0.02, Motion::new(0.02));
        let shape = |n: u32| 0.3 + 0.1 * (f64::from(n) * 0.05).sin();
        let mut before = (0.0, 0.0);
        for n in 0..300 {
            let m = *motion.step(&row(shape(n), shape(n)));
            let rate = (m.torque[0] - before.0) / step_s;
            // Once the filters have run in: at a start the velocity is known before the torque's
            // rate.
            if n > 60 {
                assert!((m.flow[0] - rate).abs() < 1e-5, "row {n}: {m:?}");
                // f32 rows: 1e-8 of the position over the square of the step.
                let change = (rate - before.1) / step_s;
                assert!((m.acceleration[0] - change).abs() < 1e-3, "row {n}: {m:?}");
            }
            before = (m.torque[0], rate);
        }
    }

    #[test]
    fn rates_of_stops_vanish_where_a_contact_slides() {
        let mut motion = Motion::new(0.02);
        let mut at = 0.5;
        let mut last = Moment::default();
        for n in 0..400 {
            // Back and forth at 0.01 rad/s.
            at += if (n / 100) % 2 == 0 { 2e-4 } else { -2e-4 };
            last = *motion.step(&row(at, 0.0));
            let bending = n % 100 == 3;
            if bending && n > 100 {
                assert!(last.stop_rates[4].abs() > 1.0, "row {n}: {last:?}");
            }
        }
        assert!(last.stop_rates[..LEVELS].iter().all(|r| r.abs() < 1e-3));
    }

    #[test]
    fn a_loaded_cable_moves_the_link_and_not_the_motor() {
        let mut motion = Motion::with_friction(0.02, [0.0, 0.2, 0.0], [1.0; 3]);
        let mut row = [0.7, 1.4, 0.38, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let mut last = Moment::default();
        for n in 0..300_u16 {
            // 2 N·m more within 6 s stretch the elbow's cable by 2 mrad.
            row[7] = f32::from(n) / 150.0;
            last = *motion.step(&row);
        }
        assert_eq!(last.motor_stop(1, 0), 0.0);
        assert_eq!(last.link_stop(0, 0), 0.0);
        assert!(last.link_stop(2, 0) < -0.99, "{last:?}");
        assert!((last.link_flow[2] + (1.0 / 3.0) / 1000.0).abs() < 2e-5);
    }

    #[test]
    fn joints_at_motors_and_back() {
        let q = [0.6, 1.3, 0.37];
        for (got, expected) in at_joints(at_motors(q)).into_iter().zip(q) {
            assert!((got - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn torques_at_motors_undo_what_the_cables_do() {
        let motor = [0.3, -0.7, 4.0];
        let joint: [f64; 3] =
            core::array::from_fn(|k| (0..3).map(|i| COUPLING[i][k] * motor[i]).sum());
        for (got, expected) in torques_at_motors(joint).into_iter().zip(motor) {
            assert!((got - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn the_state_is_causal_and_forgets() {
        let rows: Vec<[f32; INPUTS]> = (0..60)
            .map(|n| row(0.5 + 0.01 * (f64::from(n) * 0.2).sin(), f64::from(n % 7)))
            .collect();
        let mut whole = Motion::new(0.02);
        let early: Vec<Moment> = rows.iter().map(|r| *whole.step(r)).collect();
        whole.reset();
        let mut again = Moment::default();
        for r in &rows[..30] {
            again = *whole.step(r);
        }
        assert_eq!(format!("{again:?}"), format!("{:?}", early[29]));
    }
}
