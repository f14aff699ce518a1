//! Expressions and lists of names as text in reports.

use super::{Effect, Report};
use crate::effects::EffectKind;

impl Report {
    /// The name of one of its effects, and with it those that the data cannot distinguish from it: `payload or gravity_angle`.
    pub fn alternatives(&self, effect: &Effect) -> String {
        let same = self
            .not_identifiable
            .iter()
            .filter(|a| a.effects.first() == Some(&effect.name));
        let names: Vec<EffectKind> = std::iter::once(effect.name)
            .chain(same.flat_map(|a| a.effects[1..].iter().copied()))
            .collect();
        joined(&names, " or ")
    }
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
