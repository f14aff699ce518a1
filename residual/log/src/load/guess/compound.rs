//! Units that are made of several: torques such as `kgf·cm` and `in-lb`, and others such as `N/mm`,
//! of which no part may be taken for the whole.

use super::header;
use super::names;

/// Marks between the parts of a product, which stand in no plain name.
const PRODUCT: &[char] = &['·', '⋅', '•', '∙', '*', '×', '.'];

/// Units of force: name, and in N. Capitals count where two differ by nothing else.
const FORCES: &[(&str, f64)] = &[
    ("N", 1.0),
    ("mN", 1e-3),
    ("MN", 1e6),
    ("cN", 1e-2),
    ("dN", 0.1),
    ("daN", 10.0),
    ("kN", 1e3),
    ("µN", 1e-6),
    ("μN", 1e-6),
    ("uN", 1e-6),
    ("kgf", 9.806_65),
    ("kp", 9.806_65),
    ("gf", 9.806_65e-3),
];

/// Units of mass, that are forces in a torque.
const MASSES: &[(&str, f64)] = &[("kg", 9.806_65), ("g", 9.806_65e-3)];

/// Units of length beside them: name, and in m.
const LENGTHS: &[(&str, f64)] = &[("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("dm", 0.1)];

/// Units of force of Britain and America, in N.
const POUNDS: &[(&str, f64)] = &[
    ("lbf", 4.448_221_615),
    ("lb", 4.448_221_615),
    ("lbs", 4.448_221_615),
    ("lbfs", 4.448_221_615),
    ("pound", 4.448_221_615),
    ("pounds", 4.448_221_615),
    ("kip", 4_448.221_615),
    ("kips", 4_448.221_615),
    ("ozf", 0.278_013_851),
    ("oz", 0.278_013_851),
    ("ounce", 0.278_013_851),
    ("ounces", 0.278_013_851),
];

/// Units of length beside them, in m.
const FEET: &[(&str, f64)] = &[
    ("ft", 0.3048),
    ("foot", 0.3048),
    ("feet", 0.3048),
    ("in", 0.0254),
    ("inch", 0.0254),
    ("inches", 0.0254),
];

/// Words of a torque, in English, German, French, Italian, Spanish, Japanese and Chinese.
const TORQUES: &[&str] = &[
    "torque",
    "torsion",
    "moment",
    "couple",
    "coppia",
    "tau",
    "トルク",
    "扭矩",
    "转矩",
    "轉矩",
    "力矩",
];

/// A unit of several parts at the end of a name.
#[derive(Debug, PartialEq)]
pub(super) struct Compound {
    /// The name without it.
    pub(super) rest: String,
    /// The unit as it stands there.
    pub(super) text: String,
    /// How many N·m it is; `None` where it is no torque that is known.
    pub(super) newton_metres: Option<f64>,
}

/// Where a unit stands.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    /// Between brackets: all of it is the unit, and a `-` is a mark of a product.
    Brackets,
    /// Behind a name, whose own marks are `-`, `_` and blanks.
    Name,
}

/// The unit of several parts that a name ends with, in brackets or not.
pub(super) fn of(name: &str) -> Option<Compound> {
    match bracketed(name) {
        Some((before, text, after)) => {
            let rest = format!("{before} {after}");
            in_brackets(text, &rest)
        }
        None => behind(name),
    }
}

/// How many N·m a cell of a line of units is, below a name. A word that is a symbol with a prefix,
/// as `kNm`, stays as the file has it.
pub(super) fn of_cell(text: &str, name: &[String]) -> Option<f64> {
    let is_word = text.chars().all(char::is_alphabetic);
    let known = newton_metres(text, is_torque(&name.join(" ")), Place::Brackets);
    known.filter(|_| !(is_word && header::is_symbol(text)))
}

/// A name without its last brackets, what stands in them, and a number behind them.
fn bracketed(name: &str) -> Option<(&str, &str, &str)> {
    let is_close = |c| matches!(c, ')' | ']' | '}' | '>');
    let end = name.rfind(is_close)?;
    let close = name[end..].chars().next()?;
    let open = match close {
        ')' => '(',
        ']' => '[',
        '}' => '{',
        _ => '<',
    };
    let start = name[..end].rfind(open)?;
    let after = &name[end + 1..];
    let is_number = |c: char| c.is_ascii_digit() || matches!(c, '_' | ' ' | '"');
    let text = name[start + 1..end].trim();
    after
        .chars()
        .all(is_number)
        .then_some((&name[..start], text, after))
}

/// The unit in brackets. Words may stand before it: `(filtered, N·cm)`, `(in N·cm)`.
fn in_brackets(text: &str, rest: &str) -> Option<Compound> {
    let found = |text: &str, newton_metres| {
        Some(Compound {
            rest: rest.to_string(),
            text: text.to_string(),
            newton_metres,
        })
    };
    let known = newton_metres(text, is_torque(rest), Place::Brackets);
    if known.is_some() {
        return found(text, known);
    }
    if names::known(text).is_some() {
        return None;
    }
    if let Some(at) = text.rfind([' ', ',', ';']) {
        let (words, last) = text.split_at(at);
        let last = last.trim_start_matches([' ', ',', ';']);
        let is_unit = header::is_symbol(text) && words != "in" && !text.contains([',', ';']);
        return if is_unit {
            found(text, None)
        } else {
            in_brackets(last, &format!("{rest} {words}"))
        };
    }
    (is_product(text) || is_arbitrary(text)).then(|| found(text, None))?
}

/// Whether a text without blanks has several parts and begins or ends with a unit.
fn is_product(text: &str) -> bool {
    let marks = |c: char| PRODUCT.contains(&c) || matches!(c, '-' | '/' | '^');
    let is_unit = |part: &str| header::is_symbol(part) || names::known(part).is_some();
    let mut parts = text.split(marks).filter(|p| !p.is_empty());
    let ends = parts.next().zip(parts.next_back());
    ends.is_some_and(|(first, last)| is_unit(first) || is_unit(last))
}

/// Whether a text stands for arbitrary units.
fn is_arbitrary(text: &str) -> bool {
    ["a.u.", "a.u", "arb.u."].contains(&text.to_lowercase().as_str())
}

/// The unit at the end of a name without brackets: the longest end that is one.
fn behind(name: &str) -> Option<Compound> {
    let name = name.trim_matches('"').trim();
    let found = |at: usize, newton_metres| Compound {
        rest: name[..at].to_string(),
        text: name[at..].to_string(),
        newton_metres,
    };
    let torque = |at: usize| {
        // A name of nothing but `nm` may be a length in nanometres.
        let is_length = at == 0 && name == "nm";
        let known = newton_metres(&name[at..], is_torque(&name[..at]), Place::Name)?;
        (!is_length).then(|| found(at, Some(known)))
    };
    let open = |at: usize| {
        let is_behind = name[..at].ends_with([' ', '_', ',', ';']) || name[at..].contains('^');
        (is_behind && is_open(&name[at..], &name[..at])).then(|| found(at, None))
    };
    let starts = starts(name);
    let first = starts.iter().find_map(|at| torque(*at));
    first.or_else(|| starts.iter().find_map(|at| open(*at)))
}

/// Places at which a part of a name begins.
fn starts(name: &str) -> Vec<usize> {
    let mut before = ' ';
    let mut all = Vec::new();
    for (at, c) in name.char_indices() {
        if c.is_alphanumeric() && !before.is_alphanumeric() {
            all.push(at);
        }
        before = c;
    }
    all
}

/// Whether the end of a name without brackets is a unit that is not known. In `F/kN` a symbol
/// stands before its unit, and a force and a length behind `_` may be a torque or a stiffness.
fn is_open(text: &str, rest: &str) -> bool {
    let product = |c: char| PRODUCT.contains(&c);
    let is_known = names::known(text).is_some();
    let of_symbols = header::is_symbol(text) && !is_known;
    let first = text.split('/').next().unwrap_or("");
    let is_ratio = first != text && (first == "N" || first.chars().count() > 1);
    let is_product = text.contains(product) || text.contains('^') || is_ratio;
    let as_torque = newton_metres(text, true, Place::Name);
    let may_be_torque = !is_known && !is_torque(rest) && as_torque.is_some();
    let before = text.split(|c: char| !c.is_alphanumeric()).next();
    let is_side = before.is_some_and(|b| find(FEET, b).is_some() || find(LENGTHS, b).is_some());
    (of_symbols && is_product) || (may_be_torque && !is_side)
}

/// Whether a name is that of a torque.
fn is_torque(name: &str) -> bool {
    let name = name.to_lowercase();
    TORQUES.iter().any(|word| name.contains(word))
}

/// A unit of a table: as it is written, else with other capitals.
fn find(table: &[(&str, f64)], text: &str) -> Option<f64> {
    let alike = |(name, _): &&(&str, f64)| name.to_lowercase() == text.to_lowercase();
    let same = table.iter().find(|(name, _)| *name == text);
    same.or_else(|| table.iter().find(alike))
        .map(|(_, scale)| *scale)
}

/// How many N·m a text is. `torque` tells whether the name is that of a torque: then a mass is the
/// force that it weighs, and a plain mark stands between two parts of the unit.
fn newton_metres(text: &str, torque: bool, place: Place) -> Option<f64> {
    let is_mark = |c: char| PRODUCT.contains(&c) || matches!(c, '-' | '_' | ' ');
    let parts: Vec<&str> = text.split(is_mark).filter(|p| !p.is_empty()).collect();
    match parts[..] {
        [whole] => joined(whole, torque),
        [a, b] => {
            let is_plain = !text.contains(|c: char| PRODUCT.contains(&c));
            let weak = is_plain && (place == Place::Name || !text.contains('-'));
            // `force in lbf`, and `N m`, which is no stiffness in any name.
            let is_preposition = weak && a == "in";
            let is_sure = !weak || place == Place::Brackets || (a, b) == ("N", "m");
            let allowed =
                torque || (is_sure && !is_preposition) || is_feet(a, b) && !is_preposition;
            product(a, b, torque).filter(|_| allowed)
        }
        _ => None,
    }
}

/// Whether two parts are those of a torque in feet or inches: no stiffness is written so.
fn is_feet(a: &str, b: &str) -> bool {
    find(FEET, a).is_some() && find(POUNDS, b).is_some()
}

/// A force and a length with nothing between them: `kgfcm`, `ftlb`.
fn joined(word: &str, torque: bool) -> Option<f64> {
    let whole = word.char_indices().skip(1).map(|(at, _)| word.split_at(at));
    let mut fits = whole.filter_map(|(a, b)| {
        // `mN` is no product, and a `gm` no torque.
        let is_metric = find(LENGTHS, a).is_some();
        let is_mass = find(MASSES, a).is_some() && b == "m" && a.len() == 1;
        product(a, b, torque).filter(|_| !is_metric && !is_mass)
    });
    fits.next()
}

/// A force and a length, in any order, in N·m.
fn product(a: &str, b: &str, torque: bool) -> Option<f64> {
    let of = |forces: &[(&str, f64)], lengths: &[(&str, f64)]| {
        let forwards = find(forces, a).zip(find(lengths, b));
        let backwards = find(lengths, a).zip(find(forces, b));
        let both = forwards.or(backwards.map(|(length, force)| (force, length)));
        // Without the last bits of the product.
        both.map(|(force, length)| (force * length * 1e12).round() / 1e12)
    };
    let of_mass = || of(MASSES, LENGTHS).filter(|_| torque);
    of(FORCES, LENGTHS)
        .or_else(|| of(POUNDS, FEET))
        .or_else(of_mass)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torques_are_read_with_every_mark() {
        for (unit, expected) in [
            ("N?m", 1.0),
            ("N?cm", 0.01),
            ("N?mm", 1e-3),
            ("mN?m", 1e-3),
            ("kN?m", 1e3),
            ("MN?m", 1e6),
            ("dN?m", 0.1),
            ("cN?m", 0.01),
            ("daN?m", 10.0),
            ("µN?m", 1e-6),
            ("kgf?m", 9.80665),
            ("kgf?cm", 0.098_066_5),
            ("gf?cm", 9.80665e-5),
            ("kg?cm", 0.098_066_5),
            ("ft?lb", 1.355_818),
            ("ft?lbf", 1.355_818),
            ("lbf?ft", 1.355_818),
            ("lb?ft", 1.355_818),
            ("in?lb", 0.112_985),
            ("in?lbf", 0.112_985),
            ("lb?in", 0.112_985),
            ("oz?in", 0.007_061_55),
            ("ozf?in", 0.007_061_55),
        ] {
            for mark in ["", ".", "·", "*", "-", " ", "_"] {
                let unit = unit.replace('?', mark);
                for name in [format!("Torque ({unit})"), format!("torque_{unit}")] {
                    let found = of(&name).unwrap_or_else(|| panic!("{name}"));
                    let scale = found.newton_metres.unwrap_or(f64::NAN);
                    assert!((scale / expected - 1.0).abs() < 1e-5, "{name}: {scale}");
                    assert!(found.rest.to_lowercase().starts_with("torque"), "{name}");
                }
            }
        }
    }

    #[test]
    fn other_units_of_several_parts_stay_as_they_stand() {
        for (name, text) in [
            ("Stiffness (N/mm)", "N/mm"),
            ("Stiffness N/mm", "N/mm"),
            ("c_N/mm", "N/mm"),
            ("stiffness_n_mm", "n_mm"),
            ("Torque (lbf.furlong)", "lbf.furlong"),
            ("Torque (furlong.lbf)", "furlong.lbf"),
            ("Pressure [N/mm²]", "N/mm²"),
            ("acc (m/s^2) 2", "m/s^2"),
            ("imu.acc.m/s^2", "m/s^2"),
            ("mass moved (kg·cm)", "kg·cm"),
            ("Feed (mm/min)", "mm/min"),
            ("Signal (a.u.)", "a.u."),
            ("k (mean, N/mm)", "N/mm"),
        ] {
            let found = of(name).unwrap_or_else(|| panic!("{name}"));
            assert_eq!(
                (found.text.as_str(), found.newton_metres),
                (text, None),
                "{name}"
            );
        }
    }

    #[test]
    fn names_and_units_of_one_part_are_no_compounds() {
        for name in [
            "Force (N)",
            "Force in lbf",
            "force_in_lb",
            "Force (in lbf)",
            "Force (in N)",
            "CH1 in V",
            "Kraft / mN",
            "F/kN",
            "Kraft F/kN",
            "Weg s/mm",
            "speed (rad/s)",
            "Bridge [mV/V]",
            "tau(left-arm)",
            "tau_J_d[0]",
            "/joint_states.position[0]",
            "field.header.stamp",
            "/wrench/force/z",
            "disp_m",
            "vel_in_s",
            "torque_in",
            "time, s",
            "nm",
            "a2 torque cmd [Nm2]",
            "temp (°C)",
            "pos_min",
        ] {
            assert_eq!(of(name), None, "{name}");
        }
    }
}
