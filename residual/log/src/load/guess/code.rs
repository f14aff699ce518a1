//! The code of names that are not UTF-8: old programs of Japan and China write their own.

use super::names;
use encoding_rs::{Encoding, GB18030, SHIFT_JIS};

/// Codes that are tried.
const CODES: [(&Encoding, &str); 2] = [(SHIFT_JIS, "Shift-JIS"), (GB18030, "GB18030")];

/// Bytes that are not UTF-8 as text, and the name of their code: the one that makes the most words
/// that are known. `None` where none makes one: other text may be without errors in each of them.
pub(super) fn decoded(bytes: &[u8]) -> Option<(String, &'static str)> {
    let of = |(code, name): &(&'static Encoding, &'static str)| {
        let text = code.decode_without_bom_handling_and_without_replacement(bytes)?;
        let words = names::words_of_east_asia(&text);
        (words > 0).then(|| (words, text.into_owned(), *name))
    };
    let best = CODES.iter().filter_map(of).max_by_key(|(words, ..)| *words);
    best.map(|(_, text, name)| (text, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_known_by_the_words_that_it_makes() {
        for (text, code, name) in [
            ("時間[s],荷重[N]\n", SHIFT_JIS, "Shift-JIS"),
            ("时间(s),速度(mm/s)\n", GB18030, "GB18030"),
        ] {
            let (bytes, ..) = code.encode(text);
            assert_eq!(decoded(&bytes), Some((text.to_string(), name)));
        }
        // Old Windows, whose letters may be a sign of another code.
        for text in ["Prüfkraft (µN);°", "durée;effort mesuré (N)", "Größe"] {
            let bytes: Vec<u8> = text.chars().map(|c| c as u8).collect();
            assert_eq!(decoded(&bytes), None, "{text}");
        }
    }
}
