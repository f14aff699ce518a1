//! The report on the measured data of the thesis rig: `cargo xtask residual-report`.
//!
//! Runs every analysis and writes the figures into the marked blocks of a page
//! (`<!-- figures: NAME -->` to `<!-- end -->`), so that no figure in it is typed by hand, and the
//! plots into a folder beside it, named like the page. What the figures mean is the page's own text.

use residual::expr::Expr;
use residual::load::load;
use residual::rig::{self, Data};
use residual::spec::{Spec, Term};
use residual::{analyse, baseline, num, Baseline, Console, Error, Figures, Plot, Progress, Report};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[cfg(feature = "programs")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const USAGE: &str = "\
usage: rig-report [--data DIR] [--page PAGE.md]

  --data DIR      folder with the rig's data, else FORCE_DATA, ./data, ../shared/data
  --page PAGE.md  page whose marked blocks are filled (default docs/residual/rig.md)";

/// Turns of the reel in one turn of the motor.
const REEL_ORDER: f64 = 7.0 / 26.0;
/// Degrees per second at which the reel counts as turning, as in the models.
const STANDSTILL: f64 = 5.0;

fn main() -> ExitCode {
    let (mut data, mut page) = (None, PathBuf::from("docs/residual/rig.md"));
    let mut args = std::env::args_os().skip(1);
    while let Some(a) = args.next() {
        let value = args.next().map(PathBuf::from);
        match (a.to_str(), value) {
            (Some("--data"), Some(v)) => data = Some(v),
            (Some("--page"), Some(v)) => page = v,
            _ => {
                eprintln!("{USAGE}");
                return ExitCode::from(2);
            }
        }
    }
    match Data::locate(data).and_then(|d| write(&d, &page)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(e.exit_code())
        }
    }
}

/// Blocks of the page by name, and pictures by file name.
#[derive(Default)]
struct Page {
    blocks: BTreeMap<&'static str, String>,
    plots: BTreeMap<&'static str, String>,
}

fn write(data: &Data, page: &Path) -> Result<(), Error> {
    let io = |path: &Path| {
        let path = path.to_path_buf();
        move |e: std::io::Error| Error::Io {
            path,
            why: e.to_string(),
        }
    };
    let text = std::fs::read_to_string(page).map_err(io(page))?;
    let mut out = Page::default();
    let console = &mut Console::default();
    let moving = moving_rows(data, &mut out, console)?;
    all_rows(data, &mut out, console)?;
    compensated(data, &moving, &mut out, console)?;
    closed_loop(data, &mut out, console)?;
    let text = fill(&text, &out.blocks).map_err(|why| Error::Io {
        path: page.to_path_buf(),
        why,
    })?;
    let folder = page.with_extension("");
    std::fs::create_dir_all(&folder).map_err(io(&folder))?;
    for (name, svg) in &out.plots {
        let path = folder.join(name);
        std::fs::write(&path, svg).map_err(io(&path))?;
    }
    std::fs::write(page, text).map_err(io(page))?;
    println!(
        "{}: {} blocks, {} plots",
        page.display(),
        out.blocks.len(),
        out.plots.len()
    );
    Ok(())
}

/// Puts every block at its mark; a mark without block or a block without mark is an error.
fn fill(text: &str, blocks: &BTreeMap<&'static str, String>) -> Result<String, String> {
    const OPEN: &str = "<!-- figures: ";
    const CLOSE: &str = "<!-- end -->";
    let mut out = String::new();
    let mut rest = text;
    let mut used = Vec::new();
    while let Some(at) = rest.find(OPEN) {
        let (head, tail) = rest.split_at(at + OPEN.len());
        let (name, tail) = tail
            .split_once(" -->")
            .ok_or("a mark `<!-- figures: NAME -->` is not closed")?;
        let end = tail
            .find(CLOSE)
            .ok_or(format!("block `{name}` has no `{CLOSE}`"))?;
        let block = blocks.get(name).ok_or(format!(
            "no block `{name}`; there are {}",
            blocks.keys().copied().collect::<Vec<_>>().join(", ")
        ))?;
        out.push_str(&format!("{head}{name} -->\n\n{}\n\n", block.trim_end()));
        used.push(name);
        rest = &tail[end..];
    }
    match blocks.keys().find(|b| !used.contains(b)) {
        Some(missing) => Err(format!("the page has no mark `{OPEN}{missing} -->`")),
        None => Ok(out + rest),
    }
}

/// A Markdown table.
fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let mut t = format!("| {} |\n|{}\n", head.join(" | "), "---|".repeat(head.len()));
    for r in rows {
        t.push_str(&format!("| {} |\n", r.join(" | ")));
    }
    t
}

fn with_interval(f: &Figures) -> String {
    let [lo, hi] = f.heldout_rmse_ci;
    format!("{} ({} to {})", num(f.heldout_rmse), num(lo), num(hi))
}

fn percent(x: f64) -> String {
    format!("{:.2} %", 100.0 * x)
}

/// A fitted term.
fn term(expr: &str) -> Term {
    Term {
        name: expr.into(),
        expr: expr.into(),
        unit: String::new(),
        fixed: None,
        per: String::new(),
        effect: String::new(),
        fitted: None,
    }
}

/// The model with more fitted terms declared.
fn declaring(spec: &Spec, terms: &[&str]) -> Spec {
    let mut spec = spec.clone();
    spec.terms.extend(terms.iter().map(|t| term(t)));
    spec
}

const COULOMB: &str = "sgn(velocity, 5)";
const SHARE: &str = "sgn(velocity, 5) * abs(command / 0.010)";

/// Effects in the order of the report, each on top of the ones before.
fn steps(r: &Report) -> Vec<Vec<String>> {
    std::iter::once(vec!["declared".to_string(), with_interval(&r.baseline)])
        .chain(r.effects.iter().enumerate().map(|(i, e)| {
            let last = i + 1 == r.effects.len();
            let name = format!(
                "{} `{}` ({})",
                if i == 0 { "with" } else { "and" },
                e.name,
                e.form
            );
            let value = if last {
                with_interval(&r.last)
            } else {
                num(e.heldout_after)
            };
            vec![name, value]
        }))
        .collect()
}

fn parameters(r: &Report) -> String {
    let mut rows = Vec::new();
    for e in &r.effects {
        for (name, value) in &e.params {
            let ci =
                e.ci.get(name)
                    .map_or("-".into(), |c| format!("{} to {}", num(c[0]), num(c[1])));
            let unit = e.units.get(name).cloned().unwrap_or_default();
            rows.push(vec![
                e.name.to_string(),
                name.clone(),
                num(*value),
                ci,
                unit,
            ]);
        }
    }
    let mut out = table(
        &["effect", "parameter", "value", "95 % interval", "unit"],
        &rows,
    );
    let rivals: Vec<Vec<String>> = r
        .effects
        .iter()
        .filter_map(|e| {
            let x = e.rival.as_ref()?;
            Some(vec![
                e.name.to_string(),
                x.name.to_string(),
                num(x.heldout_rmse),
                percent(x.behind),
            ])
        })
        .collect();
    if !rivals.is_empty() {
        out.push('\n');
        out.push_str(&table(
            &[
                "effect",
                "nearest rival in its place",
                "held-out RMSE with the rival, N",
                "behind",
            ],
            &rivals,
        ));
    }
    out
}

/// What the analysis itself says of the rest: the verdict, what is not material, nameless structure.
fn rest(r: &Report) -> String {
    let mut out = format!("Verdict: `{}`. {}\n", r.verdict.word(), r.summary());
    let mut rows: Vec<Vec<String>> = r
        .seen_not_material
        .iter()
        .map(|s| vec![format!("`{}`", s.name), s.form.clone(), percent(s.gain)])
        .collect();
    rows.extend(
        r.structure
            .iter()
            .map(|s| vec!["no name".into(), s.depends_on.clone(), percent(s.gain)]),
    );
    if !rows.is_empty() {
        out.push('\n');
        out.push_str(&table(
            &[
                "seen on top of that",
                "form",
                "further fall of held-out RMSE",
            ],
            &rows,
        ));
    }
    for a in &r.not_identifiable {
        out.push_str(&format!(
            "\nNot told apart: {}.\n",
            a.effects
                .iter()
                .map(|e| e.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        ));
    }
    out
}

fn rmse(v: impl Iterator<Item = f64>) -> f64 {
    let (n, s) = v.fold((0usize, 0.0), |(n, s), x| (n + 1, s + x * x));
    (s / n.max(1) as f64).sqrt()
}

/// Values of an expression on the fitted rows of a baseline.
fn values(loaded: &residual::Data, b: &Baseline, expr: &str) -> Result<Vec<f64>, Error> {
    let v = Expr::parse(expr)?.eval(loaded.frame())?;
    Ok(b.rows.iter().map(|i| v[*i]).collect())
}

/// Held-out RMSE of each fold, before and after.
fn by_fold(loaded: &residual::Data, before: &Baseline, after: &Baseline) -> String {
    let rows: Vec<Vec<String>> = loaded
        .folds()
        .iter()
        .enumerate()
        .map(|(f, name)| {
            let of = |b: &Baseline| {
                num(rmse(
                    b.rows
                        .iter()
                        .zip(&b.held)
                        .filter(|(i, _)| loaded.fold()[**i] as usize == f)
                        .map(|(_, r)| *r),
                ))
            };
            vec![name.clone(), of(before), of(after)]
        })
        .collect();
    table(
        &["held out", "declared, N", "with what was found, N"],
        &rows,
    )
}

fn moving_rows(data: &Data, out: &mut Page, console: &mut Console) -> Result<Report, Error> {
    console.stage("== gauge records, moving rows");
    let spec = data.gauge_model(rig::GAUGE_MOVING, "comp == 0")?;
    let loaded = load(&folder(&data.gauge), &spec)?;
    let report = analyse(&spec, loaded.clone(), console)?;
    let declared = baseline(&spec, &loaded)?;
    let fit = |terms: &[&str]| baseline(&declaring(&spec, terms), &loaded);
    let found = baseline(&report.extended, &loaded)?;

    let mut rows = steps(&report);
    for (name, terms) in [
        ("rival: plain Coulomb friction alone", &[COULOMB][..]),
        ("rival: plain Coulomb friction and offset", &[COULOMB, "1"]),
    ] {
        rows.push(vec![name.into(), with_interval(&fit(terms)?.figures)]);
    }
    out.blocks.insert(
        "moving",
        format!(
            "{} uncompensated records, {} rows in motion.\n\n{}\n{}\n{}",
            report.sequences,
            report.rows,
            table(&["model", "held-out RMSE, N (95 %)"], &rows),
            parameters(&report),
            by_fold(&loaded, &declared, &found)
        ),
    );

    // What was asked about by name, each added to the final model as declared terms. The Stribeck
    // speed is given, so nothing here pays for a search.
    let base = &[COULOMB, SHARE, "1"][..];
    let full = fit(base)?.figures.heldout_rmse;
    let mut asked = Vec::new();
    let mut ask = |name: String, over: &[&str], more: &[String]| -> Result<f64, Error> {
        let before = fit(over)?.figures.heldout_rmse;
        let terms: Vec<&str> = over
            .iter()
            .copied()
            .chain(more.iter().map(String::as_str))
            .collect();
        let after = fit(&terms)?.figures.heldout_rmse;
        asked.push(vec![
            name,
            num(before),
            num(after),
            percent(1.0 - after / before),
        ]);
        Ok(after)
    };
    ask("viscous".into(), base, &["velocity".into()])?;
    let stribeck = |v: f64| vec![format!("{COULOMB} * exp(-(velocity / {v})^2)")];
    for v in [100.0, 300.0, 1500.0] {
        ask(format!("Stribeck at {v} deg/s"), base, &stribeck(v))?;
    }
    let viscous = &[COULOMB, SHARE, "1", "velocity"][..];
    ask(
        "Stribeck at 1500 deg/s, on top of viscous".into(),
        viscous,
        &stribeck(1500.0),
    )?;
    let ripple = |scale: &str| -> Vec<String> {
        ["sin", "cos"]
            .map(|f| {
                format!(
                    "{scale}{f}(integ(velocity) * {})",
                    REEL_ORDER.to_string() + " * pi / 180"
                )
            })
            .to_vec()
    };
    ask("ripple once per turn of the reel".into(), base, &ripple(""))?;
    ask(
        "the same, in proportion to load".into(),
        base,
        &ripple("command * "),
    )?;
    let found_stribeck = report
        .tested
        .iter()
        .find(|t| t.name == "stribeck")
        .map_or(String::new(), |t| {
            let at = t.params.values().next().copied().unwrap_or(0.0);
            format!(
                "\nThe search itself, which chooses the Stribeck speed on the training units alone ({} deg/s on all of them), credits it with {}.\n",
                num(at),
                percent(t.gain)
            )
        });
    // What friction does with speed, from the final model's residual.
    let speed = values(&loaded, &found, "abs(velocity)")?;
    let sign = values(&loaded, &found, COULOMB)?;
    let total: f64 = found.held.iter().map(|r| r * r).sum();
    let bands: Vec<Vec<String>> = [5.0, 100.0, 200.0, 400.0, 800.0, 1500.0, f64::INFINITY]
        .windows(2)
        .map(|w| {
            let rows: Vec<usize> = (0..speed.len())
                .filter(|i| speed[*i] > w[0] && speed[*i] <= w[1])
                .collect();
            let mean = rows.iter().map(|i| found.held[*i] * sign[*i]).sum::<f64>()
                / rows.len().max(1) as f64;
            let share = rows.iter().map(|i| found.held[*i].powi(2)).sum::<f64>() / total;
            let top = if w[1].is_finite() {
                format!("{} to {}", w[0], w[1])
            } else {
                format!("above {}", w[0])
            };
            vec![top, rows.len().to_string(), num(mean), percent(share)]
        })
        .collect();
    out.blocks.insert(
        "not-material",
        format!(
            "{}{found_stribeck}\n{}",
            table(
                &[
                    "on top of the final model",
                    "before, N",
                    "after, N",
                    "fall of held-out RMSE"
                ],
                &asked
            ),
            table(
                &[
                    "speed, deg/s",
                    "rows",
                    "mean residual along the motion, N",
                    "share of the squared error"
                ],
                &bands
            )
        ),
    );
    debug_assert!((full - report.last.heldout_rmse).abs() < 1e-3);
    out.blocks.insert("moving-rest", rest(&report));

    let before = &declared.held;
    out.plots.insert(
        "moving-velocity.svg",
        Plot::new(
            "motor speed, deg/s",
            &values(&loaded, &declared, "velocity")?,
            before,
            &found.held,
        )
        .named("residual", "declared model", "with what was found")
        .svg("N"),
    );
    // Along the motion friction has one sign, so its growth with load is a slope.
    let along = |r: &[f64]| {
        r.iter()
            .zip(&sign)
            .map(|(r, s)| r * s)
            .collect::<Vec<f64>>()
    };
    out.plots.insert(
        "moving-load.svg",
        Plot::new(
            "declared load, N",
            &values(&loaded, &declared, "command / 0.010")?,
            &along(before),
            &along(&found.held),
        )
        .named(
            "residual times sign of speed",
            "declared model",
            "with what was found",
        )
        .svg("N"),
    );
    Ok(report)
}

fn all_rows(data: &Data, out: &mut Page, console: &mut Console) -> Result<(), Error> {
    console.stage("== gauge records, all rows");
    let spec = data.gauge_model(rig::GAUGE_ALL, "comp == 0")?;
    let loaded = load(&folder(&data.gauge), &spec)?;
    let report = analyse(&spec, loaded.clone(), console)?;
    let declared = baseline(&spec, &loaded)?;
    let same = baseline(&declaring(&spec, &[COULOMB, SHARE, "1"]), &loaded)?;
    let found = baseline(&report.extended, &loaded)?;
    let mut rows = steps(&report);
    rows.push(vec![
        "for comparison: the terms of the moving rows, fitted here".into(),
        with_interval(&same.figures),
    ]);
    let velocity = values(&loaded, &declared, "velocity")?;
    let held = values(&loaded, &declared, "held(velocity, 5)")?;
    type Part = fn(f64, f64) -> bool;
    let parts: [(&str, Part); 3] = [
        ("in motion", |v, _| v.abs() > STANDSTILL),
        ("at rest after a motion", |v, h| {
            v.abs() <= STANDSTILL && h != 0.0
        }),
        ("before the first motion", |v, h| {
            v.abs() <= STANDSTILL && h == 0.0
        }),
    ];
    let split: Vec<Vec<String>> = parts
        .iter()
        .map(|(name, is)| {
            let of = |b: &Baseline| {
                num(rmse(
                    (0..velocity.len())
                        .filter(|i| is(velocity[*i], held[*i]))
                        .map(|i| b.held[i]),
                ))
            };
            let n = (0..velocity.len())
                .filter(|i| is(velocity[*i], held[*i]))
                .count();
            vec![
                name.to_string(),
                n.to_string(),
                of(&declared),
                of(&same),
                of(&found),
            ]
        })
        .collect();
    out.blocks.insert(
        "all",
        format!(
            "{} records, {} rows; none was filtered.\n\n{}\n{}\n{}\n{}",
            report.sequences,
            report.rows,
            table(&["model", "held-out RMSE, N (95 %)"], &rows),
            table(
                &[
                    "rows",
                    "count",
                    "declared, N",
                    "terms of the moving rows, N",
                    "with what was found, N"
                ],
                &split
            ),
            parameters(&report),
            rest(&report)
        ),
    );
    // Rows at rest only: what the friction held does there.
    let rest_rows: Vec<usize> = (0..velocity.len())
        .filter(|i| velocity[*i].abs() <= STANDSTILL && held[*i] != 0.0)
        .collect();
    let load_n = values(&loaded, &declared, "command / 0.010")?;
    let pick = |v: &[f64]| rest_rows.iter().map(|i| v[*i]).collect::<Vec<f64>>();
    let x: Vec<f64> = rest_rows.iter().map(|i| held[*i] * load_n[*i]).collect();
    out.plots.insert(
        "rest.svg",
        Plot::new(
            "declared load times direction held, N",
            &x,
            &pick(&same.held),
            &pick(&found.held),
        )
        .named("residual", "terms of moving rows", "with what was found")
        .svg("N"),
    );
    Ok(())
}

fn compensated(
    data: &Data,
    moving: &Report,
    out: &mut Page,
    console: &mut Console,
) -> Result<(), Error> {
    console.stage("== compensated records, model of the moving rows frozen");
    let mut frozen = Spec::parse(&moving.frozen()?)?;
    let model = data.gauge_model(rig::GAUGE_MOVING, "comp > 0")?;
    frozen.title = "Compensated records, frozen model".into();
    frozen.rows = model.rows.clone();
    let loaded = load(&folder(&data.gauge), &frozen)?;
    let declared = baseline(&model, &loaded)?;
    let test = baseline(&frozen, &loaded)?;
    let report = analyse(&frozen, loaded.clone(), console)?;
    let mut rows = vec![
        vec![
            "force = command / 0.010 m".into(),
            with_interval(&declared.figures),
        ],
        vec![
            "frozen model of the uncompensated records, nothing fitted".into(),
            with_interval(&test.figures),
        ],
    ];
    rows.extend(steps(&report).into_iter().skip(1));
    out.blocks.insert(
        "compensated",
        format!(
            "{} records, {} rows in motion, none of them in the fit.\n\n{}\n{}\n{}\n{}",
            report.sequences,
            report.rows,
            table(&["model", "RMSE, N (95 %)"], &rows),
            by_fold(&loaded, &declared, &test).replace("with what was found", "frozen model"),
            parameters(&report),
            rest(&report)
        ),
    );
    out.plots.insert(
        "compensated.svg",
        Plot::new(
            "motor speed, deg/s",
            &values(&loaded, &test, "velocity")?,
            &declared.held,
            &test.held,
        )
        .named("residual", "declared model", "frozen model")
        .svg("N"),
    );
    Ok(())
}

fn closed_loop(data: &Data, out: &mut Page, console: &mut Console) -> Result<(), Error> {
    if data.closed.is_empty() {
        out.blocks
            .insert("closed", "No closed-loop runs in the data given.".into());
        return Ok(());
    }
    console.stage("== closed-loop runs");
    let spec = Spec::parse(rig::CLOSED_LOOP)?;
    let loaded = load(&data.closed, &spec)?;
    let report = analyse(&spec, loaded.clone(), console)?;
    let declared = baseline(&spec, &loaded)?;
    let found = baseline(&report.extended, &loaded)?;
    let mean_load = values(&loaded, &declared, "command")?;
    let mean_load = mean_load.iter().sum::<f64>() / mean_load.len().max(1) as f64;
    let hygiene: Vec<Vec<String>> = report
        .hygiene
        .iter()
        .filter(|f| !f.check.starts_with("quantised"))
        .map(|f| vec![f.check.clone(), f.count.to_string(), f.what.clone()])
        .collect();
    out.blocks.insert(
        "closed",
        format!(
            "{} runs, {} records of one unit, {} rows; {} groups in {} folds. Mean declared load {} N.\n\n{}\n{}\n{}\n{}",
            report.files.len(),
            report.sequences,
            report.rows,
            report.groups,
            report.folds.len(),
            num(mean_load),
            table(&["model", "held-out RMSE, N (95 %)"], &steps(&report)),
            parameters(&report),
            rest(&report),
            table(&["hygiene", "count", "what"], &hygiene)
        ),
    );
    out.plots.insert(
        "closed-loop.svg",
        Plot::new(
            "declared load (command), N",
            &values(&loaded, &declared, "command")?,
            &declared.held,
            &found.held,
        )
        .named("residual", "declared model", "with stand-ins")
        .svg("N"),
    );
    Ok(())
}

fn folder(path: &Option<PathBuf>) -> Vec<PathBuf> {
    path.iter().cloned().collect()
}
