//! The page docs/residual/closed-loop.md.

use crate::effect::{Effects, Kind};
use crate::options::Options;
use crate::table::{Cost, Kinds, HEAD};

/// Why a kind has its result, printed only where it has it.
const NOTES: [(Kind, Cost, &str); 10] = [
    (
        Kind::Changing,
        Cost::Left,
        "*Friction that changes*: what is found is right for the time of the recorded session and wrong for the others. The report says by how much friction \
         changed meanwhile ([a longer look](identify.md#on-rigs-with-undeclared-effects)).",
    ),
    (
        Kind::Scatter,
        Cost::None,
        "*Scatter* of this size costs the loops little.",
    ),
    (
        Kind::Backlash,
        Cost::None,
        "*Backlash* has no effect: a cable under tension keeps its gear on one flank, so the play is never crossed.",
    ),
    (
        Kind::Creep,
        Cost::Left,
        "*Creep* is an error of the measurement. The loop holds what the cells say; weights measure it and the board takes it out \
         ([guide](../calibration.md)).",
    ),
    (
        Kind::CellCurve,
        Cost::Left,
        "A *curve of the cells* is an error of the measurement as well, with the same remedy.",
    ),
    (
        Kind::Viscous,
        Cost::None,
        "*Viscous friction* damps reel and cable: where it costs the loop nothing, a correction can't help.",
    ),
    (
        Kind::LoadFriction,
        Cost::WonBack,
        "*Friction in proportion to the pull* is drawn as that of one more guide, a quarter turn at a friction coefficient of 0.10 \
         to 0.14. `--size 0.5` halves all sizes ([what that cost](identify.md#on-rigs-with-undeclared-effects)).",
    ),
    (
        Kind::Stiffness,
        Cost::Left,
        "*Stiffness*: with open loops the tension follows the command over a stiff cable as over a soft one, and a rig file has no \
         stiffness. A stiffer cable costs, as the gains are for 24 N/mm: [which gain takes it back](identify.md#cables-of-another-stiffness).",
    ),
    (
        Kind::Stiffness,
        Cost::None,
        "*A softer cable* costs nothing: the loops are calmer with it.",
    ),
    (
        Kind::CellTilt,
        Cost::Left,
        "*Misalignment of a cell* is an error of the measurement that goes with the cable's direction, which is not among the \
         columns of the recording. The axis in the rig file corrects it, and `forcectl calibrate geometry` measures it: last column, worst cable and tip.",
    ),
];

/// The page docs/residual/closed-loop.md.
pub fn page(options: &Options, rows: &str, kinds: &Kinds) -> String {
    let (first, last) = (*options.seeds.start(), *options.seeds.end());
    let Kinds {
        better,
        back,
        left,
        harmless,
        stopped,
        failed,
    } = kinds;
    let failed = match failed.as_slice() {
        [] => String::new(),
        kinds => format!(
            "
Kinds with which the command ended without a result, in a row at least: {}. Nothing was corrected there
([faults 46 and 15](identify.md#on-rigs-with-undeclared-effects)).
",
            names(kinds)
        ),
    };
    let stopped = match stopped.as_slice() {
        [] => String::new(),
        kinds => format!(
            "
Kinds with which the board gave up units also with open loops, as their tension was implausible (fault 45, [safety](../safety.md)): {}.
Such a drive is to be put right before anything is identified; `--size 0.5` halves all sizes.
",
            names(kinds)
        ),
    };
    let notes: String = NOTES
        .iter()
        .filter(|(kind, of, _)| match of {
            Cost::None => harmless.contains(kind),
            Cost::WonBack => back.contains(kind),
            Cost::Left => left.contains(kind),
        })
        .map(|(_, _, note)| format!("* {note}\n"))
        .collect();
    let size = if options.size < 1.0 {
        format!(" --size {}", options.size)
    } else {
        String::new()
    };
    let (link, firmware) = match options.link.as_str() {
        "fast" => (
            " --link fast",
            "the firmware's own core and drivers (`--link fast`)",
        ),
        _ => ("", "the real firmware"),
    };
    let (title, option, file, which) = match options.effects {
        Effects::All => ("an effect", "", "", "one effect in all its units"),
        Effects::OneUnit => (
            "an effect in one unit",
            " --effects one-unit",
            "-one-unit",
            "one effect in one of its units",
        ),
        Effects::Two => (
            "two effects",
            " --effects two",
            "-two",
            "two effects in all its units (where one of the two is nothing, one)",
        ),
        Effects::More => (
            "stiffness, misalignment, scatter or friction that changes,",
            " --effects more",
            "-more",
            "one effect in all its units",
        ),
    };
    let sources = evaluation::sources();
    format!(
        "# Closed loop: {title} that the rig file doesn't declare

Printed by `cargo xtask closed-loop --seeds {first}..{last}{option}{size}{link} --markdown docs/residual/closed-loop{file}.md` ({sources}).

Each seed is another rig (scatter of units, survey, noise, the robot's path) with {which} that the rig
file does not have. `forcectl identify --clear-implausible --weigh` runs as a process of its own on
{firmware}. It holds 2.5 N along y at the moving tip for {hold} s, and drives the
cables for {seconds} s with the tension loops open. It analyses what was recorded. Cells in which it finds creep or a curve
are then measured with weights, which a stand-in hangs, and the cables are driven once more. It puts what the board can use into a rig file, and holds the force again. The effect is in a file that only the rig reads.

* *named*: units in which the effect was named, of those that have it; what else was named in a third of them or more. Units also differ from the rig file by
  themselves (Coulomb friction by 5 %, its share of load by 8 %, offset by 27 mN), which is found as friction, gain or offset of its own.
* *found*: median over the units that name it (smallest to largest); creep and curve as the weights say.
* *worst cable*, *tip*: RMS of the worst cable's tension error and of the force error at the tip, by the plant's truth, before and
  after. `fault 45` or `44`: the tension was implausible or negative, as in a swing, until the board gave up the units.
* *without it*: both on the same rig without the effect, rig file as it is. After a correction they can be smaller than that, since the
  units' own scatter is corrected as well.
* *board*: `better` where the worst cable of each run, or one cable, gained for sure (the 95 % interval over pairs of runs, and over all
  looks at all cables, excludes zero), by 2 % at least, no cable and no worst cable lost 2 %, and the tip no more than 5 %. Elsewhere
  `forcectl identify` leaves the rig file as it was. `broken off`: a fault ended a later run; the figures are of the runs before it. `fault 15`:
  friction held a cable at 0 V as an output does that is stuck. The run names two settings then ([why](identify.md#on-rigs-with-undeclared-effects)). With these in the
  rig file, for all units, the command is called again; the worst cable with them stands in this column, and *found* is what it found beyond them.

{HEAD}{rows}
Kinds of effect that were named in most units, and the force was held better after: {}
({}). Not all of that is due to the effect: the units' own scatter is corrected with it, as the row with nothing
undeclared shows.

Kinds that had cost the worst cable a tenth or more against *without it*, of whose cost at least half is gone: {}
({}).

Kinds whose cost is still there in a seed at least: {}.

Kinds that cost less than a tenth, or nothing: {}.
{stopped}{failed}
{notes}",
        better.len(),
        names(better),
        back.len(),
        names(back),
        names(left),
        names(harmless),
        hold = options.hold,
        seconds = options.drive,
    )
}

/// Kinds in words.
pub fn names(kinds: &[Kind]) -> String {
    if kinds.is_empty() {
        return "none".to_owned();
    }
    let names: Vec<&str> = kinds.iter().map(|kind| kind.name()).collect();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    #[test]
    fn the_page_names_kinds_in_words_and_notes_only_what_happened() {
        let options = Options {
            forcectl: PathBuf::new(),
            seeds: 1..=10,
            drive: "40".to_owned(),
            hold: "16".to_owned(),
            size: 0.5,
            link: "fast".to_owned(),
            out: PathBuf::new(),
            markdown: None,
            reuse: false,
            cells: false,
            effects: Effects::All,
        };
        let kinds = Kinds {
            better: vec![Kind::Ripple, Kind::LoadFriction],
            left: vec![Kind::Creep],
            failed: vec![Kind::Viscous],
            ..Kinds::default()
        };
        let page = page(&options, "| row |\n", &kinds);
        assert!(
            page.contains("2\n(ripple, friction in proportion to the pull)"),
            "{page}"
        );
        assert!(
            page.contains(
                "Kinds whose cost is still there in a seed at least: creep of the cells."
            ),
            "{page}"
        );
        assert!(page.contains("or nothing: none."), "{page}");
        assert!(
            page.contains("without a result, in a row at least: viscous friction."),
            "{page}"
        );
        assert!(
            page.contains("* *Creep*") && !page.contains("* *Backlash*"),
            "{page}"
        );
        assert!(
            page.contains("--seeds 1..10 --size 0.5 --link fast "),
            "{page}"
        );
        let two = Options {
            effects: Effects::Two,
            ..options
        };
        let page = super::page(&two, "| row |\n", &kinds);
        assert!(page.contains("--seeds 1..10 --effects two --size 0.5 --link fast --markdown docs/residual/closed-loop-two.md"), "{page}");
    }
}
