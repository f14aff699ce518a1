//! One run of the rig on the fine time grid: what happens around the load cell.

/// Signals of one run on a uniform grid with [`crate::steps_per_row`] steps for each row of the
/// log. All have the same length. The grid starts before the first row and ends after the last one,
/// because effects such as a delay need the signals there.
#[derive(Clone, Debug, Default)]
pub struct World {
    /// Step of the grid in s.
    pub dt: f64,
    /// Time of the first step in s; the first row of the log is at 0 s.
    pub start: f64,
    /// Seed for effects with random events; differs for every run.
    pub seed: u64,
    /// Commanded cable force in N.
    pub command: Vec<f64>,
    /// Velocity of the reel in rad/s; exactly 0 at rest.
    pub velocity: Vec<f64>,
    /// Angle of the reel in rad.
    pub angle: Vec<f64>,
    /// Temperature of the drive and the load cell in degrees Celsius.
    pub temperature: Vec<f64>,
    /// Loads of the two neighbour channels in N.
    pub neighbours: [Vec<f64>; 2],
    /// Joint angles of the robot in rad. No effect depends on them.
    pub pose: [Vec<f64>; 2],
}

impl World {
    /// Steps on the grid.
    pub fn len(&self) -> usize {
        self.command.len()
    }

    /// True without any step.
    pub fn is_empty(&self) -> bool {
        self.command.is_empty()
    }

    /// Time of step `i` in s.
    pub fn time(&self, i: usize) -> f64 {
        self.start + self.dt * i as f64
    }

    /// Acceleration of the reel at step `i` in rad/s², from central differences of the velocity.
    pub fn acceleration(&self, i: usize) -> f64 {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(self.len() - 1));
        if after == before {
            return 0.0;
        }
        (self.velocity[after] - self.velocity[before]) / (self.dt * (after - before) as f64)
    }

    /// A signal of the grid at a time in s, by linear interpolation; the end values hold outside.
    pub fn sample(&self, signal: &[f64], time: f64) -> f64 {
        interpolate(signal, (time - self.start) / self.dt)
    }

    /// Angle from the velocity by the trapezoidal rule, with `angle[i] = at_zero` where the time is
    /// 0 s.
    pub fn integrate_angle(&mut self, at_zero: f64) {
        self.angle = vec![0.0; self.velocity.len()];
        for i in 1..self.velocity.len() {
            self.angle[i] =
                self.angle[i - 1] + 0.5 * self.dt * (self.velocity[i] + self.velocity[i - 1]);
        }
        let shift = at_zero - self.sample(&self.angle, 0.0);
        self.angle.iter_mut().for_each(|angle| *angle += shift);
    }
}

/// A signal at a fractional index, by linear interpolation; the end values hold outside.
pub fn interpolate(signal: &[f64], index: f64) -> f64 {
    let last = signal.len() - 1;
    if index <= 0.0 {
        return signal[0];
    }
    let i = index as usize;
    if i >= last {
        return signal[last];
    }
    signal[i] + (signal[i + 1] - signal[i]) * (index - i as f64)
}
