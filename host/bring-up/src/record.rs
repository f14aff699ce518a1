//! The record of a rig's bring-up: a JSON file beside its calibration, and what has changed since.
//!
//! ```json
//! {"schema": 2, "rig": "...", "identity": {"board": "...", "rig_hash": "...", "serials": [...]},
//!  "tests": {"reels": {"1": "2026-11-26", "2": "2026-11-26"}}, "figures": {...}, "mistakes": [...]}
//! ```

use crate::figures::{EStopFigures, Figures, PowerFigures};
use crate::judge::judge;
use crate::mistake::{Mistake, Named};
use crate::settings::{self, Values};
use crate::steps::Test;
use files::Part;
use known::store::Store;
use known::{Result, StoreError};
use rig::Rig;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{ErrorKind, Write};
use std::path::PathBuf;
use wire::UNITS;

/// Version of the keys.
pub const SCHEMA: u32 = 2;

/// What a bring-up is of. Empty: not known.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Identity {
    /// The controller's own number (`wire::message::BoardInfo::number`).
    pub board: String,
    /// Hash of the rig file.
    pub rig_hash: String,
    /// Serial numbers of unit, motor, load cell and converter, of each unit.
    pub serials: [[String; 4]; UNITS],
    /// The rig file's settings that the tests judge by, of each unit that it uses.
    #[serde(default)]
    pub settings: [Values; UNITS],
}

impl Identity {
    /// Of this rig at this board (`None`: its number is not known), with the serial numbers of its
    /// calibration.
    ///
    /// # Errors
    /// The calibration can't be read.
    pub fn of(rig: &Rig, store: &Store, board: Option<String>) -> Result<Self> {
        let mut serials: [[String; 4]; UNITS] = Default::default();
        if let Some(record) = store.current()? {
            for unit in &record.units {
                if let Some(slot) = serials.get_mut(usize::from(unit.number).wrapping_sub(1)) {
                    *slot = unit.serials().map(|(_, number)| number.to_owned());
                }
            }
        }
        Ok(Self {
            board: board.unwrap_or_default(),
            rig_hash: rig.hash(),
            serials,
            settings: settings::of(rig),
        })
    }

    /// This one as it is now: what is not known now stays.
    #[must_use]
    pub fn updated(&self, now: Self) -> Self {
        let known = |is: String, was: &String| if is.is_empty() { was.clone() } else { is };
        let mut serials = now.serials;
        for (is, was) in serials
            .iter_mut()
            .flatten()
            .zip(self.serials.iter().flatten())
        {
            *is = known(std::mem::take(is), was);
        }
        let mut settings = now.settings;
        for (is, was) in settings.iter_mut().zip(&self.settings) {
            if is.is_empty() {
                is.clone_from(was);
            }
        }
        Self {
            board: known(now.board, &self.board),
            rig_hash: known(now.rig_hash, &self.rig_hash),
            serials,
            settings,
        }
    }

    /// What differs from `now`, in words. What one of the two does not know is no difference.
    #[must_use]
    pub fn changed(&self, now: &Self) -> Vec<Change> {
        let differs = |was: &str, is: &str| !was.is_empty() && !is.is_empty() && was != is;
        let mut found = Vec::new();
        let mut part = |what: String, was: &str, is: &str| {
            if differs(was, is) {
                found.push(Change {
                    words: format!("{what} was {was} and is {is}"),
                    again: Again::Rig,
                });
            }
        };
        part("the board".to_owned(), &self.board, &now.board);
        for (i, (was, is)) in self.serials.iter().zip(&now.serials).enumerate() {
            for (what, (was, is)) in PARTS.iter().zip(was.iter().zip(is)) {
                part(format!("the {what} of unit {}", i + 1), was, is);
            }
        }
        let mut settings = Vec::new();
        for (unit, (was, is)) in (1..).zip(self.settings.iter().zip(&now.settings)) {
            let changed = settings::changed(unit, was, is).into_iter();
            settings.extend(changed.map(|(words, tests)| Change {
                words,
                again: Again::Unit(unit, tests),
            }));
        }
        if settings.is_empty() && differs(&self.rig_hash, &now.rig_hash) {
            settings.push(Change {
                words: "the rig file has another content".to_owned(),
                again: Again::Nothing,
            });
        }
        found.append(&mut settings);
        found
    }
}

/// Parts with a serial number.
const PARTS: [&str; 4] = ["unit", "motor", "load cell", "converter"];

/// Something that has changed since the bring-up.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// In words.
    pub words: String,
    /// What has to be tested again.
    pub again: Again,
}

/// What a change asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Again {
    /// No test has looked at it.
    Nothing,
    /// These tests of this unit, from 1: a setting that they judge by was changed.
    Unit(u8, &'static [Test]),
    /// Every test: a part of the rig was exchanged, so its wiring is not what was tested.
    Rig,
}

/// When a test was done with each unit, from 1: the date, `YYYY-MM-DD`.
pub type Done = BTreeMap<u8, String>;

/// The record of a rig.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Name of the rig.
    pub rig: String,
    /// What was tested.
    pub identity: Identity,
    /// Tests that are done.
    pub tests: BTreeMap<Test, Done>,
    /// What they measured.
    pub figures: Figures,
    /// What these say, and what is in `standing`.
    pub mistakes: Vec<Named>,
    /// What tests had found that were begun anew and have measured nothing since: it stands until
    /// they do.
    #[serde(default)]
    pub standing: Vec<Named>,
    /// What exchanged parts ask for.
    #[serde(default)]
    pub owed: Owed,
}

/// Parts that were exchanged and settings that were changed, until the tests that the former ones
/// had passed through are done with them: a bring-up that is begun and broken off has not tested
/// them.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Owed {
    /// The changes, in words; empty: none.
    pub parts: Vec<String>,
    /// The tests, each with its units, from 1.
    pub tests: BTreeMap<Test, BTreeSet<u8>>,
}

impl Owed {
    /// Takes off what is done, and units that the rig file does not use.
    fn settle(&mut self, rig: &Rig, done: &BTreeMap<Test, Done>) {
        self.tests.retain(|test, units| {
            let done = done.get(test);
            let used = |unit: u8| rig.units.iter().any(|u| u.number == unit && u.enabled);
            units.retain(|unit| used(*unit) && !done.is_some_and(|done| done.contains_key(unit)));
            !units.is_empty()
        });
        if self.tests.is_empty() {
            self.parts.clear();
        }
    }
}

/// Result of a bring-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every test is done, and none found a mistake.
    Passed,
    /// A mistake is named.
    Failed,
    /// A test is not done, and no mistake is named yet.
    Undecided,
}

impl Record {
    /// An empty one.
    #[must_use]
    pub fn new(rig: &Rig, identity: Identity) -> Self {
        Self {
            schema: SCHEMA,
            rig: rig.name.clone(),
            identity,
            tests: BTreeMap::new(),
            figures: Figures::default(),
            mistakes: Vec::new(),
            standing: Vec::new(),
            owed: Owed::default(),
        }
    }

    /// One that begins anew, of a rig that has this one. Where something has changed that it judged
    /// by, what it has tested is owed.
    #[must_use]
    pub fn anew(&self, rig: &Rig, now: Identity) -> Self {
        let mut owed = self.owed.clone();
        let changes = self.identity.changed(&now).into_iter();
        let parts = changes.filter(|change| change.again != Again::Nothing);
        owed.parts.extend(parts.map(|change| change.words));
        if !owed.parts.is_empty() {
            for (test, done) in &self.tests {
                owed.tests.entry(*test).or_default().extend(done.keys());
            }
        }
        owed.settle(rig, &BTreeMap::new());
        Self {
            owed,
            // What one does not know now was tested all the same.
            ..Self::new(rig, self.identity.updated(now))
        }
    }

    /// Goes on with the same parts: what was tested of a unit by a setting that has changed is open
    /// again, and owed.
    pub fn go_on(&mut self, rig: &Rig, now: Identity) {
        for change in self.identity.changed(&now) {
            let Again::Unit(unit, tests) = change.again else {
                continue;
            };
            self.owed.parts.push(change.words);
            for test in tests {
                let done = self.tests.get(test);
                if done.is_some_and(|done| done.contains_key(&unit)) {
                    self.owed.tests.entry(*test).or_default().insert(unit);
                    self.forget(*test, &[usize::from(unit) - 1]);
                }
            }
        }
        self.owed.settle(rig, &self.tests);
        self.identity = self.identity.updated(now);
    }

    /// Takes note of what a test has measured, and judges all. A unit that it did not measure keeps
    /// the date of before.
    pub fn took(&mut self, rig: &Rig, test: Test, units: &[usize], date: &str) {
        let figures = &self.figures;
        let measured = |i: usize| match test {
            Test::Board => figures.board.is_some(),
            Test::Converters => figures.converters[i].is_some(),
            Test::Estop => figures.estop.is_some(),
            Test::Power => {
                (figures.power.as_ref()).is_some_and(|power| power.unplugged[i].is_some())
            }
            Test::Reels => figures.pulls[i].is_some(),
            Test::Weights => figures.weights[i].is_some(),
            Test::Motors => figures.motors[i].is_some(),
            Test::Tension => figures.tension[i].is_some(),
        };
        let of_all = [0, 1, 2, 3, 4, 5];
        let units = if test.is_of_the_board() {
            &of_all
        } else {
            units
        };
        let measured: Vec<usize> = units.iter().copied().filter(|i| measured(*i)).collect();
        let done = self.tests.entry(test).or_default();
        for unit in &measured {
            done.insert(*unit as u8 + 1, date.to_owned());
        }
        if !measured.is_empty() {
            self.standing.retain(|named| named.mistake.test() != test);
        }
        self.owed.settle(rig, &self.tests);
        self.mistakes = judge(rig, &self.figures);
        for named in &self.standing {
            if !(self.mistakes.iter()).any(|found| found.mistake == named.mistake) {
                self.mistakes.push(named.clone());
            }
        }
    }

    /// Tests that are not done for each of these units, from 0.
    #[must_use]
    pub fn open(&self, units: &[usize]) -> Vec<Test> {
        let done = |test: &Test| {
            self.tests
                .get(test)
                .is_some_and(|done| units.iter().all(|i| done.contains_key(&(*i as u8 + 1))))
        };
        Test::ALL.into_iter().filter(|test| !done(test)).collect()
    }

    /// Tests that are to be done for these units, from 0: the first one, those that are open, those
    /// that found something, and those that the tests before have changed.
    #[must_use]
    pub fn next(&self, units: &[usize]) -> Vec<Test> {
        let open = self.open(units);
        let wrong: Vec<Test> = self
            .mistakes
            .iter()
            .map(|named| named.mistake.test())
            .collect();
        let again =
            |test: &Test| *test == Test::Board || open.contains(test) || wrong.contains(test);
        Test::ALL.into_iter().filter(again).collect()
    }

    /// Forgets what a test has measured of these units, from 0. What it found stands until it has
    /// measured again.
    pub fn forget(&mut self, test: Test, units: &[usize]) {
        let found = (self.mistakes.iter()).filter(|named| named.mistake.test() == test);
        let new = found.filter(|named| !self.standing.contains(named));
        self.standing.extend(new.cloned().collect::<Vec<_>>());
        let figures = &mut self.figures;
        match test {
            Test::Board => figures.board = None,
            Test::Converters => units.iter().for_each(|i| figures.converters[*i] = None),
            Test::Estop => figures.estop = None,
            // The lamps are looked at anew, whichever units follow.
            Test::Power => {
                let mut unplugged = figures.power.take().unwrap_or_default().unplugged;
                units.iter().for_each(|i| unplugged[*i] = None);
                figures.power = Some(PowerFigures {
                    unplugged,
                    ..PowerFigures::default()
                });
            }
            Test::Reels => units.iter().for_each(|i| figures.pulls[*i] = None),
            Test::Weights => units.iter().for_each(|i| figures.weights[*i] = None),
            Test::Motors => units.iter().for_each(|i| figures.motors[*i] = None),
            Test::Tension => units.iter().for_each(|i| figures.tension[*i] = None),
        }
        if let Some(done) = self.tests.get_mut(&test) {
            done.retain(|unit, _| {
                !test.is_of_the_board() && !units.contains(&(usize::from(*unit) - 1))
            });
        }
    }

    /// Whether a test may drive motors: only with an E-stop that was seen to work, `motors` and
    /// `tension` only where nothing says that the power can't be cut, and `tension` only with parts
    /// that are in order.
    ///
    /// # Errors
    /// Why not.
    pub fn may_drive(&self, test: Test) -> std::result::Result<(), String> {
        let against = |named: &&Named| match named.mistake.test() {
            // A motor without power is named by its pulses too; a cable is not loaded without it.
            Test::Power if named.mistake == Mistake::NoPower => test == Test::Tension,
            Test::Power => test != Test::Power,
            Test::Estop => test != Test::Power,
            // What pulses can't tell from friction, this test does.
            Test::Motors => {
                test == Test::Tension && !matches!(named.mistake, Mistake::AmplifierGain { .. })
            }
            Test::Converters | Test::Reels | Test::Weights => test == Test::Tension,
            // A controller that is reset under way would leave the cable loaded.
            Test::Board => {
                test == Test::Tension && matches!(named.mistake, Mistake::DacResetPull { .. })
            }
            Test::Tension => false,
        };
        if let Some(named) = self.mistakes.iter().find(against) {
            return Err(format!("{}: no motor is driven", named.mistake));
        }
        let works = |estop: &EStopFigures| !estop.closed_pressed && estop.closed_released;
        match &self.figures.estop {
            Some(estop) if works(estop) => Ok(()),
            Some(_) => Err("the E-stop does not work: no motor is driven".to_owned()),
            None => Err("the E-stop was not tested: no motor is driven".to_owned()),
        }
    }

    /// The verdict over these units, from 0.
    #[must_use]
    pub fn verdict(&self, units: &[usize]) -> Verdict {
        if !self.mistakes.is_empty() {
            Verdict::Failed
        } else if self.open(units).is_empty() {
            Verdict::Passed
        } else {
            Verdict::Undecided
        }
    }
}

/// File of a rig's record.
#[must_use]
pub fn path(store: &Store) -> PathBuf {
    store.folder().join("bring-up.json")
}

/// Reads the record of a rig; `None` where there is none.
///
/// # Errors
/// The file can't be read, or is not one of this version.
pub fn read(store: &Store) -> Result<Option<Record>> {
    let path = path(store);
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(StoreError::unreadable(&path, error)),
    };
    let way_out = "delete it and run `forcectl bring-up` again";
    let record: Record = serde_json::from_str(&text)
        .map_err(|error| StoreError::unreadable(&path, format!("{error}; {way_out}")))?;
    if record.schema != SCHEMA {
        let cause = format!("schema {} is not {SCHEMA}; {way_out}", record.schema);
        return Err(StoreError::unreadable(&path, cause));
    }
    Ok(Some(record))
}

/// Writes the record of a rig, in place of the one before.
///
/// # Errors
/// It can't be written.
pub fn write(store: &Store, record: &Record) -> Result<()> {
    let path = path(store);
    let text =
        serde_json::to_string_pretty(record).map_err(|error| StoreError::file(&path, error))?;
    let write = || {
        let (part, mut file) = Part::begin(&path)?;
        writeln!(file, "{text}")?;
        part.finish(file)
    };
    write().map_err(|error| StoreError::file(&path, error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::{ConverterFigures, TensionFigures};

    fn identity() -> Identity {
        let mut identity = Identity {
            board: "B1".to_owned(),
            rig_hash: "aa".to_owned(),
            ..Identity::default()
        };
        identity.serials[2][2] = "SBA-1".to_owned();
        identity
    }

    #[test]
    fn what_changed_is_named_and_what_is_not_known_is_no_change() {
        let was = identity();
        assert_eq!(was.changed(&was), []);
        assert_eq!(was.changed(&Identity::default()), []);
        let mut now = identity();
        now.board = "B2".to_owned();
        now.rig_hash = "bb".to_owned();
        now.serials[2][2] = "SBA-7".to_owned();
        now.serials[4][1] = "new".to_owned();
        let changes = was.changed(&now);
        let words: Vec<_> = changes.iter().map(|change| change.words.as_str()).collect();
        assert_eq!(
            words,
            [
                "the board was B1 and is B2",
                "the load cell of unit 3 was SBA-1 and is SBA-7",
                "the rig file has another content",
            ]
        );
        assert_eq!(was.updated(Identity::default()), was);
        assert_eq!(was.updated(now.clone()), now);
        assert_eq!(
            changes.iter().map(|c| c.again).collect::<Vec<_>>(),
            [Again::Rig, Again::Rig, Again::Nothing]
        );
    }

    /// Every setting that a test judges by, and no other; it is open again for its unit alone.
    #[test]
    fn a_changed_setting_asks_for_the_tests_that_judge_by_it() {
        let rig = Rig::built_in().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let identity = |rig: &Rig| Identity::of(rig, &store, None).unwrap();
        let done = || {
            let mut record = Record::new(&rig, identity(&rig));
            record.figures.converters = [Some(ConverterFigures::default()); UNITS];
            record.figures.tension = std::array::from_fn(|_| Some(TensionFigures::default()));
            for test in [Test::Converters, Test::Tension] {
                record.took(&rig, test, &[0, 1, 2, 3, 4, 5], "2026-11-26");
            }
            record
        };
        type Edit = (&'static str, fn(&mut rig::UnitSettings));
        let drive: [Edit; 5] = [
            ("dac_codes_per_n", |unit| unit.dac_codes_per_n *= 2.0),
            ("friction_offset_n", |unit| unit.friction_offset_n += 0.1),
            ("friction_gain", |unit| unit.friction_gain *= 0.9),
            ("coulomb_n", |unit| unit.coulomb_n *= 1.1),
            ("coulomb_per_n", |unit| unit.coulomb_per_n += 0.01),
        ];
        let cell: Edit = ("scale_n_per_count", |unit| unit.scale_n_per_count *= -1.0);
        let reel: Edit = ("travel_m_per_count", |unit| unit.travel_m_per_count *= -1.0);
        let all = [cell, reel].into_iter().chain(drive);
        for (key, change) in all {
            let mut other = rig.clone();
            change(&mut other.units[3]);
            let mut record = done();
            let changes = record.identity.changed(&identity(&other));
            let [Change { words, again }] = changes.as_slice() else {
                panic!("{key}: {changes:?}");
            };
            assert!(
                words.starts_with(&format!("{key} of unit 4 was ")),
                "{words}"
            );
            assert!(matches!(again, Again::Unit(4, _)));
            record.go_on(&other, identity(&other));
            let mut open = vec![Test::Tension];
            if key == "scale_n_per_count" {
                open.insert(0, Test::Converters);
            }
            let owed: Vec<_> = record.owed.tests.keys().copied().collect();
            assert_eq!((&owed, record.owed.parts.len()), (&open, 1), "{key}");
            for test in open {
                assert!(record.open(&[3]).contains(&test), "{key}");
                assert!(!record.open(&[0, 1, 2, 4, 5]).contains(&test), "{key}");
            }
            // Once more, with nothing new.
            record.go_on(&other, identity(&other));
            assert_eq!(record.owed.parts.len(), 1);
            record.figures.converters[3] = Some(ConverterFigures::default());
            record.figures.tension[3] = Some(TensionFigures::default());
            record.took(&other, Test::Converters, &[3], "2026-11-27");
            record.took(&other, Test::Tension, &[3], "2026-11-27");
            assert_eq!(record.owed, Owed::default(), "{key}");
        }
        // What no test judges by, and a unit that is left out.
        let mut other = rig.clone();
        other.units[3].kp *= 2.0;
        other.units[2].enabled = false;
        other.units[2].coulomb_n *= 2.0;
        let changes = done().identity.changed(&identity(&other));
        assert_eq!(changes.len(), 1);
        assert_eq!(changes[0].again, Again::Nothing);
    }

    /// A bring-up that is begun with a new part has not tested it.
    #[test]
    fn a_new_part_is_owed_the_tests_that_the_former_one_had() {
        let rig = Rig::built_in().unwrap();
        let mut record = Record::new(&rig, identity());
        record.figures.converters[0] = Some(ConverterFigures::default());
        record.took(&rig, Test::Converters, &[0], "2026-11-26");
        record.figures.tension[1] = Some(TensionFigures::default());
        record.took(&rig, Test::Tension, &[1], "2026-11-26");
        // The same parts begin anew, and one that is not told now is no other one.
        let again = record.anew(&rig, Identity::default());
        assert_eq!((&again.owed, again.tests.len()), (&Owed::default(), 0));
        assert_eq!(again.identity, record.identity);
        let mut now = identity();
        now.board = "B2".to_owned();
        let mut new = record.anew(&rig, now.clone());
        assert_eq!(new.owed.parts, ["the board was B1 and is B2"]);
        let owed: Vec<_> = new.owed.tests.keys().copied().collect();
        assert_eq!(owed, [Test::Converters, Test::Tension]);
        // To begin once more settles nothing.
        new = new.anew(&rig, now);
        new.figures.converters[0] = Some(ConverterFigures::default());
        new.took(&rig, Test::Converters, &[0], "2026-11-27");
        new.figures.tension[0] = Some(TensionFigures::default());
        new.took(&rig, Test::Tension, &[0], "2026-11-27");
        assert_eq!(new.owed.parts.len(), 1, "unit 2 was not tested");
        new.figures.tension[1] = Some(TensionFigures::default());
        new.took(&rig, Test::Tension, &[1], "2026-11-27");
        assert_eq!(new.owed, Owed::default());
    }

    #[test]
    fn a_record_is_kept_and_a_damaged_one_names_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let rig = Rig::built_in().unwrap();
        assert_eq!(read(&store).unwrap(), None);
        let mut record = Record::new(&rig, identity());
        let units = [0, 1, 2, 3, 4, 5];
        assert_eq!(record.verdict(&units), Verdict::Undecided);
        record.took(&rig, Test::Reels, &units, "2026-11-26");
        // Nothing was measured.
        assert_eq!(record.open(&units), Test::ALL);
        let may_drive = |record: &Record| record.may_drive(Test::Motors);
        assert!(may_drive(&record).unwrap_err().contains("not tested"));
        let estop = |closed_pressed| EStopFigures {
            closed_before: true,
            closed_pressed,
            closed_released: true,
            alive_withheld: false,
        };
        record.figures.estop = Some(estop(false));
        assert_eq!(may_drive(&record), Ok(()));
        record.figures.power = Some(PowerFigures {
            lit_unplugged: Some(true),
            ..PowerFigures::default()
        });
        record.took(&rig, Test::Power, &units, "2026-11-26");
        assert!(may_drive(&record)
            .unwrap_err()
            .contains("relay is bridged: no motor"));
        // What shows it may be repeated.
        assert_eq!(record.may_drive(Test::Power), Ok(()));
        record.figures.power = None;
        record.took(&rig, Test::Power, &units, "2026-11-26");
        record.figures.estop = Some(estop(true));
        assert!(may_drive(&record).unwrap_err().contains("does not work"));
        record.took(&rig, Test::Estop, &units, "2026-11-26");
        assert_eq!(record.verdict(&units), Verdict::Failed);
        assert_eq!(record.open(&units).len(), 7);
        assert_eq!(record.next(&units), Test::ALL);
        write(&store, &record).unwrap();
        assert_eq!(read(&store).unwrap(), Some(record));
        std::fs::write(path(&store), "{").unwrap();
        let told = read(&store).unwrap_err().to_string();
        assert!(
            told.contains("bring-up.json") && told.contains("delete it"),
            "{told}"
        );
    }
}
