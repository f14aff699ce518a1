//! A calibration as a page to print and to sign: one HTML text without anything from elsewhere.

use crate::picture::{bars, Bar};
use calibration::gravity;
use calibration::record::{GainRecord, Record, UnitRecord};
use known::checks::{Check, Validity};
use std::fmt::Write as _;

/// Text that holds no markup.
fn plain(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

fn or_dash(text: &str) -> String {
    if text.is_empty() {
        "&ndash;".to_owned()
    } else {
        plain(text)
    }
}

/// A table with a heading row.
fn table(out: &mut String, head: &[&str], rows: &[Vec<String>]) {
    out.push_str("<table><tr>");
    for cell in head {
        let _ = write!(out, "<th>{cell}</th>");
    }
    out.push_str("</tr>\n");
    for row in rows {
        out.push_str("<tr>");
        for cell in row {
            let _ = write!(out, "<td>{cell}</td>");
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</table>\n");
}

const STYLE: &str =
    "body{font-family:sans-serif;font-size:10pt;max-width:19cm;margin:1cm auto;color:#111}\
h1{font-size:16pt}h2{font-size:12pt;margin-top:1.4em}table{border-collapse:collapse;width:100%}\
th,td{border:1px solid #999;padding:2px 6px;text-align:right}th{background:#eee}\
td:first-child,th:first-child{text-align:left}svg{width:100%;height:auto}\
section{break-inside:avoid}@media print{body{margin:0}}";

/// The certificate of a stored calibration. `version`: its number in the store; `checks`: those
/// made on it.
#[must_use]
pub fn html(record: &Record, version: &str, checks: &[Check], today: &str) -> String {
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Calibration of {rig}</title><style>{STYLE}</style></head><body>\n<h1>Certificate of calibration</h1>\n",
        rig = plain(&record.rig)
    );
    let validity = Validity::of(record, today);
    let valid = validity.map_or_else(
        || "not stated".to_owned(),
        |v| {
            let over = if v.days_left < 0 { " (over)" } else { "" };
            format!("{}{over}", v.until)
        },
    );
    let facts = [
        (
            "Object",
            format!(
                "force rig <b>{}</b>, {} load cells with converters",
                plain(&record.rig),
                record.units.len()
            ),
        ),
        (
            "Record",
            format!("version {}, {}", plain(version), plain(&record.hash)),
        ),
        ("Date of the record", record.date.clone()),
        ("Valid until", valid),
        ("Printed", today.to_owned()),
        ("Remarks", or_dash(&record.note)),
    ];
    table(
        &mut out,
        &["", ""],
        &facts.map(|(what, value)| vec![what.to_owned(), value]),
    );
    let _ = writeln!(
        out,
        "<h2>Method</h2><p>Known weights load each cell in rising and falling series. Generalised least squares give the scale, and where the readings show them a curve and creep. Force of a weight: mass times local gravity times (1 &minus; {:.2e}) for the air. Uncertainties follow the GUM; U is of 95 % (Student's t with effective degrees of freedom). The weights refer to their conventional mass. Temperature is not recorded.</p>",
        gravity::AIR_BUOYANCY
    );
    let measured: Vec<(&UnitRecord, &GainRecord)> = (record.units.iter())
        .filter_map(|unit| Some((unit, unit.gain.as_ref()?)))
        .filter(|(unit, _)| !unit.gain_date.is_empty())
        .collect();
    results(&mut out, record);
    budget(&mut out, &measured);
    traceability(&mut out, &measured);
    checked(&mut out, checks);
    out.push_str("<h2>Residuals</h2>\n");
    for (unit, gain) in &measured {
        let rows: Vec<Bar> = (gain.residuals.iter())
            .map(|[force_n, residual_mn, sd_mn]| Bar {
                label: format!("{force_n:.3} N"),
                value: *residual_mn,
                sd: *sd_mn,
            })
            .collect();
        let title = format!(
            "unit {}: measured less fitted, on a band of two standard deviations",
            unit.number
        );
        let svg = bars(&title, "mN", &rows).to_svg();
        // Within a page an SVG has no declaration of its own.
        let svg = svg.find("<svg").map_or("", |at| &svg[at..]);
        let _ = writeln!(out, "<section>{svg}</section>");
    }
    out.push_str("<h2>Signature</h2><p>Calibrated by: ____________________ &nbsp; Approved by: ____________________ &nbsp; Date: ____________</p>\n<p>This page states what was measured and how well. It is no certificate of an accredited laboratory.</p>\n</body></html>\n");
    out
}

fn results(out: &mut String, record: &Record) {
    out.push_str("<h2>Results</h2>\n");
    let or_nominal = |date: &str| {
        if date.is_empty() {
            "nominal".to_owned()
        } else {
            date.to_owned()
        }
    };
    let rows: Vec<Vec<String>> = (record.units.iter())
        .map(|unit| {
            let gain = unit.gain.as_ref();
            let figure =
                |of: &dyn Fn(&GainRecord) -> String| gain.map_or_else(|| "&ndash;".to_owned(), of);
            vec![
                unit.number.to_string(),
                or_dash(&unit.cell_serial),
                or_dash(&unit.converter_serial),
                or_nominal(&unit.gain_date),
                format!("{:.6e}", unit.n_per_code),
                figure(&|g| format!("{:.3} %", 100.0 * g.half_95_relative)),
                figure(&|g| format!("{:.1}", 1e3 * g.linearity_n)),
                figure(&|g| format!("{:.1}", 1e3 * g.hysteresis_n)),
                figure(&|g| format!("{:.2}", 1e3 * g.repeatability_n)),
                figure(&|g| format!("{:.2}", g.largest_n)),
                format!("{:.2} %", 100.0 * unit.creep),
            ]
        })
        .collect();
    table(
        out,
        &[
            "unit",
            "cell",
            "converter",
            "gain of",
            "N per code",
            "U",
            "linearity, mN",
            "hysteresis, mN",
            "repeatability, mN",
            "up to, N",
            "creep",
        ],
        &rows,
    );
    let rows: Vec<Vec<String>> = (record.units.iter())
        .map(|unit| {
            let [x, y, z] = unit.exit_m.map(|v| format!("{:.2}", 1e3 * v));
            let [ax, ay, az] = unit.axis.map(|v| format!("{v:.4}"));
            let covariance = unit.covariance_matrix();
            let sd = |from: usize| {
                let block = covariance.fixed_view::<3, 3>(from, from);
                block.trace().max(0.0).sqrt()
            };
            vec![
                unit.number.to_string(),
                or_nominal(&unit.zero_date),
                format!("{:.0} &plusmn; {:.0}", unit.zero_codes, unit.zero_sd_codes),
                or_nominal(&unit.geometry_date),
                format!("{x}, {y}, {z}"),
                format!("{:.2}", 1e3 * sd(0)),
                format!("{ax}, {ay}, {az}"),
                format!("{:.2}", sd(3).to_degrees()),
            ]
        })
        .collect();
    table(
        out,
        &[
            "unit",
            "zero of",
            "zero, codes",
            "geometry of",
            "exit point, mm",
            "u, mm",
            "axis of the cell",
            "u, degrees",
        ],
        &rows,
    );
}

fn budget(out: &mut String, measured: &[(&UnitRecord, &GainRecord)]) {
    out.push_str(
        "<h2>Uncertainty budget of each scale (relative standard uncertainties, %)</h2>\n",
    );
    let rows: Vec<Vec<String>> = (measured.iter())
        .map(|(unit, gain)| {
            let parts = [
                gain.readings_sd,
                gain.weights_sd,
                gain.gravity_sd,
                gain.beyond_sd,
            ];
            let combined = parts.iter().map(|p| p * p).sum::<f64>().sqrt();
            let mut row = vec![unit.number.to_string()];
            row.extend(parts.map(|p| format!("{:.4}", 100.0 * p)));
            row.push(format!("{:.4}", 100.0 * combined));
            row.push(format!("{:.4}", 100.0 * gain.half_95_relative));
            row.push(format!("{:.1}", 1e3 * gain.hysteresis_sd_n()));
            row.push(format!(
                "{:.1} / {}",
                gain.chi_square, gain.degrees_of_freedom
            ));
            row
        })
        .collect();
    table(
        out,
        &[
            "unit",
            "readings (A)",
            "weights (B)",
            "gravity, air (B)",
            "beyond the weights (B)",
            "combined",
            "U, 95 %",
            "of a force: hysteresis, mN (B)",
            "chi-squared / dof",
        ],
        &rows,
    );
}

fn traceability(out: &mut String, measured: &[(&UnitRecord, &GainRecord)]) {
    out.push_str("<h2>Traceability</h2>\n");
    let rows: Vec<Vec<String>> = (measured.iter())
        .map(|(unit, gain)| {
            let weights = &gain.weights;
            vec![
                unit.number.to_string(),
                plain(&weights.tolerance),
                format!("{}", weights.correlation),
                or_dash(&weights.certificate),
                or_dash(&weights.serial),
                format!("{:.5}", gain.gravity_m_per_s2),
                gain.readings.to_string(),
                or_dash(&gain.operator),
                or_dash(&gain.note),
            ]
        })
        .collect();
    table(
        out,
        &[
            "unit",
            "weights",
            "correlation",
            "certificate",
            "serial",
            "gravity, m/s&sup2;",
            "readings",
            "operator",
            "remarks",
        ],
        &rows,
    );
}

fn checked(out: &mut String, checks: &[Check]) {
    out.push_str("<h2>Checks with a known weight since</h2>\n");
    if checks.is_empty() {
        out.push_str("<p>none</p>\n");
        return;
    }
    let rows: Vec<Vec<String>> = (checks.iter())
        .map(|check| {
            vec![
                check.date.clone(),
                check.unit.to_string(),
                format!("{}", check.weight_g),
                format!("{:+.1}", 1e3 * (check.measured_n - check.force_n)),
                format!("{:.1}", 1e3 * check.uncertainty_95_n),
                format!("{:.2}", check.en()),
                if check.passes() {
                    "holds"
                } else {
                    "does not hold"
                }
                .to_owned(),
            ]
        })
        .collect();
    table(
        out,
        &[
            "date",
            "unit",
            "weight, g",
            "off, mN",
            "U, mN",
            "En",
            "verdict",
        ],
        &rows,
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use calibration::record::WeightsRecord;
    use known::base;
    use rig::Rig;

    #[test]
    fn the_page_says_what_the_record_says_and_no_markup_gets_in() {
        let mut record = base::nominal(&Rig::built_in().unwrap(), "2026-03-01");
        record.valid_days = 365;
        let unit = &mut record.units[2];
        unit.gain_date = "2026-03-01".to_owned();
        unit.cell_serial = "SBA-0713".to_owned();
        unit.gain = Some(GainRecord {
            readings: 31,
            largest_n: 9.8,
            half_95_relative: 3.14e-4,
            readings_sd: 4e-5,
            weights_sd: 9e-5,
            gravity_sd: 5e-5,
            beyond_sd: 6e-5,
            repeatability_n: 9e-4,
            chi_square: 41.2,
            degrees_of_freedom: 29,
            linearity_n: -1.1e-3,
            hysteresis_n: 0.049,
            hysteresis_se_n: 2e-3,
            gravity_m_per_s2: 9.80926,
            operator: "R. <b>Hooke".to_owned(),
            note: String::new(),
            residuals: vec![[0.0, 0.4, 1.0], [9.8, -0.2, 1.1]],
            weights: WeightsRecord {
                tolerance: "OIML class M2".to_owned(),
                correlation: 1.0,
                certificate: "K-2026-117".to_owned(),
                serial: "4711".to_owned(),
            },
        });
        let check = Check {
            date: "2026-04-01".to_owned(),
            unit: 3,
            weight_g: 500.0,
            force_n: 4.9,
            measured_n: 4.93,
            uncertainty_95_n: 0.01,
            calibration: String::new(),
        };
        let page = html(&record, "0004", &[check], "2026-04-02");
        for text in [
            "SBA-0713",
            "2027-03-01",
            "OIML class M2",
            "K-2026-117",
            "4711",
            "9.80926",
            "R. &lt;b&gt;Hooke",
            "0.031 %",
            "14.1",
            "41.2 / 29",
            "does not hold",
            "version 0004",
            "<svg",
            // 4, 9, 5 and 6 e-5 together.
            "<td>0.0126</td>",
        ] {
            assert!(page.contains(text), "`{text}` is missing");
        }
        assert!(!page.contains("<?xml") && !page.contains("http://www.w3.org/1999/xlink"));
        let later = html(&record, "0004", &[], "2027-03-02");
        assert!(later.contains("2027-03-01 (over)") && later.contains("<p>none</p>"));
    }
}
