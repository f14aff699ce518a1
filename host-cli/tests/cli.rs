//! The program itself, without a rig: what it refuses, what it prints where, and its exit codes.
#![cfg(all(feature = "record", feature = "residual"))]

mod common;

use common::{folder, said, words, Said};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

/// `forcectl` in a folder, without the embedded rig's variables, as on a machine without any rig.
fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = common::forcectl(folder, arguments);
    command
        .env_remove("FORCE_RIG_BIN")
        .env_remove("FORCE_FIRMWARE_ELF")
        .env_remove("FORCE_DATA");
    command
}

fn forcectl_in(folder: &Path, arguments: &[&str]) -> Said {
    said(&command(folder, arguments).output().expect("forcectl runs"))
}

fn forcectl(arguments: &[&str]) -> Said {
    forcectl_in(folder().path(), arguments)
}

/// Standard output, which is one JSON object and nothing else.
fn object(said: &Said) -> Value {
    let value: Value = serde_json::from_str(&said.out)
        .unwrap_or_else(|error| panic!("not one JSON value: {error}: {said:?}"));
    assert!(value.is_object(), "{said:?}");
    value
}

/// The error of a call with `--json`: one object with the text and the exit code.
fn error_object(said: &Said, code: i32) -> String {
    let value = object(said);
    assert_eq!(said.code, Some(code), "{said:?}");
    assert_eq!(value["exit_code"], code, "{said:?}");
    let error = value["error"].as_str().unwrap_or_default().to_owned();
    assert!(!error.is_empty() && !error.contains('\u{1b}'), "{said:?}");
    assert!(said.err.contains("forcectl: "), "{said:?}");
    error
}

/// The built-in rig file.
fn built_in() -> String {
    forcectl(&["check", "--print"]).out
}

/// Writes a rig file whose tension limits are swapped, and one that is good.
fn rig_files(folder: &Path) {
    let good = built_in();
    let bad = good
        .replacen("tension_min_n = 2.0", "tension_min_n = 12.0", 1)
        .replacen("tension_max_n = 12.0", "tension_max_n = 2.0", 1);
    assert_ne!(good, bad);
    std::fs::write(folder.join("good.toml"), good).expect("written");
    std::fs::write(folder.join("bad.toml"), bad).expect("written");
}

/// A minimal call of each command that is not refused for its arguments, and the options that it
/// has beside those of every command. `{OLD}`: those of a rig that exists; `{NEW}`: those of a new
/// one as well.
const COMMANDS: [(&str, &str); 26] = [
    (
        "set-force 0 1 0",
        "{NEW} --duration --out --record --still --inject",
    ),
    ("status", "{NEW}"),
    ("monitor", "{NEW} --duration"),
    ("zero", "{OLD} --replace"),
    ("bring-up", "{NEW} --inject"),
    ("calibrate show", "{NEW}"),
    ("workspace --rig good.toml", "{NEW} --out"),
    (
        "rig",
        "--rig --seed --plant --inject --name --tcp --token-file",
    ),
    (
        "serve",
        "--link --rig --name --tcp --token-file --pty --end",
    ),
    ("hold", "{NEW} --duration --tension"),
    ("arm", "{OLD}"),
    ("disarm", "{OLD}"),
    ("stop", "{OLD}"),
    ("clear", "{OLD}"),
    ("inject estop", "{OLD}"),
    ("explain 33", ""),
    ("check good.toml", "--print"),
    ("init good.toml", "--answers --set"),
    ("record samples", "{NEW} --duration"),
    ("recording check samples", ""),
    ("experiment check none.toml", "--print"),
    ("estimate export none.model --out found", "--out"),
    (
        "residual --data logs --model none.toml --out found",
        "--data --model --out --apply --increment",
    ),
    (
        "identify --out found",
        "{NEW} --duration --drive-duration --force --out --apply",
    ),
    ("completions bash", ""),
    ("man --out pages", "--out"),
];

/// Every option, with a value that is good.
const OPTIONS: [(&str, &str); 28] = [
    ("--link", "serial:/dev/no-such-port"),
    ("--rig", "good.toml"),
    ("--direct", ""),
    ("--replace", ""),
    ("--name", "bench2"),
    ("--tcp", "127.0.0.1:0"),
    ("--token-file", "token"),
    ("--pty", ""),
    ("--end", ""),
    ("--tension", "2 2 2 2 2 2"),
    ("--seed", "7"),
    ("--plant", "plant.toml"),
    ("--paced", ""),
    ("--duration", "1"),
    ("--drive-duration", "9"),
    ("--out", "elsewhere"),
    ("--record", "samples"),
    ("--still", ""),
    ("--inject", "estop@1s"),
    ("--print", ""),
    ("--answers", "answers.toml"),
    ("--set", "name=lab"),
    ("--data", "logs"),
    ("--model", "none.toml"),
    ("--apply", ""),
    ("--increment", ""),
    ("--force", "0 1 0"),
    ("--no-such-option", ""),
];

#[test]
fn an_option_that_a_command_does_not_use_is_rejected() {
    let folder = folder();
    rig_files(folder.path());
    for (line, has) in COMMANDS {
        let has = has
            .replace("{NEW}", "{OLD} --seed --plant --paced")
            .replace("{OLD}", "--link --rig --direct");
        let has = words(&has);
        let command = words(line)[0];
        for (option, value) in OPTIONS {
            let mut arguments = words(line);
            arguments.push(option);
            arguments.extend(words(value));
            let said = forcectl_in(folder.path(), &arguments);
            let rejected = said
                .err
                .contains(&format!("unexpected argument '{option}' found"));
            if has.contains(&option) {
                assert!(!rejected, "{arguments:?}: {said:?}");
            } else {
                assert_eq!(said.code, Some(2), "{arguments:?}: {said:?}");
                assert!(rejected && said.out.is_empty(), "{arguments:?}: {said:?}");
                if OPTIONS.iter().any(|(known, _)| *known == option) && option != "--no-such-option"
                {
                    let hint = format!("`{command}` does not use `{option}`");
                    assert!(said.err.contains(&hint), "{arguments:?}: {said:?}");
                }
            }
        }
    }
    // The table has every command: that of the help, without `help` itself.
    let help = forcectl(&["--help"]).out;
    let listed: Vec<&str> = help
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        .map(|line| words(line)[0])
        .filter(|name| *name != "help")
        .collect();
    assert_eq!(listed, COMMANDS.map(|(line, _)| words(line)[0]));
}

#[test]
fn options_of_the_embedded_rig_are_refused_with_another_link_before_anything_is_written() {
    let folder = folder();
    std::fs::write(
        folder.path().join("usb.toml"),
        built_in().replacen("rig = \"embedded\"", "rig = \"usb\"", 1),
    )
    .expect("written");
    for (options, name, link) in [
        ("--link usb --seed 1", "--seed", "usb"),
        (
            "--link serial:/dev/null --plant p.toml",
            "--plant",
            "serial:/dev/null",
        ),
        ("--link usb --paced", "--paced", "usb"),
        (
            "--rig usb.toml --paced",
            "--paced",
            "usb (from the rig file)",
        ),
    ] {
        for command in [
            "set-force 0 1 0",
            "status",
            "monitor",
            "hold",
            "record samples",
            "identify --out found",
        ] {
            let mut arguments = words(command);
            arguments.extend(words(options));
            let said = forcectl_in(folder.path(), &arguments);
            assert_eq!(said.code, Some(2), "{arguments:?}: {said:?}");
            assert!(
                said.err.contains(name) && said.err.contains(&format!("the link is {link};")),
                "{arguments:?}: {said:?}"
            );
        }
    }
    for option in ["--still", "--inject estop@1s"] {
        let mut arguments = words("set-force 0 1 0 --link usb");
        arguments.extend(words(option));
        let said = forcectl_in(folder.path(), &arguments);
        assert_eq!(said.code, Some(2), "{arguments:?}: {said:?}");
        assert!(said.err.contains(words(option)[0]), "{said:?}");
    }
    let left = std::fs::read_dir(folder.path()).expect("is there").count();
    assert_eq!(left, 1, "only usb.toml");
}

#[test]
fn old_names_get_the_new_ones() {
    for (line, hint) in [
        ("status --config my.toml", "`--config` is now `--rig`"),
        ("--config=my.toml status", "`--config` is now `--rig`"),
        ("set-force 0 1 0 --for 3", "`--for` is now `--duration`"),
        ("monitor --seconds 3", "`--seconds` is now `--duration`"),
        ("identify --out o --for 3", "`--for` is now `--duration`"),
        (
            "identify --out o --seconds 9",
            "`--seconds` is now `--drive-duration`",
        ),
        ("status --rig usb", "give the connection with `--link usb`"),
        ("set-force 0 1 0 --rig embedded", "`--link embedded`"),
        ("status --rig serial:COM3", "`--link serial:COM3`"),
        (
            "status --link my.toml",
            "give the rig file with `--rig my.toml`",
        ),
        (
            "--link usb status",
            "`--link` stands after the command: forcectl status --link",
        ),
        ("explain --for 3", "`explain` does not use `--duration`"),
    ] {
        let said = forcectl(&words(line));
        assert_eq!(said.code, Some(2), "{line}: {said:?}");
        assert!(said.err.contains(hint), "{line}: {said:?}");
        let empty = said.err.lines().any(|line| line.trim() == "tip:");
        assert!(!empty, "{line}: {said:?}");
    }
}

#[test]
fn wrong_values_are_refused_before_anything_is_opened() {
    let cases: &[(&str, &str)] = &[
        ("set-force 0 nan 0", "finite"),
        ("set-force inf 0 0", "finite"),
        ("set-force 0 0 -inf", "finite"),
        ("set-force 0 1e9 0", "limit"),
        ("set-force 0 -1e9 0", "limit"),
        (
            "set-force 0 much 0",
            "`much` is not a number; give newtons, for example 2.5",
        ),
        ("set-force 0 2.5", "required"),
        ("set-force 0 2.5 0 --duration nan", "seconds"),
        (
            "set-force 0 2.5 0 --duration long",
            "`long` is not a number; give seconds",
        ),
        ("set-force 0 2.5 0 --inject unplug=9@1s", "1 to 6"),
        ("set-force 0 2.5 0 --inject help", "known are unplug=UNIT"),
        ("set-force 0 2.5 0 --seed many", "whole number from 0"),
        ("identify", "--out"),
        ("identify --out o --drive-duration 2", "8 to 600"),
        ("identify --out o --drive-duration nan", "seconds"),
        ("identify --out o --force 0 nan 0", "finite"),
        ("identify --out o --force 0 99 0", "limit"),
        ("identify --out o --apply", "--rig FILE"),
        ("set-force 0 2.5 0 --link carrier-pigeon", "serial:PORT"),
        ("explain much", "not a fault number"),
        ("explain 999", "there is no fault 999"),
        ("status -v -q", "cannot be used with"),
    ];
    for (line, words_in_error) in cases {
        let folder = folder();
        let said = forcectl_in(folder.path(), &words(line));
        assert_eq!(said.code, Some(2), "{line}: {said:?}");
        assert!(said.err.contains(words_in_error), "{line}: {said:?}");
        let left = std::fs::read_dir(folder.path()).expect("is there").count();
        assert_eq!(left, 0, "{line} left files");
        // The same as JSON: one object, and nothing in it is for a terminal.
        let mut arguments = words(line);
        arguments.push("--json");
        let error = error_object(&forcectl(&arguments), 2);
        assert!(error.contains(words_in_error), "{line}: {error}");
        assert!(!error.contains("Usage:"), "{line}: {error}");
    }
}

#[test]
fn a_port_that_is_missing_is_named_and_faults_are_listed() {
    let said = forcectl(&["status", "--link", "serial:/some/path"]);
    assert_eq!(said.code, Some(4), "{said:?}");
    assert!(said.err.contains("port /some/path"), "{said:?}");
    let said = forcectl(&["inject", "help"]);
    assert_eq!(said.code, Some(0), "{said:?}");
    assert!(said.out.contains("unplug=UNIT"), "{said:?}");
}

#[test]
fn without_the_rigs_variables_it_says_how_to_run() {
    let said = forcectl(&["set-force", "0", "-2.5", "0"]);
    assert_eq!(said.code, Some(4), "{said:?}");
    assert!(
        said.err.contains("cargo forcectl") && said.err.contains("--link usb"),
        "{said:?}"
    );
}

#[test]
fn json_is_one_object_also_for_errors() {
    let folder = folder();
    rig_files(folder.path());
    let run = |line: &str| forcectl_in(folder.path(), &words(line));
    for command in [
        "set-force 0 1 0",
        "status",
        "monitor",
        "zero",
        "arm",
        "disarm",
        "stop",
        "clear",
        "record samples",
        "identify --out found",
    ] {
        // No rig; no device; a wrong rig file.
        let error = error_object(&run(&format!("{command} --json")), 4);
        assert!(error.contains("forcectl"), "{command}: {error}");
        let line = format!("--json {command} --rig good.toml --link serial:/dev/no-such-port");
        let error = error_object(&run(&line), 4);
        assert!(error.contains("/dev/no-such-port"), "{command}: {error}");
        let error = error_object(&run(&format!("{command} --json --rig bad.toml")), 3);
        assert!(
            error.contains("bad.toml:") && error.contains("swapped"),
            "{command}: {error}"
        );
    }
    error_object(&run("--json"), 2);
    error_object(&run("no-such-command --json"), 2);
    error_object(&run("check none.toml --json"), 3);
    error_object(&run("check bad.toml --json"), 3);
    error_object(
        &run("residual --json --data logs --model none.toml --out found"),
        2,
    );
    // These have no JSON form.
    for line in ["completions bash --json", "check --print --json"] {
        assert!(
            error_object(&run(line), 2).contains("omit --json"),
            "{line}"
        );
    }
    // Successes.
    let faults = object(&run("explain --json"));
    let count = faults["faults"].as_array().map_or(0, Vec::len);
    assert!(count > 20, "{faults}");
    assert_eq!(object(&run("explain 33 --json"))["fault"], 33);
    assert_eq!(
        object(&run("--json check good.toml"))["rig"]["name"],
        object(&run("check good.toml --json"))["name"]
    );
    assert_eq!(object(&run("man --out pages --json"))["folder"], "pages");
}

#[test]
fn rig_files_are_checked_with_their_lines() {
    let folder = folder();
    rig_files(folder.path());
    let said = forcectl_in(folder.path(), &["check", "good.toml"]);
    assert_eq!(said.code, Some(0), "{said:?}");
    assert!(said.out.contains("6 units enabled"), "{said:?}");
    for line in ["check bad.toml", "set-force 0 1 0 --rig bad.toml"] {
        let said = forcectl_in(folder.path(), &words(line));
        assert_eq!(said.code, Some(3), "{said:?}");
        assert!(
            said.err.contains("bad.toml:") && said.err.contains("swapped"),
            "{said:?}"
        );
    }
}

#[test]
fn a_tension_that_friction_alone_exceeds_is_told() {
    let folder = folder();
    for (least_n, told) in [("0.5", true), ("0.8", false)] {
        let file = built_in().replacen(
            "tension_min_n = 2.0",
            &format!("tension_min_n = {least_n}"),
            1,
        );
        std::fs::write(folder.path().join("low.toml"), file).expect("written");
        let said = forcectl_in(folder.path(), &["check", "low.toml"]);
        assert_eq!(said.code, Some(0), "{said:?}");
        let units = said.out.matches("friction alone holds 1.06 N").count();
        assert_eq!(units, if told { 6 } else { 0 }, "{said:?}");
    }
}

/// The board finds it after 0 V, when the run's own time is over.
#[test]
fn a_motor_that_does_not_let_go_at_the_end_of_a_run_is_an_error() {
    let folder = folder();
    for at in ["3.5", "3.9"] {
        let inject = format!("stuck-dac=3@{at}s");
        let mut line = words("set-force 0 2.5 0 --link fast --duration 4 --inject");
        line.push(&inject);
        let said = forcectl_in(folder.path(), &line);
        assert_eq!(said.code, Some(5), "{said:?}");
        assert!(
            said.err.contains("fault 15, ") || said.err.contains("unit 3: fault 45, "),
            "{said:?}"
        );
    }
}

/// To the board a reel that holds its cable at 0 V is an output that is stuck. The run says with
/// which settings it takes that for friction, and with them the force is held.
#[test]
fn a_rig_with_more_friction_than_declared_is_told_the_settings_that_carry_it() {
    let folder = folder();
    let plant = "cable.initial_slack_m = 0.003\n\
        [[effects]]\nkind = \"periodic\"\nshaft = \"motor\"\norder = 1.0\namplitude_n = 0.69\n\
        [[effects]]\nkind = \"coulomb\"\nconstant_n = 0.51\n";
    std::fs::write(folder.path().join("plant.toml"), plant).expect("written");
    let run = |more: &[&str]| {
        let mut line =
            words("set-force 0 2.5 0 --duration 16 --link fast --seed 31 --plant plant.toml");
        line.extend(more);
        forcectl_in(folder.path(), &line)
    };
    let said = run(&[]);
    assert_eq!(said.code, Some(5), "{said:?}");
    let value = |name: &str| {
        let (_, behind) = said.err.split_once(&format!("`{name} = ")).expect("named");
        behind.split_once('`').expect("closed").0.to_owned()
    };
    let rig = built_in()
        .replace(
            "\ncoulomb_n = 0.909",
            &format!("\ncoulomb_n = {}", value("coulomb_n")),
        )
        .replace(
            "\ntension_min_n = 2.0",
            &format!("\ntension_min_n = {}", value("tension_min_n")),
        );
    std::fs::write(folder.path().join("rig.toml"), rig).expect("written");
    let said = run(&["--rig", "rig.toml"]);
    assert_eq!(said.code, Some(0), "{said:?}");
}

#[test]
fn a_rig_file_that_cannot_hold_zero_force_is_refused() {
    let folder = folder();
    let exit = "exit_m = [-0.480, 0.010, -0.165]";
    let axis = "axis = [0.998327, 0.028404, 0.050373]";
    let copied = built_in()
        .replacen(exit, "exit_m = [0.335, 0.045, -0.110]", 1)
        .replacen(axis, "axis = [-0.996049, -0.034022, -0.082028]", 1);
    std::fs::write(folder.path().join("copied.toml"), copied).expect("written");
    let off = built_in().replacen("[defaults]", "[defaults]\nenabled = false", 1);
    std::fs::write(folder.path().join("off.toml"), off).expect("written");
    for (file, words_in_error) in [
        ("copied.toml", "zero force is out of reach"),
        ("off.toml", "no unit is enabled"),
    ] {
        let said = forcectl_in(folder.path(), &["check", file]);
        assert_eq!(said.code, Some(3), "{said:?}");
        assert!(said.err.contains(words_in_error), "{said:?}");
    }
    rig_files(folder.path());
    let good = object(&forcectl_in(
        folder.path(),
        &["check", "good.toml", "--json"],
    ));
    assert_eq!(good["feasibility"]["out_of_reach"], 0, "{good}");
    assert!(good["feasibility"]["poses"].as_u64() > Some(200), "{good}");
}

#[test]
fn a_real_rig_is_not_driven_with_the_example_geometry() {
    let folder = folder();
    for command in ["set-force 0 1 0", "zero", "hold", "identify --out found"] {
        for link in ["usb", "serial:/dev/no-such-port"] {
            let line = format!("{command} --direct --link {link}");
            let said = forcectl_in(folder.path(), &words(&line));
            assert_eq!(said.code, Some(2), "{line}: {said:?}");
            assert!(said.err.contains("forcectl init"), "{line}: {said:?}");
        }
    }
    // What drives nothing needs no rig file.
    let said = forcectl_in(
        folder.path(),
        &words("stop --link serial:/dev/no-such-port"),
    );
    assert_eq!(said.code, Some(4), "{said:?}");
    // Nothing but the folder of the service that could not open its port.
    let left: Vec<_> = std::fs::read_dir(folder.path())
        .expect("is there")
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name != "run")
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn a_name_with_escape_codes_does_not_reach_the_terminal() {
    let folder = folder();
    let text = built_in().replacen("raven-left-example", "\\u001b[31mred\\u0007", 1);
    std::fs::write(folder.path().join("red.toml"), text).expect("written");
    for line in ["check red.toml", "status -v --rig red.toml"] {
        let said = forcectl_in(folder.path(), &words(line));
        let shown = format!("{}{}", said.out, said.err);
        assert!(shown.contains("[31mred"), "{line}: {said:?}");
        assert!(
            !shown.contains('\u{1b}') && !shown.contains('\u{7}'),
            "{line}: {said:?}"
        );
    }
}

/// Makes a named pipe.
#[cfg(unix)]
fn pipe(path: &Path) {
    let made = Command::new("mkfifo").arg(path).status();
    assert!(made.expect("mkfifo runs").success());
}

#[cfg(unix)]
#[test]
fn a_pipe_is_no_rig_file() {
    let folder = folder();
    pipe(&folder.path().join("pipe.toml"));
    let said = forcectl_in(folder.path(), &["check", "pipe.toml"]);
    assert_eq!(said.code, Some(3), "{said:?}");
    assert!(said.err.contains("not a regular file"), "{said:?}");
}

#[test]
fn init_makes_a_file_that_check_accepts() {
    let folder = folder();
    let answers = "\
center = [-0.080, 0.025, -0.140]
exit = [[0.335, 0.045, -0.110], [-0.480, 0.010, -0.165], [-0.055, 0.440, -0.120],
        [-0.090, -0.375, -0.190], [-0.065, 0.055, 0.275], [-0.100, -0.030, -0.520]]
";
    std::fs::write(folder.path().join("answers.toml"), answers).expect("written");
    let run = |line: &str| forcectl_in(folder.path(), &words(line));
    let said = run("init lab.toml --answers answers.toml");
    assert_eq!(said.code, Some(2), "{said:?}");
    assert!(said.err.contains("name: an answer is missing"), "{said:?}");
    assert!(!folder.path().join("lab.toml").exists());
    let said = run("init lab.toml --answers answers.toml --set name=lab-3");
    assert_eq!(said.code, Some(0), "{said:?}");
    let checked = object(&run("check lab.toml --json"));
    assert_eq!(checked["name"], "lab-3");
    assert_eq!(checked["rig"]["link"], "usb");
    // Nothing is overwritten, and nothing is written that check refuses.
    let said = run("init lab.toml --answers answers.toml --set name=lab-4");
    assert_eq!(said.code, Some(2), "{said:?}");
    let said = run("init far.toml --answers answers.toml --set name=far --set radius=0.9");
    assert_eq!(said.code, Some(3), "{said:?}");
    assert!(!folder.path().join("far.toml").exists());
    let said = run("init one.toml --answers answers.toml --set name=one --set units=3");
    assert_eq!(said.code, Some(3), "{said:?}");
    assert!(said.err.contains("zero force"), "{said:?}");
    assert!(!folder.path().join("one.toml").exists());
    // Millimetres in place of metres: told as that, and not as what follows from it.
    for (set, words) in [
        ("center=-80 25 -140", "give metres, not millimetres"),
        ("name=", "name: \"\" is no name"),
        ("name=a\nb", "name: \"a\\nb\" is no name"),
    ] {
        let line = "init mm.toml --answers answers.toml --set name=mm --set";
        let mut arguments = common::words(line);
        arguments.push(set);
        let said = forcectl_in(folder.path(), &arguments);
        assert_eq!(said.code, Some(2), "{said:?}");
        assert!(said.err.contains(words), "{said:?}");
        assert!(!said.err.contains("axis"), "{said:?}");
        assert!(!folder.path().join("mm.toml").exists());
    }
    let said = run("init x.toml --set colour=red");
    assert!(
        said.code == Some(2) && said.err.contains("tension"),
        "{said:?}"
    );
}

#[test]
fn help_completions_and_manual_pages_know_every_command() {
    assert!(forcectl(&["explain", "33"]).out.contains("sensor silent"));
    let names = COMMANDS.map(|(line, _)| words(line)[0]);
    for name in names {
        let (help, flag) = (forcectl(&["help", name]), forcectl(&[name, "--help"]));
        assert_eq!((help.code, flag.code), (Some(0), Some(0)), "{name}");
        assert!(
            help.out.contains("Usage: forcectl ") && help.out == flag.out,
            "{name}"
        );
    }
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let said = forcectl(&["completions", shell]);
        assert_eq!(said.code, Some(0), "{said:?}");
        for word in names.iter().chain(&["drive-duration"]) {
            assert!(said.out.contains(word), "{shell} lacks {word}");
        }
    }
    let folder = folder();
    let said = forcectl_in(folder.path(), &["man", "--out", "a/man1"]);
    assert_eq!(said.code, Some(0), "{said:?}");
    let page = |name: &str| std::fs::read_to_string(folder.path().join("a/man1").join(name));
    assert!(page("forcectl.1").expect("is there").contains("130"));
    for name in names {
        let text = page(&format!("forcectl-{name}.1")).expect(name);
        assert!(text.contains("json"), "{name}");
    }
    std::fs::write(folder.path().join("file"), "").expect("written");
    assert_eq!(
        forcectl_in(folder.path(), &["man", "--out", "file/man1"]).code,
        Some(7)
    );
}

/// Calls whose output is not read: with a result, with an error, with help.
const CALLS: [(&str, i32); 9] = [
    ("explain", 0),
    ("explain --json", 0),
    ("check --print", 0),
    ("completions zsh", 0),
    ("--help", 0),
    ("set-force --help", 0),
    ("--version", 0),
    ("explain 999 --json", 2),
    ("status --json --link serial:/dev/no-such-port", 4),
];

#[test]
fn a_closed_pipe_ends_the_output_and_nothing_else() {
    for (line, code) in CALLS {
        let folder = folder();
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let output = command(folder.path(), &words(line))
            .stdout(writer)
            .output()
            .expect("forcectl runs");
        let said = said(&output);
        assert_eq!(said.code, Some(code), "{line}: {said:?}");
        // An error is told, the pipe is not.
        assert_eq!(said.err.is_empty(), code == 0, "{line}: {said:?}");
    }
}

#[test]
fn a_closed_standard_error_changes_no_exit_code() {
    for (line, code) in [
        ("explain 999", 2),
        ("no-such-command", 2),
        ("", 2),
        ("status", 4),
        ("explain 33", 0),
    ] {
        let folder = folder();
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let status = command(folder.path(), &words(line))
            .stdout(Stdio::null())
            .stderr(writer)
            .status()
            .expect("forcectl runs");
        assert_eq!(status.code(), Some(code), "{line}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_once() {
    for (line, code) in CALLS {
        let folder = folder();
        let full = std::fs::File::options().write(true).open("/dev/full");
        let output = command(folder.path(), &words(line))
            .stdout(full.expect("Linux has /dev/full"))
            .output()
            .expect("forcectl runs");
        let said = said(&output);
        // The first failure has the exit code.
        let expected = if code == 0 { 7 } else { code };
        assert_eq!(said.code, Some(expected), "{line}: {said:?}");
        let told = said
            .err
            .matches("standard output cannot be written")
            .count();
        assert_eq!(told, 1, "{line}: {said:?}");
    }
    for line in ["explain 999", "no-such-command", ""] {
        let folder = folder();
        let full = std::fs::File::options().write(true).open("/dev/full");
        let status = command(folder.path(), &words(line))
            .stdout(Stdio::null())
            .stderr(full.expect("Linux has /dev/full"))
            .status()
            .expect("forcectl runs");
        assert_eq!(status.code(), Some(2), "{line}");
    }
}

/// Signals, on systems that have them.
#[cfg(unix)]
mod signals {
    use super::common::{signal, signals};
    use super::*;
    use std::fs::File;
    use std::io::Write;
    use std::os::unix::fs::PermissionsExt;
    use std::process::Child;
    use std::time::{Duration, Instant};

    /// A command that is held where it reads its model file.
    const HELD: &str = "residual --data logs --model model.toml --out found";

    /// Starts it with a pipe as its model file, which holds it until the test writes there.
    fn held(folder: &Path, mut command: Command) -> (Child, File) {
        let model = folder.join("model.toml");
        pipe(&model);
        let child = command.spawn().expect("forcectl runs");
        // Opened when the command reads. In a thread, because it waits for the command for ever.
        let (send, opened) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let _ = send.send(File::options().write(true).open(model));
        });
        let opened = opened.recv_timeout(Duration::from_secs(60));
        let pipe = opened.expect("the command reads its model file");
        (child, pipe.expect("a pipe"))
    }

    /// Waits for a condition; a minute at most, as the machine may be busy.
    fn wait(what: &str, mut condition: impl FnMut() -> bool) {
        let start = Instant::now();
        while !condition() {
            assert!(start.elapsed() < Duration::from_secs(60), "{what}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn one_signal_ends_a_command_that_drives_nothing() {
        for name in signals() {
            for json in [false, true] {
                let folder = folder();
                let mut arguments = words(HELD);
                arguments.extend(json.then_some("--json"));
                let (child, mut pipe) = held(folder.path(), command(folder.path(), &arguments));
                pipe.write_all(b"#").expect("written");
                signal(&child, name);
                let said = said(&child.wait_with_output().expect("ends"));
                assert_eq!(said.code, Some(130), "{name}: {said:?}");
                if json {
                    let value = object(&said);
                    assert_eq!(value["exit_code"], 130, "{said:?}");
                } else {
                    assert!(said.out.is_empty(), "{name}: {said:?}");
                }
            }
        }
    }

    /// `nohup` starts a program with SIGHUP ignored; it has to stay so.
    #[test]
    fn an_ignored_hangup_stays_ignored() {
        let folder = folder();
        let mut shell = Command::new("sh");
        shell
            .current_dir(folder.path())
            .args(["-c", "trap '' HUP; exec \"$0\" \"$@\""])
            .arg(env!("CARGO_BIN_EXE_forcectl"))
            .args(words(HELD))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let (child, mut pipe) = held(folder.path(), shell);
        signal(&child, "HUP");
        std::thread::sleep(Duration::from_millis(100));
        pipe.write_all(b"# no roles")
            .expect("the command still reads");
        drop(pipe);
        let said = said(&child.wait_with_output().expect("ends"));
        assert_eq!(said.code, Some(2), "{said:?}");
    }

    #[test]
    fn the_first_signal_asks_and_the_second_ends_at_once() {
        for name in signals() {
            let folder = folder();
            // A rig that reads and never answers.
            let rig = folder.path().join("rig");
            std::fs::write(&rig, "#!/bin/sh\ntouch started\ncat > /dev/null\n").expect("written");
            std::fs::set_permissions(&rig, PermissionsExt::from_mode(0o755)).expect("set");
            let mut child = command(folder.path(), &["status", "--json", "-v"])
                .env("FORCE_RIG_BIN", &rig)
                .env("FORCE_FIRMWARE_ELF", &rig)
                .stderr(File::create(folder.path().join("err")).expect("made"))
                .spawn()
                .expect("forcectl runs");
            wait("the rig starts", || folder.path().join("started").exists());
            signal(&child, name);
            let err = || std::fs::read_to_string(folder.path().join("err")).unwrap_or_default();
            wait("the signal is noticed", || err().contains("Interrupted"));
            assert!(child.try_wait().expect("is there").is_none(), "{}", err());
            signal(&child, name);
            let said = said(&child.wait_with_output().expect("ends"));
            assert_eq!(said.code, Some(130), "{name}: {said:?}");
            assert_eq!(object(&said)["exit_code"], 130, "{said:?}");
        }
    }
}

/// A folder's name may be any bytes.
#[cfg(target_os = "linux")]
#[test]
fn names_that_are_not_utf_8_are_taken_as_they_are() {
    use std::os::unix::ffi::OsStrExt;
    let folder = common::folder();
    let name = std::ffi::OsStr::from_bytes(b"log\xe9");
    let data = folder.path().join(name).with_extension("csv");
    std::fs::write(&data, "t,f,x\n0,1,2\n1,2,3\n2,3,4\n").unwrap();
    let said = |words: &[&std::ffi::OsStr]| {
        let mut command = common::forcectl(folder.path(), &["--json"]);
        common::said(&command.args(words).output().unwrap())
    };
    let word = std::ffi::OsStr::new;
    let pages = said(&[word("man"), word("--out"), name]);
    assert_eq!(pages.code, Some(0), "{pages:?}");
    assert!(folder.path().join(name).is_dir());
    assert!(pages.out.contains("log\u{fffd}"), "{pages:?}");
    let model = folder.path().join(name).join("model.toml");
    let first = [word("residual"), word("--init"), word("--data")];
    let model = [data.as_os_str(), word("--model"), model.as_os_str()];
    let init = said(&[&first[..], &model[..]].concat());
    assert!(matches!(init.code, Some(0 | 2 | 3)), "{init:?}");
    // The name of a command in messages to others is read from all arguments.
    let link = [
        word("--link"),
        word("serial:/dev/no-such-port"),
        word("record"),
    ];
    let record = said(&[&link[2..], &[name], &link[..2]].concat());
    assert_eq!(record.code, Some(4), "{record:?}");
}
