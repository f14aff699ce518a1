//! The joint estimate: all stations and all points in one least-squares fit (bundle adjustment).
//!
//! # Model
//!
//! A station `s` measures point `l` as `z = T_s p_l + noise`, with `T_s` the motion from the base
//! frame to the digitizer's frame at that station, `p_l` the point in the base frame and
//! independent noise of equal standard deviation in each coordinate. Unknown are all `T_s` and all
//! `p_l` that the CAD model does not give.
//!
//! Gauss-Newton on SE(3), steps acting from the left ([`crate::se3`]). With `q = T p` the residual
//! `q - z` has the derivatives `[I, -skew(q)]` to the step and `R` to the point ([`jacobians`]). A
//! point enters the normal equations through a 3 x 3 block of its own, so points are eliminated
//! first (Schur complement) and a system of six unknowns a station is left. The inverse of the
//! normal matrix is the covariance; at the true values it is the Cramer-Rao bound.

use super::points::{Label, PointReading, Reference};
use super::GeometryError;
use crate::input::Location;
use crate::kabsch;
use crate::se3::{self, Pose};
use crate::stats;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};
use std::collections::{BTreeMap, BTreeSet};

/// One reading with numbers for station and point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Item {
    pub station: usize,
    pub landmark: usize,
    pub position_m: Vector3<f64>,
    /// Whether it takes part.
    pub used: bool,
}

/// All readings with numbers for stations and points. Hypotheses about faults change the items.
#[derive(Debug, Clone)]
pub(super) struct Items {
    pub stations: Vec<String>,
    /// Where each station is first mentioned.
    pub station_at: Vec<Location>,
    pub landmarks: Vec<Label>,
    /// CAD position of each point, m, where there is one.
    pub known_m: Vec<Option<Vector3<f64>>>,
    pub hole_sd_m: f64,
    pub items: Vec<Item>,
    /// Pairs of stations that are the same one before and after it was bumped.
    pub links: Vec<(usize, usize)>,
}

impl Items {
    pub fn new(readings: &[PointReading], reference: &Reference) -> Result<Self, GeometryError> {
        if !(reference.hole_sd_m >= 0.0 && reference.hole_sd_m.is_finite()) {
            return Err(GeometryError::BadOption {
                name: "hole_sd_m",
                value: reference.hole_sd_m,
            });
        }
        let mut out = Self {
            stations: Vec::new(),
            station_at: Vec::new(),
            landmarks: Vec::new(),
            known_m: Vec::new(),
            hole_sd_m: reference.hole_sd_m,
            items: Vec::new(),
            links: Vec::new(),
        };
        let mut landmark_numbers: BTreeMap<&Label, usize> = BTreeMap::new();
        // All holes of the CAD model, measured or not: a wrong label may hide one.
        let holes: Vec<Label> = reference
            .holes_m
            .keys()
            .map(|name| Label::Base(name.clone()))
            .collect();
        let labels: BTreeSet<&Label> = readings.iter().map(|r| &r.label).chain(&holes).collect();
        for label in labels {
            landmark_numbers.insert(label, out.landmarks.len());
            out.landmarks.push(label.clone());
            out.known_m.push(match label {
                Label::Base(name) => reference.holes_m.get(name).copied(),
                _ => None,
            });
        }
        for reading in readings {
            if !reading.position_m.iter().all(|v| v.is_finite()) {
                return Err(GeometryError::NotFinite {
                    at: reading.at.clone(),
                });
            }
            let landmark = landmark_numbers[&reading.label];
            if let (Label::Base(_), None) = (&reading.label, out.known_m[landmark]) {
                return Err(GeometryError::UnknownHole {
                    at: reading.at.clone(),
                    label: reading.label.to_string(),
                    known: reference
                        .holes_m
                        .keys()
                        .map(|name| format!("base_{name}"))
                        .collect::<Vec<_>>()
                        .join(", "),
                });
            }
            let station = match out.stations.iter().position(|s| *s == reading.station) {
                Some(number) => number,
                None => {
                    out.stations.push(reading.station.clone());
                    out.station_at.push(reading.at.clone());
                    out.stations.len() - 1
                }
            };
            out.items.push(Item {
                station,
                landmark,
                position_m: reading.position_m,
                used: true,
            });
        }
        Ok(out)
    }
}

/// The repeats of one point from one station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Group {
    pub station: usize,
    pub landmark: usize,
    /// Mean, digitizer frame, m.
    pub mean_m: Vector3<f64>,
    pub count: usize,
}

/// Readings, repeats averaged, ready to be solved.
#[derive(Debug, Clone)]
pub(super) struct Network<'i> {
    pub data: &'i Items,
    pub groups: Vec<Group>,
    /// Sum of squared distances of repeats from their means, m^2.
    within_m2: f64,
}

/// Standard deviation allowed for a bump of a station, m and rad.
const BUMP_SD: (f64, f64) = (0.02, 0.05);

impl<'i> Network<'i> {
    pub fn new(data: &'i Items) -> Self {
        let mut sums: BTreeMap<(usize, usize), (Vector3<f64>, usize)> = BTreeMap::new();
        for item in data.items.iter().filter(|i| i.used) {
            let entry = sums
                .entry((item.station, item.landmark))
                .or_insert((Vector3::zeros(), 0));
            entry.0 += item.position_m;
            entry.1 += 1;
        }
        let means: BTreeMap<_, _> = sums
            .iter()
            .map(|(key, (sum, count))| (*key, sum / *count as f64))
            .collect();
        let within_m2 = data
            .items
            .iter()
            .filter(|i| i.used)
            .map(|i| (i.position_m - means[&(i.station, i.landmark)]).norm_squared())
            .sum();
        let groups = sums
            .iter()
            .map(|(&(station, landmark), &(_, count))| Group {
                station,
                landmark,
                mean_m: means[&(station, landmark)],
                count,
            })
            .collect();
        Self {
            data,
            groups,
            within_m2,
        }
    }

    fn is_fixed(&self, landmark: usize) -> bool {
        self.data.known_m[landmark].is_some() && self.data.hole_sd_m == 0.0
    }

    /// Coordinates measured less unknowns: degrees of freedom of the residuals.
    pub fn degrees_of_freedom(&self) -> usize {
        let seen: BTreeSet<usize> = self.groups.iter().map(|g| g.landmark).collect();
        let free = seen
            .iter()
            .filter(|l| self.data.known_m[**l].is_none())
            .count();
        let linked = self.data.links.len();
        let stations: BTreeSet<usize> = self.groups.iter().map(|g| g.station).collect();
        (3 * self.groups.iter().map(|g| g.count).sum::<usize>())
            .saturating_sub(3 * free + 6 * (stations.len() - linked))
    }

    /// A first estimate: stations placed one after the other by Kabsch's algorithm on points that
    /// are already placed, the station with the most of them next.
    pub fn initial(&self, sd_m: f64) -> Result<State, GeometryError> {
        let data = self.data;
        let mut landmarks = data.known_m.clone();
        let mut poses: Vec<Option<Pose>> = vec![None; data.stations.len()];
        if !self.groups.iter().any(|g| landmarks[g.landmark].is_some()) {
            return Err(GeometryError::NoBase);
        }
        loop {
            let waiting: Vec<usize> = (0..poses.len())
                .filter(|&s| poses[s].is_none() && self.groups.iter().any(|g| g.station == s))
                .collect();
            if waiting.is_empty() {
                break;
            }
            let placed = |s: usize| -> Vec<&Group> {
                self.groups
                    .iter()
                    .filter(|g| g.station == s && landmarks[g.landmark].is_some())
                    .collect()
            };
            let next = waiting
                .iter()
                .copied()
                .max_by_key(|&s| (placed(s).len(), std::cmp::Reverse(s)));
            let Some(station) = next else { break };
            let common = placed(station);
            let linked = data.links.iter().find_map(|&(a, b)| {
                if a == station {
                    poses[b]
                } else if b == station {
                    poses[a]
                } else {
                    None
                }
            });
            let pose = match (self.place(station, &common, &landmarks, sd_m), linked) {
                (Ok(pose), _) => pose,
                (Err(_), Some(pose)) => pose,
                (Err(error), None) => return Err(error),
            };
            poses[station] = Some(pose);
            let back = pose.inverse();
            for group in self.groups.iter().filter(|g| g.station == station) {
                landmarks[group.landmark].get_or_insert_with(|| back.apply(&group.mean_m));
            }
        }
        Ok(State {
            poses: poses
                .into_iter()
                .map(|p| p.unwrap_or_else(Pose::identity))
                .collect(),
            landmarks_m: landmarks
                .into_iter()
                .map(|l| l.unwrap_or_else(Vector3::zeros))
                .collect(),
        })
    }

    fn place(
        &self,
        station: usize,
        common: &[&Group],
        landmarks: &[Option<Vector3<f64>>],
        sd_m: f64,
    ) -> Result<Pose, GeometryError> {
        let data = self.data;
        let labels = || -> Vec<String> {
            common
                .iter()
                .map(|g| data.landmarks[g.landmark].to_string())
                .collect()
        };
        let from: Vec<Vector3<f64>> = common
            .iter()
            .filter_map(|g| landmarks[g.landmark])
            .collect();
        let to: Vec<Vector3<f64>> = common.iter().map(|g| g.mean_m).collect();
        let weights: Vec<f64> = common.iter().map(|g| g.count as f64).collect();
        let Some(found) = kabsch::align(&from, &to, &weights) else {
            return Err(GeometryError::NotConnected {
                at: data.station_at[station].clone(),
                station: data.stations[station].clone(),
                shared: labels().join(", "),
            });
        };
        // Squared distances from the best line, in units of the digitizer's variance, are
        // chi-square with 2 k - 4 degrees of freedom where the points lie on a line and only the
        // digitizer moves them off it.
        let measured = kabsch::align(&to, &to, &weights);
        let off_line = measured.map_or(0.0, |m| m.spread_m[1].powi(2) + m.spread_m[2].powi(2));
        let p = stats::chi_square_survival(off_line / (sd_m * sd_m), 2 * common.len() - 4);
        if p > 1e-3 {
            return Err(GeometryError::Collinear {
                at: data.station_at[station].clone(),
                station: data.stations[station].clone(),
                labels: labels().join(", "),
                off_line_mm: 1e3 * (off_line / weights.iter().sum::<f64>()).sqrt(),
            });
        }
        Ok(found.pose)
    }

    /// Solves from `start`. `sd_m` is the digitizer's standard deviation in one coordinate, m.
    pub fn solve(&self, start: State, sd_m: f64) -> Result<Solution, GeometryError> {
        let mut state = start;
        let mut cost = self.cost(&state, sd_m);
        let mut damping = 0.0;
        for _ in 0..100 {
            let normal = self.normal(&state, sd_m);
            let Some((stations, landmarks)) = normal.step(damping) else {
                damping = f64::max(1e-6, 10.0 * damping);
                if damping > 1e9 {
                    return Err(GeometryError::Undetermined);
                }
                continue;
            };
            let next = state.moved(&stations, &landmarks);
            let next_cost = self.cost(&next, sd_m);
            let size = stations
                .amax()
                .max(landmarks.iter().map(|l| l.amax()).fold(0.0, f64::max));
            if next_cost <= cost || size < 1e-13 {
                let done = size < 1e-11 || (cost - next_cost < 1e-12 * cost && size < 1e-7);
                state = next;
                cost = next_cost;
                damping = if damping < 1e-8 { 0.0 } else { damping * 0.1 };
                if done {
                    return self.at(state, sd_m);
                }
            } else {
                damping = f64::max(1e-6, 10.0 * damping);
                if damping > 1e9 {
                    // No step lowers the cost: this is its least value to rounding.
                    return self.at(state, sd_m);
                }
            }
        }
        Err(GeometryError::NoConvergence)
    }

    /// Chi-square at a state, repeats about their means included.
    fn cost(&self, state: &State, sd_m: f64) -> f64 {
        let weight = sd_m.powi(-2);
        let mut sum = self.within_m2 * weight;
        for g in &self.groups {
            let r = state.poses[g.station].apply(&state.landmarks_m[g.landmark]) - g.mean_m;
            sum += weight * g.count as f64 * r.norm_squared();
        }
        if self.data.hole_sd_m > 0.0 {
            for (known, now) in self.data.known_m.iter().zip(&state.landmarks_m) {
                if let Some(known) = known {
                    sum += (now - known).norm_squared() / self.data.hole_sd_m.powi(2);
                }
            }
        }
        for &(a, b) in &self.data.links {
            sum += bump(state, a, b).norm_squared();
        }
        sum
    }

    fn normal(&self, state: &State, sd_m: f64) -> Normal {
        let stations = state.poses.len();
        let count = state.landmarks_m.len();
        let mut out = Normal {
            stations: DMatrix::zeros(6 * stations, 6 * stations),
            station_gradient: DVector::zeros(6 * stations),
            landmarks: vec![Matrix3::zeros(); count],
            landmark_gradient: vec![Vector3::zeros(); count],
            cross: BTreeMap::new(),
            free: vec![false; count],
        };
        for g in &self.groups {
            let weight = g.count as f64 / (sd_m * sd_m);
            let pose = &state.poses[g.station];
            let point = &state.landmarks_m[g.landmark];
            let r = pose.apply(point) - g.mean_m;
            let (to_pose, to_point) = jacobians(pose, point);
            let at = 6 * g.station;
            let mut block = out.stations.fixed_view_mut::<6, 6>(at, at);
            block += to_pose.transpose() * to_pose * weight;
            let mut gradient = out.station_gradient.fixed_rows_mut::<6>(at);
            gradient += to_pose.transpose() * r * weight;
            if !self.is_fixed(g.landmark) {
                out.free[g.landmark] = true;
                out.landmarks[g.landmark] += to_point.transpose() * to_point * weight;
                out.landmark_gradient[g.landmark] += to_point.transpose() * r * weight;
                out.cross.insert(
                    (g.landmark, g.station),
                    to_point.transpose() * to_pose * weight,
                );
            }
        }
        if self.data.hole_sd_m > 0.0 {
            let weight = self.data.hole_sd_m.powi(-2);
            for (l, known) in self.data.known_m.iter().enumerate() {
                if let (Some(known), true) = (known, out.free[l]) {
                    out.landmarks[l] += Matrix3::identity() * weight;
                    out.landmark_gradient[l] += (state.landmarks_m[l] - known) * weight;
                }
            }
        }
        let weights = bump_weights();
        let weight = Matrix6::from_diagonal(&weights.component_mul(&weights));
        for &(a, b) in &self.data.links {
            // The bump exp(d) = T_b T_a^-1 changes by the step of b less that of a, to first order
            // in its size.
            let slope = weights.component_mul(&bump(state, a, b));
            for (i, j, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                let mut block = out.stations.fixed_view_mut::<6, 6>(6 * i, 6 * j);
                block += weight * sign;
            }
            for (i, sign) in [(a, -1.0), (b, 1.0)] {
                let mut gradient = out.station_gradient.fixed_rows_mut::<6>(6 * i);
                gradient += slope * sign;
            }
        }
        // Stations without a group keep their place.
        for s in 0..stations {
            if !self.groups.iter().any(|g| g.station == s) {
                for k in 0..6 {
                    out.stations[(6 * s + k, 6 * s + k)] += 1.0;
                }
            }
        }
        out
    }

    /// Covariance and chi-square at a state, without moving it. At the truth, the covariance is the
    /// Cramer-Rao bound.
    pub fn at(&self, state: State, sd_m: f64) -> Result<Solution, GeometryError> {
        let normal = self.normal(&state, sd_m);
        let (reduced, _) = normal.reduced(0.0).ok_or(GeometryError::Undetermined)?;
        let stations_covariance = reduced
            .cholesky()
            .ok_or(GeometryError::Undetermined)?
            .inverse();
        let mut own = vec![Matrix3::zeros(); normal.free.len()];
        let mut gains: Vec<BTreeMap<usize, Matrix3x6<f64>>> =
            vec![BTreeMap::new(); normal.free.len()];
        for (l, inverse) in own.iter_mut().enumerate() {
            if normal.free[l] {
                *inverse = normal.landmarks[l]
                    .try_inverse()
                    .ok_or(GeometryError::Undetermined)?;
            }
        }
        for (&(l, s), block) in &normal.cross {
            gains[l].insert(s, own[l] * block);
        }
        Ok(Solution {
            chi_square: self.cost(&state, sd_m),
            degrees_of_freedom: self.degrees_of_freedom(),
            state,
            stations_covariance,
            own,
            gains,
        })
    }
}

/// Derivatives of `T p` to a step of the pose from the left and to the point.
pub(super) fn jacobians(pose: &Pose, point: &Vector3<f64>) -> (Matrix3x6<f64>, Matrix3<f64>) {
    let mut to_pose = Matrix3x6::zeros();
    to_pose
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&Matrix3::identity());
    to_pose
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&-se3::skew(&pose.apply(point)));
    (to_pose, pose.rotation)
}

fn bump_weights() -> Vector6<f64> {
    let (m, rad) = (1.0 / BUMP_SD.0, 1.0 / BUMP_SD.1);
    Vector6::new(m, m, m, rad, rad, rad)
}

/// The bump between two halves of a station, in units of its standard deviation.
fn bump(state: &State, a: usize, b: usize) -> Vector6<f64> {
    let step = se3::log(&state.poses[b].compose(&state.poses[a].inverse()));
    bump_weights().component_mul(&step)
}

/// Poses of the stations and positions of the points.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// Base frame to digitizer frame, per station.
    pub poses: Vec<Pose>,
    /// Base frame, m, per point.
    pub landmarks_m: Vec<Vector3<f64>>,
}

impl State {
    fn moved(&self, stations: &DVector<f64>, landmarks: &[Vector3<f64>]) -> Self {
        Self {
            poses: self
                .poses
                .iter()
                .enumerate()
                .map(|(s, pose)| pose.moved(&stations.fixed_rows::<6>(6 * s).into_owned()))
                .collect(),
            landmarks_m: self
                .landmarks_m
                .iter()
                .zip(landmarks)
                .map(|(l, step)| l + step)
                .collect(),
        }
    }
}

/// The normal equations with the points' blocks apart.
struct Normal {
    stations: DMatrix<f64>,
    station_gradient: DVector<f64>,
    landmarks: Vec<Matrix3<f64>>,
    landmark_gradient: Vec<Vector3<f64>>,
    /// By point and station: 3 x 6.
    cross: BTreeMap<(usize, usize), Matrix3x6<f64>>,
    free: Vec<bool>,
}

impl Normal {
    /// The stations' equations with the points eliminated.
    fn reduced(&self, damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let mut matrix = self.stations.clone();
        let mut gradient = self.station_gradient.clone();
        for i in 0..matrix.nrows() {
            matrix[(i, i)] *= 1.0 + damping;
        }
        for l in 0..self.free.len() {
            if !self.free[l] {
                continue;
            }
            let inverse = self.block(l, damping).try_inverse()?;
            let seen: Vec<(usize, &Matrix3x6<f64>)> = self
                .cross
                .range((l, 0)..(l + 1, 0))
                .map(|(&(_, s), block)| (s, block))
                .collect();
            for &(i, a) in &seen {
                let mut rows = gradient.fixed_rows_mut::<6>(6 * i);
                rows -= a.transpose() * inverse * self.landmark_gradient[l];
                for &(j, b) in &seen {
                    let mut block = matrix.fixed_view_mut::<6, 6>(6 * i, 6 * j);
                    block -= a.transpose() * inverse * b;
                }
            }
        }
        Some((matrix, gradient))
    }

    fn block(&self, l: usize, damping: f64) -> Matrix3<f64> {
        let mut block = self.landmarks[l];
        for i in 0..3 {
            block[(i, i)] *= 1.0 + damping;
        }
        block
    }

    /// Step of all stations and of each point.
    fn step(&self, damping: f64) -> Option<(DVector<f64>, Vec<Vector3<f64>>)> {
        let (matrix, gradient) = self.reduced(damping)?;
        let stations = -matrix.cholesky()?.solve(&gradient);
        let mut landmarks = vec![Vector3::zeros(); self.free.len()];
        for (l, step) in landmarks.iter_mut().enumerate() {
            if self.free[l] {
                let mut right = -self.landmark_gradient[l];
                for (&(_, s), block) in self.cross.range((l, 0)..(l + 1, 0)) {
                    right -= block * stations.fixed_rows::<6>(6 * s);
                }
                *step = self.block(l, damping).try_inverse()? * right;
            }
        }
        stations
            .iter()
            .all(|v| v.is_finite())
            .then_some((stations, landmarks))
    }
}

/// A solved network.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    pub state: State,
    pub chi_square: f64,
    pub degrees_of_freedom: usize,
    stations_covariance: DMatrix<f64>,
    /// Covariance of each point with the stations held.
    own: Vec<Matrix3<f64>>,
    /// How a point follows the stations that see it.
    gains: Vec<BTreeMap<usize, Matrix3x6<f64>>>,
}

impl Solution {
    /// Covariance between two points, m^2; 0 for points that the CAD model gives exactly.
    pub fn covariance(&self, a: usize, b: usize) -> Matrix3<f64> {
        let mut out = if a == b {
            self.own[a]
        } else {
            Matrix3::zeros()
        };
        for (&i, left) in &self.gains[a] {
            for (&j, right) in &self.gains[b] {
                let between = self.stations_covariance.fixed_view::<6, 6>(6 * i, 6 * j);
                out += left * between * right.transpose();
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::testing;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn jacobians_match_finite_differences(
            s in prop::array::uniform6(-1.5..1.5f64),
            p in prop::array::uniform3(-1.0..1.0f64),
        ) {
            let pose = se3::exp(&Vector6::from(s));
            let p = Vector3::from(p);
            let (to_pose, to_point) = jacobians(&pose, &p);
            let h = 1e-6;
            for k in 0..6 {
                let mut step = Vector6::zeros();
                step[k] = h;
                let slope = (pose.moved(&step).apply(&p) - pose.moved(&-step).apply(&p)) / (2.0 * h);
                prop_assert!((slope - to_pose.column(k)).norm() < 1e-8);
            }
            for k in 0..3 {
                let mut step = Vector3::zeros();
                step[k] = h;
                let slope = (pose.apply(&(p + step)) - pose.apply(&(p - step))) / (2.0 * h);
                prop_assert!((slope - to_point.column(k)).norm() < 1e-8);
            }
        }
    }

    /// The Schur complement against one dense normal matrix made from finite differences of the
    /// cost.
    #[test]
    fn covariance_matches_the_dense_inverse() {
        let scene = testing::scene(2);
        for hole_sd_m in [0.0, 1e-4] {
            let mut reference = scene.reference.clone();
            reference.hole_sd_m = hole_sd_m;
            let readings = scene.measure(7, 2, 2e-4);
            let items = Items::new(&readings, &reference).unwrap();
            let network = Network::new(&items);
            let solution = network.solve(network.initial(2e-4).unwrap(), 2e-4).unwrap();
            let free: Vec<usize> = (0..items.landmarks.len())
                .filter(|&l| !network.is_fixed(l))
                .collect();
            let stations = items.stations.len();
            let size = 6 * stations + 3 * free.len();
            let cost = |step: &DVector<f64>| {
                let mut points = vec![Vector3::zeros(); items.landmarks.len()];
                for (k, &l) in free.iter().enumerate() {
                    points[l] = step.fixed_rows::<3>(6 * stations + 3 * k).into_owned();
                }
                network.cost(
                    &solution
                        .state
                        .moved(&step.rows(0, 6 * stations).into_owned(), &points),
                    2e-4,
                )
            };
            // Gauss-Newton's matrix is half the Hessian of the cost where residuals are small.
            let h = 1e-4;
            let mut hessian = DMatrix::zeros(size, size);
            for i in 0..size {
                for j in 0..=i {
                    let mut sum = 0.0;
                    for (si, sj) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                        let mut step = DVector::zeros(size);
                        step[i] += si * h;
                        step[j] += sj * h;
                        sum += si * sj * cost(&step);
                    }
                    hessian[(i, j)] = sum / (8.0 * h * h);
                    hessian[(j, i)] = hessian[(i, j)];
                }
            }
            let dense = hessian.try_inverse().unwrap();
            for (a, &l) in free.iter().enumerate() {
                for (b, &m) in free.iter().enumerate() {
                    let want = dense.fixed_view::<3, 3>(6 * stations + 3 * a, 6 * stations + 3 * b);
                    let scale = (dense[(6 * stations + 3 * a, 6 * stations + 3 * a)]
                        * dense[(6 * stations + 3 * b, 6 * stations + 3 * b)])
                        .sqrt();
                    let got = solution.covariance(l, m);
                    assert!((got - want).norm() < 0.05 * scale, "{a} {b} {got} {want}");
                }
            }
        }
    }
}
