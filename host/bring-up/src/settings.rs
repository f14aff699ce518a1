//! The rig file's settings that the tests judge by. One that was changed since asks for these tests
//! again; the rest of the file (poses, limits, gains of the controllers) no test has looked at.

use crate::steps::Test;
use rig::{Rig, UnitSettings};
use std::collections::BTreeMap;
use wire::UNITS;

/// A setting of a unit: its key, its value, the tests that judge by it.
type Setting = (&'static str, fn(&UnitSettings) -> f64, &'static [Test]);

/// What a motor's pulses and its cable's load are compared with.
const DRIVE: &[Test] = &[Test::Motors, Test::Tension];

const SETTINGS: [Setting; 7] = [
    (
        "scale_n_per_count",
        |unit| unit.scale_n_per_count,
        &[
            Test::Converters,
            Test::Reels,
            Test::Weights,
            Test::Motors,
            Test::Tension,
        ],
    ),
    (
        "travel_m_per_count",
        |unit| unit.travel_m_per_count,
        &[Test::Reels, Test::Motors, Test::Tension],
    ),
    ("dac_codes_per_n", |unit| unit.dac_codes_per_n, DRIVE),
    ("friction_offset_n", |unit| unit.friction_offset_n, DRIVE),
    ("friction_gain", |unit| unit.friction_gain, DRIVE),
    ("coulomb_n", |unit| unit.coulomb_n, DRIVE),
    ("coulomb_per_n", |unit| unit.coulomb_per_n, DRIVE),
];

/// Differences below this share are those of a number that was written and read.
const SAME: f64 = 1e-9;

/// Values of a unit's settings by their keys; empty: the unit is not used, or nobody took note.
pub type Values = BTreeMap<String, f64>;

/// Those of a rig file.
pub(crate) fn of(rig: &Rig) -> [Values; UNITS] {
    std::array::from_fn(|i| {
        let unit = &rig.units[i];
        let used = SETTINGS.iter().filter(|_| unit.enabled);
        used.map(|(key, value, _)| ((*key).to_owned(), value(unit)))
            .collect()
    })
}

/// What differs between a unit's settings, in words, with the tests that judged by them.
pub(crate) fn changed(unit: u8, was: &Values, is: &Values) -> Vec<(String, &'static [Test])> {
    let difference = |(key, _, tests): &Setting| {
        let (was, is) = (was.get(*key)?, is.get(*key)?);
        let same = (was - is).abs() <= SAME * was.abs().max(is.abs());
        (!same).then(|| {
            (
                format!("{key} of unit {unit} was {was} and is {is}"),
                *tests,
            )
        })
    };
    SETTINGS.iter().filter_map(difference).collect()
}
