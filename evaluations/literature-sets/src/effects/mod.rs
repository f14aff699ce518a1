//! The catalogue of effects: names, sources, ranges, and which names describe the same force.

pub mod drive;
pub mod friction;
pub mod outside;
pub mod sensor;

use crate::declared::Declared;
use crate::parameters::{Draw, Parameters, Scene};
use crate::random::Random;
use crate::world::World;
use std::fmt;

/// Where in the chain from motor to log an effect acts. Effects are applied in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Motor, gear, reel and cable: changes the tension.
    Drive,
    /// The load cell: from tension to its reading.
    Cell,
    /// The amplifier: lag and tones.
    Amplifier,
    /// The logger: delay and clocks.
    Logger,
    /// The limit of the amplifier's output, last because it also clips the noise.
    Limit,
}

/// Names that describe the same force, or one so close that data can't distinguish them.
#[derive(Clone, Copy, Debug)]
pub struct Equivalence {
    /// Names, of this catalogue where it has the effect, else as textbooks have it.
    pub names: &'static [&'static str],
    /// `exact`: the same equation in the stated case. `close`: the same up to a part that may stay
    /// below the noise.
    pub kind: &'static str,
    /// The case in which it holds, and why.
    pub reason: &'static str,
}

/// One effect of the catalogue.
#[derive(Clone, Copy)]
pub struct Effect {
    /// Name on the command line and in `truth.json`.
    pub name: &'static str,
    /// What it is, in a few words.
    pub title: &'static str,
    /// Author and year.
    pub source: &'static str,
    /// Equation, as text.
    pub equation: &'static str,
    /// True for effects that no analysis could be expected to know.
    pub outside: bool,
    /// Where it acts.
    pub stage: Stage,
    /// Draws the parameters.
    pub draw: fn(&mut Draw, &Scene),
    /// Applies the effect to the signal of a run on the fine grid.
    pub apply: fn(&Parameters, &World, &mut [f64]),
    /// Declared models that would contain the effect already.
    pub declared_in: &'static [Declared],
    /// Other names for the same force.
    pub equivalences: &'static [Equivalence],
}

impl fmt::Debug for Effect {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "Effect({})", self.name)
    }
}

impl PartialEq for Effect {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Effect {
    /// Parameters from the documented ranges.
    pub fn draw(&self, random: &mut Random, scene: &Scene) -> Parameters {
        let mut draw = Draw::new(random);
        (self.draw)(&mut draw, scene);
        draw.finish()
    }
}

/// The effect of this name.
///
/// # Errors
/// For an unknown name, with the nearest known one.
pub fn by_name(name: &str) -> Result<&'static Effect, String> {
    CATALOGUE.iter().find(|e| e.name == name).ok_or_else(|| {
        let nearest = CATALOGUE
            .iter()
            .min_by_key(|e| strsim::levenshtein(e.name, name))
            .map_or("", |e| e.name);
        format!(
            "no effect `{name}`; did you mean `{nearest}`? `--list` shows all {}",
            CATALOGUE.len()
        )
    })
}

const fn same(
    names: &'static [&'static str],
    kind: &'static str,
    reason: &'static str,
) -> Equivalence {
    Equivalence {
        names,
        kind,
        reason,
    }
}

const NO_OTHER_NAME: &[Equivalence] = &[];

/// The catalogue as a Markdown table, with the ranges for a travel of 1.5 rad and commands of 1 N
/// to 13 N. The page `docs/residual/literature-sets.md` holds it.
pub fn table() -> String {
    let scene = Scene {
        rate_hz: 100.0,
        max_command_n: 13.0,
        min_command_n: 1.0,
        max_reading_n: 13.0,
        travel_rad: 1.5,
        max_speed_rad_s: 3.0,
    };
    let mut text =
        String::from("| name | effect and equation | parameters | source |\n|---|---|---|---|\n");
    for effect in CATALOGUE {
        let parameters: Vec<String> = effect
            .draw(&mut Random::new(1, "table"), &scene)
            .list()
            .iter()
            .map(|p| {
                let [low, high] = p.typical.map(|x| (x * 1e6).round() / 1e6);
                let range = if low == high {
                    format!("{low:.4}")
                } else {
                    format!("{low} to {high}")
                };
                let unit = if p.unit == "-" {
                    String::new()
                } else {
                    format!(" {}", p.unit)
                };
                format!(
                    "{}{} {range}{unit}",
                    p.name,
                    if p.scaled { "*" } else { "" }
                )
            })
            .collect();
        let outside = if effect.outside { " (outside)" } else { "" };
        text += &format!(
            "| `{}` | {}{outside}: `{}` | {} | {} |\n",
            effect.name,
            effect.title,
            effect.equation.replace('|', "\\|"),
            parameters.join("; "),
            effect.source
        );
    }
    text
}

/// All effects.
pub const CATALOGUE: &[Effect] = &[
    Effect {
        name: "coulomb",
        title: "Coulomb friction",
        source: "Coulomb 1785",
        equation: "F = fc sgn(v), sign held at rest",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_coulomb,
        apply: friction::coulomb,
        declared_in: &[Declared::Friction],
        equivalences: &[
            same(
                &["dahl", "lugre", "maxwell-slip", "bouc-wen", "armstrong", "dry friction"],
                "exact",
                "these models contain it: a presliding distance that is short against the motion within a row, and a \
                 static level equal to the sliding one, leave Coulomb friction",
            ),
            same(
                &["capstan"],
                "close",
                "at a nearly constant load, friction that is proportional to the load is constant",
            ),
        ],
    },
    Effect {
        name: "capstan",
        title: "friction proportional to the load over a cable guide",
        source: "Euler 1769, Eytelwein 1808; Kaneko et al. 1991",
        equation: "T <- T exp(-mu phi sgn(v))",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_capstan,
        apply: friction::capstan,
        declared_in: &[],
        equivalences: &[
            same(
                &["load-proportional coulomb"],
                "close",
                "exp(-x) = 1 - x to first order; the rest, x^2/2 of the load, is a gain",
            ),
            same(
                &["bouc-wen-load"],
                "close",
                "hysteresis with a short presliding distance and a force proportional to the load",
            ),
            same(&["coulomb"], "close", "at a nearly constant load; with a varying load only the mean part of it"),
        ],
    },
    Effect {
        name: "viscous",
        title: "viscous friction",
        source: "Reynolds 1886",
        equation: "F = b v",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_viscous,
        apply: friction::viscous,
        declared_in: &[Declared::Viscous, Declared::Friction],
        equivalences: &[same(
            &["motor damping", "back-EMF damping"],
            "exact",
            "each force proportional to the velocity is the same force",
        )],
    },
    Effect {
        name: "viscous-load",
        title: "viscous friction that grows with the load",
        source: "Waiboer, Aarts and Jonker 2005; Bittencourt and Gunnarsson 2012",
        equation: "F = b (1 + kappa u) v",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_viscous_load,
        apply: friction::viscous_load,
        declared_in: &[],
        equivalences: &[same(
            &["viscous"],
            "close",
            "the part at the mean load is plain viscous friction; the complete answer has velocity times load as well",
        )],
    },
    Effect {
        name: "viscous-temperature",
        title: "viscous friction that falls with the temperature",
        source: "Reynolds 1886; Bittencourt and Gunnarsson 2012",
        equation: "F = b exp(-beta (T - 25 degC)) v",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_viscous_temperature,
        apply: friction::viscous_temperature,
        declared_in: &[],
        equivalences: &[same(
            &["viscous"],
            "close",
            "the part at the mean temperature is plain viscous friction; the complete answer has velocity times \
             temperature as well, which differs mostly from run to run",
        )],
    },
    Effect {
        name: "armstrong",
        title: "seven-parameter friction with rising static friction",
        source: "Armstrong-Helouvry, Dupont and Canudas de Wit 1994; Bo and Pavelescu 1982",
        equation: "presliding F = kt x; sliding F = [fc + (fs(t2) - fc) exp(-|v/vs|^delta)] sgn(v) + fv v",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_armstrong,
        apply: friction::armstrong,
        declared_in: &[],
        equivalences: &[
            same(
                &["stribeck", "lugre", "maxwell-slip"],
                "close",
                "the same Stribeck curve in sliding; they differ in presliding and in the growth of the static level",
            ),
            same(
                &["coulomb", "dahl", "viscous"],
                "close",
                "parts that it contains: the sliding level, the presliding spring, fv v",
            ),
        ],
    },
    Effect {
        name: "dahl",
        title: "Dahl friction",
        source: "Dahl 1968, 1976",
        equation: "dF/dx = (fc/d) |1 - (F/fc) sgn v|^i sgn(1 - (F/fc) sgn v)",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_dahl,
        apply: friction::dahl,
        declared_in: &[],
        equivalences: &[
            same(&["lugre"], "exact", "for i = 1: LuGre with fs = fc and sigma1 = sigma2 = 0"),
            same(&["bouc-wen"], "exact", "for i = 1: Bouc-Wen with n = 1 and beta = 1, gamma = 0"),
            same(
                &["maxwell-slip", "presliding hysteresis"],
                "close",
                "a sum of Maxwell elements with a suitable distribution follows any rate-independent hysteresis loop",
            ),
            same(&["coulomb"], "close", "where d is short against the motion within a row"),
        ],
    },
    Effect {
        name: "lugre",
        title: "LuGre friction",
        source: "Canudas de Wit, Olsson, Astrom and Lischinsky 1995",
        equation: "dz/dt = v - sigma0 |v| z/g(v); F = sigma0 z + sigma1 dz/dt + sigma2 v",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_lugre,
        apply: friction::lugre,
        declared_in: &[],
        equivalences: &[
            same(
                &["stribeck", "armstrong", "maxwell-slip"],
                "close",
                "the same steady state over the velocity; they differ in presliding only",
            ),
            same(
                &["dahl", "coulomb", "viscous", "bouc-wen"],
                "close",
                "parts that it contains: presliding, the sliding level, sigma2 v",
            ),
        ],
    },
    Effect {
        name: "maxwell-slip",
        title: "generalised Maxwell-slip friction",
        source: "Al-Bender, Lampaert and Swevers 2005",
        equation: "8 elements: dF/dx = k until |F| = alpha s(v), then dF/dt = sgn(v) C (alpha - |F|/s(v))",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_maxwell_slip,
        apply: friction::maxwell_slip,
        declared_in: &[],
        equivalences: &[
            same(
                &["lugre", "armstrong", "stribeck", "prandtl-ishlinskii"],
                "close",
                "the same steady state over the velocity; the stick phase is a Prandtl-Ishlinskii operator",
            ),
            same(&["dahl", "bouc-wen", "coulomb"], "close", "presliding loops of nearly the same shape; sliding level"),
        ],
    },
    Effect {
        name: "bouc-wen",
        title: "Bouc-Wen hysteresis",
        source: "Bouc 1967; Wen 1976",
        equation: "F = fh z; d dz/dx = 1 - |z|^n (gamma + beta sgn(v z)), gamma = 1 - beta",
        outside: false,
        stage: Stage::Drive,
        draw: friction::draw_bouc_wen,
        apply: friction::bouc_wen,
        declared_in: &[],
        equivalences: &[
            same(&["dahl"], "exact", "for n = 1, beta = 1; close for other exponents"),
            same(
                &["lugre", "maxwell-slip", "coulomb"],
                "close",
                "presliding loops of nearly the same shape; with a short d only the sliding level",
            ),
        ],
    },
    Effect {
        name: "harmonic-drive",
        title: "kinematic error of a harmonic drive",
        source: "Tuttle and Seering 1996; Ghorbel, Gandhi and Alpeter 2001",
        equation: "F = (k/r) [e1 sin(n theta + phi1) + e2 sin(2 n theta + phi2)]",
        outside: false,
        stage: Stage::Drive,
        draw: drive::draw_harmonic_drive,
        apply: drive::harmonic_drive,
        declared_in: &[],
        equivalences: &[same(
            &["ripple over the angle", "torque ripple"],
            "exact",
            "any force that is periodic in the angle, of the order n or 2 n per turn of the reel; the cause behind an \
             order is not in the data",
        )],
    },
    Effect {
        name: "cogging",
        title: "cogging of the motor",
        source: "Hanselman 2006; Islam, Mir and Sebastian 2004",
        equation: "F = a [sin(m g theta + phi1) + h2 sin(2 m g theta + phi2)]",
        outside: false,
        stage: Stage::Drive,
        draw: drive::draw_cogging,
        apply: drive::cogging,
        declared_in: &[],
        equivalences: &[same(
            &["ripple over the angle", "torque ripple"],
            "exact",
            "any force that is periodic in the angle, of the order m g or 2 m g per turn of the reel",
        )],
    },
    Effect {
        name: "gear-mesh",
        title: "ripple of meshing teeth",
        source: "Ozguven and Houser 1988; Smith 2003",
        equation: "T <- T (1 + eps [sin(z theta + phi1) + h2 sin(2 z theta + phi2)])",
        outside: false,
        stage: Stage::Drive,
        draw: drive::draw_gear_mesh,
        apply: drive::gear_mesh,
        declared_in: &[],
        equivalences: &[same(
            &["ripple over the angle", "torque ripple"],
            "close",
            "the part at the mean load is a ripple of the order z; the complete answer is proportional to the load",
        )],
    },
    Effect {
        name: "eccentricity",
        title: "eccentric reel",
        source: "geometry; Shigley, Mechanical Engineering Design",
        equation: "T <- T / (1 + (e/r) cos(theta - phi))",
        outside: false,
        stage: Stage::Drive,
        draw: drive::draw_eccentricity,
        apply: drive::eccentricity,
        declared_in: &[],
        equivalences: &[same(
            &["gravity", "ripple over the angle"],
            "close",
            "at a nearly constant load both are a sine of the angle, once per turn",
        )],
    },
    Effect {
        name: "backlash",
        title: "play between drive and return spring",
        source: "Tao and Kokotovic 1996; Nordin and Gutman 2002",
        equation: "T <- T + k play(theta, w)",
        outside: false,
        stage: Stage::Drive,
        draw: drive::draw_backlash,
        apply: drive::backlash,
        declared_in: &[Declared::Bare, Declared::Gain, Declared::Viscous, Declared::Friction],
        equivalences: &[same(
            &["coulomb", "dahl", "bouc-wen", "maxwell-slip", "stop operator"],
            "exact",
            "theta - play(theta, w) is the stop operator, one Maxwell element: with the spring declared, what is \
             missing is a Coulomb friction k w/2 with a presliding distance of w",
        )],
    },
    Effect {
        name: "stretch",
        title: "elastic transmission between rotor and reel",
        source: "Spong 1987; Readman 1994",
        equation: "M q'' + D q' + k q = u - M theta''; T = k q + D q'",
        outside: false,
        stage: Stage::Drive,
        draw: drive::draw_stretch,
        apply: drive::stretch,
        declared_in: &[],
        equivalences: &[
            same(&["inertia"], "close", "below the resonance the motion's part is the inertia of the rotor"),
            same(
                &["lag-second", "lag-first", "delay"],
                "close",
                "below the resonance the command's part is a second-order lag of the command",
            ),
        ],
    },
    Effect {
        name: "inertia",
        title: "inertia of reel and rotor",
        source: "Craig 2005",
        equation: "F = (j_reel + g^2 j_rotor) theta''/r",
        outside: false,
        stage: Stage::Drive,
        draw: drive::draw_inertia,
        apply: drive::inertia,
        declared_in: &[],
        equivalences: &[same(
            &["reflected inertia", "stretch"],
            "exact",
            "inertia of reel, rotor and gear add to one number; a stiff elastic transmission shows the same",
        )],
    },
    Effect {
        name: "gravity",
        title: "payload on a lever that turns with the reel",
        source: "Craig 2005",
        equation: "F = m g l sin(theta + phi)/r",
        outside: false,
        stage: Stage::Drive,
        draw: drive::draw_gravity,
        apply: drive::gravity,
        declared_in: &[],
        equivalences: &[same(
            &["ripple over the angle", "eccentricity"],
            "exact",
            "a sine of the angle, once per turn; an eccentric reel differs by the factor of the load only",
        )],
    },
    Effect {
        name: "lag-first",
        title: "first-order lag of the sensor",
        source: "Doebelin 2003",
        equation: "tau y' + y = F",
        outside: false,
        stage: Stage::Amplifier,
        draw: sensor::draw_lag_first,
        apply: sensor::lag_first,
        declared_in: &[],
        equivalences: &[same(
            &["delay", "lag-second", "lag of the command"],
            "close",
            "for slow signals each of them is -tau dF/dt (second order: -2 zeta tau dF/dt)",
        )],
    },
    Effect {
        name: "lag-second",
        title: "second-order lag of the sensor",
        source: "Doebelin 2003",
        equation: "tau^2 y'' + 2 zeta tau y' + y = F",
        outside: false,
        stage: Stage::Amplifier,
        draw: sensor::draw_lag_second,
        apply: sensor::lag_second,
        declared_in: &[],
        equivalences: &[same(
            &["delay", "lag-first", "lag of the command"],
            "close",
            "for slow signals each of them is a delay of 2 zeta tau",
        )],
    },
    Effect {
        name: "delay",
        title: "pure delay",
        source: "Doebelin 2003",
        equation: "y(t) = F(t - tau)",
        outside: false,
        stage: Stage::Logger,
        draw: sensor::draw_delay,
        apply: sensor::delay,
        declared_in: &[],
        equivalences: &[same(
            &["lag-first", "lag-second", "clock offset"],
            "close",
            "for slow signals each of them is -tau dF/dt; a constant offset of two clocks is a delay exactly",
        )],
    },
    Effect {
        name: "clock-skew",
        title: "two loggers whose clocks differ in rate and drift",
        source: "Mills 1991",
        equation: "y(t) = F(t + skew t + drift t^2/2)",
        outside: false,
        stage: Stage::Logger,
        draw: sensor::draw_clock_skew,
        apply: sensor::clock_skew,
        declared_in: &[],
        equivalences: &[same(
            &["delay"],
            "close",
            "the mean of the growing shift is a delay (or a lead); the complete answer grows over each run",
        )],
    },
    Effect {
        name: "creep",
        title: "creep of the load cell with return to zero",
        source: "OIML R 60 2017; Zener 1948",
        equation: "y = F + a1 x1 + a2 x2; tau x' + x = F, unloaded before the run",
        outside: false,
        stage: Stage::Cell,
        draw: sensor::draw_creep,
        apply: sensor::creep,
        declared_in: &[],
        equivalences: &[
            same(
                &["drift", "slow lag of the load", "viscoelasticity"],
                "close",
                "the slow part (tau2 longer than the run) is a drift in proportion to the mean load",
            ),
            same(&["nonlinearity"], "close", "the settled part of creep is a gain"),
        ],
    },
    Effect {
        name: "nonlinearity",
        title: "quadratic and cubic characteristic of the load cell",
        source: "OIML R 60 2017; VDI/VDE/DKD 2638",
        equation: "y = F + fs [c2 (F/fs)^2 + c3 (F/fs)^3]",
        outside: false,
        stage: Stage::Cell,
        draw: sensor::draw_nonlinearity,
        apply: sensor::nonlinearity,
        declared_in: &[],
        equivalences: &[same(
            &["kink", "gain", "quadratic", "cubic"],
            "close",
            "over a limited range of loads a polynomial, a gain with offset and a kink bend nearly the same way",
        )],
    },
    Effect {
        name: "temperature-zero",
        title: "zero drift with temperature",
        source: "OIML R 60 2017",
        equation: "y = F + z (T - 25 degC)",
        outside: false,
        stage: Stage::Cell,
        draw: sensor::draw_temperature_zero,
        apply: sensor::temperature_zero,
        declared_in: &[],
        equivalences: &[same(
            &["drift", "offset per run"],
            "close",
            "the temperature differs most from run to run: an offset per run holds most of it; within a run it is a \
             slow drift",
        )],
    },
    Effect {
        name: "temperature-span",
        title: "span drift with temperature",
        source: "OIML R 60 2017",
        equation: "y = F [1 + s (T - 25 degC)]",
        outside: false,
        stage: Stage::Cell,
        draw: sensor::draw_temperature_span,
        apply: sensor::temperature_span,
        declared_in: &[],
        equivalences: &[
            same(&["gain per run"], "close", "the temperature differs most from run to run"),
            same(&["temperature-zero"], "close", "at a nearly constant load the span's part is a zero's part"),
        ],
    },
    Effect {
        name: "crosstalk",
        title: "crosstalk from two neighbour channels",
        source: "Webster 1999",
        equation: "y = F + c1 n1 + c2 n2",
        outside: false,
        stage: Stage::Cell,
        draw: sensor::draw_crosstalk,
        apply: sensor::crosstalk,
        declared_in: &[],
        equivalences: NO_OTHER_NAME,
    },
    Effect {
        name: "clipping",
        title: "saturation of the amplifier",
        source: "Doebelin 2003",
        equation: "y = min(F + noise, reference - depth)",
        outside: false,
        stage: Stage::Limit,
        draw: sensor::draw_clipping,
        apply: sensor::clipping,
        declared_in: &[],
        equivalences: &[same(
            &["kink", "nonlinearity", "saturation"],
            "close",
            "clipping is a kink with the slope 0; a polynomial follows it in part. A note on repeated or clipped \
             readings is a correct answer too",
        )],
    },
    Effect {
        name: "mains",
        title: "mains tone",
        source: "Horowitz and Hill 2015",
        equation: "y = F + a sin(2 pi f t + phase of the run), f = nominal (1 + detune)",
        outside: false,
        stage: Stage::Amplifier,
        draw: sensor::draw_mains,
        apply: sensor::mains,
        declared_in: &[],
        equivalences: &[same(
            &["tone", "periodic disturbance"],
            "exact",
            "rows see the alias: |f - rate round(f/rate)|; a frequency that differs by a multiple of the rate is the \
             same data, and an alias below the inverse of a run's length is an offset per run",
        )],
    },
    Effect {
        name: "sector-friction",
        title: "friction in a sector of the turn",
        source: "Armstrong-Helouvry 1991, chapter 4",
        equation: "F = fc sgn(v) while theta mod 2 pi is in the sector",
        outside: true,
        stage: Stage::Drive,
        draw: outside::draw_sector_friction,
        apply: outside::sector_friction,
        declared_in: &[],
        equivalences: &[same(
            &["coulomb"],
            "close",
            "the mean over the turn is Coulomb friction, fc width/(2 pi); to name it is right but incomplete",
        )],
    },
    Effect {
        name: "kink",
        title: "second load path above a load",
        source: "Thompson and Stewart 2002",
        equation: "y = F - share max(0, F - at)",
        outside: true,
        stage: Stage::Cell,
        draw: outside::draw_kink,
        apply: outside::kink,
        declared_in: &[],
        equivalences: &[same(
            &["nonlinearity", "clipping", "gain"],
            "close",
            "a polynomial of the load follows the kink in part; to name it is right about the kind, not the shape",
        )],
    },
    Effect {
        name: "bouc-wen-load",
        title: "Bouc-Wen hysteresis proportional to the load",
        source: "Do, Tjahjowidodo, Lau and Phee 2014; Bouc 1967; Wen 1976",
        equation: "T <- T (1 - mu z), z as in bouc-wen",
        outside: true,
        stage: Stage::Drive,
        draw: outside::draw_bouc_wen_load,
        apply: outside::bouc_wen_load,
        declared_in: &[],
        equivalences: &[
            same(
                &["capstan", "load-proportional coulomb"],
                "close",
                "with a short presliding distance; to name it is right but for presliding",
            ),
            same(&["bouc-wen", "dahl", "coulomb"], "close", "the part at the mean load"),
        ],
    },
    Effect {
        name: "rest-bursts",
        title: "contact bursts at rest",
        source: "no textbook: disturbance from outside",
        equation: "decaying oscillations at random times while v = 0",
        outside: true,
        stage: Stage::Drive,
        draw: outside::draw_rest_bursts,
        apply: outside::rest_bursts,
        declared_in: &[],
        equivalences: NO_OTHER_NAME,
    },
    Effect {
        name: "release-bursts",
        title: "ringing when the reel breaks loose",
        source: "Rabinowicz 1958; Armstrong-Helouvry, Dupont and Canudas de Wit 1994",
        equation: "a decaying oscillation from each start after a rest",
        outside: true,
        stage: Stage::Drive,
        draw: outside::draw_release_bursts,
        apply: outside::release_bursts,
        declared_in: &[],
        equivalences: NO_OTHER_NAME,
    },
];
