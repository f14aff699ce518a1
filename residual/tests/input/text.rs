//! Text of every kind: comments, headers, decimal commas, several kinds of message, lines that are
//! no rows.

use super::*;

fn with_input(keys: &str) -> String {
    format!("[input]\n{keys}\n{MODEL}")
}

#[test]
fn a_number_ends_before_the_extension_of_a_file_name() {
    let folder = Folder::new();
    let data = written(&folder, &csv, "TXT");
    let model = with_input("file_name = \"{run}.TXT\"");
    assert_coulomb(&analyse(&data, &model).unwrap());
}

#[test]
fn comments_lines_to_skip_and_a_decimal_comma_are_read() {
    let folder = Folder::new();
    let european = |rows: &[[f64; 4]]| {
        let body = csv(rows).replace(',', ";").replace('.', ",");
        format!("a line of the logger\n% a comment\n{body}")
    };
    let data = written(&folder, &european, "log");
    let model = with_input("skip = 1\nseparator = \";\"\ndecimal = \",\"");
    assert_coulomb(&analyse(&data, &model).unwrap());
    // The extension is that of a log in a folder, too.
    assert_coulomb(&analyse(&[folder.path()], &model).unwrap());
}

#[test]
fn a_log_without_time_has_it_from_its_rate() {
    let folder = Folder::new();
    let bare = |rows: &[[f64; 4]]| {
        rows.iter().fold("y,c,v\n".to_string(), |s, r| {
            s + &format!("{},{},{}\n", r[1], r[2], r[3])
        })
    };
    let data = written(&folder, &bare, "csv");
    assert_coulomb(&analyse(&data, &with_input("rate = 50.0")).unwrap());
    let error = analyse(&data, MODEL).unwrap_err().to_string();
    assert!(error.contains("no column `t`"), "{error}");
}

#[test]
fn a_file_without_header_is_told_so() {
    let folder = Folder::new();
    let bare = |rows: &[[f64; 4]]| csv(rows).replacen("t,y,c,v\n", "", 1);
    let data = written(&folder, &bare, "csv");
    let error = analyse(&data, MODEL).unwrap_err().to_string();
    assert!(error.contains("4 numbers and no names"), "{error}");
    let tabs = |rows: &[[f64; 4]]| csv(rows).replace(',', "\t");
    let data = written(&folder, &tabs, "tsv");
    let error = analyse(&data, MODEL).unwrap_err().to_string();
    assert!(error.contains("input.separator"), "{error}");
}

/// Lines of several kinds in one file: the other kinds are read at the times of the force.
#[test]
fn several_kinds_of_message_in_one_log_are_joined() {
    let header = "[[input.messages]]\nbegins = \"F,\"\nheader = [\"\", \"t\", \"y\"]\n\
                  [[input.messages]]\nbegins = \"J,\"\nheader = [\"\", \"t\", \"c\", \"v\"]\n";
    let text = |rows: &[[f64; 4]], bad: &str| {
        let mut text = String::from("started\n");
        for [t, y, c, v] in rows {
            text += &format!("F,{t},{y}\nJ,{t},{c},{v}\nSTATUS,ok\n");
        }
        text + bad
    };
    let dir = Folder::new();
    for run in 0..3 {
        dir.put(&format!("run{run}.csv"), &text(&rows(run, 1500), ""));
    }
    let model = format!("{header}{MODEL}");
    let report = analyse(&[dir.path()], &model).unwrap();
    assert_coulomb(&report);
    let left_out = report.hygiene.iter().find(|f| f.check == "messages");
    assert!(
        left_out.is_some_and(|f| f.count == 3 * 1501),
        "{:?}",
        report.hygiene
    );
    // One plain log of the same values says the same.
    let plain = Folder::new();
    for run in 0..3 {
        plain.put(&format!("run{run}.csv"), &csv(&rows(run, 1500)));
    }
    let same = analyse(&[plain.path()], MODEL).unwrap();
    assert_eq!(report.last.heldout_rmse, same.last.heldout_rmse);
    // What is wrong is said with its line.
    let says = |model: &str, bad: &str, part: &str| {
        let dir = Folder::new();
        dir.put("run.csv", &text(&rows(0, 60), bad));
        let error = analyse(&[dir.path()], model).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    };
    says(
        &model,
        "F,9\n",
        "line 182: 2 cells where the kind `F,` has 3 columns",
    );
    says(&model, "F,9,x\n", "run.csv:182: column `y`");
    says(
        &model.replace("\"J,\"", "\"K,\""),
        "",
        "no line begins with `K,`",
    );
    says(
        &model.replace("\"v\"]", "\"y\"]"),
        "",
        "2 kinds have the target's column `y`",
    );
    says(
        &model.replace("\"t\", \"c\"", "\"u\", \"c\""),
        "",
        "every kind needs its time",
    );
}

#[test]
fn lines_that_are_no_rows_refuse_the_file_or_are_left_out_and_counted() {
    // Which rows are damaged, and how: a message of the logger, a cell of text, a quotation mark
    // that takes two more lines along, and a line that was cut off.
    let damaged = |text: &str| {
        let mut lines: Vec<String> = text.lines().map(str::to_string).collect();
        lines[300] = "Centering is taking longer than expected".into();
        lines[400] = lines[400].replacen(',', ",x", 1);
        lines[500] = format!("\"{}", lines[500]);
        lines[502] = format!("{}\"", lines[502]);
        let last = lines.len() - 1;
        lines[last] = lines[last].split_once(',').unwrap().0.to_string();
        lines.join("\n")
    };
    let lost = [300, 400, 500, 501, 502, 1500];
    let with = |text: &dyn Fn(u64) -> String, model: &str| {
        let dir = Folder::new();
        for run in 0..3 {
            dir.put(&format!("run{run}.csv"), &text(run));
        }
        analyse(&[dir.path()], model)
    };
    let bad = |run| damaged(&csv(&rows(run, 1500)));
    let refused = with(&bad, MODEL).unwrap_err().to_string();
    for part in [
        "run0.csv: line 301: 1 cells where 4 columns",
        "hygiene.text",
    ] {
        assert!(refused.contains(part), "{refused}");
    }

    let drop = format!("{MODEL}[hygiene]\ntext = \"drop\"\n");
    let report = with(&bad, &drop).unwrap();
    let counted = report.hygiene.iter().find(|f| f.check == "broken lines");
    assert!(
        counted.is_some_and(|f| f.count == 3 * lost.len()),
        "{:?}",
        report.hygiene
    );
    let good = |run| {
        let text = csv(&rows(run, 1500));
        let lines: Vec<&str> = text.lines().collect();
        let kept = (0..lines.len()).filter(|i| !lost.contains(i));
        kept.map(|i| lines[i]).collect::<Vec<_>>().join("\n")
    };
    let same = with(&good, MODEL).unwrap();
    assert_eq!(report.last.heldout_rmse, same.last.heldout_rmse);

    // A file without a single row is refused with its first line.
    let none = with(&|_| "t,y,c,v\n1,2\n3\n".to_string(), &drop);
    let why = none.unwrap_err().to_string();
    assert!(why.contains("line 2: 2 cells where 4"), "{why}");
}

#[test]
fn lines_are_those_of_an_editor() {
    // Line ends of two bytes, comments and empty lines before the bad line, and no line feed at the
    // end.
    let text = csv(&rows(0, 100));
    let with = |bad: &str, end: &str| {
        let mut lines: Vec<&str> = text.lines().collect();
        lines.splice(50..50, ["# a comment", "", "# another"]);
        lines[60] = bad;
        lines.join(end)
    };
    for end in ["\n", "\r\n"] {
        for (bad, part) in [
            ("1,2", "line 61: 2 cells"),
            ("1,x,3,4", "run.csv:61: column `y`: `x`"),
        ] {
            let dir = Folder::new();
            dir.put("run.csv", &with(bad, end));
            let error = analyse(&[dir.path()], MODEL).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
    // The last line without an end.
    let dir = Folder::new();
    dir.put("run.csv", &format!("{text}9,9"));
    let error = analyse(&[dir.path()], MODEL).unwrap_err().to_string();
    assert!(error.contains("line 102: 2 cells"), "{error}");
}

#[test]
fn text_that_the_model_does_not_use_loses_no_row() {
    let noted = |run| {
        let text = csv(&rows(run, 1500));
        let mut lines = text.lines();
        let mut out = format!("{},note\n", lines.next().unwrap());
        for (i, line) in lines.enumerate() {
            let note = if i == 700 { "gripper open" } else { "" };
            out += &format!("{line},{note}\n");
        }
        out
    };
    let dir = Folder::new();
    for run in 0..3 {
        dir.put(&format!("run{run}.csv"), &noted(run));
    }
    let report = analyse(&[dir.path()], MODEL).unwrap();
    assert_eq!(report.rows, 3 * 1500);
    assert_coulomb(&report);
}

#[test]
fn a_line_that_is_no_text_is_left_out_and_a_time_from_lines_is_not_made_up() {
    let model = format!("{MODEL}[hygiene]\ntext = \"drop\"\n");
    let dir = Folder::new();
    for run in 0..3 {
        let mut bytes = csv(&rows(run, 1500)).into_bytes();
        let at = bytes.len() / 2;
        bytes[at] = 0xff;
        std::fs::write(dir.path().join(format!("run{run}.csv")), bytes).unwrap();
    }
    let error = analyse(&[dir.path()], MODEL).unwrap_err().to_string();
    assert!(error.contains("not text"), "{error}");
    let report = analyse(&[dir.path()], &model).unwrap();
    assert_eq!(report.rows, 3 * 1499);

    let by_rate = model.replace("column = \"t\"", "column = \"row_time\"");
    let by_rate = format!("[input]\nrate = 50.0\n{by_rate}");
    // A new run begins behind it.
    let report = analyse(&[dir.path()], &by_rate).unwrap();
    assert_eq!((report.rows, report.sequences), (3 * 1499, 6));
}

#[test]
fn a_message_that_is_no_text_is_left_out() {
    let header =
        "[[input.messages]]\nbegins = \"F,\"\nheader = [\"\", \"t\", \"y\", \"c\", \"v\"]\n";
    let model = format!("{header}{MODEL}");
    let dir = Folder::new();
    for run in 0..3 {
        let text = csv(&rows(run, 1500));
        let lines: Vec<String> = text.lines().skip(1).map(|l| format!("F,{l}")).collect();
        let mut bytes = lines.join("\r\n").into_bytes();
        // In the first number of a line.
        let at = lines[..700].iter().map(|l| l.len() + 2).sum::<usize>() + 3;
        bytes[at] = 0xff;
        std::fs::write(dir.path().join(format!("run{run}.csv")), bytes).unwrap();
    }
    let error = analyse(&[dir.path()], &model).unwrap_err().to_string();
    assert!(
        error.contains("run0.csv: line ") && error.contains("not text"),
        "{error}"
    );
    let report = analyse(
        &[dir.path()],
        &format!("{model}[hygiene]\ntext = \"drop\"\n"),
    )
    .unwrap();
    assert_eq!(report.rows, 3 * 1499);
    assert_coulomb(&report);
}
