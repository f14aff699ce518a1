//! What a seed's rig has beyond its rig file: kind and size, drawn from the seed, as a plant file.

use evaluation::clap;
use plant::{Plant, PlantConfig};
use std::f64::consts::TAU;
use std::fmt::Write as _;

/// Cables start this slack, m, so that the zeros are taken without a pull, as docs/bring-up.md has
/// it.
const SLACK_M: f64 = 0.003;
/// Mean command of the excitation, N: where friction that grows with load is compared.
pub const MIDDLE_N: f64 = 4.5;

/// How much later each session of the command begins than the one before, s: one that holds a force
/// for 16 s takes 25 s with its start, the one that drives for 40 s takes 48 s.
const RUN_S: f64 = 30.0;
/// Begin, middle and end of what session 2 records by that clock, s.
const RECORDED_S: [f64; 3] = [RUN_S + 7.0, RUN_S + 27.0, RUN_S + 47.0];

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
    Stiffness,
    CellTilt,
    Scatter,
    Changing,
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
            Self::Stiffness => "stiffness of the cables",
            Self::CellTilt => "misalignment of the cells",
            Self::Scatter => "scatter of the units",
            Self::Changing => "friction that changes",
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

/// Further kinds, one for each of four seeds. The ten stay as they are, so that a seed's rig does.
pub const MORE: [Kind; 4] = [
    Kind::Stiffness,
    Kind::CellTilt,
    Kind::Scatter,
    Kind::Changing,
];

/// Which effects a rig has, and where.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Effects {
    /// One, in all units.
    All,
    /// One, in one unit.
    OneUnit,
    /// Two, in all units: that of the seed and that of the next one of its ten.
    Two,
    /// One of the further kinds, in all units: stiffness of the cables, cells that are askew, more
    /// scatter of the units, friction that changes while the command runs.
    More,
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
    /// By how much it grows while session 2 is recorded, N, where it does.
    pub change_n: Option<f64>,
    /// Figures of the plant that it changes, with their tables in the keys.
    figures: String,
    /// Its entry of `[[effects]]`, where it is one.
    entry: String,
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
    let drawn = match effects {
        Effects::Two => vec![(seed, kind_of(seed)), (next, kind_of(next))],
        Effects::All | Effects::OneUnit => vec![(seed, kind_of(seed))],
        Effects::More => vec![(seed, MORE[(seed.saturating_sub(1) % 4) as usize])],
    };
    let effects_of: Vec<Effect> = (drawn.into_iter())
        .filter_map(|(seed, kind)| effect(seed, kind, size))
        .collect();
    let only = (effects == Effects::OneUnit && !effects_of.is_empty()).then_some(1 + seed % 6);
    let entries = (effects_of.iter().filter(|effect| !effect.entry.is_empty())).map(|effect| {
        let of = only.map_or(String::new(), |unit| format!("\nunits = [{}]", unit - 1));
        effect.entry.clone() + &of
    });
    let figures: String = effects_of.iter().map(|e| e.figures.as_str()).collect();
    Truth {
        plant: plant_text(&figures, &entries.collect::<Vec<_>>()),
        effects: effects_of,
        only,
    }
}

/// The effect of a seed; `None`: it has none.
fn effect(seed: u64, kind: Kind, size: f64) -> Option<Effect> {
    let mut draw = Draw(seed.wrapping_mul(0x5851_F42D_4C95_7F2D));
    let sign = if draw.next() & 1 == 0 { 1.0 } else { -1.0 };
    let x = draw.between(0.0, 1.0);
    let within = |low: f64, high: f64| size * (low + (high - low) * x);
    let y = draw.between(0.0, 1.0);
    let mut figures = String::new();
    let mut change_n = None;
    let (words, entry, names, value, unit) = match kind {
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
        // From stranded steel of twice the section, or a braid of half the modulus.
        Kind::Stiffness => {
            let times = (sign * within(0.5, 0.9)).exp();
            let ea_n = times * PlantConfig::default().cable.axial_stiffness_n;
            let _ = writeln!(figures, "cable.axial_stiffness_n = {ea_n}");
            (
                format!("cables of {times:.2} times the stiffness"),
                String::new(),
                &["cable_stretch"][..],
                times,
                "times",
            )
        }
        // A bracket that was bent, or mounted askew, after the survey.
        Kind::CellTilt => {
            let tilt = within(0.1, 0.2);
            let (first, second) = (TAU * y).sin_cos();
            (
                format!("cells askew by {:.1} degrees", tilt.to_degrees()),
                format!(
                    "kind = \"cell_tilt\"\nfirst_rad = {}\nsecond_rad = {}",
                    tilt * first,
                    tilt * second
                ),
                &["cosine_misalignment", "geometry"][..],
                tilt,
                "rad",
            )
        }
        Kind::Scatter => {
            let times = 1.0 + within(1.5, 2.5);
            let mut config = PlantConfig::default();
            let f = &mut config.friction;
            for (key, sd) in [
                ("offset_sd_n", &mut f.offset_sd_n),
                ("gain_sd", &mut f.gain_sd),
                ("coulomb_relative_sd", &mut f.coulomb_relative_sd),
                ("per_load_relative_sd", &mut f.per_load_relative_sd),
            ] {
                *sd *= times;
                let _ = writeln!(figures, "friction.{key} = {sd}");
            }
            (
                format!("{times:.2} times the scatter of the units' friction"),
                String::new(),
                FRICTION,
                friction_scatter_n(config, seed),
                "N RMS at 4.5 N",
            )
        }
        // Grease that warms within the time of the command, or runs dry.
        Kind::Changing => {
            let n = within(0.5, 0.8);
            let (begin, end) = if sign > 0.0 { (0.0, n) } else { (n, 0.0) };
            let s = 40.0 + 50.0 * y;
            let level = RECORDED_S.map(|at_s| end + (begin - end) * (-at_s / s).exp());
            change_n = Some(level[2] - level[0]);
            (
                format!("Coulomb friction from +{begin:.3} to +{end:.3} N, 63 % of it in {s:.0} s"),
                format!(
                    "kind = \"changing_friction\"\nbegin_n = {begin:?}\nend_n = {end:?}\ntime_constant_s = {s}\nrun_s = {RUN_S:?}"
                ),
                FRICTION,
                level[1],
                "N in session 2",
            )
        }
    };
    Some(Effect {
        kind,
        words,
        names,
        value,
        unit,
        change_n,
        figures,
        entry,
    })
}

/// A plant file with these figures and entries of effects.
pub fn plant_text(figures: &str, entries: &[String]) -> String {
    let mut plant = format!("cable.initial_slack_m = {SLACK_M:?}\n{figures}");
    for entry in entries {
        let _ = write!(plant, "\n[[effects]]\n{entry}\n");
    }
    plant
}

/// What the units of a plant have of friction at the middle command beyond the rig file, RMS, N.
fn friction_scatter_n(config: PlantConfig, seed: u64) -> f64 {
    let f = PlantConfig::default().friction;
    let declared = f.coulomb_n + MIDDLE_N * f.per_load;
    Plant::new(config, seed).map_or(f64::NAN, |plant| {
        let units = (0..plant.units()).map(|unit| plant.parameters(unit));
        let more = units.map(|own| own.coulomb_n + MIDDLE_N * own.per_load - declared);
        rms(&more.collect::<Vec<_>>(), plant.units())
    })
}

/// Root mean square over so many units; those without a number have none.
pub fn rms(values: &[f64], units: usize) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / units as f64).sqrt()
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

    /// Every plant is one that the rig takes, and differs from the rig file's in what the words
    /// say.
    #[test]
    fn the_further_kinds_come_in_turn_and_their_plants_are_good() {
        let usual = parsed(&plant_text("", &[]));
        for seed in 1..60 {
            for effects in [Effects::All, Effects::OneUnit, Effects::Two] {
                parsed(&truth(seed, 1.0, effects).plant).validate().unwrap();
            }
            let more = truth(seed, 1.0, Effects::More);
            let config = parsed(&more.plant);
            config.validate().unwrap();
            assert_eq!(config.cable.initial_slack_m, SLACK_M);
            assert_eq!(
                config.effects.len(),
                usize::from(seed % 2 == 0),
                "{}",
                more.plant
            );
            let [effect] = more.effects.as_slice() else {
                panic!("{seed}")
            };
            assert_eq!(effect.kind, MORE[(seed as usize - 1) % 4]);
            assert!(effect.value.is_finite());
            assert_ne!(config, usual);
        }
        // Half of them one way, half the other.
        let ea_n = |seed| {
            parsed(&truth(seed, 1.0, Effects::More).plant)
                .cable
                .axial_stiffness_n
        };
        let stiffer = (1..200)
            .step_by(4)
            .filter(|seed| ea_n(*seed) > 10_000.0)
            .count();
        assert!((15..=35).contains(&stiffer), "{stiffer} of 50");
        // Scatter of the usual size is 0.05 of 0.909 N beside 4.5 N times 0.08 of 0.154.
        let usual_n = |seed| friction_scatter_n(PlantConfig::default(), seed);
        let mean_n = (1..=200).map(usual_n).sum::<f64>() / 200.0;
        assert!(
            (mean_n / 0.045_f64.hypot(0.055) - 1.0).abs() < 0.1,
            "{mean_n}"
        );
    }

    fn parsed(plant: &str) -> PlantConfig {
        toml::from_str(plant).unwrap()
    }
}
