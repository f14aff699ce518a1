//! Values that are no measurement, rows that are left out, stamps in print.

use super::*;

#[test]
fn a_reading_at_the_end_of_the_converter_is_named_and_left_out_on_request() {
    // Raw codes; the first reading of each log is that of a converter that has none yet.
    let codes = |run: usize, rows: &mut Vec<[f64; 3]>, value: f64, at: &[usize]| {
        for (i, row) in rows.iter_mut().enumerate() {
            row[1] = (140_000.0 * row[1] - 250_000.0 + run as f64).round();
            if at.contains(&i) {
                row[1] = value;
            }
        }
    };
    let drop = format!("{MODEL}[hygiene]\nspikes = \"drop\"\n");
    for value in [8_388_607.0, -9999.0e6, 9.9e37, 2_147_483_647.0] {
        for at in [&[0][..], &[199], &[70, 71, 72, 73, 74, 75, 76]] {
            let folder = runs(|run, rows| codes(run, rows, value, at));
            let data = folder.load(MODEL).unwrap();
            let seen = finding(&data, "code in target").unwrap();
            assert_eq!(seen.count, 3 * at.len(), "{seen:?}");
            assert!(seen.what.contains("column `y` has"), "{seen:?}");
            assert_eq!(data.suspects().len(), 3 * at.len());
            assert!(finding(&data, "spike").is_none(), "{:?}", data.hygiene);
            assert!(
                finding(&data, "copied rows").is_none(),
                "{:?}",
                data.hygiene
            );
            let data = folder.load(&drop).unwrap();
            assert_eq!(data.kept_rows().len(), 600 - 3 * at.len());
            assert!(data.suspects().is_empty());
        }
    }
    // A value that is not a limit of a converter, and stands in one log only once, is a spike.
    for at in [0, 100, 199] {
        let folder = runs(|run, rows| {
            if run == 1 {
                rows[at][1] = 400.0;
            }
        });
        assert_eq!(
            finding(&folder.load(MODEL).unwrap(), "spike")
                .unwrap()
                .count,
            1
        );
        assert_eq!(folder.load(&drop).unwrap().kept_rows().len(), 599);
    }
}

#[test]
fn a_code_within_the_range_is_known_by_its_repetition() {
    let folder = runs(|run, rows| {
        for i in (5 + run..200).step_by(23) {
            rows[i][1] = 2.0;
            rows[i + 1][1] = 2.0;
        }
    });
    let data = folder.load(MODEL).unwrap();
    let seen = finding(&data, "code in target").unwrap();
    assert!(
        seen.what.contains("2.000 in 5") && seen.count > 50,
        "{seen:?}"
    );
    // Steps of a reading, a force that is nothing out of contact, levels of a command: none is one.
    type Change = fn(usize, &mut Vec<[f64; 3]>);
    let good: [Change; 4] = [
        |_, _| {},
        |_, rows| {
            rows.iter_mut()
                .for_each(|r| r[1] = (r[1] * 20.0).round() / 20.0)
        },
        |_, rows| rows[60..110].iter_mut().for_each(|r| r[1] = 0.0),
        |_, rows| {
            let n = rows.len();
            for (i, r) in rows.iter_mut().enumerate() {
                r[2] = if i > n - 9 {
                    60.0
                } else {
                    (i / 12) as f64 * 0.1
                };
            }
        },
    ];
    for change in good {
        let data = runs(change).load(MODEL).unwrap();
        let codes = data.hygiene.iter().find(|f| f.check.starts_with("code in"));
        assert!(codes.is_none(), "{codes:?}");
    }
}

#[test]
fn a_code_in_an_input_does_not_reach_the_memory_of_operators() {
    let folder = runs(|run, rows| rows[50 + run][2] = -9999.0);
    let data = folder.load(MODEL).unwrap();
    let seen = finding(&data, "code in command").unwrap();
    assert!(seen.count == 3 && seen.what.contains("`c`"), "{seen:?}");
    let drop = format!("{MODEL}[hygiene]\nspikes = \"drop\"\n");
    let data = folder.load(&drop).unwrap();
    assert_eq!(data.kept_rows().len(), 597);
    let least = data.frame().column("command").unwrap().iter().copied();
    assert!(least.fold(0.0, f64::min) > -1.0);
}

#[test]
fn a_few_bad_values_do_not_make_runs_alike() {
    // In the same place of each run.
    let folder = runs(|_, rows| rows[0][2] = 1e6);
    let found = folder.load(MODEL).unwrap();
    assert!(
        finding(&found, "repeated motion").is_none(),
        "{:?}",
        found.hygiene
    );
}

#[test]
fn rows_that_are_left_out_are_counted_with_their_cause() {
    // The middle is a second run of the clock: nothing is lost.
    let folder = runs(|_, rows| rows[120..].iter_mut().for_each(|r| r[0] -= 2.0));
    let data = folder.load(MODEL).unwrap();
    assert_eq!(
        (data.frame().len(), data.frame().sequences().len()),
        (600, 6)
    );
    assert_eq!(finding(&data, "clock set back").unwrap().count, 3);
    assert!(finding(&data, "rows left out").is_none());

    // Rows that are early, and cells that are empty: each cause with its rows.
    let drop = format!("{MODEL}[hygiene]\ntime = \"drop\"\n");
    let folder = runs(|_, rows| {
        (0..4).for_each(|k| rows[40 * k + 20][0] = 0.001);
        rows[7][2] = f64::NAN;
    });
    let data = folder.load(&drop).unwrap();
    let seen = finding(&data, "rows left out").unwrap();
    assert_eq!(seen.count, 15, "{seen:?}");
    for part in [
        "2.50 % of 600 rows",
        "before that of a row above (12 rows, first in run0.csv)",
        "in a mapped column: `c` 3 (3 rows, first in run0.csv)",
    ] {
        assert!(seen.what.contains(part), "{part}: {seen:?}");
    }
    assert!(
        finding(&data, "joined columns").is_none(),
        "{:?}",
        data.hygiene
    );

    // Half of the rows are early: no cell is empty, and none is said to be.
    let folder = runs(|_, rows| {
        let n = rows.len();
        (2..n).step_by(2).for_each(|i| rows[i][0] -= 0.05);
    });
    let data = folder.load(&drop).unwrap();
    assert!(finding(&data, "rows left out").unwrap().count > 200);
    let said = format!("{:?}", data.hygiene);
    assert!(!said.contains("empty"), "{said}");
}

#[test]
fn a_time_in_coarse_print_loses_no_row() {
    let folder = runs(|_, rows| {
        rows.iter_mut()
            .for_each(|r| r[0] = (r[0] / 0.05).round() * 0.05)
    });
    let data = folder.load(MODEL).unwrap();
    assert_eq!(data.frame().len(), 600);
    assert_eq!(finding(&data, "coarse time").unwrap().count, 600);
    let steps = data.frame().time()[..200].windows(2).map(|w| w[1] - w[0]);
    assert!(
        steps.clone().all(|s| (s - 0.02).abs() < 1e-3),
        "{:?}",
        steps.collect::<Vec<_>>()
    );
}

#[test]
fn stamps_in_bunches_and_a_held_target_are_checks() {
    for (rows_at_once, apart) in [(7, 0.0004), (30, 0.0003)] {
        let folder = Folder::new();
        for run in 0..3 {
            let mut rows = rows(run, 1200);
            for (i, r) in rows.iter_mut().enumerate() {
                let (bunch, k) = (i / rows_at_once, i % rows_at_once);
                r[0] = (bunch * rows_at_once) as f64 * 0.02 + k as f64 * apart;
            }
            folder.put(&format!("run{run}.csv"), &csv(&rows));
        }
        let data = folder.load(MODEL).unwrap();
        let seen = finding(&data, "stamps in bunches").unwrap();
        let words = format!("{rows_at_once} rows {apart:.7}");
        assert!(seen.what.contains(words.trim_end_matches('0')), "{seen:?}");
        assert!(seen.what.contains("there are 50"), "{seen:?}");
    }
    let held = |rows: &mut Vec<[f64; 3]>| {
        let mut shown = (0, 0.0);
        for (i, r) in rows.iter_mut().enumerate() {
            if i == 0 || i * 2 / 5 != shown.0 {
                shown = (i * 2 / 5, r[1]);
            }
            r[1] = shown.1;
        }
    };
    let folder = runs(|_, rows| held(rows));
    let data = folder.load(MODEL).unwrap();
    let seen = finding(&data, "held target").unwrap();
    assert!(
        seen.what.contains("2 to 3 rows: it has about 20"),
        "{seen:?}"
    );
    let drop = format!("{MODEL}[hygiene]\nrepeats = \"drop\"\n");
    assert_eq!(folder.load(&drop).unwrap().kept_rows().len(), 240);
    // Uneven steps, a gap, and a reading in coarse steps are neither.
    let folder = runs(|run, rows| {
        for (i, r) in rows.iter_mut().enumerate() {
            r[0] += if i > 100 { 3.0 } else { 0.0 } + 0.009 * noise(i, run + 9);
            r[1] = (r[1] * 10.0).round() / 10.0;
        }
    });
    let data = folder.load(MODEL).unwrap();
    for check in ["stamps in bunches", "held target"] {
        assert!(finding(&data, check).is_none(), "{:?}", data.hygiene);
    }
}

#[test]
fn columns_that_are_alike_are_named() {
    let folder = Folder::new();
    for run in 0..3 {
        let text = rows(run, 200).iter().enumerate().fold(
            "t,y,c,d,e\n".to_string(),
            |s, (i, [t, y, c])| {
                s + &format!(
                    "{t},{y},{c},{},{}\n",
                    2.0 - 3.0 * c + 1e-4 * noise(i, run),
                    c + 0.1 * noise(i, 7)
                )
            },
        );
        folder.put(&format!("run{run}.csv"), &text);
    }
    let channels = "[roles.channels]\nd = { column = \"d\" }\ne = { column = \"e\" }\n[[terms]]";
    let data = folder.load(&MODEL.replace("[[terms]]", channels)).unwrap();
    let alike: Vec<&Finding> = data
        .hygiene
        .iter()
        .filter(|f| f.check.contains(" like "))
        .collect();
    assert_eq!(alike.len(), 1, "{alike:?}");
    let said = "columns `c` (command) and `d` (d) move alike (correlation -1.000000)";
    assert!(alike[0].what.contains(said), "{alike:?}");
}

#[test]
fn a_time_in_two_columns_is_one() {
    let two = |text: &dyn Fn(f64) -> String| {
        let folder = Folder::new();
        for run in 0..3 {
            let lines = rows(run, 200);
            let lines = lines
                .iter()
                .map(|[t, y, c]| format!("{},{y},{c}\n", text(*t)));
            folder.put(
                &format!("run{run}.csv"),
                &format!("a,b,y,c\n{}", lines.collect::<String>()),
            );
        }
        folder.load(&MODEL.replace("\"t\"", "\"a+b\"")).unwrap()
    };
    // Over midnight.
    let date = |t: f64| {
        let s = 86_398.5 + t;
        let (day, s) = if s < 86_400.0 {
            (4, s)
        } else {
            (5, s - 86_400.0)
        };
        let (h, m) = ((s / 3600.0).floor(), (s % 3600.0 / 60.0).floor());
        format!("2026-03-0{day},{h:02}:{m:02}:{:06.3}", s % 60.0)
    };
    let nanoseconds = |t: f64| {
        let ns = (1e9 * (t + 0.5)).round();
        format!("{},{}", 1_741_082_400.0 + (ns / 1e9).floor(), ns % 1e9)
    };
    for data in [two(&date), two(&nanoseconds)] {
        let time = data.frame().time();
        assert_eq!((time.len(), data.frame().sequences().len()), (600, 3));
        assert!(
            (time[199] - time[0] - 3.98).abs() < 1e-5,
            "{}",
            time[199] - time[0]
        );
    }
}

#[test]
fn a_rate_begins_again_where_lines_were_left_out() {
    let folder = Folder::new();
    for run in 0..3 {
        let text = csv(&rows(run, 200)).replace("t,y,c", "x,y,c");
        let lines: Vec<&str> = text.lines().collect();
        let with = [
            &lines[..101],
            &["Channels,3", "Samples,1000"],
            &lines[101..],
        ]
        .concat();
        folder.put(&format!("run{run}.csv"), &with.join("\n"));
    }
    let model = format!("[input]\nrate = 50.0\n{MODEL}[hygiene]\ntext = \"drop\"\n");
    let data = folder.load(&model).unwrap();
    assert_eq!(
        (data.frame().len(), data.frame().sequences().len()),
        (600, 6)
    );
    assert_eq!(data.frame().time()[100..102], [0.0, 0.02]);
}
