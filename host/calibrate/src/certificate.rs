//! A calibration as a page to print and to sign: one HTML text without anything from elsewhere.

use crate::picture::{bars, Bar};
use calibration::gravity;
use calibration::record::{GainRecord, Iso376Record, Record, TemperatureRecord, UnitRecord};
use known::checks::{self, Check, Validity};
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
h1{font-size:16pt}h2{font-size:12pt;margin-top:1.4em}table{border-collapse:collapse;width:100%;font-size:8pt;margin-bottom:6px}\
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
        "<h2>Method</h2><p>Known weights load each cell in rising and falling series. Generalised least squares give the scale, and where the readings show them a curve and creep. Force of a weight: mass times local gravity times (1 &minus; {:.2e}) for the air. Uncertainties follow the GUM; U is of 95 % (Student's t with effective degrees of freedom). The weights refer to their conventional mass. A force lies within the hysteresis of its cell as well: see the budget. Chi-squared counts with the noise of each reading alone; where it is above its degrees of freedom, the repeatability stands for the rest.</p>",
        gravity::AIR_BUOYANCY
    );
    let measured: Vec<(&UnitRecord, &GainRecord)> = (record.units.iter())
        .filter_map(|unit| Some((unit, unit.gain.as_ref()?)))
        .filter(|(unit, _)| !unit.gain_date.is_empty())
        .collect();
    results(&mut out, record);
    iso376(&mut out, &measured);
    budget(&mut out, &measured);
    traceability(&mut out, &measured);
    conditions(&mut out, record, &measured);
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
            "U up to 12 N",
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
            let mut row = vec![unit.number.to_string()];
            row.extend(gain.budget().map(|(_, sd)| format!("{:.4}", 100.0 * sd)));
            row.push(format!("{:.4}", 100.0 * gain.combined_sd()));
            row.push(format!("{:.4}", 100.0 * gain.half_95_relative));
            row.push(format!("{:.1}", 1e3 * gain.hysteresis_sd_n()));
            row.push(format!(
                "{:.1} / {}",
                gain.chi_square, gain.degrees_of_freedom
            ));
            row
        })
        .collect();
    let Some((_, first)) = measured.first() else {
        return;
    };
    let mut head = vec!["unit"];
    head.extend(first.budget().map(|(name, _)| name));
    head.extend([
        "combined",
        "U up to 12 N, 95 %",
        "of a force: hysteresis, mN (B)",
        "chi-squared / dof",
    ]);
    table(out, &head, &rows);
}

/// The temperature of a gain in words.
#[must_use]
pub fn temperature(warm: &TemperatureRecord) -> String {
    let at = if warm.from_c == warm.to_c {
        format!("{:.1} degrees Celsius", warm.from_c)
    } else {
        format!("{:.1} to {:.1} degrees Celsius", warm.from_c, warm.to_c)
    };
    let term =
        |value: f64, sd: f64, unit: &str| format!("{value:+.4} +- {:.4} {unit} per K", 2.0 * sd);
    let mut found = Vec::new();
    if warm.scale_per_k_sd > 0.0 {
        found.push(format!(
            "scale {}",
            term(100.0 * warm.scale_per_k, 100.0 * warm.scale_per_k_sd, "%")
        ));
    }
    if warm.zero_n_per_k_sd > 0.0 {
        found.push(format!(
            "zero {}",
            term(1e3 * warm.zero_n_per_k, 1e3 * warm.zero_n_per_k_sd, "mN")
        ));
    }
    if found.is_empty() {
        // The fit looks for a change from 2 K on.
        let seen = if warm.to_c - warm.from_c < 2.0 {
            "too small a range to show a change"
        } else {
            "the readings show no change with temperature"
        };
        format!("{at}; {seen}")
    } else {
        format!(
            "{at}; {}; the rig reads no temperature, and does not correct it",
            found.join(", ")
        )
    }
}

/// Conditions of the measurements.
fn conditions(out: &mut String, record: &Record, measured: &[(&UnitRecord, &GainRecord)]) {
    out.push_str("<h2>Conditions</h2>\n");
    let rows: Vec<Vec<String>> = (measured.iter())
        .map(|(unit, gain)| {
            let warm = gain.temperature.as_ref().map(temperature);
            vec![
                unit.number.to_string(),
                or_dash(&gain.loading),
                warm.map_or_else(|| "not recorded".to_owned(), |text| plain(&text)),
            ]
        })
        .collect();
    table(out, &["unit", "loading of the cell", "temperature"], &rows);
    if let Some(void) = checks::geometry_void(record) {
        let _ = writeln!(out, "<p>{}</p>", plain(&void));
    }
}

/// The figures of ISO 376, where its procedure was followed.
fn iso376(out: &mut String, measured: &[(&UnitRecord, &GainRecord)]) {
    let of = |unit: &UnitRecord, gain: &GainRecord| Some((unit.number, gain.iso376.clone()?));
    let found: Vec<(u8, Iso376Record)> = measured
        .iter()
        .filter_map(|(unit, gain)| of(unit, gain))
        .collect();
    if found.is_empty() {
        return;
    }
    out.push_str("<h2>Figures by ISO 376</h2>\n<p>Three preloads, two rising series in one position, a rising and a falling series in each of two further positions, creep from 30 to 300 s. b: reproducibility, b': repeatability, fc: interpolation, v: reversibility, f0: zero, c: creep; in percent of the force, f0 and c of the largest. U is of k = 2. A class holds where every figure is within its limits, for rising and falling forces; the limits of the class hold for the calibrating force too. The limits of v and the combination of U were not compared with the text of the standard. Only an accredited laboratory gives a class.</p>\n");
    let percent = |value: f64| format!("{:.4}", 100.0 * value);
    let rows: Vec<Vec<String>> = (found.iter())
        .map(|(unit, iso)| {
            let class = if iso.class.is_empty() {
                "none".to_owned()
            } else {
                format!(
                    "<b>{}</b> from {:.2} to {:.2} N",
                    iso.class, iso.from_n, iso.to_n
                )
            };
            vec![
                unit.to_string(),
                class,
                percent(iso.zero),
                iso.creep.map_or_else(|| "&ndash;".to_owned(), percent),
                format!("{:.2}", 1e3 * iso.resolution_n),
                iso.degree.to_string(),
                or_dash(&iso.in_the_way.join(", ")),
            ]
        })
        .collect();
    table(
        out,
        &[
            "unit",
            "class",
            "f0",
            "c",
            "resolution, mN",
            "degree of the interpolation",
            "beyond the next better class",
        ],
        &rows,
    );
    for (unit, iso) in &found {
        let rows: Vec<Vec<String>> = (iso.loads.iter())
            .map(|[force_n, parts @ ..]| {
                let mut row = vec![unit.to_string(), format!("{force_n:.4}")];
                row.extend(parts.map(percent));
                row
            })
            .collect();
        table(
            out,
            &[
                "unit",
                "force, N",
                "b",
                "b'",
                "fc",
                "v",
                "U of the calibrating force",
                "U",
            ],
            &rows,
        );
    }
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
                check.what(),
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
            "where",
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
        unit.geometry_date = "2026-02-20".to_owned();
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
            remounting_sd: 2e-4,
            pulley_sd: 0.0,
            repeatability_n: 9e-4,
            chi_square: 41.2,
            degrees_of_freedom: 29,
            linearity_n: -1.1e-3,
            hysteresis_n: 0.049,
            hysteresis_se_n: 2e-3,
            gravity_m_per_s2: 9.80926,
            operator: "R. <b>Hooke".to_owned(),
            note: String::new(),
            loading: "dismounted, axis upright".to_owned(),
            residuals: vec![[0.0, 0.4, 1.0], [9.8, -0.2, 1.1]],
            weights: WeightsRecord {
                tolerance: "OIML class M2".to_owned(),
                correlation: 1.0,
                certificate: "K-2026-117".to_owned(),
                serial: "4711".to_owned(),
            },
            temperature: Some(TemperatureRecord {
                from_c: 21.5,
                to_c: 24.0,
                scale_per_k: 2e-5,
                scale_per_k_sd: 1e-5,
                ..TemperatureRecord::default()
            }),
            iso376: Some(Iso376Record {
                class: "0.5".to_owned(),
                from_n: 0.98,
                to_n: 9.8,
                in_the_way: vec!["creep c".to_owned()],
                zero: -1e-4,
                creep: Some(4.1e-4),
                resolution_n: 1e-4,
                degree: 1,
                loads: vec![[9.8, 4.2e-4, 1.1e-4, -2.3e-5, 0.0, 1e-4, 5.6e-4]],
            }),
        });
        let check = Check {
            date: "2026-04-01".to_owned(),
            unit: Some(3),
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
            // 4, 9, 5, 6 and 20 e-5 together.
            "<td>0.0236</td>",
            "<b>0.5</b> from 0.98 to 9.80 N",
            "<td>0.0420</td><td>0.0110</td><td>-0.0023</td>",
            "<td>0.0410</td>",
            "creep c",
            "21.5 to 24.0 degrees Celsius; scale +0.0020 +- 0.0020 % per K; the rig reads no temperature",
            "dismounted for its gain after its geometry",
        ] {
            assert!(page.contains(text), "`{text}` is missing");
        }
        assert!(!page.contains("<?xml") && !page.contains("http://www.w3.org/1999/xlink"));
        let later = html(&record, "0004", &[], "2027-03-02");
        assert!(later.contains("2027-03-01 (over)") && later.contains("<p>none</p>"));
    }
}
