//! Whether 0 V has an effect on a motor. A DAC may be stuck, its select wire broken, or the words
//! of another unit reach it.
//!
//! | evidence | what it compares | time |
//! | --- | --- | --- |
//! | the cable lets go | tension before and after 0 V; without a load cell, whether the reel has paid out | [`LET_GO_US`] |
//! | the cable is pulled again | a tension that comes back while other motors are driven, or with a reel that winds in; one above the over-tension limit | [`LET_GO_US`] |
//! | the reel speeds up | speed of winding in with the least since 0 V | two samples, 6 ms |
//! | the reel is thrown | gain of speed in each of two samples, whatever other motors do | two samples, 6 ms |
//! | the reel winds in | without a load cell: travel from where it had paid out furthest | [`COASTING_MS`], then at once |
//! | the reel winds in | for [`TRIAL_MS`] after the amplifiers got their power: travel from where it had paid out furthest | at once |
//! | the cable tightens | for [`TRIAL_MS`] after the amplifiers got their power: tension above the least since then | `TIGHTER_SAMPLES` |
//!
//! Those of the reel need no load cell that can be believed. At 0 V nothing drives a reel inwards:
//! friction and the cable both brake it. A reel that winds in faster than before, or on and on, is
//! driven by its motor.
//!
//! A load cell that reads too little says at once that the cable has let go. After a fault that
//! puts it in doubt the encoder has to show it. Where the motor had no force before (its amplifier
//! is off) nothing shows it either: that counts as not let go.

use crate::friction::travel;
#[cfg(doc)]
use crate::friction::Model;
use crate::plausible::milli;
use crate::units::{EncoderCounts, Micros, Newton};
use wire::UnitIndex;

/// How far above the unit's [`Model::let_go`] letting go is told from holding on.
const HELD_BEYOND: Newton = Newton::from_un(300_000);

/// Tension from which letting go is told from holding on.
const fn held(let_go: Newton) -> Newton {
    let_go.saturating_add(HELD_BEYOND)
}

/// Encoder counts that a reel pays out at least when a cable of [`held`] lets go: 5 are 21 um, half
/// of what a stiff cable of 24 N/mm gives back between 2 and 1.1 N.
const LET_GO_COUNTS: i32 = 5;

/// Cable wound in, in nanometres, while the tension stays at [`held`] or above, that a motor at 0 V
/// does not take up: ten counts. A weight that is hung on a cable or a robot that moves away lets
/// the reel pay out; a hand that turns it does wind in.
const PULLED_NM: i32 = 42_000;

/// How fast cable that was wound in below [`held`] is forgotten: 1/16 a sample, 50 ms.
const WOUND_IN_SHIFT: u32 = 4;

/// Time after 0 V in which a reel that was winding in comes to rest, in milliseconds: from 50 mm/s
/// at 2 m/s^2.
pub const COASTING_MS: u8 = 30;

/// Cable that no reel at 0 V winds in after that, in nanometres: twice what a presliding contact
/// springs back (50 um).
const WOUND_IN_NM: i32 = 100_000;

/// Time after 0 V in which a cable must let go, in microseconds: three times what the converter's
/// filter (12.5 ms), the unit's filter and the cable (6 ms on the emulated rig) take.
pub const LET_GO_US: u32 = 75_000;

/// Gain of speed, winding in, that no reel at 0 V has, in nanometres a nominal sample: 25 mm/s. The
/// springs of a presliding contact give back 9 mm/s at most (0.9 N over 50 um, 0.5 kg).
pub const DRIVEN_NM: i32 = 78_125;

/// Gain of speed in two samples, winding in, that no hand gives, in nanometres a nominal sample:
/// 144 mm/s, or 23 m/s^2, for which reel and motor (0.51 kg) take 12 N. An output at the end of its
/// range, 17 N, gives 32 m/s^2.
pub const THROWN_NM: i32 = 450_000;

/// Travels after 0 V that are not compared: the word acts within the first, and the mean speed of
/// an interval lags by half.
const SETTLING_TRAVELS: u8 = 2;

/// Time after the amplifiers got their power in which no reel may wind in, in milliseconds: the PLC
/// waits for ten edges of the alive line (10 ms), an output that is stuck with 2 N winds in
/// `WOUND_IN_NM` in 10 ms. The rest is for a relay and an amplifier that are slower than those of
/// the emulated rig.
pub const TRIAL_MS: u16 = 300;

/// Samples in a row in [`TRIAL_MS`] with [`TIGHTER`] more than before, 12.5 ms: what the
/// converter's filter takes.
const TIGHTER_SAMPLES: u8 = 4;

/// Tension in [`TRIAL_MS`] above the least since then that an output which is stuck makes.
const TIGHTER: Newton = Newton::from_un(2_000_000);

/// Calls of [`LetGo::turned`], a millisecond apart, that make a travel of a nominal sample.
const TURNS_PER_TRAVEL: u8 = 3;

/// A sample of a unit that is not driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Released {
    /// Encoder position.
    pub counts: EncoderCounts,
    /// Travel since the last sample in nanometres, winding in positive.
    pub travel_nm: i32,
    /// Samples were missed in between.
    pub missed: bool,
    /// Filtered cable tension.
    pub tension: Newton,
    /// What it must come down to: [`Model::let_go`] of the unit.
    pub let_go: Newton,
    /// Other motors of the board are driven.
    pub others_drive: bool,
    /// A zero is being measured, or was refused: nothing may drive this motor.
    pub zeroing: bool,
    /// The tension is above the over-tension limit.
    pub over_tension: bool,
}

/// Watches whether a cable lets go after its motor was switched to 0 V, and whether the motor stays
/// without force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LetGo {
    waiting: Option<Waiting>,
    last: Option<(EncoderCounts, Newton)>,
    /// The load cell does not measure.
    blind: bool,
    /// It measures, and not the tension.
    doubted: bool,
    /// It was driven since the configuration was put in force.
    was_driven: bool,
    /// Cable wound in since the tension was below [`held`], and shortly before, nanometres.
    wound_in_nm: i32,
    reel: Reel,
    /// Travels of the last two samples without force, the older first.
    before_nm: [Option<i32>; 2],
    /// The reel gained speed as no hand can give it.
    thrown: bool,
    trial: Option<Trial>,
}

/// The reel since the amplifiers got their power.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Trial {
    /// Where it had paid out furthest.
    outermost: Option<EncoderCounts>,
    /// The least tension, whose zero may not be measured yet, and samples in a row that were far
    /// above it.
    least: Option<Newton>,
    tighter: u8,
    /// The reel has wound in, or the cable has become tight.
    driven: bool,
    /// Calls of [`LetGo::turned`] that are left.
    left: u16,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Waiting {
    since: Micros,
    at: EncoderCounts,
    tension: Option<Newton>,
    /// It began with a tension that came back: a load cell that reads too little did not begin it,
    /// and may end it.
    again: bool,
}

/// The reel of a motor at 0 V.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Reel {
    /// Travels since 0 V, up to [`SETTLING_TRAVELS`].
    travels: u8,
    /// Least speed of winding in since then, nanometres a sample.
    slowest_nm: i32,
    /// It has gained more speed than a reel at 0 V can.
    driven: bool,
    /// Without a load cell: where the present travel began, and calls since.
    began: Option<EncoderCounts>,
    turns: u8,
    /// Without a load cell: calls, up to [`COASTING_MS`], and where it had paid out furthest after
    /// them.
    coasting: u8,
    outermost: EncoderCounts,
}

impl Reel {
    fn add(&mut self, travel_nm: i32) {
        let speed_nm = travel_nm.max(0);
        if self.travels < SETTLING_TRAVELS {
            self.travels += 1;
            self.slowest_nm = speed_nm;
        } else {
            self.slowest_nm = self.slowest_nm.min(speed_nm);
            self.driven |= speed_nm - self.slowest_nm > DRIVEN_NM;
        }
    }

    /// A call of [`LetGo::turned`].
    fn at(&mut self, counts: EncoderCounts, nm_per_count: i32) {
        if self.coasting < COASTING_MS {
            self.coasting += 1;
            self.outermost = counts;
            return;
        }
        let wound_in_nm = travel(self.outermost, counts, nm_per_count);
        if wound_in_nm < 0 {
            self.outermost = counts;
        }
        self.driven |= wound_in_nm > WOUND_IN_NM;
    }
}

impl LetGo {
    /// A sample of a unit that is driven. `least`: the least tension that its command can make, so
    /// that a load cell that reads too little does not end the watch before it begins.
    pub fn driven(&mut self, counts: EncoderCounts, tension: Newton, least: Newton) {
        *self = Self {
            last: Some((counts, tension.max(least))),
            was_driven: true,
            ..Self::default()
        };
    }

    /// 0 V was written. Starts the watch where the unit was driven with enough tension to see it go
    /// below its [`Model::let_go`].
    pub fn switched_off(&mut self, now: Micros, let_go: Newton) {
        if let Some((at, tension)) = self.last.take() {
            self.reel = Reel::default();
            if tension >= held(let_go) {
                self.waiting = Some(Waiting {
                    since: now,
                    at,
                    tension: None,
                    again: false,
                });
            }
        }
    }

    /// A sample of a unit that is not driven. While other motors are driven, a word that reaches
    /// the wrong DAC can pull this cable again after it let go. A robot cannot: a reel at 0 V pays
    /// out at less than [`Model::let_go`]. With every motor at 0 V an output that is stuck pulls
    /// when the power comes back, or one that fails now: that winds the reel in. It counts once the
    /// unit was driven with this configuration: other electronics may drive the motors of a board
    /// that only measures.
    pub fn released(&mut self, now: Micros, sample: Released) {
        let believed = !self.doubted;
        self.blind &= !believed;
        // The load cell's filters show a pull some 15 ms after the reel has made it.
        let held = held(sample.let_go);
        let kept_nm = if sample.tension < held {
            self.wound_in_nm.max(0) - (self.wound_in_nm.max(0) >> WOUND_IN_SHIFT)
        } else {
            self.wound_in_nm
        };
        self.wound_in_nm = kept_nm.saturating_add(sample.travel_nm);
        let pulled = sample.others_drive
            || sample.over_tension
            || self.was_driven && self.wound_in_nm > PULLED_NM;
        if let Some(waiting) = &mut self.waiting {
            if believed || waiting.again {
                waiting.tension = Some(sample.tension);
                if sample.tension < sample.let_go {
                    self.waiting = None;
                }
            }
        } else if pulled && sample.tension >= held {
            self.waiting = Some(Waiting {
                since: now,
                at: sample.counts,
                tension: Some(sample.tension),
                again: true,
            });
        }
        self.throw(&sample);
        if let Some(trial) = &mut self.trial {
            let least = trial.least.get_or_insert(sample.tension);
            *least = (*least).min(sample.tension);
            trial.tighter = if sample.tension.saturating_sub(*least) >= TIGHTER {
                trial.tighter.saturating_add(1)
            } else {
                0
            };
            trial.driven |= trial.tighter >= TIGHTER_SAMPLES;
        }
        // With every motor at 0 V somebody may turn a reel by hand.
        if !sample.others_drive && self.waiting.is_none() {
            self.reel = Reel::default();
        } else if believed && !sample.missed {
            self.reel.add(sample.travel_nm);
        }
    }

    /// Whether both of the last two samples have gained a part of [`THROWN_NM`]: a position that
    /// jumped is one.
    fn throw(&mut self, sample: &Released) {
        let travel_nm = sample.travel_nm.max(0);
        if let ([Some(older), Some(last)], false) = (self.before_nm, sample.missed) {
            let gains = [last - older, travel_nm - last];
            let thrown = gains[0].saturating_add(gains[1]) > THROWN_NM
                && gains.iter().all(|gain| *gain > THROWN_NM / 4);
            self.thrown |= thrown && (self.was_driven || sample.zeroing);
        }
        self.before_nm = if sample.missed {
            [None; 2]
        } else {
            [self.before_nm[1], Some(travel_nm)]
        };
    }

    /// The load cell does not measure any more.
    pub fn blind(&mut self) {
        self.blind = true;
        if let Some(waiting) = &mut self.waiting {
            waiting.tension = None;
        }
    }

    /// The load cell measures something else than the tension.
    pub fn doubt(&mut self) {
        self.doubted = true;
        if let Some(waiting) = &mut self.waiting {
            waiting.tension = None;
        }
    }

    /// Whether the encoder is needed, each millisecond: the watch runs without a load cell.
    #[must_use]
    pub const fn needs_encoder(&self, others_drive: bool) -> bool {
        self.trial.is_some()
            || (self.blind || self.doubted) && (self.waiting.is_some() || others_drive)
    }

    /// The amplifiers get their power, with the motor at 0 V.
    pub fn powered(&mut self) {
        self.trial = Some(Trial {
            outermost: None,
            least: None,
            tighter: 0,
            driven: false,
            left: TRIAL_MS,
        });
    }

    /// The encoder of a unit whose load cell does not measure, a millisecond after the last call.
    pub fn turned(&mut self, counts: EncoderCounts, nm_per_count: i32) {
        self.try_out(counts, nm_per_count);
        if !self.blind && !self.doubted {
            return;
        }
        // Only paying out is letting go: a robot that moves towards the unit can let a stuck motor
        // wind in.
        let let_go_nm = nm_per_count.saturating_abs().saturating_mul(-LET_GO_COUNTS);
        if self.waiting.is_some_and(|waiting| {
            !waiting.again && travel(waiting.at, counts, nm_per_count) <= let_go_nm
        }) {
            self.waiting = None;
        }
        self.reel.at(counts, nm_per_count);
        let Some(began) = self.reel.began else {
            self.reel.began = Some(counts);
            return;
        };
        self.reel.turns += 1;
        if self.reel.turns >= TURNS_PER_TRAVEL {
            self.reel.turns = 0;
            self.reel.began = Some(counts);
            self.reel.add(travel(began, counts, nm_per_count));
        }
    }

    fn try_out(&mut self, counts: EncoderCounts, nm_per_count: i32) {
        let Some(trial) = &mut self.trial else { return };
        let wound_in_nm = travel(*trial.outermost.get_or_insert(counts), counts, nm_per_count);
        if wound_in_nm < 0 {
            trial.outermost = Some(counts);
        }
        trial.driven |= wound_in_nm > WOUND_IN_NM;
        trial.left = trial.left.saturating_sub(1);
        if trial.left == 0 && !trial.driven {
            self.trial = None;
        }
    }

    /// The tension, once a cable should have let go and has not, or a reel at 0 V is driven; `None`
    /// in it: not measured.
    #[must_use]
    pub fn overdue(&self, now: Micros) -> Option<Option<Newton>> {
        if self.thrown || self.reel.driven || self.trial.is_some_and(|trial| trial.driven) {
            return Some(self.waiting.and_then(|waiting| waiting.tension));
        }
        let waiting = self.waiting?;
        // A sample newer than `now` (an interrupt came between) wraps to a huge time.
        let waited = now.since(waiting.since);
        (waited > LET_GO_US && waited < u32::MAX / 2).then_some(waiting.tension)
    }

    /// Whether the cable has not let go, with this tension now.
    #[must_use]
    pub fn holds(&self, tension: Newton, let_go: Newton) -> bool {
        self.waiting.is_some() && tension >= let_go
    }

    /// Ends the watch.
    pub fn forget(&mut self) {
        *self = Self {
            blind: self.blind,
            was_driven: self.was_driven,
            trial: self.trial.filter(|trial| !trial.driven),
            ..Self::default()
        };
    }

    /// A configuration was put in force.
    pub fn configured(&mut self) {
        self.was_driven = false;
    }

    /// Detail of [`Fault::OutputStuck`](crate::Fault::OutputStuck) for this unit.
    #[must_use]
    pub fn detail(unit: UnitIndex, left: Option<Newton>) -> u32 {
        let left = left.map_or(0xFF_FFFF, |tension| milli(tension).min(0xFF_FFFE));
        (unit as u32 + 1) << 24 | left
    }
}
