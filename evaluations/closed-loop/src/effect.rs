//! What a seed's rig has beyond its rig file: kind and size, drawn from the seed, as a plant file.

use evaluation::clap;
use std::fmt::Write as _;

/// Cables start this slack, m, so that the zeros are taken without a pull, as docs/bring-up.md has
/// it.
const SLACK_M: f64 = 0.003;
/// Mean command of the excitation, N: where friction that grows with load is compared.
pub const MIDDLE_N: f64 = 4.5;

/// Names by which friction of the reel counts as named, with its load or without.
const FRICTION: &[&str] = &["coulomb", "load_dependent_coulomb"];

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

/// Where the effects of a rig are, and how many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Effects {
    /// One, in all units.
    All,
    /// One, in one unit.
    OneUnit,
    /// Two, in all units: that of the seed and that of the next one of its ten.
    Two,
}

/// An effect that a rig has.
pub struct Effect {
    pub kind: Kind,
    /// In words, with its size.
    pub words: String,
    /// Names by which it counts as named.
    pub names: &'static [&'static str],
    /// The number that is compared, and its unit.
    pub value: f64,
    pub unit: &'static str,
    /// Its lines of a plant file.
    lines: String,
}

/// What a rig has beyond its rig file.
pub struct Truth {
    /// One or two; none where the rig has nothing.
    pub effects: Vec<Effect>,
    /// The unit that has them, from 1; `None`: all.
    pub only: Option<u64>,
    /// The plant file's text.
    pub plant: String,
}

impl Truth {
    /// The effects in words.
    pub fn words(&self) -> String {
        let words: Vec<&str> = self.effects.iter().map(|e| e.words.as_str()).collect();
        match (words.as_slice(), self.only) {
            ([], _) => "nothing but the units' own scatter".to_owned(),
            (_, Some(unit)) => format!("{}, unit {unit} only", words.join("; ")),
            _ => words.join("; "),
        }
    }

    /// Kinds of the effects; that of nothing where there is none.
    pub fn kinds(&self) -> Vec<Kind> {
        match self.effects.as_slice() {
            [] => vec![Kind::Nothing],
            effects => effects.iter().map(|effect| effect.kind).collect(),
        }
    }

    /// Whether a unit, from 1, has the effects.
    pub fn is_in(&self, unit: u64) -> bool {
        self.only.is_none_or(|only| only == unit)
    }
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
pub fn truth(seed: u64, size: f64, effects: Effects) -> Truth {
    let ten = KINDS.len() as u64;
    let next = seed - seed.saturating_sub(1) % ten + seed % ten;
    let seeds = match effects {
        Effects::Two => vec![seed, next],
        Effects::All | Effects::OneUnit => vec![seed],
    };
    let effects_of: Vec<Effect> = seeds.into_iter().filter_map(|s| effect(s, size)).collect();
    let only = (effects == Effects::OneUnit && !effects_of.is_empty()).then_some(1 + seed % 6);
    let lines: Vec<String> = effects_of
        .iter()
        .map(|effect| match only {
            Some(unit) => format!("{}\nunits = [{}]", effect.lines, unit - 1),
            None => effect.lines.clone(),
        })
        .collect();
    Truth {
        plant: plant_text(&lines),
        effects: effects_of,
        only,
    }
}

/// The effect of a seed; `None`: it has none.
fn effect(seed: u64, size: f64) -> Option<Effect> {
    let kind = kind_of(seed);
    let mut draw = Draw(seed.wrapping_mul(0x5851_F42D_4C95_7F2D));
    let sign = if draw.next() & 1 == 0 { 1.0 } else { -1.0 };
    let x = draw.between(0.0, 1.0);
    let within = |low: f64, high: f64| size * (low + (high - low) * x);
    let (words, lines, names, value, unit) = match kind {
        Kind::Coulomb => {
            let n = within(0.4, 0.8);
            (
                format!("Coulomb friction +{n:.3} N"),
                format!("kind = \"coulomb\"\nconstant_n = {n}"),
                FRICTION,
                n,
                "N",
            )
        }
        // A cable over one more guide, by a quarter turn, loses 1 - exp(-mu pi / 2) of its pull: mu
        // of 0.10 to 0.14.
        Kind::LoadFriction => {
            let share = within(0.15, 0.20);
            (
                format!("friction +{share:.3} of the pull"),
                format!("kind = \"coulomb\"\nconstant_n = 0.0\nper_load = {share}"),
                FRICTION,
                share * MIDDLE_N,
                "N at 4.5 N",
            )
        }
        Kind::Ripple => {
            let n = within(0.4, 0.8);
            (
                format!("ripple {n:.3} N, once a motor turn"),
                format!("kind = \"periodic\"\nshaft = \"motor\"\norder = 1.0\namplitude_n = {n}"),
                &["periodic_angle"][..],
                n,
                "N",
            )
        }
        Kind::Gain => {
            let error = sign * within(0.2, 0.3);
            (
                format!("amplifier gain {:+.1} %", 100.0 * error),
                format!("kind = \"amplifier_gain\"\nrelative_error = {error}"),
                &["gain"][..],
                100.0 * error,
                "%",
            )
        }
        Kind::Delay => {
            let ms = within(4.0, 10.0);
            (
                format!("command delayed by {ms:.2} ms"),
                format!("kind = \"command_delay\"\ndelay_s = {}", ms * 1e-3),
                &["delay", "cable_stretch"][..],
                ms,
                "ms",
            )
        }
        Kind::Viscous => {
            let c = within(20.0, 50.0);
            (
                format!("viscous friction +{c:.1} N s/m"),
                format!("kind = \"viscous\"\ncoefficient_n_s_per_m = {c}"),
                &["viscous"][..],
                c,
                "N s/m",
            )
        }
        Kind::Backlash => {
            let mm = within(0.4, 1.0);
            (
                format!("backlash of {mm:.2} mm"),
                format!(
                    "kind = \"backlash\"\ngap_m = {}\nreel_friction_n = 0.2",
                    mm * 1e-3
                ),
                &["backlash"][..],
                mm,
                "mm",
            )
        }
        Kind::Creep => {
            let part = within(0.06, 0.12);
            (
                format!("creep of the cells, {:.1} % in 6 s", 100.0 * part),
                format!("kind = \"creep\"\nfraction = {part}\ntime_constant_s = 6.0"),
                &["creep"][..],
                100.0 * part,
                "%",
            )
        }
        Kind::CellCurve => {
            let k = within(0.006, 0.012);
            (
                format!("cells curved by {k:.4} /N"),
                format!("kind = \"cell_quadratic\"\nper_n = {k}"),
                &["quadratic"][..],
                k,
                "1/N",
            )
        }
        Kind::Nothing => return None,
    };
    Some(Effect {
        kind,
        words,
        names,
        value,
        unit,
        lines,
    })
}

/// A plant file with these effects.
pub fn plant_text(effects: &[String]) -> String {
    let mut plant = format!("[cable]\ninitial_slack_m = {SLACK_M}\n");
    for lines in effects {
        let _ = write!(plant, "\n[[effects]]\n{lines}\n");
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
            let one = truth(seed, 1.0, Effects::All);
            let nothing = one.kinds() == [Kind::Nothing];
            assert_eq!(one.plant.contains("[[effects]]"), !nothing);
            assert!(one.plant.contains("initial_slack_m = 0.003"));
            // The same in one unit.
            let in_one = truth(seed, 1.0, Effects::OneUnit);
            assert_eq!(in_one.plant.contains("units = ["), !nothing);
            assert_eq!((1..=6).filter(|u| in_one.is_in(*u)).count() == 6, nothing);
            let two = truth(seed, 1.0, Effects::Two).kinds();
            assert_eq!(two.contains(&one.kinds()[0]), !nothing);
        }
        let of = |seed, size| truth(seed, size, Effects::All).plant;
        // The sizes differ from seed to seed, and one seed is one rig.
        assert_ne!(of(1, 1.0), of(11, 1.0));
        assert_ne!(of(1, 1.0), of(1, 0.5));
        assert_eq!(of(7, 1.0), of(7, 1.0));
        // Two of ten pairs have nothing beside an effect, and no effect stands beside itself.
        let pairs: Vec<Vec<Kind>> = (1..=10)
            .map(|s| truth(s, 1.0, Effects::Two).kinds())
            .collect();
        assert_eq!(pairs.iter().filter(|kinds| kinds.len() == 2).count(), 8);
        assert!(pairs
            .iter()
            .all(|kinds| kinds.len() < 2 || kinds[0] != kinds[1]));
    }
}
