//! The set of feasible forces at a pose, exactly: `Z = { sum t_i d_i, t_min_i <= t_i <= t_max_i }`.
//!
//! A sum of segments is a zonotope. Each of its faces lies across a direction that is the cross
//! product of two cable directions, in both senses, so with six cables there are at most 30 faces;
//! the distance of a face from the origin is the support function
//! `h(n) = sum max(t_min_i n . d_i, t_max_i n . d_i)` (Bouchard, Gosselin and Moore, *J. Mechanisms
//! Robotics* 2 (2010) 011010). The corners of a face come from the cables that lie in it.

use super::WorkspaceError;
use nalgebra::Vector3;

/// Sine of an angle below which two directions count as parallel, and a cable as lying in a face.
const PARALLEL: f64 = 1e-9;

/// A face: the points `x` of it have `normal . x = offset_n`, those of the set
/// `normal . x <= offset_n`.
#[derive(Debug, Clone, PartialEq)]
pub struct Facet {
    /// Outward unit normal.
    pub normal: Vector3<f64>,
    /// Distance from the origin along the normal, N; negative where the origin is outside of this
    /// face.
    pub offset_n: f64,
    /// Corners in order around the face, N.
    pub corners_n: Vec<Vector3<f64>>,
}

/// The feasible forces at a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Zonotope {
    directions: Vec<Vector3<f64>>,
    bounds_n: Vec<(f64, f64)>,
    facets: Vec<Facet>,
}

impl Zonotope {
    /// From the cables' directions (unit vectors from the tip to the exit points) and the least and
    /// largest tension of each, N.
    ///
    /// # Errors
    /// [`WorkspaceError`]: different numbers of directions and bounds, numbers that are not finite,
    /// directions that are not of unit length, a least tension above the largest, cables that all
    /// lie in a plane.
    pub fn new(
        directions: &[Vector3<f64>],
        bounds_n: &[(f64, f64)],
    ) -> Result<Self, WorkspaceError> {
        if directions.is_empty() || directions.len() != bounds_n.len() {
            return Err(WorkspaceError::Counts {
                directions: directions.len(),
                bounds: bounds_n.len(),
            });
        }
        for (i, (d, (low, high))) in directions.iter().zip(bounds_n).enumerate() {
            let bad = |what| WorkspaceError::BadCable { cable: i + 1, what };
            let unit_length = (d.norm() - 1.0).abs() < 1e-6;
            if !unit_length {
                return Err(bad("its direction is not of unit length"));
            }
            if !(*low >= 0.0 && high >= low && high.is_finite()) {
                return Err(bad(
                    "its tensions have to be finite, 0 N or more, least first",
                ));
            }
        }
        let mut out = Self {
            directions: directions.to_vec(),
            bounds_n: bounds_n.to_vec(),
            facets: Vec::new(),
        };
        let normals = out.normals();
        if normals.is_empty() || out.is_flat(&normals) {
            return Err(WorkspaceError::Flat);
        }
        out.facets = normals.iter().map(|n| out.facet(n)).collect();
        Ok(out)
    }

    /// Cables that have a choice of tension: the others only move the set.
    fn active(&self) -> impl Iterator<Item = &Vector3<f64>> {
        self.directions
            .iter()
            .zip(&self.bounds_n)
            .filter(|(_, (low, high))| high > low)
            .map(|(d, _)| d)
    }

    /// Outward normals of all faces, both senses, each once.
    fn normals(&self) -> Vec<Vector3<f64>> {
        let active: Vec<&Vector3<f64>> = self.active().collect();
        let mut out: Vec<Vector3<f64>> = Vec::new();
        for (i, a) in active.iter().enumerate() {
            for b in &active[i + 1..] {
                let Some(n) = a.cross(b).try_normalize(PARALLEL) else {
                    continue;
                };
                if !out.iter().any(|o| o.cross(&n).norm() < PARALLEL) {
                    out.push(n);
                }
            }
        }
        let opposite: Vec<Vector3<f64>> = out.iter().map(|n| -n).collect();
        out.extend(opposite);
        out
    }

    /// Whether all cables lie across one of the normals.
    fn is_flat(&self, normals: &[Vector3<f64>]) -> bool {
        normals
            .iter()
            .any(|n| self.active().all(|d| n.dot(d).abs() < PARALLEL))
    }

    fn facet(&self, n: &Vector3<f64>) -> Facet {
        let mut fixed = Vector3::zeros();
        // Segments in the face, in coordinates of the face.
        let mut within: Vec<Vector3<f64>> = Vec::new();
        for (d, &(low, high)) in self.directions.iter().zip(&self.bounds_n) {
            let along = n.dot(d);
            if along.abs() < PARALLEL && high > low {
                fixed += d * low;
                within.push(d * (high - low));
            } else {
                fixed += d * if along > 0.0 { high } else { low };
            }
        }
        // All segments turned into one half-plane of the face; sorted by angle they are half of its
        // border.
        let x = within
            .first()
            .and_then(|w| w.try_normalize(0.0))
            .unwrap_or_else(Vector3::x);
        let y = n.cross(&x);
        for w in &mut within {
            let forward =
                w.dot(&y) > 0.0 || (w.dot(&y).abs() < PARALLEL * w.norm() && w.dot(&x) > 0.0);
            if !forward {
                fixed += *w;
                *w = -*w;
            }
        }
        within.sort_by(|a, b| {
            let angle = |v: &Vector3<f64>| v.dot(&y).max(0.0).atan2(v.dot(&x));
            angle(a).total_cmp(&angle(b))
        });
        // Parallel segments are one side.
        let mut sides: Vec<Vector3<f64>> = Vec::new();
        for w in within {
            match sides.last_mut() {
                Some(last) if last.cross(&w).norm() <= PARALLEL * last.norm() * w.norm() => {
                    *last += w
                }
                _ => sides.push(w),
            }
        }
        let mut corner = fixed;
        let mut corners_n = vec![corner];
        for w in &sides {
            corner += w;
            corners_n.push(corner);
        }
        for w in &sides {
            corner -= w;
            corners_n.push(corner);
        }
        corners_n.pop();
        Facet {
            normal: *n,
            offset_n: self.support_n(n),
            corners_n,
        }
    }

    /// Support function: the largest `u . f` over the feasible forces `f`, N for a unit vector `u`.
    #[must_use]
    pub fn support_n(&self, u: &Vector3<f64>) -> f64 {
        self.directions
            .iter()
            .zip(&self.bounds_n)
            .map(|(d, (low, high))| {
                let along = u.dot(d);
                f64::max(along * low, along * high)
            })
            .sum()
    }

    /// The faces.
    #[must_use]
    pub fn facets(&self) -> &[Facet] {
        &self.facets
    }

    /// The corners of the set, each once, N.
    #[must_use]
    pub fn vertices_n(&self) -> Vec<Vector3<f64>> {
        let size: f64 = self.bounds_n.iter().map(|b| b.1).sum();
        let mut out: Vec<Vector3<f64>> = Vec::new();
        for corner in self.facets.iter().flat_map(|f| &f.corners_n) {
            if !out.iter().any(|v| (v - corner).norm() < 1e-9 * size) {
                out.push(*corner);
            }
        }
        out
    }

    /// Whether a force (N) is feasible.
    #[must_use]
    pub fn contains(&self, force_n: &Vector3<f64>) -> bool {
        self.signed_margin_n(force_n) >= 0.0
    }

    /// Least distance of a force inside the set to a face, N; for a force outside the negative of
    /// the largest amount by which it passes a face (at most its distance, see
    /// [`Self::distance_n`]).
    #[must_use]
    pub fn signed_margin_n(&self, force_n: &Vector3<f64>) -> f64 {
        self.facets
            .iter()
            .map(|f| f.offset_n - f.normal.dot(force_n))
            .fold(f64::INFINITY, f64::min)
    }

    /// Smallest and largest size in N of the feasible forces in a direction (unit vector), 0 and
    /// above. `None` where there is none. The smallest is 0 where no force at all is feasible too.
    #[must_use]
    pub fn range_n(&self, direction: &Vector3<f64>) -> Option<(f64, f64)> {
        let (mut low, mut high) = (0.0, f64::INFINITY);
        for f in &self.facets {
            let along = f.normal.dot(direction);
            if along > 1e-12 {
                high = f64::min(high, f.offset_n / along);
            } else if along < -1e-12 {
                low = f64::max(low, f.offset_n / along);
            } else if f.offset_n < 0.0 {
                return None;
            }
        }
        (high.is_finite() && low <= high).then_some((low, high))
    }

    /// Largest force in a direction (unit vector), N; `None` where none is feasible.
    #[must_use]
    pub fn largest_n(&self, direction: &Vector3<f64>) -> Option<f64> {
        self.range_n(direction).map(|r| r.1)
    }

    /// Radius of the largest ball about no force that is feasible, N: every force up to this size
    /// is, in any direction. Negative where not even no force is feasible: its distance to the set
    /// is then at least this.
    #[must_use]
    pub fn radius_n(&self) -> f64 {
        self.signed_margin_n(&Vector3::zeros())
    }

    /// Distance of a force from the set, N, and the feasible force nearest to it. 0 and the force
    /// itself inside.
    #[must_use]
    pub fn distance_n(&self, force_n: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let mut best = (f64::INFINITY, *force_n);
        let mut inside = true;
        for f in &self.facets {
            let beyond = f.normal.dot(force_n) - f.offset_n;
            if beyond <= 0.0 {
                continue;
            }
            inside = false;
            let near = nearest_in_polygon(f, force_n);
            let distance = (near - force_n).norm();
            if distance < best.0 {
                best = (distance, near);
            }
        }
        if inside {
            (0.0, *force_n)
        } else {
            best
        }
    }

    /// Volume of the set, N^3: the sum over triples of the volume their segments span (McMullen;
    /// Shephard, *Canad. J. Math.* 26 (1974) 302).
    #[must_use]
    pub fn volume_n3(&self) -> f64 {
        let segments: Vec<Vector3<f64>> = self
            .directions
            .iter()
            .zip(&self.bounds_n)
            .map(|(d, (low, high))| d * (high - low))
            .collect();
        let mut sum = 0.0;
        for (i, a) in segments.iter().enumerate() {
            for (j, b) in segments.iter().enumerate().skip(i + 1) {
                for c in &segments[j + 1..] {
                    sum += a.cross(b).dot(c).abs();
                }
            }
        }
        sum
    }
}

/// The point of a face nearest to a point.
fn nearest_in_polygon(facet: &Facet, point: &Vector3<f64>) -> Vector3<f64> {
    let flat = point - facet.normal * (facet.normal.dot(point) - facet.offset_n);
    let corners = &facet.corners_n;
    let mut best: Option<(f64, Vector3<f64>)> = None;
    let mut inside = true;
    for (i, a) in corners.iter().enumerate() {
        let b = &corners[(i + 1) % corners.len()];
        let side = b - a;
        // Corners run anticlockwise seen from outside.
        if facet.normal.dot(&side.cross(&(flat - a))) < 0.0 {
            inside = false;
        }
        let length = side.norm_squared();
        let part = if length > 0.0 {
            ((flat - a).dot(&side) / length).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let near = a + side * part;
        let distance = (near - flat).norm_squared();
        if best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, near));
        }
    }
    match best {
        Some((_, near)) if !inside => near,
        _ => flat,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BOUNDS: [(f64, f64); 6] = [(2.0, 12.0); 6];

    fn unit_vectors(count: usize) -> impl Strategy<Value = Vec<Vector3<f64>>> {
        prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), count).prop_filter_map(
            "too short",
            |raw| {
                raw.into_iter()
                    .map(|v| Vector3::from(v).try_normalize(0.1))
                    .collect::<Option<Vec<_>>>()
            },
        )
    }

    /// Oracle: all 2^6 sums of end tensions, the corners among them.
    fn corner_sums(d: &[Vector3<f64>], bounds: &[(f64, f64)]) -> Vec<Vector3<f64>> {
        (0..1usize << d.len())
            .map(|bits| {
                d.iter()
                    .zip(bounds)
                    .enumerate()
                    .map(|(i, (d, b))| d * if bits >> i & 1 == 1 { b.1 } else { b.0 })
                    .sum()
            })
            .collect()
    }

    /// Oracle: nearest feasible force by trying, for each cable, least, largest and free tension
    /// (3^6 cases), and solving the free ones by least squares.
    fn nearest(d: &[Vector3<f64>], bounds: &[(f64, f64)], force: &Vector3<f64>) -> f64 {
        let mut best = f64::INFINITY;
        for code in 0..3usize.pow(d.len() as u32) {
            let digits: Vec<usize> = (0..d.len())
                .map(|i| code / 3usize.pow(i as u32) % 3)
                .collect();
            let mut rest = *force;
            for (i, digit) in digits.iter().enumerate() {
                match digit {
                    0 => rest -= d[i] * bounds[i].0,
                    1 => rest -= d[i] * bounds[i].1,
                    _ => {}
                }
            }
            let free: Vec<usize> = (0..d.len()).filter(|&i| digits[i] == 2).collect();
            if free.len() > 3 {
                continue;
            }
            if free.is_empty() {
                best = best.min(rest.norm());
                continue;
            }
            let a = nalgebra::DMatrix::from_fn(3, free.len(), |r, c| d[free[c]][r]);
            let b = nalgebra::DVector::from_column_slice(rest.as_slice());
            let Ok(t) = a.clone().svd(true, true).solve(&b, 1e-10) else {
                continue;
            };
            let feasible = free
                .iter()
                .zip(t.iter())
                .all(|(&i, t)| (bounds[i].0 - 1e-9..=bounds[i].1 + 1e-9).contains(t));
            if feasible {
                best = best.min((a * t - b).norm());
            }
        }
        best
    }

    /// Oracle: the largest force along `u` as a linear program, by all of its basic solutions:
    /// three cables free, the others at an end.
    fn linear_program(d: &[Vector3<f64>], bounds: &[(f64, f64)], u: &Vector3<f64>) -> Option<f64> {
        let mut best: Option<f64> = None;
        let n = d.len();
        for i in 0..n {
            for j in i + 1..n {
                // Unknowns: t_i, t_j and the size of the force.
                let matrix = nalgebra::Matrix3::from_columns(&[d[i], d[j], -u]);
                let Some(inverse) = matrix.try_inverse() else {
                    continue;
                };
                let others: Vec<usize> = (0..n).filter(|k| *k != i && *k != j).collect();
                for bits in 0..1usize << others.len() {
                    let rest: Vector3<f64> = others
                        .iter()
                        .enumerate()
                        .map(|(b, &k)| {
                            d[k] * if bits >> b & 1 == 1 {
                                bounds[k].1
                            } else {
                                bounds[k].0
                            }
                        })
                        .sum();
                    let x = inverse * -rest;
                    let within =
                        |t: f64, k: usize| (bounds[k].0 - 1e-9..=bounds[k].1 + 1e-9).contains(&t);
                    if within(x[0], i) && within(x[1], j) && x[2] >= 0.0 {
                        best = Some(best.map_or(x[2], |b| b.max(x[2])));
                    }
                }
            }
        }
        best
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn faces_and_corners_match_the_oracle(d in unit_vectors(6), probe in prop::array::uniform3(-30.0..30.0f64)) {
            let z = Zonotope::new(&d, &BOUNDS).unwrap();
            let sums = corner_sums(&d, &BOUNDS);
            for f in z.facets() {
                let most = sums.iter().map(|s| f.normal.dot(s)).fold(f64::NEG_INFINITY, f64::max);
                prop_assert!((most - f.offset_n).abs() < 1e-9);
                for c in &f.corners_n {
                    prop_assert!((f.normal.dot(c) - f.offset_n).abs() < 1e-6);
                    prop_assert!(sums.iter().any(|s| (s - c).norm() < 1e-6));
                }
            }
            // In general position: k (k - 1) faces and k (k - 1) + 2 corners.
            prop_assert_eq!(z.facets().len(), 30);
            prop_assert_eq!(z.vertices_n().len(), 32);
            let probe = Vector3::from(probe);
            let (distance, near) = z.distance_n(&probe);
            let want = nearest(&d, &BOUNDS, &probe);
            prop_assert!((distance - want).abs() < 1e-5, "{} {}", distance, want);
            prop_assert!(z.signed_margin_n(&near) > -1e-6);
        }

        #[test]
        fn largest_force_matches_the_linear_program(d in unit_vectors(6), u in unit_vectors(1)) {
            let z = Zonotope::new(&d, &BOUNDS).unwrap();
            match (z.largest_n(&u[0]), linear_program(&d, &BOUNDS, &u[0])) {
                (Some(a), Some(b)) => prop_assert!((a - b).abs() < 1e-6, "{} {}", a, b),
                (a, b) => {
                    // Both ends of a range that just touches may differ by rounding.
                    let size = a.or(b);
                    prop_assert!(size.is_none() || z.signed_margin_n(&(u[0] * size.unwrap_or(0.0))).abs() < 1e-6);
                }
            }
        }

        #[test]
        fn tensions_within_bounds_give_forces_within_the_set(
            d in unit_vectors(6),
            t in prop::collection::vec(2.0..12.0f64, 6),
        ) {
            let z = Zonotope::new(&d, &BOUNDS).unwrap();
            let force: Vector3<f64> = d.iter().zip(&t).map(|(d, t)| d * *t).sum();
            prop_assert!(z.signed_margin_n(&force) > -1e-9);
            let radius = z.radius_n();
            let probe = d[0].cross(&d[1]).normalize() * radius.abs();
            if radius > 0.0 {
                prop_assert!(z.contains(&(probe * 0.999)));
            } else {
                prop_assert!(!z.contains(&Vector3::zeros()) || radius.abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_cube_is_a_cube() {
        let d = [
            Vector3::x(),
            -Vector3::x(),
            Vector3::y(),
            -Vector3::y(),
            Vector3::z(),
            -Vector3::z(),
        ];
        let z = Zonotope::new(&d, &BOUNDS).unwrap();
        assert_eq!((z.facets().len(), z.vertices_n().len()), (6, 8));
        assert!((z.radius_n() - 10.0).abs() < 1e-12);
        assert!((z.volume_n3() - 8000.0).abs() < 1e-9);
        let diagonal = Vector3::new(1.0, 1.0, 1.0).normalize();
        assert!((z.largest_n(&diagonal).unwrap() - 300f64.sqrt()).abs() < 1e-9);
        let (distance, near) = z.distance_n(&Vector3::new(13.0, 14.0, 0.0));
        assert!(
            (distance - 5.0).abs() < 1e-12 && (near - Vector3::new(10.0, 10.0, 0.0)).norm() < 1e-12
        );
        assert_eq!(z.distance_n(&Vector3::new(1.0, 2.0, 3.0)).0, 0.0);
    }

    #[test]
    fn cables_that_pull_one_way_leave_no_force_out() {
        let d = [
            Vector3::new(0.1, 0.0, 1.0).normalize(),
            Vector3::new(-0.1, 0.1, 1.0).normalize(),
            Vector3::new(0.0, -0.1, 1.0).normalize(),
        ];
        let z = Zonotope::new(&d, &BOUNDS[..3]).unwrap();
        assert!(z.radius_n() < 0.0 && !z.contains(&Vector3::zeros()));
        let (low, high) = z.range_n(&Vector3::z()).unwrap();
        assert!(low > 5.0 && high < 36.0);
        assert_eq!(z.largest_n(&-Vector3::z()), None);
    }

    #[test]
    fn bad_cables_are_refused() {
        let flat = [Vector3::x(), Vector3::y(), -Vector3::x()];
        assert_eq!(
            Zonotope::new(&flat, &BOUNDS[..3]),
            Err(WorkspaceError::Flat)
        );
        assert_eq!(
            Zonotope::new(&flat[..1], &BOUNDS[..1]),
            Err(WorkspaceError::Flat)
        );
        assert!(matches!(
            Zonotope::new(&[], &[]),
            Err(WorkspaceError::Counts { .. })
        ));
        let nan = [Vector3::repeat(f64::NAN), Vector3::y(), Vector3::z()];
        assert!(matches!(
            Zonotope::new(&nan, &BOUNDS[..3]),
            Err(WorkspaceError::BadCable { cable: 1, .. })
        ));
        let d = [Vector3::x(), Vector3::y(), Vector3::z()];
        assert!(Zonotope::new(&d, &[(5.0, 2.0); 3]).is_err());
        assert!(Zonotope::new(&d, &[(2.0, f64::NAN); 3]).is_err());
    }
}
