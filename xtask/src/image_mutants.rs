//! Mutants of the firmware image: one place changed, the image built, and the test run that must
//! find it, on the embedded rig or on Renode. `cargo xtask faults --mutants` does the same for the
//! fault campaign, without an image.
//!
//! The sources are copied into `target/mutants` and changed there. The checkout is not touched.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Stdio;

use crate::firmware;
use crate::mutants::{choose, copy_workspace, Mutant};
use crate::process;
use crate::renode;
use crate::report::{say, Failure, Result};
use crate::rig::{self, ELF_VARIABLE, RIG_VARIABLE};
use crate::toolchain::Arm;
use crate::workspace::Workspace;

/// What runs the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Machine {
    /// The embedded rig: a file of `tests/scenarios/tests`.
    Rig,
    /// Renode: a file of `renode/suites`.
    Renode,
}

/// A mutant and the test that finds it.
struct Row {
    mutant: Mutant,
    machine: Machine,
    /// File without its ending.
    file: &'static str,
    test: &'static str,
}

macro_rules! rows {
    ($($name:literal: $file:literal, $from:literal => $to:literal, $machine:ident $suite:literal $test:literal;)*) => {
        const ROWS: &[Row] = &[$(Row {
            mutant: Mutant { name: $name, file: $file, from: $from, to: $to },
            machine: Machine::$machine,
            file: $suite,
            test: $test,
        },)*];
    };
}

rows! {
    "encoder-watch-off": "control/src/friction.rs",
        "pub const STILL_SWING: Newton = Newton::from_un(6_000_000);" => "pub const STILL_SWING: Newton = Newton::from_un(60_000_000);",
        Rig "faults" "a_lost_encoder_is_noticed_by_what_the_tension_does";
    "register-watch-off": "board/src/firmware.rs",
        "let register_changed = self.registers.check(&mut self.usart);" => "let register_changed = None;\n        let _ = &mut self.registers;",
        Rig "flips" "a_known_register_that_changes_is_a_fault";
    "register-watch-of-spi-off": "board/src/hw/registers.rs",
        "        self.add_always(at!(spi.cfg2()), ALL);\n" => "",
        Rig "flips" "a_known_register_that_changes_is_a_fault";
    "spi-not-set-up-again": "board/src/hw/registers.rs",
        "        dac::restart();\n" => "",
        Rig "flips" "a_known_register_that_changes_is_a_fault";
    "saturation-off": "control/src/unit.rs",
        "self.saturated >= TRIP_SAMPLES" => "self.saturated == u8::MAX",
        Rig "detections" "a_converter_at_the_end_of_its_range_stops_its_unit";
    "dac-link-ignored": "board/src/machine/supervision.rs",
        "if let Some(status) = health.dac_error {" => "if let Some(status) = health.dac_error.filter(|_| false) {",
        Rig "detections" "a_spi_that_stops_takes_the_motors_to_zero_and_the_power_away";
    "frame-crc-off": "wire/src/frame.rs",
        "if crc32(payload) != u32::from_le_bytes(*crc) {" => "if crc32(payload) == 0 && *crc == [1; 4] {",
        Rig "detections" "a_frame_with_a_wrong_checksum_is_dropped_and_counted";
    "watchdog-fed-from-systick": "board/src/hw/tick.rs",
        "    time::set_tick();" => "    time::set_tick();\n    unsafe { (0x5800_4800 as *mut u32).write_volatile(0xAAAA) };",
        Rig "detections" "the_watchdog_resets_within_its_time_while_interrupts_go_on";
    "watchdog-slow": "board/src/hw/watchdog.rs",
        "w.bits(clocks::IWDG_PR.into())" => "w.bits((clocks::IWDG_PR + 4).into())",
        Rig "detections" "the_watchdog_resets_within_its_time_while_interrupts_go_on";
    "saturation-off": "control/src/unit.rs",
        "self.saturated >= TRIP_SAMPLES" => "self.saturated == u8::MAX",
        Renode "detections" "ADC Saturated";
    "dac-link-ignored": "board/src/machine/supervision.rs",
        "if let Some(status) = health.dac_error {" => "if let Some(status) = health.dac_error.filter(|_| false) {",
        Renode "detections" "The DAC Link Stops";
    "frame-crc-off": "wire/src/frame.rs",
        "if crc32(payload) != u32::from_le_bytes(*crc) {" => "if crc32(payload) == 0 && *crc == [1; 4] {",
        Renode "detections" "A Frame With A Wrong Checksum Is Dropped";
    "sda-alternate-function": "board/src/pins.rs",
        "\"I2C_SDA\", OpenDrain(4)" => "\"I2C_SDA\", OpenDrain(6)",
        Renode "sensors" "Six Units Stream At Their Own Rates";
    "mosi-alternate-function": "board/src/pins.rs",
        "\"DAC_MOSI\", Alternate(5)" => "\"DAC_MOSI\", Alternate(6)",
        Renode "sensors" "Cables Come To Their Setpoint";
    "watchdog-fed-from-systick": "board/src/hw/tick.rs",
        "    time::set_tick();" => "    time::set_tick();\n    unsafe { (0x5800_4800 as *mut u32).write_volatile(0xAAAA) };",
        Renode "detections" "Watchdog Resets Within Its Time While Interrupts Go On";
    "watchdog-slow": "board/src/hw/watchdog.rs",
        "w.bits(clocks::IWDG_PR.into())" => "w.bits((clocks::IWDG_PR + 4).into())",
        Renode "detections" "Watchdog Resets Within Its Time While Interrupts Go On";
    "calibration-skipped": "drivers/src/nau7802/bringup/mod.rs",
        "0x3F, Stage::CalibrationStart)" => "0x3F, Stage::CycleStop)",
        Renode "detections" "Converters Are Calibrated";
    "sensor-slow-off": "control/src/supervisor.rs",
        "max_us: 3_370" => "max_us: 33_700",
        Renode "detections" "Converter Too Slow";
    "sensor-fast-off": "control/src/supervisor.rs",
        "min_us: 2_900" => "min_us: 290",
        Renode "detections" "Converter Too Fast";
    "configuration-check-off": "board/src/machine/supervision.rs",
        "self.config_check_ms += 1;" => "self.config_check_ms += 0;",
        Renode "detections" "Configuration Changed In Memory";
    "flush-after-nack-removed": "board/src/hw/sensors.rs",
        "                i2c.isr().write(|w| w.txe().set_bit());\n" => "",
        Renode "detections" "A Byte That Was Refused Does Not Begin The Next Transaction";
    "check-in-ignored": "board/src/hw/watchdog.rs",
        "if self.check_in.complete() {" => "if self.check_in.complete() || true {",
        Renode "detections" "A Stage That Does Not Run Is Found By The Watchdog";
    "arbitration-loss-ignored": "board/src/hw/sensors.rs",
        "if flags.arlo().bit_is_clear() && flags.ovr().bit_is_clear() {" => "if flags.ovr().bit_is_clear() {",
        Renode "detections" "Lost Arbitration Is Recovered";
    "bus-error-ends-transfer": "board/src/hw/sensors.rs",
        "if flags.arlo().bit_is_clear() && flags.ovr().bit_is_clear() {" => "if false {",
        Renode "detections" "A Bus Error Is Cleared And Nothing Else";
}

/// Builds every mutant of `machine`, or those named, and runs its test. `true`: every test found
/// its mutant.
///
/// # Errors
/// A name is unknown, a place is not found once, or a test fails without a mutant.
pub fn run(workspace: &Workspace, arm: &Arm, machine: Machine, names: &[String]) -> Result<bool> {
    let rows = ROWS.iter().filter(|row| row.machine == machine).collect();
    let chosen = choose(rows, |row| row.mutant.name, names)?;
    let folder = workspace.target().join("mutants");
    copy_workspace(workspace, &folder)?;
    let copy = Workspace::of_copy(folder.clone(), workspace.target().join("mutants-image"));
    let tester = Tester::new(workspace, machine)?;
    say("mutants: the unchanged sources first");
    firmware::build(&copy, arm)?;
    let tests: BTreeSet<_> = chosen.iter().map(|row| (row.file, row.test)).collect();
    for (file, test) in tests {
        if !tester.passes(&copy.firmware_elf(), file, test)? {
            return Err(Failure::new(format!(
                "{file}: `{test}` fails without a mutant"
            )));
        }
    }
    println!("| mutant | change in | found by |\n| --- | --- | --- |");
    let mut survived = 0;
    for row in &chosen {
        let passes = row.mutant.applied(&folder, || {
            firmware::build(&copy, arm)?;
            tester.passes(&copy.firmware_elf(), row.file, row.test)
        })?;
        survived += usize::from(passes);
        let verdict = if passes { "SURVIVED " } else { "" };
        println!(
            "| {} | `{}` | {verdict}`{}`: {} |",
            row.mutant.name, row.mutant.file, row.file, row.test
        );
    }
    println!("{} mutants, {survived} survived", chosen.len());
    Ok(survived == 0)
}

/// Runs single tests with an image.
struct Tester<'w> {
    workspace: &'w Workspace,
    renode: Option<renode::Renode>,
}

impl<'w> Tester<'w> {
    fn new(workspace: &'w Workspace, machine: Machine) -> Result<Self> {
        let renode = match machine {
            Machine::Rig => {
                rig::build(workspace, &["rig", "forcectl"])?;
                None
            }
            Machine::Renode => Some(renode::require(workspace)?),
        };
        Ok(Self { workspace, renode })
    }

    fn passes(&self, elf: &Path, file: &str, test: &str) -> Result<bool> {
        let Some(renode) = &self.renode else {
            return Ok(self.scenario_passes(elf, file, test));
        };
        let suite = format!("renode/suites/{file}.robot");
        let arguments = [suite.as_str(), "--fixture", test].map(Into::into);
        let tally = renode::run_image(self.workspace, renode, elf, &arguments)?;
        if tally.passed + tally.failed != 1 {
            return Err(Failure::new(format!(
                "{suite}: `{test}` selects {} tests",
                tally.passed + tally.failed
            )));
        }
        Ok(tally.failed == 0)
    }

    fn scenario_passes(&self, elf: &Path, file: &str, test: &str) -> bool {
        let mut command = rig::cargo_for(self.workspace, "test");
        command
            .arg("--quiet")
            .args(rig::EMULATED)
            .args(["--test", file, "--", "--exact", test])
            .env(ELF_VARIABLE, elf)
            .env(RIG_VARIABLE, self.workspace.program("rig"))
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        process::run(&mut command).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn every_mutant_has_its_place_once_and_its_test() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        for row in ROWS {
            let mutant = &row.mutant;
            let text = fs::read_to_string(root.join(mutant.file)).unwrap();
            assert_eq!(text.matches(mutant.from).count(), 1, "{}", mutant.name);
            assert_ne!(mutant.from, mutant.to, "{}", mutant.name);
            let (path, line) = match row.machine {
                Machine::Rig => ("tests/scenarios/tests", format!("fn {}()", row.test)),
                Machine::Renode => ("renode/suites", format!("\n{}\n", row.test)),
            };
            let ending = if row.machine == Machine::Rig {
                "rs"
            } else {
                "robot"
            };
            let suite = root.join(path).join(row.file).with_extension(ending);
            let text = fs::read_to_string(&suite).unwrap();
            assert!(text.contains(&line), "{}: {}", row.file, row.test);
        }
    }
}
