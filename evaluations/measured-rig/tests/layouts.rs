//! Both layouts of the data: found, and read.

use measured_rig::arguments::{parse, Request};
use measured_rig::data::Data;
use measured_rig::{models, recording};
use residual::load::from_tables;
use residual::spec::Spec;
use std::path::Path;

#[test]
fn both_layouts_are_found_and_their_models_are_good() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let make = |name: &str| std::fs::create_dir_all(root.join(name)).unwrap();
    make("clone/force_gauge_records/motor_1");
    std::fs::write(root.join("clone/other.json"), "{}").unwrap();
    std::fs::write(root.join("clone/run.json"), "{\"load_cell_forces\": []}").unwrap();
    let original = Data::find(root);
    assert!(original.original && original.closed.is_none());
    assert_eq!(original.recordings, [root.join("clone/run.json")]);
    make("rig/force_gauge");
    make("rig/closed_loop");
    let named = Data::find(root);
    assert!(!named.original && named.recordings.is_empty());
    assert_eq!(named.closed, Some(root.join("rig/closed_loop")));
    for text in [models::GAUGE_ALL, models::GAUGE_MOVING] {
        let a = models::gauge(&original, text, "comp == 0").unwrap();
        let b = models::gauge(&named, text, "comp == 0").unwrap();
        assert_eq!(a.input.separator, "blank");
        assert_eq!(b.input.separator, ",");
    }
    Spec::parse(models::CLOSED_LOOP).unwrap();
}

#[test]
fn without_data_the_message_says_where_they_are_and_where_was_looked() {
    let folder = tempfile::tempdir().unwrap();
    let error = Data::locate(Some("nowhere".into()), folder.path()).unwrap_err();
    for part in ["nowhere", "git clone", "5e4966ee", "--data"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    // A relative folder is looked for below the base.
    std::fs::create_dir_all(folder.path().join("here/force_gauge")).unwrap();
    let data = Data::locate(Some("here".into()), folder.path()).unwrap();
    assert_eq!(data.gauge, Some(folder.path().join("here/force_gauge")));
}

#[test]
fn arguments_are_read_or_refused() {
    let read = |text: &str| parse(text.split_whitespace().map(Into::into));
    let page = |data: Option<&str>, page: &str| {
        Ok(Request::Page {
            data: data.map(Into::into),
            page: page.into(),
        })
    };
    assert_eq!(read(""), page(None, "docs/residual/rig.md"));
    assert_eq!(read("--page p.md --data d"), page(Some("d"), "p.md"));
    assert_eq!(read("--data d --help"), Ok(Request::Help));
    assert!(read("--data").unwrap_err().contains("--data needs"));
    assert!(read("--dta d").unwrap_err().contains("--dta"));
}

#[test]
fn a_closed_loop_recording_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let list = |f: &dyn Fn(u32) -> f64| {
        let numbers: Vec<String> = (0..40).map(|i| f(i).to_string()).collect();
        numbers.join(",")
    };
    // The two runs differ in their first rows: copies of a log are refused.
    let run = |first: f64| {
        format!(
        "{{\"load_cell_force_times\":[[],[{}]],\"load_cell_forces\":[[],[{}]],\"tor_cmds\":[[],[{}]],\
         \"p_terms\":[[],[1]],\"i_terms\":[[],[]],\"d_terms\":[[],[]],\"setpoints\":[[],[1,2]],\"pid_p\":1}}",
            list(&|i| 0.5 * f64::from(i)),
            list(&|i| f64::from(i * i) + if i < 5 { first } else { 0.0 }),
            list(&|i| 10.0 * f64::from(i))
        )
    };
    let tables: Vec<_> = [("a.json", 0.0), ("b.json", 1.0)]
        .map(|(name, first)| recording::read(&put(name, &run(first))).unwrap())
        .into();
    let spec = Spec::parse(models::CLOSED_LOOP).unwrap();
    let loaded = from_tables(tables, &spec).unwrap();
    assert_eq!(loaded.folds(), ["a.json", "b.json"]);
    // Unit 1 is idle. Forces are N as logged, commands a tenth of the mN·m; the rate of the
    // setpoints is their own.
    let column = |name: &str| loaded.frame().column(name).unwrap()[30..40].to_vec();
    let of = |f: &dyn Fn(u32) -> f64| (30..40).map(f).collect::<Vec<f64>>();
    assert_eq!(column("target"), of(&|i| f64::from(i * i)));
    assert_eq!(column("command"), of(&f64::from));
    assert_eq!(column("unit"), [2.0; 10]);
    assert_eq!(column("setpoint"), [2.0; 10]);
    assert_eq!(loaded.frame().column("setpoint").unwrap()[19], 1.0);
    assert_eq!(loaded.frame().time()[30..32], [15.0, 15.5]);

    for (text, part) in [("{\"x\": 1}", "load_cell_forces"), ("t,y\n", "expected")] {
        let error = recording::read(&put("bad.json", text)).unwrap_err();
        assert!(
            error.exit_code() == 3 && error.to_string().contains(part),
            "{error}"
        );
    }
    assert!(recording::read(Path::new("gone.json")).is_err());
}
