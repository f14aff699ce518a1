//! From TOML text to a checked [`RigFile`]: every value by hand, so that each message can name the line.

use super::{
    AllocationSettings, ControllerSettings, Filter, PoseChoice, Problem, Reference, RigFile,
    RippleSettings, UnitSettings, Workspace, SCHEMA,
};
use nalgebra::Vector3;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ops::{Range, RangeInclusive};
use toml::de::{DeTable, DeValue};
use toml::Spanned;
use wire::UNITS;

/// Text and the problems found so far.
struct Context<'t> {
    text: &'t str,
    problems: RefCell<Vec<Problem>>,
}

impl Context<'_> {
    fn line_of(&self, offset: usize) -> usize {
        let end = offset.min(self.text.len());
        1 + self.text.as_bytes()[..end]
            .iter()
            .filter(|byte| **byte == b'\n')
            .count()
    }

    fn report(&self, offset: usize, unit: Option<u8>, key: &str, message: impl Into<String>) {
        self.problems.borrow_mut().push(Problem {
            line: self.line_of(offset),
            unit,
            key: key.to_owned(),
            message: message.into(),
        });
    }
}

/// Where a value stands and what it is; a stand-in where it was wrong and reported.
#[derive(Clone, Copy)]
struct Found<T> {
    value: T,
    at: usize,
    /// Whether the value is the file's own.
    good: bool,
}

/// A table being read. Keys that nobody asked for are unknown.
struct Section<'c, 't> {
    context: &'c Context<'t>,
    name: String,
    unit: Option<u8>,
    at: usize,
    table: Option<&'c DeTable<'t>>,
    fallback: Option<&'c DeTable<'t>>,
    asked: RefCell<BTreeSet<String>>,
}

type Value<'c, 't> = (&'c DeValue<'t>, Range<usize>);

fn look_up<'c, 't>(table: &'c DeTable<'t>, key: &str) -> Option<Value<'c, 't>> {
    table
        .iter()
        .find(|(name, _)| name.get_ref() == key)
        .map(|(_, value)| (value.get_ref(), value.span()))
}

impl<'c, 't> Section<'c, 't> {
    fn report(&self, at: usize, key: &str, message: impl Into<String>) {
        self.context.report(at, self.unit, key, message);
    }

    fn get(&self, key: &str) -> Option<Value<'c, 't>> {
        self.asked.borrow_mut().insert(key.to_owned());
        self.table
            .and_then(|table| look_up(table, key))
            .or_else(|| self.fallback.and_then(|table| look_up(table, key)))
    }

    fn missing(&self, key: &str, example: &str) {
        let place = if self.fallback.is_some() {
            format!("to this [[{}]] or to [defaults]", self.name)
        } else if self.name.is_empty() {
            "at the top of the file".to_owned()
        } else {
            format!("to [{}]", self.name)
        };
        self.report(
            self.at,
            key,
            format!("is missing; add `{key} = {example}` {place}"),
        );
    }

    /// A number within a range, both ends included.
    fn number(&self, key: &str, range: RangeInclusive<f64>, example: &str) -> Found<f64> {
        let bad = |at| Found {
            value: *range.start(),
            at,
            good: false,
        };
        let Some((value, span)) = self.get(key) else {
            self.missing(key, example);
            return bad(self.at);
        };
        let Some(number) = as_number(value) else {
            self.report(
                span.start,
                key,
                format!(
                    "is {}, a number is needed, as in `{key} = {example}`",
                    value.type_str()
                ),
            );
            return bad(span.start);
        };
        if !number.is_finite() {
            self.report(
                span.start,
                key,
                format!("is {number}; a finite number is needed, as in `{key} = {example}`"),
            );
            return bad(span.start);
        }
        if !range.contains(&number) {
            self.report(
                span.start,
                key,
                format!(
                    "is {number}, allowed is {} to {}; check value and unit (as in `{key} = {example}`)",
                    range.start(),
                    range.end()
                ),
            );
            return bad(span.start);
        }
        Found {
            value: number,
            at: span.start,
            good: true,
        }
    }

    /// A number within a range, or `default` where the key is not there.
    fn optional(&self, key: &str, range: RangeInclusive<f64>, default: f64) -> Found<f64> {
        if self.get(key).is_some() {
            let example = format!("{}", range.end());
            return self.number(key, range, &example);
        }
        Found {
            value: default,
            at: self.at,
            good: true,
        }
    }

    fn flag(&self, key: &str, default: Option<bool>) -> bool {
        match (self.get(key), default) {
            (None, Some(default)) => default,
            (None, None) => {
                self.missing(key, "true");
                false
            }
            (Some((value, span)), _) => value.as_bool().unwrap_or_else(|| {
                self.report(
                    span.start,
                    key,
                    format!("is {}, write true or false", value.type_str()),
                );
                false
            }),
        }
    }

    fn text(&self, key: &str, example: &str) -> Found<String> {
        let bad = |at| Found {
            value: String::new(),
            at,
            good: false,
        };
        match self.get(key) {
            None => {
                self.missing(key, &format!("\"{example}\""));
                bad(self.at)
            }
            Some((value, span)) => match value.as_str() {
                Some(text) => Found {
                    value: text.to_owned(),
                    at: span.start,
                    good: true,
                },
                None => {
                    self.report(
                        span.start,
                        key,
                        format!(
                            "is {}, write text in quotes, as in \"{example}\"",
                            value.type_str()
                        ),
                    );
                    bad(span.start)
                }
            },
        }
    }

    /// Three finite numbers.
    fn vector(&self, key: &str, largest: f64, example: &str) -> Found<Vector3<f64>> {
        let Some((value, span)) = self.get(key) else {
            self.missing(key, example);
            return Found {
                value: Vector3::zeros(),
                at: self.at,
                good: false,
            };
        };
        let at = span.start;
        let numbers: Option<Vec<f64>> = value
            .as_array()
            .and_then(|array| array.iter().map(|v| as_number(v.get_ref())).collect());
        let mut found = Found {
            value: Vector3::zeros(),
            at,
            good: false,
        };
        match numbers.as_deref() {
            Some(&[x, y, z]) => {
                if [x, y, z]
                    .iter()
                    .all(|v| v.is_finite() && v.abs() <= largest)
                {
                    found.value = Vector3::new(x, y, z);
                    found.good = true;
                } else {
                    self.report(
                        at,
                        key,
                        format!("is [{x}, {y}, {z}]; each has to be finite and within +-{largest}; check the unit"),
                    );
                }
            }
            Some(other) => {
                self.report(
                    at,
                    key,
                    format!(
                        "has {} numbers, three are needed, as in `{key} = {example}`",
                        other.len()
                    ),
                );
            }
            None => self.report(
                at,
                key,
                format!("has to be three numbers, as in `{key} = {example}`"),
            ),
        }
        found
    }

    /// A section inside this one.
    fn section(&self, key: &str) -> Section<'c, 't> {
        let (table, at) = match self.get(key) {
            None => {
                self.report(self.at, key, format!("is missing; add a [{key}] section (the built-in rig file shows all keys: `forcectl check --print`)"));
                (None, self.at)
            }
            Some((value, span)) => match value.as_table() {
                Some(table) => (Some(table), span.start),
                None => {
                    self.report(
                        span.start,
                        key,
                        format!("is {}, a [{key}] section is needed", value.type_str()),
                    );
                    (None, span.start)
                }
            },
        };
        Section {
            context: self.context,
            name: key.to_owned(),
            unit: None,
            at,
            table,
            fallback: None,
            asked: RefCell::default(),
        }
    }

    /// Reports keys that nobody asked for.
    fn finish(&self) {
        let asked = self.asked.borrow();
        for (name, _) in self.table.into_iter().flat_map(|table| table.iter()) {
            let key = name.get_ref();
            if !asked.contains(key.as_ref()) {
                let near = asked
                    .iter()
                    .map(|known| (distance(known, key), known))
                    .min()
                    .filter(|(d, _)| *d <= 3);
                let hint = match near {
                    Some((_, known)) => format!("did you mean `{known}`?"),
                    None => format!(
                        "known here: {}",
                        asked.iter().cloned().collect::<Vec<_>>().join(", ")
                    ),
                };
                self.report(name.span().start, key, format!("unknown key; {hint}"));
            }
        }
    }
}

fn as_number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(n) if n.radix() == 10 => n.as_str().parse().ok(),
        DeValue::Float(x) => x.as_str().parse().ok(),
        _ => None,
    }
}

/// Edit distance of two keys.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

/// Parses and checks.
pub(super) fn parse(text: &str) -> Result<RigFile, Vec<Problem>> {
    let context = Context {
        text,
        problems: RefCell::default(),
    };
    let table = match DeTable::parse(text) {
        Ok(table) => table,
        Err(error) => {
            let at = error.span().map_or(0, |span| span.start);
            context.report(at, None, "", format!("not TOML: {}", error.message()));
            return Err(context.problems.into_inner());
        }
    };
    let rig = read_root(&context, &table);
    let mut problems = context.problems.into_inner();
    if problems.is_empty() {
        return Ok(rig);
    }
    problems.sort_by_key(|problem| problem.line);
    Err(problems)
}

fn read_root<'c, 't>(context: &'c Context<'t>, table: &'c Spanned<DeTable<'t>>) -> RigFile {
    let root = Section {
        context,
        name: String::new(),
        unit: None,
        at: 0,
        table: Some(table.get_ref()),
        fallback: None,
        asked: RefCell::default(),
    };
    let schema = root.number("schema", 0.0..=1e6, "1");
    if schema.good && schema.value != SCHEMA as f64 {
        root.report(
            schema.at,
            "schema",
            format!("is {}, this forcectl reads schema {SCHEMA}; use a forcectl of that time or bring the file up to date", schema.value),
        );
    }
    let name = root.text("name", "my-rig").value;
    let link = read_link(&root);
    let pose = read_pose(&root);
    let workspace = read_workspace(&root);
    let controller = read_controller(&root);
    let allocation = read_allocation(&root);
    let units = read_units(&root, workspace);
    root.finish();
    RigFile {
        name,
        link,
        pose,
        workspace,
        controller,
        allocation,
        units,
    }
}

fn read_link(root: &Section<'_, '_>) -> super::LinkChoice {
    let section = root.section("link");
    let rig = section.text("rig", "embedded");
    let link = rig.value.parse().unwrap_or_else(|message: String| {
        if rig.good {
            section.report(rig.at, "rig", message);
        }
        super::LinkChoice::Embedded
    });
    section.finish();
    link
}

fn read_pose(root: &Section<'_, '_>) -> PoseChoice {
    let section = root.section("pose");
    let source = section.text("source", "rig");
    let pose = match source.value.as_str() {
        "rig" => PoseChoice::Rig,
        "udp" => {
            let listen = section.text("listen", "127.0.0.1:4711");
            if listen.good && listen.value.parse::<std::net::SocketAddr>().is_err() {
                section.report(
                    listen.at,
                    "listen",
                    format!(
                        "`{}` is not an address with a port, for example \"127.0.0.1:4711\"",
                        listen.value
                    ),
                );
            }
            PoseChoice::Udp {
                listen: listen.value,
                max_age_s: section.number("max_age_s", 0.005..=1.0, "0.1").value,
            }
        }
        "static" => PoseChoice::Static {
            position_m: section.vector("position_m", 10.0, "[0.0, 0.0, 0.0]").value,
        },
        other => {
            if source.good {
                section.report(
                    source.at,
                    "source",
                    format!("`{other}` is not a pose source; use \"rig\", \"udp\" or \"static\""),
                );
            }
            PoseChoice::Rig
        }
    };
    section.finish();
    pose
}

fn read_workspace(root: &Section<'_, '_>) -> Workspace {
    let section = root.section("workspace");
    let workspace = Workspace {
        center_m: section
            .vector("center_m", 10.0, "[-0.08, 0.025, -0.14]")
            .value,
        radius_m: section.number("radius_m", 1e-3..=1.0, "0.10").value,
    };
    section.finish();
    workspace
}

fn read_controller(root: &Section<'_, '_>) -> ControllerSettings {
    let section = root.section("controller");
    let controller = ControllerSettings {
        kp: section.number("kp", 0.0..=10.0, "0.2").value,
        ki_per_s: section.number("ki_per_s", 0.0..=100.0, "2.0").value,
        integral_limit_n: section.number("integral_limit_n", 0.0..=20.0, "1.5").value,
        slew_n_per_s: section.number("slew_n_per_s", 0.1..=1000.0, "20.0").value,
        force_limit_n: section.number("force_limit_n", 0.1..=60.0, "12.0").value,
    };
    section.finish();
    controller
}

fn read_allocation(root: &Section<'_, '_>) -> AllocationSettings {
    let section = root.section("allocation");
    let reference = section.text("reference", "lower");
    let allocation = AllocationSettings {
        reference: match reference.value.as_str() {
            "lower" => Reference::Lower,
            "middle" => Reference::Middle,
            other => {
                if reference.good {
                    section.report(
                        reference.at,
                        "reference",
                        format!("`{other}` is not a policy; use \"lower\" (kind to robot and motors) or \"middle\" (far from slack)"),
                    );
                }
                Reference::Lower
            }
        },
        tie_break: section.number("tie_break", 1e-6..=1.0, "1e-4").value,
    };
    section.finish();
    allocation
}

fn read_units(root: &Section<'_, '_>, workspace: Workspace) -> [UnitSettings; UNITS] {
    let defaults = root.section("defaults");
    let mut units: [Option<UnitSettings>; UNITS] = [None; UNITS];
    let mut asked = BTreeSet::new();
    let mut last = root.at;
    let entries = match root.get("unit") {
        None => &[][..],
        Some((value, span)) => match value.as_array() {
            Some(array) => array,
            None => {
                root.report(
                    span.start,
                    "unit",
                    "has to be a list: begin each unit with [[unit]]",
                );
                &[][..]
            }
        },
    };
    for entry in entries {
        let at = entry.span().start;
        last = at;
        let Some(table) = entry.get_ref().as_table() else {
            root.report(
                at,
                "unit",
                "has to be a list of tables: begin each unit with [[unit]]",
            );
            continue;
        };
        let mut section = Section {
            context: root.context,
            name: "unit".to_owned(),
            unit: None,
            at,
            table: Some(table),
            fallback: defaults.table,
            asked: RefCell::default(),
        };
        let number = section.number("number", 1.0..=UNITS as f64, "1");
        if !number.good {
            continue;
        }
        if number.value.fract() != 0.0 {
            section.report(
                number.at,
                "number",
                format!("is {}, a whole number is needed", number.value),
            );
            continue;
        }
        let index = number.value as usize - 1;
        section.unit = Some(number.value as u8);
        let unit = read_unit(&section, workspace);
        section.finish();
        asked.append(&mut section.asked.borrow_mut());
        match units.get_mut(index) {
            Some(slot @ None) => *slot = Some(unit),
            _ => section.report(
                number.at,
                "number",
                "is used twice; number the units 1 to 6, each once",
            ),
        }
    }
    // [defaults] knows the keys of a unit but for those that are its own.
    for own in ["number", "exit_m", "axis"] {
        asked.remove(own);
    }
    if !entries.is_empty() {
        *defaults.asked.borrow_mut() = asked;
        defaults.finish();
    }
    core::array::from_fn(|i| {
        units[i].unwrap_or_else(|| {
            let number = i as u8 + 1;
            root.context.report(
                last,
                Some(number),
                "",
                format!("is missing; add a [[unit]] with `number = {number}` (and `enabled = false` where the unit isn't there)"),
            );
            stand_in(number)
        })
    })
}

/// Fills the place of a unit that was reported missing; never leaves this module.
fn stand_in(number: u8) -> UnitSettings {
    UnitSettings {
        number,
        enabled: false,
        exit_m: Vector3::zeros(),
        axis: Vector3::x(),
        scale_n_per_count: 0.0,
        tension_min_n: 0.0,
        tension_max_n: 0.0,
        filter: Filter::MovingAverage(1),
        spike_limit_n: 0.0,
        kp: 0.0,
        ki_per_s: 0.0,
        kd_s: 0.0,
        damping_n_s_per_m: 0.0,
        friction_feedforward: false,
        friction_offset_n: 0.0,
        friction_gain: 0.0,
        coulomb_n: 0.0,
        coulomb_per_n: 0.0,
        reversal_m: 0.0,
        travel_m_per_count: 0.0,
        dac_codes_per_n: 0.0,
        force_limit_n: 0.0,
        slew_n_per_s: 0.0,
        over_tension_n: 0.0,
        viscous_n_s_per_m: 0.0,
        ripples: Default::default(),
    }
}

/// Ripple `n` (from 0): keys `ripple_...` and `ripple2_...`. Without an amplitude there is none.
fn read_ripple(section: &Section<'_, '_>, n: usize) -> RippleSettings {
    let prefix = ["ripple", "ripple2"][n.min(1)];
    let amplitude_key = format!("{prefix}_amplitude_n");
    let amplitude = section.optional(&amplitude_key, 0.0..=3.0, 0.0);
    let per_n = section.optional(&format!("{prefix}_amplitude_per_n"), 0.0..=0.2, 0.0);
    let period_key = format!("{prefix}_period_m");
    let period = section.optional(&period_key, 5e-4..=1.0, 0.0);
    let ripple = RippleSettings {
        period_m: period.value,
        amplitude_n: amplitude.value,
        amplitude_per_n: per_n.value,
        phase_rad: section
            .optional(&format!("{prefix}_phase_rad"), -1e3..=1e3, 0.0)
            .value,
    };
    if !ripple.is_none() && period.good && ripple.period_m == 0.0 {
        section.report(
            amplitude.at,
            &period_key,
            format!("is missing beside {prefix}'s amplitude; add the cable travel of a period, as in `{period_key} = 0.0169`"),
        );
    }
    ripple
}

fn read_unit(section: &Section<'_, '_>, workspace: Workspace) -> UnitSettings {
    let n = |key, range, example| section.number(key, range, example);
    let exit = section.vector("exit_m", 10.0, "[0.335, 0.045, -0.110]");
    let axis = section.vector("axis", 2.0, "[-1.0, 0.0, 0.0]");
    let scale = n("scale_n_per_count", -3e-5..=3e-5, "6.85e-6");
    if scale.good && scale.value.abs() < 1e-6 {
        section.report(
            scale.at,
            "scale_n_per_count",
            format!(
                "is {}, too small to be a load cell's; calibrate the unit (nominal 6.85e-6)",
                scale.value
            ),
        );
    }
    let tension_min = n("tension_min_n", 0.1..=60.0, "2.0");
    let tension_max = n("tension_max_n", 0.1..=60.0, "12.0");
    let force_limit = n("force_limit_n", 0.1..=40.0, "16.0");
    let over_tension = n("over_tension_n", 1.0..=50.0, "20.0");
    let travel = n("travel_m_per_count", -1e-4..=1e-4, "-4.229e-6");
    if travel.good && travel.value.abs() < 1e-7 {
        section.report(travel.at, "travel_m_per_count", "is (nearly) zero; nominal is 2 pi 10 mm / (4000 * 26 / 7) = 4.229e-6, negative where winding in counts down");
    }
    let dac = n("dac_codes_per_n", -1000.0..=1000.0, "282.2");
    if dac.good && dac.value.abs() < 10.0 {
        section.report(dac.at, "dac_codes_per_n", "is (nearly) zero; nominal is 282.2, negative where the motor turns the other way round");
    }
    let unit = UnitSettings {
        number: section.unit.unwrap_or(0),
        enabled: section.flag("enabled", Some(true)),
        exit_m: exit.value,
        axis: axis.value,
        scale_n_per_count: scale.value,
        tension_min_n: tension_min.value,
        tension_max_n: tension_max.value,
        filter: read_filter(section),
        spike_limit_n: n("spike_limit_n", 0.05..=60.0, "1.5").value,
        kp: n("kp", 0.0..=20.0, "1.0").value,
        ki_per_s: n("ki_per_s", 0.0..=200.0, "20.0").value,
        kd_s: n("kd_s", 0.0..=0.5, "0.0").value,
        damping_n_s_per_m: n("damping_n_s_per_m", 0.0..=1000.0, "60.0").value,
        friction_feedforward: section.flag("friction_feedforward", None),
        friction_offset_n: n("friction_offset_n", -3.0..=3.0, "0.155").value,
        friction_gain: n("friction_gain", 0.5..=2.0, "1.018").value,
        coulomb_n: n("coulomb_n", 0.0..=5.0, "0.909").value,
        coulomb_per_n: n("coulomb_per_n", 0.0..=0.4, "0.154").value,
        reversal_m: n("reversal_m", 1e-5..=5e-3, "1e-4").value,
        travel_m_per_count: travel.value,
        dac_codes_per_n: dac.value,
        force_limit_n: force_limit.value,
        slew_n_per_s: n("slew_n_per_s", 1.0..=2000.0, "400.0").value,
        over_tension_n: over_tension.value,
        viscous_n_s_per_m: section
            .optional("viscous_n_s_per_m", 0.0..=100.0, 0.0)
            .value,
        ripples: core::array::from_fn(|n| read_ripple(section, n)),
    };
    if tension_min.good && tension_max.good && tension_min.value >= tension_max.value {
        section.report(
            tension_min.at,
            "tension_min_n",
            format!(
                "is {} and not below tension_max_n = {}; are the two swapped?",
                tension_min.value, tension_max.value
            ),
        );
    } else if tension_max.good && over_tension.good && over_tension.value <= tension_max.value {
        section.report(
            over_tension.at,
            "over_tension_n",
            format!("is {} and not above tension_max_n = {}; the unit would fault on a tension that is allowed", over_tension.value, tension_max.value),
        );
    }
    if tension_max.good && force_limit.good && force_limit.value < tension_max.value {
        section.report(
            force_limit.at,
            "force_limit_n",
            format!(
                "is {} and below tension_max_n = {}; the motor could not hold the tension",
                force_limit.value, tension_max.value
            ),
        );
    }
    // The board's own check, so that nothing is refused only once it is connected.
    if section.context.problems.borrow().is_empty() {
        if let Err(error) = control::Config::from_wire(&unit.to_wire()) {
            section.report(
                section.at,
                error.field.name,
                format!("the board would refuse it: {error}"),
            );
        }
    }
    if exit.good && axis.good {
        check_geometry(section, &unit, axis.at, exit.at, workspace);
    }
    unit
}

fn read_filter(section: &Section<'_, '_>) -> Filter {
    let kind = section.text("filter", "low_pass");
    // Both are asked for, so that the one not in use may stay in [defaults].
    let corner = |s: &Section<'_, '_>| s.number("filter_corner_hz", 5.0..=120.0, "100.0").value;
    let samples = |s: &Section<'_, '_>| s.number("filter_samples", 1.0..=16.0, "4");
    match kind.value.as_str() {
        "low_pass" => {
            section
                .asked
                .borrow_mut()
                .insert("filter_samples".to_owned());
            Filter::LowPass(corner(section))
        }
        "moving_average" => {
            section
                .asked
                .borrow_mut()
                .insert("filter_corner_hz".to_owned());
            let n = samples(section);
            if n.value.fract() != 0.0 {
                section.report(
                    n.at,
                    "filter_samples",
                    format!("is {}, a whole number is needed", n.value),
                );
            }
            Filter::MovingAverage(n.value as u8)
        }
        other => {
            if kind.good {
                section.report(
                    kind.at,
                    "filter",
                    format!("`{other}` is not a filter; use \"low_pass\" or \"moving_average\""),
                );
            }
            Filter::MovingAverage(1)
        }
    }
}

/// Checks where a unit stands and looks.
fn check_geometry(
    section: &Section<'_, '_>,
    unit: &UnitSettings,
    axis_at: usize,
    exit_at: usize,
    workspace: Workspace,
) {
    let length = unit.axis.norm();
    if (length - 1.0).abs() > 1e-3 {
        let hint = match unit.axis.try_normalize(0.0) {
            Some(v) => format!("; write [{:.6}, {:.6}, {:.6}]", v.x, v.y, v.z),
            None => String::new(),
        };
        section.report(
            axis_at,
            "axis",
            format!("has length {length:.4}, a unit vector is needed{hint}"),
        );
        return;
    }
    let span = (unit.exit_m - workspace.center_m).norm();
    if span <= workspace.radius_m {
        section.report(
            exit_at,
            "exit_m",
            format!("lies {span:.3} m from the workspace's centre, inside its radius of {} m; check the unit (metres) and the signs", workspace.radius_m),
        );
        return;
    }
    let Some((_, cos)) = unit.cable_at(workspace.center_m) else {
        return;
    };
    if cos <= 0.0 {
        section.report(
            axis_at,
            "axis",
            "points away from the workspace; it has to point from the unit to the workspace: flip all three signs",
        );
    } else if cos < 0.5 {
        section.report(
            axis_at,
            "axis",
            format!("is {:.0} degrees off the cable, the load cell would hardly see it; check exit_m and axis", cos.acos().to_degrees()),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::super::{RigFileError, DEFAULT_TEXT};
    use super::*;

    fn problems(text: &str) -> RigFileError {
        RigFile::parse("rig.toml", text).expect_err("a problem was put in")
    }

    /// Line (from 1) of the n-th occurrence of a text in the example.
    fn line_of(needle: &str, n: usize) -> usize {
        let (at, _) = DEFAULT_TEXT
            .match_indices(needle)
            .nth(n)
            .expect("is in the example");
        1 + DEFAULT_TEXT[..at].matches('\n').count()
    }

    #[test]
    fn the_built_in_file_is_right() {
        let rig = RigFile::built_in().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(rig.units.map(|u| u.number), [1, 2, 3, 4, 5, 6]);
        assert_eq!(rig.hash().len(), 64);
        let config = rig.units[0].to_wire();
        assert_eq!(config.coulomb_un, 909_000);
        assert_eq!(config.friction_offset_un, 155_000);
    }

    #[test]
    fn the_hash_follows_the_values_and_not_the_comments() {
        let rig = RigFile::built_in().unwrap();
        let commented = RigFile::parse("x", &format!("# more\n{DEFAULT_TEXT}")).unwrap();
        assert_eq!(rig.hash(), commented.hash());
        let changed = DEFAULT_TEXT.replacen("coulomb_n = 0.909", "coulomb_n = 0.91", 1);
        assert_ne!(rig.hash(), RigFile::parse("x", &changed).unwrap().hash());
    }

    #[test]
    fn a_missing_unit_is_named() {
        let cut = DEFAULT_TEXT.rfind("[[unit]]").unwrap();
        let error = problems(&DEFAULT_TEXT[..cut]);
        assert_eq!(error.problems.len(), 1, "{error}");
        assert_eq!(error.problems[0].unit, Some(6));
        assert!(error.to_string().contains("number = 6"), "{error}");
    }

    #[test]
    fn every_kind_of_mistake_names_line_key_and_way_out() {
        let cases: &[(&str, &str, &str, &str)] = &[
            (
                "tension_min_n = 2.0",
                "tension_min_n = 14.0",
                "tension_min_n",
                "swapped",
            ),
            (
                "coulomb_n = 0.909",
                "coulomb_n = nan",
                "coulomb_n",
                "finite",
            ),
            (
                "coulomb_n = 0.909",
                "coulomb_n = inf",
                "coulomb_n",
                "finite",
            ),
            (
                "coulomb_n = 0.909",
                "coulomb_n = 909.0",
                "coulomb_n",
                "check value and unit",
            ),
            (
                "coulomb_n = 0.909",
                "coulomb_n = \"much\"",
                "coulomb_n",
                "a number is needed",
            ),
            (
                "coulomb_n = 0.909",
                "coulom_n = 0.909",
                "coulom_n",
                "did you mean `coulomb_n`?",
            ),
            ("number = 2", "number = 1", "number", "used twice"),
            ("number = 2", "number = 7", "number", "allowed is 1 to 6"),
            ("number = 2", "number = 1.5", "number", "whole number"),
            (
                "reference = \"lower\"",
                "reference = \"low\"",
                "reference",
                "\"middle\"",
            ),
            (
                "rig = \"embedded\"",
                "rig = \"serial\"",
                "rig",
                "serial:PORT",
            ),
            ("source = \"rig\"", "source = \"ros\"", "source", "\"udp\""),
            (
                "friction_feedforward = true",
                "friction_feedforward = 1",
                "friction_feedforward",
                "true or false",
            ),
            ("schema = 1", "schema = 2", "schema", "schema 1"),
            (
                "filter = \"low_pass\"",
                "filter = \"kalman\"",
                "filter",
                "\"moving_average\"",
            ),
            (
                "center_m = [-0.080, 0.025, -0.140]",
                "center_m = [-0.080, 0.025]",
                "center_m",
                "three are needed",
            ),
            (
                "over_tension_n = 20.0",
                "over_tension_n = 11.0",
                "over_tension_n",
                "would fault",
            ),
        ];
        for (good, bad, key, way_out) in cases {
            assert!(DEFAULT_TEXT.contains(good), "{good}");
            let error = problems(&DEFAULT_TEXT.replacen(good, bad, 1));
            let line = line_of(good, 0);
            assert!(
                error
                    .problems
                    .iter()
                    .any(|p| p.key == *key && p.message.contains(way_out) && p.line == line),
                "{bad}: {error}"
            );
            assert!(
                error.to_string().contains(&format!("rig.toml:{line}: ")),
                "{error}"
            );
        }
    }

    #[test]
    fn axes_are_checked_against_the_geometry() {
        let text: String = DEFAULT_TEXT
            .lines()
            .map(|line| match line.strip_prefix("axis = [") {
                Some(rest) => {
                    let numbers: Vec<f64> = rest
                        .trim_end_matches(']')
                        .split(',')
                        .map(|n| n.trim().parse().unwrap())
                        .collect();
                    format!(
                        "axis = [{}, {}, {}]\n",
                        -numbers[0], -numbers[1], -numbers[2]
                    )
                }
                None => format!("{line}\n"),
            })
            .collect();
        let error = problems(&text);
        assert_eq!(error.problems.len(), UNITS, "{error}");
        assert!(
            error.problems.iter().all(|p| p.message.contains("flip")),
            "{error}"
        );
        let error = problems(&DEFAULT_TEXT.replacen("axis = [", "axis = [0.3, 0.0, 0.0] # [", 1));
        assert!(
            error.to_string().contains("unit 1: `axis`: has length 0.3"),
            "{error}"
        );
        assert!(error.to_string().contains("write [1.0"), "{error}");
    }

    #[test]
    fn broken_toml_names_the_line() {
        let error = problems("schema = 1\nname = [\n");
        assert!(error.problems[0].line >= 2, "{error}");
        assert!(error.to_string().contains("not TOML"), "{error}");
        assert!(!problems("").problems.is_empty());
        assert!(!problems("\u{0}\u{fffd}").problems.is_empty());
    }
}
