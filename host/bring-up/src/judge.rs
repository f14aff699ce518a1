//! From what was measured to named mistakes. Pure: the same figures give the same names.
//!
//! What a hand does names encoders and load cells. What a pulse moves is then known by the reel and
//! not by the plug, so that exchanged motors are told from exchanged encoders. Without hands the
//! load cells help; where nothing tells them apart, both are named.

use crate::figures::{
    ConverterFigures, EStopFigures, Figures, LoadLine, MotorFigures, PowerFigures, PullFigures,
    PulseFigures, TensionFigures,
};
use crate::mistake::{Mistake, Named, Sure};
use crate::pulse::{ANSWER_M, ANSWER_N, TIGHT_N, TURNED_M};
use crate::steps::Test;
use control::Fault;
use rig::{Rig, UnitSettings};
use wire::message::Pull;
use wire::UNITS;

/// Part of the travel that a hand pulled from which an encoder has counted it: half the lines at
/// half the decoding are a quarter.
const COUNTED: f64 = 0.1;
/// How far the counted travel may be from the pulled one: a ruler read to 1 mm at both ends of 200
/// mm, less than half of what 1,024 lines in place of 1,000 make.
const TRAVEL_SHARE: f64 = 0.011;
/// Lines that encoders have.
const LINES: [u32; 6] = [250, 256, 500, 512, 1_024, 2_000];
/// Lines of the rig's encoders.
const NOMINAL_LINES: f64 = 1_000.0;
/// Force on a load cell that a hand gives at least, N: the friction of a reel is 0.9.
const HAND_N: f64 = 0.4;
/// How far a cell of nominal gain may be from a known weight: cells spread by 4 % (one standard
/// deviation).
const WEIGHT_SHARE: f64 = 0.16;
/// Noise above which a load cell is disturbed, N: ten times the rig's 1.5 mN.
const NOISE_N: f64 = 0.015;
/// Amplitude of a tone that is disturbing, N: its 5 mN RMS are the noise of the worst idle channel
/// of the real rig.
const TONE_N: f64 = 0.007;
/// Failed reads of all from which something is wrong: one in 640 may be chance.
const FAILED_SHARE: f64 = 0.002;
/// Conversions missed of those that were read from which something is wrong.
const MISSED_SHARE: f64 = 0.002;
/// Sample rates of a sound converter: 320 with its oscillator's 3 %.
const RATE_SPS: std::ops::RangeInclusive<f64> = 308.0..=332.0;
/// Ratio of the gain found to the right one that is named: the middle between 1 and 2. Friction
/// differs by 5 to 8 %, the command is known to a step of 0.1 N.
const GAIN: f64 = std::f64::consts::SQRT_2;
/// The same from which it is certain. A line has no more than its slope: friction that takes 0.4 of
/// the tension in place of 0.15 makes 0.7 of it, and so did a breakaway of 1.3 on the plant. No
/// cable loses half.
const SURE_GAIN: f64 = 1.65;
/// Friction without tension as a share of the rig file's that is in order. It differs between units
/// by 7 % (one standard deviation), and the line finds it to some percent.
const FRICTION: std::ops::RangeInclusive<f64> = 0.7..=1.3;
/// Delay of a chirp on a rig in order, s: on the plant 10.5 to 11.6 ms, of which the converter's
/// filter makes 6.
const DELAY_S: f64 = 0.0111;
/// Delay beyond that which is named, s.
const LATE_S: f64 = 2.0e-3;

/// The mistakes, the surest first.
#[must_use]
pub fn judge(rig: &Rig, figures: &Figures) -> Vec<Named> {
    let mut found = Vec::new();
    board(figures, &mut found);
    converters(&figures.converters, &mut found);
    let hands = Hands::of(rig, figures);
    hands.name(rig, figures, &mut found);
    channels(&mut found);
    counters(&mut found);
    weights(figures, &hands, &mut found);
    power(figures, &mut found);
    motors(rig, figures, &hands, &mut found);
    tension(rig, figures, &mut found);
    found.sort_by_key(|named| named.sure);
    found
}

fn number(unit: usize) -> u8 {
    unit as u8 + 1
}

fn certain(mistake: Mistake, evidence: impl Into<String>) -> Named {
    Named {
        mistake,
        sure: Sure::Certain,
        evidence: evidence.into(),
    }
}

fn board(figures: &Figures, found: &mut Vec<Named>) {
    if let Some(board) = &figures.board {
        if !board.hse {
            found.push(certain(Mistake::NoClock, "the board says so at its start"));
        }
        if board.brown_out_level != wire::message::BoardInfo::BROWN_OUT_LEVEL {
            let level = board.brown_out_level;
            found.push(certain(Mistake::BrownOutLevel { level }, "FLASH_OPTSR"));
        }
        let told = "its level at the start, with the controller's own pull-up and pull-down";
        match board.dac_reset_pull {
            Pull::Down => {}
            Pull::None => found.push(certain(Mistake::DacResetPull { up: false }, told)),
            Pull::Up => found.push(certain(Mistake::DacResetPull { up: true }, told)),
        }
        // The E-stop's own test says what is wrong with it.
        let wrong = |estop: &EStopFigures| estop.closed_pressed || !estop.closed_released;
        let named = board.fault == Fault::EStop.code() && figures.estop.as_ref().is_some_and(wrong);
        if !named && board.fault != 0 && board.fault != Fault::SetpointsExpired.code() {
            let fault = board.fault;
            found.push(certain(Mistake::BoardFault { fault }, "the board's status"));
        }
    }
    if let Some(estop) = &figures.estop {
        let told = format!(
            "loop closed before, pressed, released: {}, {}, {}",
            estop.closed_before, estop.closed_pressed, estop.closed_released
        );
        match (estop.closed_pressed, estop.closed_released) {
            (true, true) => found.push(certain(Mistake::EStopNotRead, told)),
            (true, false) => found.push(certain(Mistake::EStopInverted, told)),
            (false, false) => found.push(certain(Mistake::EStopOpen, told)),
            (false, true) => {}
        }
    }
}

fn converters(converters: &[Option<ConverterFigures>; UNITS], found: &mut Vec<Named>) {
    let measured =
        || (converters.iter().enumerate()).filter_map(|(i, found)| Some((i, found.as_ref()?)));
    // Whose DRDY a unit misses, where it misses another's.
    let mut wired: [usize; UNITS] = std::array::from_fn(|i| i);
    for (i, converter) in measured() {
        let others: Vec<usize> = (0..UNITS)
            .filter(|j| *j != i && converter.silenced[*j])
            .collect();
        if let [other] = others.as_slice() {
            wired[*other] = i;
        }
    }
    for units in cycles(&wired) {
        found.push(certain(
            Mistake::DrdyExchanged { units },
            "one converter was started anew, and another unit went silent",
        ));
    }
    for (i, converter) in measured() {
        let unit = number(i);
        let detail = converter.fault_detail;
        let fault = Fault::from_code(converter.fault);
        if fault == Some(Fault::BringUpFailed) && detail >> 8 == 7 {
            found.push(certain(
                Mistake::DrdyDead { unit },
                "registers are right, and no edge came",
            ));
        } else if converter.fault != 0 {
            let fault = converter.fault;
            let silent = Mistake::ConverterSilent {
                unit,
                fault,
                detail,
            };
            found.push(certain(silent, "the unit's fault"));
        }
        if !converter.works() || wired[i] != i {
            continue;
        }
        let told = |what: &str| {
            format!(
                "{} samples in {:.1} s, {what}",
                converter.samples, converter.seconds
            )
        };
        let sps = f64::from(converter.samples.saturating_sub(1)) / converter.seconds.max(1e-9);
        if f64::from(converter.missed) > MISSED_SHARE * f64::from(converter.samples) {
            let missed = converter.missed;
            found.push(certain(
                Mistake::SamplesMissed { unit, missed },
                told("conversions that nobody read"),
            ));
        } else if converter.seconds > 1.0 && !RATE_SPS.contains(&sps) {
            found.push(certain(
                Mistake::Rate { unit, sps },
                told("a sound one gives 310 to 330 a second"),
            ));
        }
        if f64::from(converter.failed_reads) > FAILED_SHARE * f64::from(converter.samples) {
            let failed = converter.failed_reads;
            found.push(certain(
                Mistake::FailedReads { unit, failed },
                told("with these repetitions"),
            ));
        }
        let (samples, seconds) = (converter.samples, converter.seconds);
        let told = format!("{samples} samples in {seconds:.1} s, slack cables");
        noise(unit, converter, told, found);
    }
    // A converter at fault explains it.
    let recoveries = measured().map(|(_, converter)| converter.recoveries).max();
    let named = |named: &Named| named.mistake.test() == Test::Converters;
    if let Some(recoveries) = recoveries.filter(|count| *count > 0 && !found.iter().any(named)) {
        found.push(certain(
            Mistake::BusRecoveries { recoveries },
            "the board's count while nothing moved",
        ));
    }
}

/// Names what disturbs the signal of a cell at rest.
fn noise(unit: u8, converter: &ConverterFigures, told: String, found: &mut Vec<Named>) {
    let (hz, amplitude_n) = (converter.tone_hz, converter.tone_n);
    let mut noise_n = converter.noise_n;
    if amplitude_n > TONE_N {
        let tone = Mistake::Tone {
            unit,
            hz,
            amplitude_n,
        };
        found.push(certain(tone, told.clone()));
        // What it leaves of the noise.
        noise_n = (noise_n.powi(2) - 0.5 * amplitude_n.powi(2))
            .max(0.0)
            .sqrt();
    }
    if noise_n > NOISE_N {
        found.push(certain(Mistake::Noise { unit, noise_n }, told));
    }
}

/// Cycles of a permutation, as numbers of units; those that stay are left out.
fn cycles(of: &[usize; UNITS]) -> Vec<Vec<u8>> {
    let mut seen = [false; UNITS];
    let mut found = Vec::new();
    for start in 0..UNITS {
        let mut cycle = Vec::new();
        let mut at = start;
        while !std::mem::replace(&mut seen[at], true) {
            cycle.push(number(at));
            at = of[at];
        }
        if cycle.len() > 1 {
            cycle.sort_unstable();
            found.push(cycle);
        }
    }
    found
}

/// What hands have shown.
struct Hands {
    /// Counter at which each reel's encoder is plugged in, and the travel that it counted per
    /// travel of the cable, positive where winding in counts as winding in. `None`: none counted,
    /// or nobody pulled.
    encoder: [Option<(usize, f64)>; UNITS],
    /// Converter at which each unit's cell is, and its force, N.
    cell: [Option<(usize, f64)>; UNITS],
    pulled: [bool; UNITS],
}

impl Hands {
    fn of(rig: &Rig, figures: &Figures) -> Self {
        let mut hands = Self {
            encoder: [None; UNITS],
            cell: [None; UNITS],
            pulled: [false; UNITS],
        };
        for (i, pull) in figures.pulls.iter().enumerate() {
            let Some(pull) = pull else { continue };
            hands.pulled[i] = true;
            hands.encoder[i] = counted(rig, pull);
            hands.cell[i] = strongest(&pull.cell_n).filter(|(_, force_n)| force_n.abs() >= HAND_N);
        }
        hands
    }

    /// The reel whose encoder is plugged in at this counter.
    fn reel_at(&self, counter: usize) -> Option<usize> {
        (0..UNITS).find(|reel| self.encoder[*reel].is_some_and(|(at, _)| at == counter))
    }

    fn name(&self, rig: &Rig, figures: &Figures, found: &mut Vec<Named>) {
        let place = |at: &[Option<(usize, f64)>; UNITS]| -> [usize; UNITS] {
            std::array::from_fn(|i| at[i].map_or(i, |(at, _)| at))
        };
        let encoders = place(&self.encoder);
        if is_permutation(&encoders) {
            for units in cycles(&encoders) {
                let told = "a cable was pulled out, and another unit's encoder counted";
                found.push(certain(Mistake::EncodersExchanged { units }, told));
            }
        }
        let cells = place(&self.cell);
        if is_permutation(&cells) {
            for units in cycles(&cells) {
                let told = "a cable was pulled, and another unit's load cell answered";
                found.push(certain(Mistake::CellsExchanged { units }, told));
            }
        }
        for i in (0..UNITS).filter(|i| self.pulled[*i]) {
            let unit = number(i);
            let mm = figures.pulls[i].map_or(0.0, |pull| 1e3 * pull.travel_m);
            match self.encoder[i] {
                None => found.push(certain(
                    Mistake::EncoderDead { unit },
                    format!("{mm:.0} mm of cable were pulled out, and no encoder counted"),
                )),
                Some((at, ratio)) => self.scale(rig, i, at, ratio, mm, found),
            }
            match self.cell[i] {
                None => found.push(certain(
                    Mistake::CellDead { unit },
                    "the cable was pulled, and no load cell answered",
                )),
                Some((_, force_n)) if force_n < 0.0 => found.push(certain(
                    Mistake::CellSign { unit },
                    format!("it read {force_n:.2} N when the cable was pulled"),
                )),
                Some(_) => {}
            }
        }
    }

    /// Names sign and scale of the encoder of reel `i`.
    fn scale(&self, _rig: &Rig, i: usize, at: usize, ratio: f64, mm: f64, found: &mut Vec<Named>) {
        let unit = number(i);
        let told = format!(
            "{mm:.0} mm of cable were pulled out, and encoder {} counted {:.1} mm of {}",
            number(at),
            (ratio * mm).abs(),
            if ratio > 0.0 {
                "paying out"
            } else {
                "winding in"
            }
        );
        if ratio < 0.0 {
            found.push(certain(Mistake::EncoderSign { unit }, told.clone()));
        }
        let size = ratio.abs();
        if (size - 1.0).abs() <= TRAVEL_SHARE {
            return;
        }
        let lines = LINES
            .into_iter()
            .find(|lines| (size * NOMINAL_LINES / f64::from(*lines) - 1.0).abs() <= TRAVEL_SHARE);
        found.push(certain(
            match lines {
                Some(lines) => Mistake::EncoderLines { unit, lines },
                None => Mistake::EncoderScale { unit, ratio: size },
            },
            told,
        ));
    }
}

fn is_permutation(of: &[usize; UNITS]) -> bool {
    (0..UNITS).all(|i| of.contains(&i))
}

fn strongest(values: &[f64; UNITS]) -> Option<(usize, f64)> {
    let found = values.iter().copied().enumerate();
    found.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
}

/// The counter that counted a pull, and what it counted per travel, positive where the sign is
/// right.
fn counted(rig: &Rig, pull: &PullFigures) -> Option<(usize, f64)> {
    let ratio: [f64; UNITS] = std::array::from_fn(|i| {
        -f64::from(pull.counts[i]) * rig.units[i].travel_m_per_count / pull.travel_m
    });
    strongest(&ratio).filter(|(_, ratio)| ratio.abs() >= COUNTED)
}

fn weights(figures: &Figures, hands: &Hands, found: &mut Vec<Named>) {
    let mut place: [usize; UNITS] = std::array::from_fn(|i| i);
    for (i, weight) in figures.weights.iter().enumerate() {
        let Some(weight) = weight else { continue };
        let unit = number(i);
        let answer = strongest(&weight.cell_n).filter(|(_, n)| n.abs() >= 0.1 * weight.weight_n);
        let told = |force_n: f64| {
            format!(
                "{:.2} N hung on it, and it read {force_n:.2} N",
                weight.weight_n
            )
        };
        match answer {
            None if !hands.pulled[i] => {
                found.push(certain(Mistake::CellDead { unit }, told(0.0)));
            }
            None => {}
            Some((at, force_n)) => {
                place[i] = at;
                if force_n < 0.0 && !hands.pulled[i] {
                    found.push(certain(Mistake::CellSign { unit }, told(force_n)));
                }
                let ratio = force_n.abs() / weight.weight_n;
                if (ratio - 1.0).abs() > WEIGHT_SHARE {
                    found.push(certain(Mistake::CellScale { unit, ratio }, told(force_n)));
                }
            }
        }
    }
    let known = hands.pulled.iter().all(|pulled| *pulled);
    if !known && is_permutation(&place) {
        for units in cycles(&place) {
            let told = "a weight hung on one unit, and another's cell answered";
            found.push(certain(Mistake::CellsExchanged { units }, told));
        }
    }
}

/// A converter whose DRDY and whose load cell both seem to be another's is itself at the other's
/// place.
fn channels(found: &mut Vec<Named>) {
    let drdy: Vec<Vec<u8>> = (found.iter())
        .filter_map(|named| match &named.mistake {
            Mistake::DrdyExchanged { units } => Some(units.clone()),
            _ => None,
        })
        .collect();
    for units in drdy {
        let cells = Mistake::CellsExchanged {
            units: units.clone(),
        };
        if !found.iter().any(|named| named.mistake == cells) {
            continue;
        }
        let drdy = Mistake::DrdyExchanged {
            units: units.clone(),
        };
        found.retain(|named| named.mistake != cells && named.mistake != drdy);
        let told = "one converter was started anew, and the other unit's DRDY line went silent; their load cells answered for each other too";
        found.push(certain(Mistake::ChannelsExchanged { units }, told));
    }
}

/// Two encoders of one counter that do not count are the counter.
fn counters(found: &mut Vec<Named>) {
    for chip in 1..=UNITS as u8 / 2 {
        let units = [2 * chip - 1, 2 * chip];
        let dead = |named: &Named, unit| named.mistake == Mistake::EncoderDead { unit };
        if units.map(|unit| found.iter().any(|named| dead(named, unit))) != [true; 2] {
            continue;
        }
        found.retain(|named| !units.into_iter().any(|unit| dead(named, unit)));
        let told = "both cables were pulled out, and no encoder counted";
        found.push(certain(Mistake::CounterDead { chip }, told));
    }
}

/// What moved or was lit although it must not.
fn power(figures: &Figures, found: &mut Vec<Named>) {
    let Some(power) = &figures.power else { return };
    let tested: Vec<usize> = (0..UNITS)
        .filter(|i| (power.unplugged[*i].as_ref()).is_some_and(|motor| !motor.pulses.is_empty()))
        .collect();
    let moved: Vec<u8> = (tested.iter())
        .filter(|i| power.unplugged[**i].as_ref().is_some_and(answers))
        .map(|i| number(*i))
        .collect();
    e_stop_in_power(power, found);
    let lit = power.lit_unplugged == Some(true);
    let units: Vec<String> = moved.iter().map(u8::to_string).collect();
    let told = if moved.is_empty() {
        "the lamps said so".to_owned()
    } else {
        let units = units.join(", ");
        format!("pulses moved units {units} while the alive line was unplugged")
    };
    let bridged = match power.lit_ready {
        Some(false) => Mistake::RelayInverted,
        _ => Mistake::RelayBridged,
    };
    let bypassed = Mistake::RelayBypassed {
        units: moved.clone(),
    };
    if lit || (tested.len() > 1 && moved.len() == tested.len()) {
        found.push(certain(bridged, told));
    } else if !moved.is_empty() && tested.len() == 1 && power.lit_unplugged.is_none() {
        // One unit alone, and nobody has looked: it may be all of them.
        let told = format!("{told}; no other unit was tested, and nobody looked at the lamps");
        for mistake in [bypassed, bridged] {
            found.push(Named {
                mistake,
                sure: Sure::Likely,
                evidence: told.clone(),
            });
        }
    } else if !moved.is_empty() {
        found.push(certain(bypassed, told));
    } else if power.lit_ready == Some(false) && power.alive_withheld != Some(true) {
        found.push(certain(
            Mistake::NoPower,
            "no lamp was lit, with every unit ready and the E-stop released",
        ));
    }
    if power.lit_pressed == Some(true) && !lit && moved.is_empty() {
        found.push(certain(Mistake::EStopNotAtPlc, "the lamps said so"));
    }
}

/// What the board saw of the E-stop while the power was tested.
fn e_stop_in_power(power: &PowerFigures, found: &mut Vec<Named>) {
    let mut name = |mistake: Mistake, told: &str| {
        if !found.iter().any(|named| named.mistake == mistake) {
            found.push(certain(mistake, told));
        }
    };
    if power.closed_pressed == Some(true) {
        name(
            Mistake::EStopNotRead,
            "test `power`: the board saw its loop closed with the button pressed",
        );
    }
    if power.closed_released == Some(false) {
        name(
            Mistake::EStopOpen,
            "test `power`: the board saw its loop open with the button released",
        );
    }
}

/// Whether pulses moved something: the strongest turned a reel or tightened a cable, or two of them
/// showed something.
fn answers(motor: &MotorFigures) -> bool {
    let most = |values: &[f64; UNITS]| values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let clear =
        |pulse: &PulseFigures| most(&pulse.travel_m) >= TURNED_M || most(&pulse.cell_n) >= TIGHT_N;
    let some = |pulse: &&PulseFigures| {
        most(&pulse.travel_m) >= ANSWER_M || most(&pulse.cell_n) >= ANSWER_N
    };
    motor.pulses.iter().any(clear) || motor.pulses.iter().filter(some).count() >= 2
}

/// What a motor's pulses moved.
enum Moved {
    Nothing,
    /// The counter, and the pulse.
    One(usize, PulseFigures),
    /// Several counters at once.
    Several(Vec<usize>),
}

fn moved(motor: &MotorFigures) -> Moved {
    let Some(last) = motor.pulses.last() else {
        return Moved::Nothing;
    };
    let most = strongest(&last.travel_m).map_or(0.0, |(_, m)| m.abs());
    let counters: Vec<usize> = (0..UNITS)
        .filter(|i| last.travel_m[*i].abs() >= ANSWER_M.max(0.3 * most))
        .collect();
    match counters.as_slice() {
        [] => Moved::Nothing,
        [one] => Moved::One(*one, *last),
        several => Moved::Several(several.to_vec()),
    }
}

fn motors(rig: &Rig, figures: &Figures, hands: &Hands, found: &mut Vec<Named>) {
    let tested = || (0..UNITS).filter_map(|i| Some((i, figures.motors[i].as_ref()?)));
    let mut place: [usize; UNITS] = std::array::from_fn(|i| i);
    let mut dead = Vec::new();
    for (i, motor) in tested() {
        let unit = number(i);
        if let (Some(why), true) = (&motor.refused, motor.pulses.is_empty()) {
            let why = why.clone();
            found.push(certain(
                Mistake::NotDriven { unit, why },
                "the board's answer to arming",
            ));
            continue;
        }
        if motor.fault != 0 && matches!(moved(motor), Moved::Nothing) {
            let why = session::explain_fault(motor.fault, 0);
            found.push(certain(
                Mistake::NotDriven { unit, why },
                "a pulse ended with this fault",
            ));
            continue;
        }
        let cell = motor
            .pulses
            .last()
            .and_then(|pulse| strongest(&pulse.cell_n));
        let cell = cell.filter(|(_, force_n)| force_n.abs() >= ANSWER_N);
        match moved(motor) {
            Moved::Several(units) => {
                let units = units.into_iter().map(number).collect();
                found.push(certain(
                    Mistake::SelectsTied { motor: unit, units },
                    "one motor was commanded, and several reels moved",
                ));
            }
            Moved::Nothing => match (cell, motor.pulses.last()) {
                (Some((at, _)), Some(pulse)) => {
                    let reel = reel_of_cell(hands, at);
                    place[i] = reel;
                    match hands.encoder[reel] {
                        Some((counter, _)) => one(rig, hands, i, counter, reel, pulse, found),
                        // The motor pulls, and its encoder does not count.
                        None if hands.pulled[reel] => {}
                        None => found.push(certain(
                            Mistake::EncoderDead { unit: number(reel) },
                            "its cable got tighter, and no encoder counted",
                        )),
                    }
                }
                _ => dead.push(i),
            },
            Moved::One(counter, pulse) => {
                place[i] = match (hands.reel_at(counter), cell) {
                    (Some(reel), _) => reel,
                    // Nobody pulled: the load cell says which cable got tight.
                    (None, Some((at, _))) => reel_of_cell(hands, at),
                    (None, None) => counter,
                };
                one(rig, hands, i, counter, place[i], &pulse, found);
            }
        }
    }
    exchanged(figures, hands, &place, &dead, found);
    // A reel without an encoder does not answer, whatever its motor does.
    let silent: Vec<usize> = dead
        .iter()
        .copied()
        .filter(|i| !(hands.pulled[*i] && hands.encoder[*i].is_none()))
        .collect();
    if silent.len() == tested().count() && silent.len() > 1 {
        let told = "no encoder and no load cell answered any motor's pulses";
        // Without power there is one more cause, and `power` has named it.
        let lit = figures.power.as_ref().and_then(|power| power.lit_ready);
        if lit != Some(false) {
            found.push(certain(Mistake::AllMotorsDead, told));
        }
        if lit == Some(true) {
            found.push(Named {
                mistake: Mistake::NoCommand,
                sure: Sure::Likely,
                evidence: format!("{told}, and the amplifiers show power"),
            });
        }
        return;
    }
    for i in silent {
        let unit = number(i);
        let by_hand = hands.encoder[i].is_some();
        // Words for a DAC whose select is tied may be another's.
        let tied = found.iter().any(|named| {
            matches!(&named.mistake, Mistake::SelectsTied { units, .. } if units.contains(&unit))
        });
        let sure = if by_hand && !tied {
            Sure::Certain
        } else {
            Sure::Likely
        };
        let most_n = figures.motors[i]
            .as_ref()
            .and_then(|motor| motor.pulses.last());
        let evidence = format!(
            "pulses up to {:.1} N moved nothing",
            most_n.map_or(0.0, |pulse| pulse.command_n)
        );
        if !by_hand {
            found.push(Named {
                mistake: Mistake::EncoderDead { unit },
                sure: Sure::Likely,
                evidence: format!("{evidence}; nobody has pulled its cable"),
            });
        }
        found.push(Named {
            mistake: Mistake::MotorDead { unit },
            sure,
            evidence,
        });
    }
}

fn reel_of_cell(hands: &Hands, converter: usize) -> usize {
    let reel = (0..UNITS).find(|reel| hands.cell[*reel].is_some_and(|(at, _)| at == converter));
    reel.unwrap_or(converter)
}

/// Names what a pulse of motor `i` shows that turned one reel, whose encoder is at `counter`.
fn one(
    rig: &Rig,
    hands: &Hands,
    i: usize,
    counter: usize,
    reel: usize,
    pulse: &PulseFigures,
    found: &mut Vec<Named>,
) {
    let travel_m = pulse.travel_m[counter];
    // By hand it is known which way the counts go.
    let by_hand = hands.encoder[reel].map_or(1.0, |(_, ratio)| ratio.signum());
    let told = format!(
        "a pulse of {:.1} N moved it by {:.0} um",
        pulse.command_n,
        travel_m * by_hand * 1e6
    );
    if travel_m * by_hand < 0.0 {
        let unit = number(i);
        if hands.encoder[reel].is_some() {
            found.push(certain(Mistake::MotorSign { unit }, told.clone()));
        } else {
            for mistake in [
                Mistake::EncoderSign { unit: number(reel) },
                Mistake::MotorSign { unit },
            ] {
                let named = Named {
                    mistake,
                    sure: Sure::Likely,
                    evidence: told.clone(),
                };
                found.push(named);
            }
        }
    }
    if travel_m.abs() >= TURNED_M || pulse.cell_n.iter().any(|n| n.abs() >= TIGHT_N) {
        let ratio = turning_n(&rig.units[reel], pulse.cell_n[reel]) / pulse.command_n;
        if !(1.0 / GAIN..=GAIN).contains(&ratio) {
            gain_or_friction(number(i), number(reel), ratio, &told, found);
        }
    } else {
        // The strongest pulse moved it no further than its contact gives way.
        let ratio = turning_n(&rig.units[reel], 0.0) / pulse.command_n;
        gain_or_friction(number(i), number(reel), ratio, &told, found);
    }
}

/// A reel that turns at another command than it should: its amplifier or its friction. `tension`
/// tells which.
fn gain_or_friction(unit: u8, reel: u8, ratio: f64, told: &str, found: &mut Vec<Named>) {
    let friction = Mistake::Friction {
        unit: reel,
        ratio: 1.0 / ratio,
    };
    for mistake in [Mistake::AmplifierGain { unit, ratio }, friction] {
        found.push(Named {
            mistake,
            sure: Sure::Likely,
            evidence: told.to_owned(),
        });
    }
}

/// Names what a cable under tension shows, in place of what pulses could not tell apart.
fn tension(rig: &Rig, figures: &Figures, found: &mut Vec<Named>) {
    for (i, tension) in figures.tension.iter().enumerate() {
        let Some(tension) = tension else { continue };
        let unit = number(i);
        if let Some(why) = &tension.refused {
            let why = why.clone();
            found.push(certain(
                Mistake::NotLoaded { unit, why },
                "the board's answer to arming",
            ));
            continue;
        }
        if tension.fault != 0 {
            let why = session::explain_fault(tension.fault, 0);
            let told = "the cable's load ended with this fault";
            found.push(certain(Mistake::NotLoaded { unit, why }, told));
        }
        if let Some(line) = &tension.line {
            found.retain(|named| match named.mistake {
                Mistake::AmplifierGain { unit: of, .. } | Mistake::Friction { unit: of, .. } => {
                    of != unit
                }
                _ => true,
            });
            name_line(unit, shares(&rig.units[i], line), line, found);
        } else if tension.fault == 0 && !found.iter().any(|named| is_weak(&named.mistake, unit)) {
            not_loaded(&rig.units[i], unit, tension, found);
        }
        if let Some(late_s) = tension.delay_s.map(|delay_s| delay_s - DELAY_S) {
            if late_s > LATE_S {
                let ms = 1e3 * late_s;
                // Friction, presliding and a softer cable shift the phase as well: by 2 to 7 ms
                // where the plant's friction is a third more, or its cable a seventh as stiff.
                found.push(Named {
                    mistake: Mistake::Delay { unit, ms },
                    sure: Sure::Likely,
                    evidence: format!(
                        "a chirp came {:.1} ms after the DAC's word; friction or a cable unlike the rig file's delays it too",
                        1e3 * (late_s + DELAY_S)
                    ),
                });
            }
        }
    }
}

/// Names why a cable was not loaded enough.
fn not_loaded(settings: &UnitSettings, unit: u8, tension: &TensionFigures, found: &mut Vec<Named>) {
    let wound_mm = 1e3 * tension.wound_m.max(0.0);
    let told = format!(
        "the load cell read {:.2} N at most, after {wound_mm:.1} mm",
        tension.most_n
    );
    let ratio = tension
        .idle_n
        .map(|idle_n| turning_n(settings, 0.0) / idle_n);
    match ratio.filter(|ratio| !(1.0 / GAIN..=GAIN).contains(ratio)) {
        Some(ratio) => gain_or_friction(unit, unit, ratio, &told, found),
        None if tension.tight => found.push(certain(Mistake::NotLoose { unit }, told)),
        None => found.push(certain(Mistake::NotTight { unit, wound_mm }, told)),
    }
}

/// Whether pulses have named a unit's amplifier as too weak for its friction: the command does not
/// load its cable then.
fn is_weak(mistake: &Mistake, unit: u8) -> bool {
    matches!(mistake, Mistake::AmplifierGain { unit: of, ratio } if *of == unit && *ratio < 1.0)
}

/// Gain and friction that a line shows, as shares of the rig file's.
fn shares(unit: &UnitSettings, line: &LoadLine) -> (f64, f64) {
    let gain = line.gain() / (unit.friction_gain - unit.coulomb_per_n).max(0.1);
    (gain, line.idle_n / turning_n(unit, 0.0).max(0.1))
}

fn name_line(unit: u8, (gain, friction): (f64, f64), line: &LoadLine, found: &mut Vec<Named>) {
    let told = format!(
        "{:.2} N turned the reel with a slack cable, and {:.2} N gave it {:.2} N of tension",
        line.idle_n, line.command_n, line.reading_n
    );
    let outside = |limit: f64| !(1.0 / limit..=limit).contains(&gain);
    if outside(SURE_GAIN) {
        found.push(certain(Mistake::AmplifierGain { unit, ratio: gain }, told));
    } else if outside(GAIN) {
        gain_or_friction(unit, unit, gain, &told, found);
    } else if !FRICTION.contains(&friction) {
        let ratio = friction;
        found.push(certain(Mistake::Friction { unit, ratio }, told));
    }
}

/// Command at which a reel of the rig file's friction turns, with this tension in its cable, N. On
/// the plant the first pulse that turns it by [`TURNED_M`] is within 20 % of it.
fn turning_n(unit: &UnitSettings, tension_n: f64) -> f64 {
    let holds_n = tension_n.max(0.0) + unit.coulomb_n - unit.friction_offset_n;
    holds_n / (unit.friction_gain - unit.coulomb_per_n).max(0.1)
}

/// Names exchanged motors; where no hand has shown the encoders, exchanged encoders too.
fn exchanged(
    figures: &Figures,
    hands: &Hands,
    place: &[usize; UNITS],
    dead: &[usize],
    found: &mut Vec<Named>,
) {
    let mut place = *place;
    // The encoder of one of two exchanged motors may be dead: the other one tells.
    for i in dead {
        if let Some(other) = (0..UNITS).find(|j| place[*j] == *i && j != i) {
            place[*i] = other;
        }
    }
    if is_permutation(&place) {
        for units in cycles(&place) {
            let shown = units
                .iter()
                .all(|unit| hands.encoder[usize::from(*unit) - 1].is_some());
            let told = "one motor was commanded, and another unit's reel moved";
            if !shown {
                found.push(Named {
                    mistake: Mistake::EncodersExchanged {
                        units: units.clone(),
                    },
                    sure: Sure::Likely,
                    evidence: format!("{told}; nobody has pulled the cables"),
                });
            }
            found.push(Named {
                mistake: Mistake::MotorsExchanged { units },
                sure: if shown { Sure::Certain } else { Sure::Likely },
                evidence: told.to_owned(),
            });
        }
    }
    // Encoders that moved at another place although the cable of their own got tight.
    let mut encoders: [usize; UNITS] = std::array::from_fn(|i| i);
    for i in 0..UNITS {
        if let Some(Moved::One(counter, _)) = figures.motors[i].as_ref().map(moved) {
            if !hands.pulled[i] && place[i] == i {
                encoders[i] = counter;
            }
        }
    }
    if is_permutation(&encoders) {
        for units in cycles(&encoders) {
            let told = "a cable got tight, and another unit's encoder counted";
            found.push(certain(Mistake::EncodersExchanged { units }, told));
        }
    }
}
