//! Figures of the virtual arm: published values, their ranges, and the draw of one arm from a seed.
//!
//! Published figures of the Raven-II's friction differ by up to ten times, so no arm here has the
//! published values: each seed is another Raven, drawn from the ranges below. docs/robot.md lists
//! them with their sources.

use crate::random::Random;
use serde::Serialize;

/// A range around a published value; an arm's value is drawn log-uniform within it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Range {
    /// Smallest.
    pub low: f64,
    /// Published, or the middle of several clues.
    pub nominal: f64,
    /// Largest.
    pub high: f64,
}

const fn range(low: f64, nominal: f64, high: f64) -> Range {
    Range { low, nominal, high }
}

/// A half to four times: the simulation's hand-tuned friction (raven2_sim, two_arm_dyn.cpp) and the
/// standstill at 1,000 DAC codes (raven2, defines.h) are that far apart.
const fn friction(nominal: f64) -> Range {
    range(0.5 * nominal, nominal, 4.0 * nominal)
}

/// Coulomb friction of the links: N·m, N·m, N (raven2_sim).
pub const LINK_COULOMB: [Range; 3] = [friction(0.505), friction(0.49), friction(0.53)];
/// Coulomb friction of motor and gearhead at the gearhead's output, N·m (raven2_sim).
pub const MOTOR_COULOMB: [Range; 3] = [friction(0.041), friction(0.072), friction(0.051)];
/// Viscous friction of the links: N·m·s/rad, N·m·s/rad, N·s/m (raven2_sim); of little effect at
/// these speeds.
pub const LINK_VISCOUS: [Range; 3] = [
    range(0.0025, 0.005, 0.5),
    range(0.00125, 0.0025, 0.5),
    range(0.0027, 0.0053, 5.0),
];
/// Viscous friction at the gearhead's output, N·m·s/rad of the gearhead (raven2_sim).
pub const MOTOR_VISCOUS: [Range; 3] = [
    range(0.001, 0.0025, 0.01),
    range(0.001, 0.0024, 0.01),
    range(0.001, 0.0028, 0.01),
];
/// Breakaway per Coulomb friction. Estimate: 1.02 to 1.4 covers greased gears and dry cable guides.
pub const BREAKAWAY: Range = range(1.02, 1.15, 1.4);
/// Speed at which the excess of breakaway has faded to a quarter: rad/s, rad/s, m/s of the joint.
/// Estimate.
pub const STRIBECK: [Range; 3] = [
    range(0.002, 0.005, 0.015),
    range(0.002, 0.005, 0.015),
    range(2e-4, 5e-4, 1.5e-3),
];
/// Travel until a sticking contact slides: rad, rad, m of the joint. Estimate: backlash-free gear
/// and belts of cable.
pub const PRESLIDING: [Range; 3] = [
    range(2e-4, 5e-4, 1.5e-3),
    range(2e-4, 5e-4, 1.5e-3),
    range(3e-5, 8e-5, 2.5e-4),
];
/// Growth of the motors' Coulomb friction with the force that the cable passes on, per force.
/// Estimate from cable-pulley friction, which grows with tension, wrap and number of pulleys and
/// not with speed (Miyasaka).
pub const LOAD_SHARE: [Range; 3] = [
    range(0.01, 0.04, 0.12),
    range(0.01, 0.04, 0.12),
    range(0.01, 0.05, 0.15),
];
/// Friction of the tool's shaft in its guide per lateral force at the tip, acts on the insertion.
/// Estimate.
pub const GUIDE_FRICTION: Range = range(0.05, 0.12, 0.3);
/// Stiffness of the cables at the joints: N·m/rad, N·m/rad, N/m (raven2_sim; the elbow's is
/// published as 0.56 to 1.7 k).
pub const CABLE_STIFFNESS: [Range; 3] = [
    range(2_800.0, 5_700.0, 11_000.0),
    range(560.0, 1_000.0, 1_700.0),
    range(9_000.0, 18_500.0, 37_000.0),
];
/// Damping of the cables, ratio to critical with the link. Estimate; the simulation's figures are
/// of this order.
pub const CABLE_DAMPING: Range = range(0.03, 0.08, 0.2);
/// Rotor inertia of the RE40 with its part of the gearhead, kg·m² (maxon catalogue: 1.4e-5 for the
/// rotor).
pub const ROTOR_INERTIA: Range = range(1.3e-5, 1.45e-5, 1.7e-5);
/// Masses per those of the gravity model (two published sets differ by up to 2 % for links 1 and 2,
/// by 76 % for link 3).
pub const MASS: [Range; 3] = [
    range(0.95, 1.0, 1.05),
    range(0.95, 1.0, 1.05),
    range(0.9, 1.0, 1.76),
];
/// Torque per current per the nominal: tolerance of motor and amplifier. Estimate.
pub const TORQUE_GAIN: Range = range(0.96, 1.0, 1.04);
/// Standard deviation of the amplifiers' zero, A. Estimate: 0.1 % of the 12 A range.
pub const CURRENT_OFFSET_SD_A: f64 = 0.012;
/// Standard deviation of the joints' zero after homing: rad, rad, m. From joint errors of 0.43 and
/// 0.5 degrees and 0.5 mm before correction (Peng, arXiv 2408.01604), of which stretch has its
/// part.
pub const HOMING_SD: [f64; 3] = [0.0035, 0.0035, 2e-4];

/// The ranges as a table in Markdown, for docs/robot.md: what it is, joint, unit, smallest,
/// nominal, largest.
#[must_use]
pub fn table() -> String {
    use std::fmt::Write as _;
    const ROTARY: [&str; 3] = ["N·m", "N·m", "N"];
    const DAMPING: [&str; 3] = ["N·m·s/rad", "N·m·s/rad", "N·s/m"];
    const STIFFNESS: [&str; 3] = ["N·m/rad", "N·m/rad", "N/m"];
    const SPEED: [&str; 3] = ["rad/s", "rad/s", "m/s"];
    const TRAVEL: [&str; 3] = ["rad", "rad", "m"];
    const NONE: [&str; 3] = ["", "", ""];
    let threes: [(&str, [Range; 3], [&str; 3]); 9] = [
        ("Coulomb friction, link", LINK_COULOMB, ROTARY),
        (
            "Coulomb friction, motor, at the gearhead",
            MOTOR_COULOMB,
            ["N·m"; 3],
        ),
        ("viscous friction, link", LINK_VISCOUS, DAMPING),
        (
            "viscous friction, motor, at the gearhead",
            MOTOR_VISCOUS,
            ["N·m·s/rad"; 3],
        ),
        ("Stribeck speed", STRIBECK, SPEED),
        ("presliding travel", PRESLIDING, TRAVEL),
        ("load share of the motor's friction", LOAD_SHARE, NONE),
        ("cable stiffness at the joint", CABLE_STIFFNESS, STIFFNESS),
        ("mass per gravity model", MASS, NONE),
    ];
    let ones = [
        ("breakaway per Coulomb friction", BREAKAWAY, ""),
        ("guide friction per lateral force", GUIDE_FRICTION, ""),
        ("cable damping, ratio to critical", CABLE_DAMPING, ""),
        ("rotor inertia", ROTOR_INERTIA, "kg·m²"),
        ("torque per current, ratio", TORQUE_GAIN, ""),
    ];
    let mut table = String::from(
        "| parameter | joint | unit | smallest | nominal | largest |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    // Six digits at most: what 4 times 0.53 is written as.
    let number = |value: f64| {
        let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
        format!("{rounded}")
    };
    let mut row = |name: &str, joint: &str, unit: &str, range: Range| {
        let [low, nominal, high] = [range.low, range.nominal, range.high].map(number);
        // A String takes every write.
        let _ = writeln!(
            table,
            "| {name} | {joint} | {unit} | {low} | {nominal} | {high} |"
        );
    };
    for (name, ranges, units) in threes {
        for (i, (range, unit)) in ranges.into_iter().zip(units).enumerate() {
            row(name, ["shoulder", "elbow", "insertion"][i], unit, range);
        }
    }
    for (name, range, unit) in ones {
        row(name, "all", unit, range);
    }
    table
}

/// True figures of one arm. No estimator may see them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[allow(missing_docs)] // each named after the range above from which it is drawn, in its unit
pub struct Parameters {
    pub link_coulomb: [f64; 3],
    /// At the joints: N·m, N·m, N.
    pub motor_coulomb: [f64; 3],
    pub link_viscous: [f64; 3],
    /// At the joints: N·m·s/rad, N·m·s/rad, N·s/m.
    pub motor_viscous: [f64; 3],
    pub link_breakaway: [f64; 3],
    pub motor_breakaway: [f64; 3],
    pub stribeck: [f64; 3],
    pub presliding: [f64; 3],
    pub load_share: [f64; 3],
    pub guide_friction: f64,
    pub cable_stiffness: [f64; 3],
    pub cable_damping_ratio: [f64; 3],
    pub rotor_inertia: [f64; 3],
    pub mass_factor: [f64; 3],
    pub torque_gain: [f64; 3],
    pub current_offset_a: [f64; 3],
    pub homing: [f64; 3],
    /// Where between two edges the encoders stand at the start, counts.
    pub encoder_phase: [f64; 3],
}

/// Draws from ranges; `scatter` 0 gives the nominal values, 1 the whole ranges.
struct Draw {
    random: Random,
    scatter: f64,
}

impl Draw {
    fn new(seed: u64, label: &str, scatter: f64) -> Self {
        Self {
            random: Random::stream(seed, label, 0),
            scatter,
        }
    }

    fn one(&mut self, range: Range) -> f64 {
        let value = self.random.log_uniform(range.low, range.high);
        range.nominal * libm::pow(value / range.nominal, self.scatter)
    }

    fn three(&mut self, ranges: [Range; 3]) -> [f64; 3] {
        ranges.map(|range| self.one(range))
    }

    /// Half of the draw is common to the arm: how it was greased and how tight its cables are.
    fn with_common(&mut self, common: f64, ranges: [Range; 3]) -> [f64; 3] {
        ranges.map(|range| {
            let part = 0.5 * (common + self.random.unit());
            let value = range.low * libm::pow(range.high / range.low, part);
            range.nominal * libm::pow(value / range.nominal, self.scatter)
        })
    }

    fn normal(&mut self, sd: [f64; 3]) -> [f64; 3] {
        sd.map(|sd| self.scatter * sd * self.random.normal().clamp(-2.5, 2.5))
    }
}

impl Parameters {
    /// The arm of `seed`. `scatter`: 1 for the whole ranges, 0 for the nominal values.
    #[must_use]
    pub fn draw(seed: u64, scatter: f64) -> Self {
        use crate::kinematics::TRANSMISSION;
        use crate::ravenstate::GEAR;
        let mut friction = Draw::new(seed, "arm friction", scatter);
        let common = friction.random.unit();
        let link_coulomb = friction.with_common(common, LINK_COULOMB);
        let at_gear = friction.with_common(common, MOTOR_COULOMB);
        let link_viscous = friction.three(LINK_VISCOUS);
        let viscous_at_gear = friction.three(MOTOR_VISCOUS);
        let mut contact = Draw::new(seed, "arm contact", scatter);
        let mut drive = Draw::new(seed, "arm drive", scatter);
        let mut zero = Draw::new(seed, "arm zero", scatter);
        Self {
            link_coulomb,
            motor_coulomb: core::array::from_fn(|i| at_gear[i] * TRANSMISSION[i] / GEAR),
            link_viscous,
            motor_viscous: core::array::from_fn(|i| {
                viscous_at_gear[i] * (TRANSMISSION[i] / GEAR).powi(2)
            }),
            link_breakaway: contact.three([BREAKAWAY; 3]),
            motor_breakaway: contact.three([BREAKAWAY; 3]),
            stribeck: contact.three(STRIBECK),
            presliding: contact.three(PRESLIDING),
            load_share: contact.three(LOAD_SHARE),
            guide_friction: contact.one(GUIDE_FRICTION),
            cable_stiffness: drive.three(CABLE_STIFFNESS),
            cable_damping_ratio: drive.three([CABLE_DAMPING; 3]),
            rotor_inertia: drive.three([ROTOR_INERTIA; 3]),
            mass_factor: drive.three(MASS),
            torque_gain: drive.three([TORQUE_GAIN; 3]),
            current_offset_a: zero.normal([CURRENT_OFFSET_SD_A; 3]),
            homing: zero.normal(HOMING_SD),
            encoder_phase: [zero.random.unit(), zero.random.unit(), zero.random.unit()],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_arm_is_within_the_ranges_and_seeds_differ() {
        let mut seen = Vec::new();
        for seed in 0..200 {
            let p = Parameters::draw(seed, 1.0);
            for i in 0..3 {
                let within = |value: f64, range: Range| {
                    assert!(value >= range.low * 0.999 && value <= range.high * 1.001);
                };
                within(p.link_coulomb[i], LINK_COULOMB[i]);
                within(p.cable_stiffness[i], CABLE_STIFFNESS[i]);
                within(p.mass_factor[i], MASS[i]);
                within(p.load_share[i], LOAD_SHARE[i]);
            }
            seen.push(p.link_coulomb[0]);
        }
        let (least, most) = (
            seen.iter().copied().fold(f64::MAX, f64::min),
            seen.iter().copied().fold(0.0, f64::max),
        );
        assert!(most / least > 4.0, "{least} to {most}");
    }

    #[test]
    fn the_page_has_this_table() {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/robot.md");
        let page = std::fs::read_to_string(page).unwrap();
        assert!(
            page.contains(&table()),
            "docs/robot.md lacks the table of `cargo run -p robot --example parameters`:\n{}",
            table()
        );
    }

    #[test]
    fn without_scatter_the_arm_is_the_published_one() {
        let p = Parameters::draw(5, 0.0);
        assert_eq!(p.link_coulomb, LINK_COULOMB.map(|r| r.nominal));
        assert_eq!(p.homing, [0.0; 3]);
        // 0.041 N·m at the gearhead are 0.46 N·m at the shoulder.
        assert!((p.motor_coulomb[0] - 0.456).abs() < 1e-3);
        assert_eq!(
            p,
            Parameters {
                encoder_phase: p.encoder_phase,
                ..Parameters::draw(6, 0.0)
            }
        );
    }
}
