//! Expressions and lists of names as text in reports.

use super::{Effect, Report};
use residual_columns::format::num;
use residual_effects::EffectKind;

/// Parameters that tell effects of one kind apart, whatever else they have in common.
const TELLING: [&str; 2] = ["order", "frequency"];

impl Report {
    /// What tells an effect apart from the others of its kind: its order or frequency, and its
    /// form, where they differ. Empty for the only effect of its kind.
    fn distinction(&self, effect: &Effect) -> Vec<String> {
        let all = self.effects.iter().chain(&self.improves);
        let kind: Vec<&Effect> = all.filter(|e| e.name == effect.name).collect();
        let mut out: Vec<String> = TELLING
            .iter()
            .filter(|n| {
                kind.iter()
                    .any(|e| e.params.get(**n) != effect.params.get(**n))
            })
            .filter_map(|n| at(effect, n))
            .collect();
        if kind.iter().any(|e| e.form != effect.form) {
            out.push(effect.form.clone());
        }
        out
    }

    /// The name of an effect, and in brackets what tells it apart from others of its kind:
    /// `periodic_angle (order 7.000)`.
    pub(super) fn called(&self, effect: &Effect) -> String {
        self.listed(&[effect])
    }

    /// Names of effects in one text; those of one kind together, with what tells them apart.
    pub(super) fn listed(&self, effects: &[&Effect]) -> String {
        let mut kinds: Vec<(EffectKind, Vec<String>)> = vec![];
        for e in effects {
            let own = self.distinction(e).join(", ");
            match kinds.iter_mut().find(|(kind, _)| *kind == e.name) {
                Some((_, all)) => all.push(own),
                None => kinds.push((e.name, vec![own])),
            }
        }
        let texts = kinds.into_iter().map(|(kind, mut own)| {
            own.retain(|text| !text.is_empty());
            match own.len() {
                0 => kind.to_string(),
                _ => format!("{kind} ({})", own.join("; ")),
            }
        });
        texts.collect::<Vec<_>>().join(", ")
    }

    /// The form of an effect, with the order or the frequency where others of its kind have
    /// another: `ripple, order 7.000`.
    pub fn details(&self, effect: &Effect) -> String {
        let mut own = self.distinction(effect);
        own.retain(|text| *text != effect.form);
        own.insert(0, effect.form.clone());
        own.join(", ")
    }

    /// The name of one of its effects, and with it those that the data cannot distinguish from it:
    /// `payload or gravity_angle`.
    pub fn alternatives(&self, effect: &Effect) -> String {
        self.either(effect.name.to_string(), effect)
    }

    /// The same with what tells the effect apart from others of its kind.
    pub(super) fn heading_of(&self, effect: &Effect) -> String {
        self.either(self.called(effect), effect)
    }

    fn either(&self, name: String, effect: &Effect) -> String {
        let others = self.others(effect.name);
        let others = others.iter().map(|names| joined(names, " and "));
        let names: Vec<String> = std::iter::once(name).chain(others).collect();
        names.join(" or ")
    }

    /// The names that may stand for an effect as well as its own: those that the data cannot
    /// distinguish from it ([`Report::not_identifiable`]), and those of other courses of the search
    /// that predict as well ([`Report::equal_paths`]). Names of one entry stand together: *A and
    /// B*. Empty for an effect whose name is the only one.
    pub fn others(&self, name: EffectKind) -> Vec<Vec<EffectKind>> {
        let groups = self.not_identifiable.iter().map(|a| &a.effects);
        let own = groups.filter(|names| names.first() == Some(&name));
        let same = own.flat_map(|names| names[1..].iter().map(|n| vec![*n]));
        let paths = self.equal_paths.iter();
        let equal = paths.filter(|p| p.effects.contains(&name));
        let mut out: Vec<Vec<EffectKind>> = Vec::new();
        for names in same.chain(equal.map(|p| p.instead.clone())) {
            if !out.contains(&names) {
                out.push(names);
            }
        }
        out
    }
}

/// A unit as it stands behind a figure: with a space before it, or nothing where there is none.
pub(super) fn behind(unit: &str) -> String {
    match unit {
        "" => String::new(),
        unit => format!(" {unit}"),
    }
}

/// The title of figures with their unit, where there is one.
pub(super) fn titled(what: &str, unit: &str) -> String {
    match unit {
        "" => what.to_owned(),
        unit => format!("{what}, {unit}"),
    }
}

/// A parameter of an effect by its name, with its unit; an order has none.
fn at(effect: &Effect, name: &str) -> Option<String> {
    let value = num(*effect.params.get(name)?);
    let unit = effect.units.get(name).map_or("", String::as_str);
    Some(match (name, unit) {
        ("order", _) | (_, "" | "1") => format!("{name} {value}"),
        _ => format!("{name} {value} {unit}"),
    })
}

/// Names of effects in one text.
pub(super) fn joined(effects: &[EffectKind], between: &str) -> String {
    let names: Vec<&str> = effects.iter().map(|e| e.as_str()).collect();
    names.join(between)
}

/// An expression with its numbers rounded to five significant digits.
pub(super) fn readable(expression: &str) -> String {
    let mut out = String::new();
    let mut rest = expression;
    while let Some(at) = rest.find(|c: char| c.is_ascii_digit()) {
        let (head, tail) = rest.split_at(at);
        let part_of_name = head
            .chars()
            .next_back()
            .is_some_and(|c| c.is_alphanumeric() || c == '_');
        let mut end = tail
            .find(|c: char| !(c.is_ascii_digit() || c == '.'))
            .unwrap_or(tail.len());
        if !part_of_name && tail[end..].starts_with(['e', 'E']) {
            let exponent = tail[end + 1..].trim_start_matches(['+', '-']);
            let digits = exponent
                .find(|c: char| !c.is_ascii_digit())
                .unwrap_or(exponent.len());
            if digits > 0 {
                end = tail.len() - exponent.len() + digits;
            }
        }
        let number = &tail[..end];
        out.push_str(head);
        match number.parse::<f64>() {
            Ok(x) if !part_of_name && x != 0.0 => {
                let short: f64 = format!("{x:.4e}").parse().unwrap_or(x);
                out.push_str(&format!("{short}"));
            }
            _ => out.push_str(number),
        }
        rest = &tail[end..];
    }
    out + rest
}

/// The first `most` of the names, and how many more there are.
pub(super) fn first_of(names: &[String], most: usize) -> String {
    let mut text = names
        .iter()
        .take(most)
        .map(String::as_str)
        .collect::<Vec<_>>()
        .join(", ");
    if names.len() > most {
        text += &format!(" and {} more", names.len() - most);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_names_that_may_stand_for_an_effect_are_in_one_place() {
        use EffectKind::{Coulomb, Gain, Hysteresis, Offset, Viscous};
        let report = super::super::example::report();
        let others = report.others(Coulomb);
        assert_eq!(others, [vec![Viscous], vec![Hysteresis, Gain]]);
        // The first of a group is the one found.
        assert!(report.others(Viscous).is_empty() && report.others(Offset).is_empty());
        assert_eq!(
            report.alternatives(&report.effects[0]),
            "coulomb or viscous or hysteresis and gain"
        );
    }

    #[test]
    fn expressions_are_shortened_in_their_numbers_alone() {
        assert_eq!(
            readable("command -> delay(q2, 0.0629091530243523) + 1.23456789e-7 * v_1.5"),
            "command -> delay(q2, 0.062909) + 0.00000012346 * v_1.5"
        );
        assert_eq!(
            readable("sgn(velocity, 5) * (2 == x)"),
            "sgn(velocity, 5) * (2 == x)"
        );
        assert_eq!(readable("1e"), "1e");
    }
}
