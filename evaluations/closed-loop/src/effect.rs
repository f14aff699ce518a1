//! What a seed's rig has beyond its rig file: kind and size, drawn from the seed, as a plant file.

use std::fmt::Write as _;

/// Cables start this slack, m, so that the zeros are taken without a pull, as docs/bring-up.md has it.
const SLACK_M: f64 = 0.003;
/// Mean command of the excitation, N: where friction that grows with load is compared.
pub const MIDDLE_N: f64 = 4.5;

/// Draws numbers from a seed: SplitMix64.
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A kind of effect that a rig may have beyond its rig file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Coulomb,
    LoadFriction,
    Ripple,
    Gain,
    Delay,
    Viscous,
    Backlash,
    Creep,
    CellCurve,
    Nothing,
}

impl Kind {
    /// Name in the page and the summary.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Coulomb => "Coulomb friction",
            Self::LoadFriction => "friction in proportion to the pull",
            Self::Ripple => "ripple",
            Self::Gain => "gain of the amplifier",
            Self::Delay => "delay of the command",
            Self::Viscous => "viscous friction",
            Self::Backlash => "backlash",
            Self::Creep => "creep of the cells",
            Self::CellCurve => "curve of the cells",
            Self::Nothing => "nothing",
        }
    }
}

/// Every kind, one for each of ten seeds.
pub const KINDS: [Kind; 10] = [
    Kind::Coulomb,
    Kind::LoadFriction,
    Kind::Ripple,
    Kind::Gain,
    Kind::Delay,
    Kind::Viscous,
    Kind::Backlash,
    Kind::Creep,
    Kind::CellCurve,
    Kind::Nothing,
];

/// What a rig has beyond its rig file.
pub struct Truth {
    pub kind: Kind,
    /// In words, with its size.
    pub words: String,
    /// The plant file's text.
    pub plant: String,
    /// Names by which it counts as named.
    pub names: &'static [&'static str],
    /// The number that is compared, and its unit.
    pub value: f64,
    pub unit: &'static str,
}

/// The kinds of ten seeds in a row are a permutation of all.
pub fn kind_of(seed: u64) -> Kind {
    let turn = seed.saturating_sub(1) / KINDS.len() as u64;
    let mut kinds = KINDS;
    let mut draw = Draw(turn ^ 0xC105_ED10);
    for i in (1..kinds.len()).rev() {
        kinds.swap(i, (draw.next() % (i as u64 + 1)) as usize);
    }
    kinds[(seed.saturating_sub(1) % KINDS.len() as u64) as usize]
}

/// What the rig of a seed has, its size times a factor.
pub fn truth(seed: u64, size: f64) -> Truth {
    let kind = kind_of(seed);
    let mut draw = Draw(seed.wrapping_mul(0x5851_F42D_4C95_7F2D));
    let sign = if draw.next() & 1 == 0 { 1.0 } else { -1.0 };
    let x = draw.between(0.0, 1.0);
    let within = |low: f64, high: f64| size * (low + (high - low) * x);
    match kind {
        Kind::Coulomb => coulomb(within(0.4, 0.8)),
        // A cable over one more guide, by a quarter turn, loses 1 - exp(-mu pi / 2) of its pull: mu of 0.10 to 0.14.
        Kind::LoadFriction => load_friction(within(0.15, 0.20)),
        Kind::Ripple => ripple(within(0.4, 0.8)),
        Kind::Gain => gain(sign * within(0.2, 0.3)),
        Kind::Delay => delay(within(4.0, 10.0)),
        Kind::Viscous => viscous(within(20.0, 50.0)),
        Kind::Backlash => backlash(within(0.4, 1.0)),
        Kind::Creep => creep(within(0.06, 0.12)),
        Kind::CellCurve => cell_curve(within(0.006, 0.012)),
        Kind::Nothing => Truth {
            kind,
            words: "nothing but the units' own scatter".to_owned(),
            plant: plant_text(""),
            names: &[],
            value: 0.0,
            unit: "",
        },
    }
}

fn coulomb(n: f64) -> Truth {
    Truth {
        kind: Kind::Coulomb,
        words: format!("Coulomb friction +{n:.3} N"),
        plant: plant_text(&format!("kind = \"coulomb\"\nconstant_n = {n}")),
        names: &["coulomb", "load_dependent_coulomb"],
        value: n,
        unit: "N",
    }
}

fn load_friction(share: f64) -> Truth {
    Truth {
        kind: Kind::LoadFriction,
        words: format!("friction +{share:.3} of the pull"),
        plant: plant_text(&format!(
            "kind = \"coulomb\"\nconstant_n = 0.0\nper_load = {share}"
        )),
        names: &["coulomb", "load_dependent_coulomb"],
        value: share * MIDDLE_N,
        unit: "N at 4.5 N",
    }
}

fn ripple(n: f64) -> Truth {
    Truth {
        kind: Kind::Ripple,
        words: format!("ripple {n:.3} N, once a motor turn"),
        plant: plant_text(&format!(
            "kind = \"periodic\"\nshaft = \"motor\"\norder = 1.0\namplitude_n = {n}"
        )),
        names: &["periodic_angle"],
        value: n,
        unit: "N",
    }
}

fn gain(error: f64) -> Truth {
    Truth {
        kind: Kind::Gain,
        words: format!("amplifier gain {:+.1} %", 100.0 * error),
        plant: plant_text(&format!(
            "kind = \"amplifier_gain\"\nrelative_error = {error}"
        )),
        names: &["gain"],
        value: 100.0 * error,
        unit: "%",
    }
}

fn delay(ms: f64) -> Truth {
    Truth {
        kind: Kind::Delay,
        words: format!("command delayed by {ms:.2} ms"),
        plant: plant_text(&format!(
            "kind = \"command_delay\"\ndelay_s = {}",
            ms * 1e-3
        )),
        names: &["delay", "cable_stretch"],
        value: ms,
        unit: "ms",
    }
}

fn viscous(c: f64) -> Truth {
    Truth {
        kind: Kind::Viscous,
        words: format!("viscous friction +{c:.1} N s/m"),
        plant: plant_text(&format!("kind = \"viscous\"\ncoefficient_n_s_per_m = {c}")),
        names: &["viscous"],
        value: c,
        unit: "N s/m",
    }
}

fn backlash(mm: f64) -> Truth {
    Truth {
        kind: Kind::Backlash,
        words: format!("backlash of {mm:.2} mm"),
        plant: plant_text(&format!(
            "kind = \"backlash\"\ngap_m = {}\nreel_friction_n = 0.2",
            mm * 1e-3
        )),
        names: &["backlash"],
        value: mm,
        unit: "mm",
    }
}

fn creep(part: f64) -> Truth {
    Truth {
        kind: Kind::Creep,
        words: format!("creep of the cells, {:.1} % in 6 s", 100.0 * part),
        plant: plant_text(&format!(
            "kind = \"creep\"\nfraction = {part}\ntime_constant_s = 6.0"
        )),
        names: &["creep"],
        value: 100.0 * part,
        unit: "%",
    }
}

fn cell_curve(k: f64) -> Truth {
    Truth {
        kind: Kind::CellCurve,
        words: format!("cells curved by {k:.4} /N"),
        plant: plant_text(&format!("kind = \"cell_quadratic\"\nper_n = {k}")),
        names: &["quadratic"],
        value: k,
        unit: "1/N",
    }
}

/// A plant file with this effect, or none.
pub fn plant_text(effect: &str) -> String {
    let mut plant = format!("[cable]\ninitial_slack_m = {SLACK_M}\n");
    if !effect.is_empty() {
        let _ = write!(plant, "\n[[effects]]\n{effect}\n");
    }
    plant
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_seeds_in_a_row_have_every_kind_and_good_plants() {
        for first in [1, 11, 101] {
            let mut kinds: Vec<Kind> = (first..first + 10).map(kind_of).collect();
            kinds.sort_by_key(|kind| format!("{kind:?}"));
            kinds.dedup();
            assert_eq!(kinds.len(), KINDS.len());
        }
        for seed in 1..60 {
            let truth = truth(seed, 1.0);
            assert_eq!(
                truth.plant.contains("[[effects]]"),
                truth.kind != Kind::Nothing
            );
            assert!(truth.plant.contains("initial_slack_m = 0.003"));
        }
        // The sizes differ from seed to seed, and one seed is one rig.
        assert_ne!(truth(1, 1.0).plant, truth(11, 1.0).plant);
        assert_ne!(truth(1, 1.0).plant, truth(1, 0.5).plant);
        assert_eq!(truth(7, 1.0).plant, truth(7, 1.0).plant);
    }
}
