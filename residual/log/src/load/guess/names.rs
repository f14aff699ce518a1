//! What the name of a column says: role, unit, and the index of a joint.

use super::compound::{self, Compound};

/// Parts of names by role, in English, German, French, Italian, Spanish, Portuguese, Japanese and
/// Chinese, the usual ones in other languages too. The role of the first row that fits counts; none
/// for the first row.
const WORDS: &[(&str, &[&str])] = &[
    (
        "",
        &[
            "error",
            "err",
            "enable",
            "status",
            "seq",
            "acc",
            "accel",
            // Japanese and Chinese, and Korean: an acceleration has the word of a velocity in it.
            "加速度",
            "가속도",
        ],
    ),
    (
        "time",
        &[
            "time",
            "stamp",
            "sec",
            "secs",
            "seconds",
            "elapsed",
            "millis",
            "micros",
            "zeit",
            "t",
            "tempo",
            "tiempo",
            "tijd",
            "czas",
            "tid",
            "čas",
            "aika",
            "zaman",
            "idő",
            "время",
            "時刻",
            "时间",
            "時間",
            "시간",
        ],
    ),
    (
        "setpoint",
        &[
            "setpoint",
            "desired",
            "des",
            "goal",
            "ref",
            "reference",
            "demand",
            "target",
            "cmptd",
            "soll",
            "sollwert",
            "set",
            "consigne",
            "consigna",
            "zadana",
            "börvärde",
            "目標",
        ],
    ),
    (
        "command",
        &[
            "command",
            "cmd",
            "commanded",
            "pwm",
            "voltage",
            "uq",
            "u",
            "spannung",
            "stellgröße",
            "stellgroesse",
            "commande",
            "comando",
            "befehl",
            "polecenie",
            "команда",
            "指令",
        ],
    ),
    (
        "velocity",
        &[
            "velocity",
            "speed",
            "vel",
            "omega",
            "rpm",
            "dq",
            "qd",
            "qdot",
            "dot",
            "dtheta",
            "thetadot",
            "dpos",
            "geschwindigkeit",
            "geschw",
            "drehzahl",
            "vitesse",
            "velocidad",
            "velocidade",
            "velocità",
            "velocita",
            "snelheid",
            "prędkość",
            "hastighet",
            "hastighed",
            "rychlost",
            "nopeus",
            "hız",
            "sebesség",
            "скорость",
            "速度",
            "속도",
            // Japanese; Chinese, in both scripts.
            "回転数",
            "转速",
            "轉速",
        ],
    ),
    (
        "angle",
        &[
            "angle",
            "position",
            "pos",
            "encoder",
            "theta",
            "q",
            "displacement",
            "disp",
            "travel",
            "stroke",
            "winkel",
            "weg",
            "phi",
            "angolo",
            "ángulo",
            "ângulo",
            "hoek",
            "déplacement",
            "posizione",
            "posición",
            "kąt",
            "vinkel",
            "úhel",
            "kulma",
            "açı",
            "szög",
            "угол",
            "角度",
            "位置",
            "각도",
            "crosshead",
            "extension",
            "elongation",
            "deflection",
            // German.
            "standardweg",
            "traversenweg",
            "kolbenweg",
            "verschiebung",
            "auslenkung",
            // French.
            "deplacement",
            "course",
            "allongement",
            // Italian.
            "corsa",
            "spostamento",
            // Spanish.
            "posicion",
            "desplazamiento",
            "carrera",
            "angulo",
            // Portuguese.
            "posição",
            "posicao",
            "deslocamento",
            "curso",
            // Japanese.
            "変位",
            "伸び",
            "ストローク",
            // Chinese, in both scripts.
            "位移",
            "行程",
            "转角",
            "轉角",
        ],
    ),
    (
        "temperature",
        &[
            "temperature",
            "temp",
            "temperatur",
            "thermocouple",
            "température",
            "温度",
            "溫度",
        ],
    ),
    (
        "target",
        &[
            "force",
            "tension",
            "torque",
            "load",
            "effort",
            "current",
            "iq",
            "measured",
            "tau",
            "y",
            "f",
            "kraft",
            "moment",
            "drehmoment",
            "strom",
            "forza",
            "fuerza",
            "força",
            "kracht",
            "coppia",
            "siła",
            "síla",
            "voima",
            "kuvvet",
            "erő",
            "сила",
            "荷重",
            "張力",
            "拉力",
            "하중",
            // The axes of a plate or a sensor of forces.
            "fx",
            "fy",
            "fz",
            "mx",
            "mz",
            // Spanish and Italian, French and Portuguese, without their accents too.
            "carga",
            "carico",
            "couple",
            "forca",
            // A current in French, Italian and Portuguese, and Spanish.
            "courant",
            "corrente",
            "corriente",
            // Japanese.
            "力",
            "試験力",
            "トルク",
            "電流",
            // Chinese, in both scripts.
            "试验力",
            "载荷",
            "載荷",
            "负荷",
            "負荷",
            "扭矩",
            "转矩",
            "轉矩",
            "力矩",
            "电流",
        ],
    ),
];

/// Words that are parts of words of another meaning, as `curso` of `cursor`: they count alone
/// only.
const ALONE: &[&str] = &[
    "curso", "course", "carga", "carico", "couple", "forca", "carrera",
];

/// Words of columns that count rows.
pub(super) const COUNTERS: &[&str] = &[
    "seq", "sequence", "index", "row", "id", "no", "count", "counter", "sample", "frame", "line",
];

/// Endings of names and the units that they mean, with the factor to the unit of the model file.
/// The first that fits is taken: longer ones stand before those that end them.
const UNITS: &[(&str, &str, f64)] = &[
    ("rad_s2", "rad/s²", 1.0),
    ("m_s2", "m/s²", 1.0),
    ("mrad_s", "rad/s", 1e-3),
    ("rad_s", "rad/s", 1.0),
    ("rad_sec", "rad/s", 1.0),
    ("deg_s", "deg/s", 1.0),
    ("dps", "deg/s", 1.0),
    ("rev_s", "rev/s", 1.0),
    ("rpm", "rev/s", 1.0 / 60.0),
    ("r_min", "rev/s", 1.0 / 60.0),
    ("u_min", "rev/s", 1.0 / 60.0),
    ("1_min", "rev/s", 1.0 / 60.0),
    ("m_s", "m/s", 1.0),
    ("mm_s", "mm/s", 1.0),
    ("cm_s", "mm/s", 10.0),
    ("in_s", "mm/s", 25.4),
    ("ft_s", "m/s", 0.3048),
    ("km_h", "m/s", 1.0 / 3.6),
    ("millis", "s", 1e-3),
    ("micros", "s", 1e-6),
    ("ms", "s", 1e-3),
    ("us", "s", 1e-6),
    ("µs", "s", 1e-6),
    ("μs", "s", 1e-6),
    ("ns", "s", 1e-9),
    ("second", "s", 1.0),
    ("seconds", "s", 1.0),
    ("sec", "s", 1.0),
    ("s", "s", 1.0),
    ("秒", "s", 1.0),
    ("min", "s", 60.0),
    ("minutes", "s", 60.0),
    ("h", "s", 3600.0),
    ("hours", "s", 3600.0),
    ("mrad", "mrad", 1.0),
    ("rad", "rad", 1.0),
    ("deg", "deg", 1.0),
    ("rev", "rev", 1.0),
    ("n_m", "N·m", 1.0),
    ("nm", "N·m", 1.0),
    ("lbf_ft", "N·m", 1.355_817_948),
    ("lbf_in", "N·m", 0.112_984_829),
    ("n", "N", 1.0),
    ("kn", "N", 1e3),
    ("mn", "N", 1e-3),
    ("mnm", "N·m", 1e-3),
    ("ncm", "N·m", 1e-2),
    ("dan", "N", 10.0),
    ("cn", "N", 1e-2),
    ("kgf", "N", 9.806_65),
    ("gf", "N", 9.806_65e-3),
    ("ozf", "N", 0.278_013_851),
    ("lbs", "N", 4.448_221_615),
    ("lbf", "N", 4.448_221_615),
    ("lb", "N", 4.448_221_615),
    ("kip", "N", 4_448.221_615),
    ("kips", "N", 4_448.221_615),
    ("mm", "mm", 1.0),
    ("cm", "mm", 10.0),
    ("µm", "mm", 1e-3),
    ("μm", "mm", 1e-3),
    ("um", "mm", 1e-3),
    ("in", "mm", 25.4),
    ("inch", "mm", 25.4),
    ("ft", "m", 0.3048),
    ("m", "m", 1.0),
    ("ma", "A", 1e-3),
    ("a", "A", 1.0),
    ("mv_v", "mV/V", 1.0),
    ("mv", "V", 1e-3),
    ("v", "V", 1.0),
    ("volt", "V", 1.0),
    ("volts", "V", 1.0),
    ("deg_c", "K", 1.0),
    ("c", "K", 1.0),
    ("degc", "K", 1.0),
];

/// Units that stand alone as the name of a column, of two letters or more.
const NAMELESS: &[&str] = &["ma", "mv", "kn", "mn", "mm", "kgf", "lbf", "deg_c", "degc"];

/// A name, taken apart.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Name {
    /// Its words in lower case, without unit and numbers.
    pub(super) words: Vec<String>,
    /// Its numbers, separated by dots: those of one joint have the same.
    pub(super) index: String,
    /// Unit of the model file, or an empty text.
    pub(super) unit: &'static str,
    /// Factor from cell to unit.
    pub(super) scale: f64,
    /// Its unit as the file has it, where it is made of several and not known; else an empty text.
    pub(super) stated: String,
}

impl Name {
    pub(super) fn of(name: &str) -> Name {
        let name = without_port(name);
        let mut found = match compound::of(name) {
            Some(unit) => Name::with(unit),
            None => Name::of_parts(name),
        };
        // A length may be in nanometres.
        let is_motion = matches!(found.role(), Some("angle" | "velocity"));
        if is_motion && found.unit == "N·m" {
            let unit = parts(name).pop().unwrap_or_default();
            (found.unit, found.scale, found.stated) = ("", 1.0, unit);
        }
        found
    }

    /// A name with a unit of several parts.
    fn with(unit: Compound) -> Name {
        let (unit_name, scale, stated) = match unit.newton_metres {
            Some(scale) => ("N·m", scale, String::new()),
            None => ("", 1.0, unit.text),
        };
        Name {
            unit: unit_name,
            scale,
            stated,
            ..Name::of_words(&parts(&unit.rest))
        }
    }

    /// Words and numbers of a name without a unit.
    fn of_words(parts: &[String]) -> Name {
        let (mut words, mut numbers): (Vec<String>, Vec<String>) = Default::default();
        for part in parts {
            let word = part.trim_end_matches(|c: char| c.is_ascii_digit());
            match words.last_mut() {
                // A component of a motor's current or voltage: `i_q`.
                Some(last) if word == "q" && ["i", "u"].contains(&last.as_str()) => last.push('q'),
                _ if word.is_empty() => {}
                _ => words.push(word.to_string()),
            }
            if let Ok(number) = part[word.len()..].parse::<u64>() {
                numbers.push(number.to_string());
            }
        }
        Name {
            words,
            index: numbers.join("."),
            unit: "",
            scale: 1.0,
            stated: String::new(),
        }
    }

    /// A name with a unit of the table, or without one.
    fn of_parts(name: &str) -> Name {
        let mut parts = parts(name);
        // The index stands before or after the unit: `q7_rad`, `q_rad_7`.
        let last = parts
            .last()
            .filter(|p| p.chars().all(|c| c.is_ascii_digit()))
            .cloned();
        if last.is_some() {
            parts.pop();
        }
        let (count, mut unit, mut scale) = unit(&parts);
        scale = capital(name, unit, scale);
        let ending = parts.split_off(parts.len() - count);
        parts.extend(last);
        let mut name = Name::of_words(&parts);
        // An `in` may be a side of something, and a letter part of a unit that is not known: a
        // speed is not in s.
        let role = name.role();
        let is_length = matches!(role, Some("angle" | "velocity"));
        let is_side = ending == ["in"] && !is_length;
        let is_part = unit == "s" && !matches!(role, None | Some("time"));
        if is_side {
            name.words.extend(ending);
        }
        if is_side || is_part {
            (unit, scale) = ("", 1.0);
        }
        Name {
            unit,
            scale,
            ..name
        }
    }

    /// The name of what a setpoint is for: `sollkraft` is for a force.
    pub(super) fn without_setpoint(&self) -> Name {
        let setpoints = WORDS.iter().find(|(role, _)| *role == "setpoint");
        let all = setpoints.map_or(&[][..], |(_, words)| *words);
        let rest = |word: &String| {
            let prefix = all.iter().filter(|s| s.len() > 3 || word == *s);
            let rest = prefix
                .filter_map(|s| word.strip_prefix(s))
                .min_by_key(|r| r.len());
            rest.map_or_else(|| word.clone(), str::to_string)
        };
        let words = self.words.iter().map(rest).filter(|w| !w.is_empty());
        Name {
            words: words.collect(),
            ..self.clone()
        }
    }

    /// The role that the name stands for.
    pub(super) fn role(&self) -> Option<&'static str> {
        // Alone it is what the model predicts; with another word it is what a controller aims at.
        if self.words == ["target"] {
            return Some("target");
        }
        // The French time, and not several temperatures.
        if self.words == ["temps"] {
            return Some("time");
        }
        // The moment about an axis, and not an English word.
        if self.words == ["my"] {
            return Some("target");
        }
        // A desired value, as libfranka names it: `tau_J_d`.
        if self.words.len() > 1 && self.words.last().is_some_and(|w| w == "d") {
            return Some("setpoint");
        }
        let whole = self.words.join("_");
        let is_within = |w: &str| w.len() > 3 && !ALONE.contains(&w) && whole.contains(w);
        let fits = |w: &&str| self.words.iter().any(|p| p == w) || is_within(w);
        WORDS
            .iter()
            .find(|(_, words)| words.iter().any(&fits))
            .map(|(role, _)| *role)
            .filter(|role| !role.is_empty())
    }
}

/// A name without the number of a port, which Simulink writes behind a path: `Rig/Force [N]/Out1`.
fn without_port(name: &str) -> &str {
    let port = name.trim_matches('"').rsplit_once("/Out");
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    port.filter(|(_, number)| is_number(number))
        .map_or(name, |(path, _)| path)
}

/// The parts of a name in lower case: `jointPos[3] (°/s)` has joint, pos, 3, deg and s.
fn parts(name: &str) -> Vec<String> {
    let mut plain = String::new();
    let mut small = 0;
    for c in name.chars() {
        // A capital begins a word after three small letters; in `dA` it does not.
        if c.is_uppercase() && small >= 3 {
            plain.push('_');
        }
        small = if c.is_lowercase() { small + 1 } else { 0 };
        match c {
            '°' => plain.push_str("_deg"),
            c if c.is_alphanumeric() => plain.extend(c.to_lowercase()),
            _ => plain.push('_'),
        }
    }
    let parts = plain.split('_').filter(|p| !p.is_empty());
    parts.map(str::to_string).collect()
}

/// How many of the last parts are a unit, the unit and its factor. A name that is nothing but a
/// unit of time is a time.
fn unit(parts: &[String]) -> (usize, &'static str, f64) {
    for (ending, unit, scale) in UNITS {
        let count = ending.split('_').count();
        let ends = parts.len() >= count && parts[parts.len() - count..].join("_") == *ending;
        if ends && parts.len() > count {
            return (count, unit, *scale);
        }
        // `rpm` and `millis` are name and unit in one, and `mA` has no name.
        if ends && NAMELESS.contains(ending) {
            return (0, unit, *scale);
        }
        if ends && ending.len() > 2 && WORDS.iter().any(|(_, words)| words.contains(ending)) {
            return (0, unit, *scale);
        }
    }
    (0, "", 1.0)
}

/// The unit that a text is as a whole, and its factor.
pub(super) fn known(text: &str) -> Option<(&'static str, f64)> {
    let whole = parts(text).join("_");
    let row = UNITS.iter().find(|(ending, _, _)| *ending == whole)?;
    Some((row.1, capital(text, row.1, row.2)))
}

/// The factor of a unit at the end of a text: `MN` is no `mN`, the only pair of the table that
/// differs in capitals only.
fn capital(text: &str, unit: &str, scale: f64) -> f64 {
    let mut last = text.rsplit(|c: char| !c.is_alphabetic());
    let last = last.find(|part| !part.is_empty());
    if unit == "N" && scale == 1e-3 && last == Some("MN") {
        1e6
    } else {
        scale
    }
}

/// How many words of names in Japanese and Chinese a text has, of two letters or more.
pub(super) fn words_of_east_asia(text: &str) -> usize {
    // From here on stand the letters of China, Japan and Korea.
    let is_of = |w: &&&str| w.chars().count() > 1 && w.chars().all(|c| c >= '\u{2e80}');
    let all = WORDS.iter().flat_map(|(_, words)| words.iter());
    all.filter(is_of).filter(|w| text.contains(**w)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roles_and_indices_of_names() {
        for (name, role, index) in [
            ("q7", "angle", "7"),
            ("pos_7", "angle", "7"),
            ("position[7]", "angle", "7"),
            ("/joint_states.position[0]", "angle", "0"),
            ("joint_7.position", "angle", "7"),
            ("actual_q_7", "angle", "7"),
            ("q7_rad", "angle", "7"),
            ("jointPosition07", "angle", "7"),
            ("dq7", "velocity", "7"),
            ("qd7", "velocity", "7"),
            ("vel7", "velocity", "7"),
            ("q_dot_7", "velocity", "7"),
            ("tau7", "target", "7"),
            ("effort[7]", "target", "7"),
            ("PositionCmptd7", "setpoint", "7"),
            ("target_speed", "setpoint", ""),
            ("target", "target", ""),
            ("current_position", "angle", ""),
            ("field.header.stamp", "time", ""),
            ("disp_in", "angle", ""),
            ("vel_in_s", "velocity", ""),
            ("Prüfkraft", "target", ""),
            ("Sollkraft", "setpoint", ""),
            ("Geschwindigkeit [mm/s]", "velocity", ""),
            ("Drehmoment_2", "target", "2"),
            ("Winkel", "angle", ""),
            ("tau_J_d[0]", "setpoint", "0"),
            ("tau_J[0]", "target", "0"),
            ("Temps (s)", "time", ""),
            ("Consigne (N)", "setpoint", ""),
            ("Set/kg", "setpoint", ""),
            ("Vitesse (rad/s)", "velocity", ""),
            ("Force mesurée (N)", "target", ""),
            ("Tiempo", "time", ""),
            ("Velocidad", "velocity", ""),
            ("Ángulo", "angle", ""),
            ("Fuerza", "target", ""),
            ("Tempo [s]", "time", ""),
            ("Velocità", "velocity", ""),
            ("Forza", "target", ""),
            ("Temperature", "temperature", ""),
            ("temp_2", "temperature", "2"),
            ("motor_temps", "temperature", ""),
            ("thermocouple temperature", "temperature", ""),
        ] {
            let name_of = Name::of(name);
            assert_eq!(
                (name_of.role(), name_of.index.as_str()),
                (Some(role), index),
                "{name}"
            );
        }
        assert_eq!(Name::of("position_error").role(), None);
        assert_eq!(Name::of("ddq7").role(), None);
    }

    #[test]
    fn units_of_names() {
        for (name, unit, scale) in [
            ("time [ms]", "s", 1e-3),
            ("Time(µs)", "s", 1e-6),
            ("jointPos3 [°/s]", "deg/s", 1.0),
            ("torque (N·m)", "N·m", 1.0),
            ("current_mA", "A", 1e-3),
            ("rpm", "rev/s", 1.0 / 60.0),
            ("temp (°C)", "K", 1.0),
            ("current_dA", "", 1.0),
            ("q_rad_7", "rad", 1.0),
            ("vel_in_s", "mm/s", 25.4),
            ("disp_in", "mm", 25.4),
            ("torque_in", "", 1.0),
            ("force_kip", "N", 4_448.221_615),
            ("force [kN]", "N", 1e3),
            ("Kraft (mN)", "N", 1e-3),
            ("Kraft (MN)", "N", 1e6),
            ("Torque (ft-lb)", "N·m", 1.355_817_948_252),
            ("Torque [in·lbf]", "N·m", 0.112_984_829_021),
            ("torque_kgf_cm", "N·m", 0.098_066_5),
            ("Force in lbf", "N", 4.448_221_615),
            ("Stiffness (N/mm)", "", 1.0),
            ("position (nm)", "", 1.0),
            ("Rig/Force [N]/Out1", "N", 1.0),
            ("speed (mrad/s)", "rad/s", 1e-3),
            ("speed_furlong_s", "", 1.0),
            ("delay_s", "s", 1.0),
        ] {
            let of = Name::of(name);
            assert_eq!((of.unit, of.scale), (unit, scale), "{name}");
        }
        assert_eq!(known("[r/min]"), Some(("rev/s", 1.0 / 60.0)));
        assert_eq!(known("1/s"), None);
        for (k, (longer, _, _)) in UNITS.iter().enumerate() {
            for (shorter, _, _) in &UNITS[..k] {
                assert!(
                    !longer.ends_with(&format!("_{shorter}")),
                    "{longer} behind {shorter}"
                );
            }
        }
    }
}
