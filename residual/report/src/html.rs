//! `report.html`: the document as one HTML page, plots included.

use super::document::Part;
use super::{svg, Report};
use std::fmt::Write as _;

impl Report {
    /// The text of `report.html`, with the plots in it.
    pub fn html(&self) -> String {
        let mut out = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{}</title>\n<style>{STYLE}</style></head><body>\n",
            escape(&self.heading())
        );
        for part in self.document() {
            write_part(&mut out, &part, &self.unit);
        }
        out + "</body></html>\n"
    }
}

/// Appends a part of the document; `unit` is the target's.
fn write_part(out: &mut String, part: &Part, unit: &str) {
    // Writing to a text cannot fail.
    let _ = match part {
        Part::Title(t) => writeln!(out, "<h1>{}</h1>", escape(t)),
        Part::Verdict { text, class } => {
            writeln!(out, "<p class=\"verdict {class}\">{}</p>", inline(text))
        }
        Part::Heading(t) => writeln!(out, "<h2>{}</h2>", escape(t)),
        Part::Text(t) => writeln!(out, "<p>{}</p>", inline(t)),
        Part::Table { head, rows } => {
            let cells = |tag: &str, cells: &[String]| -> String {
                let cell = |c: &String| format!("<{tag}>{}</{tag}>", inline(c));
                cells.iter().map(cell).collect()
            };
            let rows: String = rows
                .iter()
                .map(|row| format!("<tr>{}</tr>\n", cells("td", row)))
                .collect();
            writeln!(
                out,
                "<div class=\"wide\"><table><thead><tr>{}</tr></thead>\n{rows}</table></div>",
                cells("th", head)
            )
        }
        Part::Picture { plot, caption, .. } => writeln!(
            out,
            "<figure><div class=\"panels\">{}</div><figcaption>{} <span style=\"color:{}\">&#9679;</span> {}, <span style=\"color:{}\">&#9473;</span> {}.</figcaption></figure>",
            svg::separate(plot, unit).concat(),
            inline(caption),
            svg::POINTS,
            svg::POINTS_ARE,
            svg::MEANS,
            svg::MEANS_ARE
        ),
    };
}

/// Text with the characters that mean something in HTML replaced.
fn escape(s: &str) -> String {
    s.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// Text as HTML, with pairs of backticks as code and pairs of double asterisks as bold.
fn inline(text: &str) -> String {
    let pairs = |text: &str, mark: &str, tag: &str| {
        let parts: Vec<&str> = text.split(mark).collect();
        let mut out = String::new();
        for (i, part) in parts.iter().enumerate() {
            match i {
                0 => {}
                // A mark without a partner stays as it is.
                _ if i % 2 == 1 && i + 1 == parts.len() => out.push_str(mark),
                _ if i % 2 == 1 => out.push_str(&format!("<{tag}>")),
                _ => out.push_str(&format!("</{tag}>")),
            }
            out.push_str(part);
        }
        out
    };
    pairs(&pairs(&escape(text), "**", "strong"), "`", "code")
        .replace(" -&gt; ", "&nbsp;&rarr;&nbsp;")
        .replace('\n', "<br>")
}

/// Style of `report.html`: readable at 360 px, on a wide screen, and on paper.
const STYLE: &str = "\
body{font:16px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}\
h1{font-size:1.7em;line-height:1.25}h2{font-size:1.25em;margin-top:2em;overflow-wrap:anywhere}\
p,figcaption{max-width:52em;overflow-wrap:anywhere}\
.verdict{font-size:1.1em;border-left:.4em solid #888;background:#f4f4f4;padding:.6em .9em}\
.effect,.several{border-color:#2a7d46}.none{border-color:#4878a8}\
.partly,.not_identifiable{border-color:#c08a10;background:#fbf3dd}.unknown{border-color:#c03020;background:#fbebe8}\
.wide{overflow-x:auto;margin:1em 0}table{border-collapse:collapse}\
td,th{border:1px solid #ccc;padding:.2em .6em;min-width:4em;text-align:left;vertical-align:top}\
code{font-size:.92em;background:#f4f4f4}\
figure{margin:1em 0}.panels{display:flex;flex-wrap:wrap;gap:.4em}\
.panels svg{flex:1 1 300px;min-width:0;max-width:400px;height:auto}\
figcaption{font-size:.9em;color:#444}\
@media print{body{font-size:10pt;margin:0;max-width:none}h2,thead{break-after:avoid}\
figure,tr{break-inside:avoid}.wide{overflow:visible}.panels svg{max-width:48%}}";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_becomes_html_without_losing_a_mark() {
        assert_eq!(
            inline("**a** `b < c` d ` e\n1 -> 2"),
            "<strong>a</strong> <code>b &lt; c</code> d ` e<br>1&nbsp;&rarr;&nbsp;2"
        );
    }
}
