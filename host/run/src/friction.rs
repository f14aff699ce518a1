//! Friction that the rig file does not declare, where a fault ended a run: to the board a reel that
//! holds its cable at 0 V looks like an output that is stuck.
//!
//! The power tells them apart: the board withholds the alive line, the PLC switches the amplifiers
//! off, and then no motor pulls any more. What a cable still holds is friction, or the power is not
//! gone. Only a person at the supply's switch can tell these two, so nothing is cleared here.

use crate::phase::Observer;
use control::friction::Model;
use control::Fault;
use rig::{Rig, UnitSettings};
use session::{LatchedFault, Session};
use std::time::Duration;
use wire::message::Status;

/// Time after a fault in which fault 15 comes behind it ([`LET_GO_US`], from the end of the DAC's
/// and the filter's delay), alive line, PLC and relay take the power away (10 ms and the relay's),
/// and cable, converter and filter settle for half a second.
///
/// [`LET_GO_US`]: control::let_go::LET_GO_US
const POWER_GONE: Duration = Duration::from_millis(600);
/// How much more tension the proposed settings carry than was seen, as another reversal may show
/// it.
const BEYOND: f64 = 1.05;
/// Steps of the proposed `coulomb_n`, N.
const STEP_N: f64 = 0.05;
/// Most friction that is proposed beyond the declared one, N: what `identify` corrects at most. A
/// cable that is held by more is caught somewhere.
const MOST_N: f64 = 2.0;
/// Settings that carry a tension which friction holds at 0 V.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Carried {
    coulomb_n: f64,
    tension_min_n: f64,
}

/// What a cable must come down to after 0 V, N, with this `coulomb_n`: as the board has it.
fn let_go_n(unit: &UnitSettings, coulomb_n: f64) -> f64 {
    let with = UnitSettings { coulomb_n, ..*unit };
    Model::new(&with.to_wire()).let_go().to_f64()
}

/// The least settings with which the board takes `held_n` at 0 V for friction; `None` where that
/// is more than friction is taken to be.
fn carried(unit: &UnitSettings, held_n: f64) -> Option<Carried> {
    let steps = (MOST_N / STEP_N) as u32;
    let first = (unit.coulomb_n / STEP_N).ceil();
    let coulomb_n = core::iter::once(unit.coulomb_n)
        .chain((0..steps).map(|k| (first + f64::from(k)) * STEP_N))
        .find(|coulomb_n| let_go_n(unit, *coulomb_n) > BEYOND * held_n)?;
    let tension_min_n = (10.0 * (held_n + UnitSettings::AT_LIMIT_N)).ceil() / 10.0;
    Some(Carried {
        coulomb_n,
        tension_min_n: tension_min_n.max(unit.tension_min_n),
    })
}

/// After a run that a fault ended: says what a cable holds once the amplifiers have no power, and
/// with which settings the board takes that for friction, where fault 15 may be that.
///
/// The rig is at 0 V. A link that is lost says nothing.
pub fn tell_of_friction(session: &mut Session<'_>, rig: &Rig, observer: &mut dyn Observer) {
    // Behind a unit's own fault it may still come.
    let stuck =
        |fault: LatchedFault| fault.unit.is_some() || fault.code == Fault::OutputStuck.code();
    let may_be = |status: &Status| LatchedFault::all_of(status).any(stuck);
    if !session.get_status().is_ok_and(|status| may_be(&status)) {
        return;
    }
    let Ok(status) = (session.exchange(POWER_GONE)).and_then(|()| session.get_status()) else {
        return;
    };
    let held = LatchedFault::all_of(&status).find_map(|fault| fault.output_stuck());
    if let Some((i, Some(held_n))) = held {
        if let Some(unit) = rig.units.get(i) {
            let now_n = f64::from(status.units[i].tension_un) * 1e-6;
            observer.notice(&words(unit, held_n, now_n));
        }
    }
}

/// What was seen, what it can be, and what to do.
fn words(unit: &UnitSettings, held_n: f64, now_n: f64) -> String {
    let seen = format!(
        "unit {}: its cable held {held_n:.2} N at 0 V, and holds {now_n:.2} N half a second after the board took the amplifiers' \
         power away.",
        unit.number
    );
    if now_n < let_go_n(unit, unit.coulomb_n) {
        return format!("{seen} Its motor pulled until then, or the robot has come nearer since");
    }
    let friction = match carried(unit, held_n.max(now_n)) {
        Some(Carried {
            coulomb_n,
            tension_min_n,
        }) => format!(
            "the reel has more friction than the rig file declares (it holds {:.2} N): with `coulomb_n = {coulomb_n:.2}` and \
             `tension_min_n = {tension_min_n:.1}` the board takes this for friction, and `forcectl identify` finds its value",
            unit.held_by_friction_n()
        ),
        None => "something else pulls the cable, or the reel or its cable is caught".to_owned(),
    };
    format!(
        "{seen} Switch the amplifiers' supply off, and look at `forcectl status`. If the tension goes, the output is stuck and \
         the PLC has not taken the power away. If it stays, {friction}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The board's own limit, for every unit: what is proposed carries what was seen, and a step
    /// less does not.
    #[test]
    fn the_proposed_settings_are_the_least_that_the_board_takes_for_friction() {
        for unit in &Rig::built_in().unwrap().units {
            let with = |coulomb_n| let_go_n(unit, coulomb_n);
            assert_eq!(carried(unit, 1.5).unwrap().coulomb_n, unit.coulomb_n);
            for held_n in [1.8, 2.24, 3.0, 4.0] {
                let proposed = carried(unit, held_n).unwrap();
                assert!(with(proposed.coulomb_n) > held_n, "{proposed:?}");
                let less = (proposed.coulomb_n - STEP_N).max(unit.coulomb_n);
                assert!(with(less) <= BEYOND * held_n, "{proposed:?} {held_n}");
                assert!(proposed.tension_min_n > held_n);
                assert!(proposed.coulomb_n <= unit.coulomb_n + MOST_N);
            }
            assert_eq!(carried(unit, 8.0), None);
        }
    }

    #[test]
    fn what_is_said_depends_on_what_the_cable_holds_without_power() {
        let unit = &Rig::built_in().unwrap().units[5];
        let stays = words(unit, 2.24, 2.2);
        for part in ["unit 6", "2.24 N", "`coulomb_n = ", "`tension_min_n = 2.6`"] {
            assert!(stays.contains(part), "{stays}");
        }
        let goes = words(unit, 2.24, 0.4);
        assert!(goes.contains("Its motor pulled until then"), "{goes}");
        assert!(!goes.contains("coulomb_n"), "{goes}");
        let caught = words(unit, 9.0, 9.0);
        assert!(
            caught.contains("caught") && !caught.contains("coulomb_n"),
            "{caught}"
        );
    }
}
