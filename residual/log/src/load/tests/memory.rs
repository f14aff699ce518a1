//! Columns in memory that are no plain numbers, and one log to check a model on.

use super::*;

fn table(name: &str) -> Table {
    let seconds: Vec<f64> = (0..100).map(|i| 0.01 * f64::from(i)).collect();
    let command: Vec<f64> = seconds.iter().map(|t| (7.0 * t).sin()).collect();
    let target = command.iter().map(|c| 1.1 * c).collect();
    Table::new(name)
        .with_time("t", seconds, "a timestamp")
        .with("c", command)
        .with("y", target)
        .with_text("note", "hello")
}

#[test]
fn a_time_by_its_type_takes_no_scale_and_text_is_quoted() {
    let spec = Spec::parse(MODEL).unwrap();
    let data = from_tables(vec![table("a"), table("b")], &spec);
    // The same rows twice.
    assert!(data.unwrap_err().to_string().contains("copied"));
    let scaled = MODEL.replace("unit = \"s\"", "unit = \"s\", scale = 0.001");
    let scaled = Spec::parse(&scaled).unwrap();
    let error = from_tables(vec![table("a")], &scaled).unwrap_err();
    let words = "column `t` is a timestamp, which is converted to seconds by its type";
    assert!(error.to_string().contains(words), "{error}");
    let of_text = Spec::parse(&MODEL.replace("\"c\"", "\"note\"")).unwrap();
    let error = from_tables(vec![table("a")], &of_text).unwrap_err();
    assert!(matches!(&error, Error::BadCell { text, .. } if text == "hello"));
}

#[test]
fn one_table_is_enough_to_check_a_model_on() {
    let spec = Spec::parse(MODEL).unwrap();
    assert!(from_tables(vec![table("a")], &spec).is_err());
    let data = from_tables_to_check(vec![table("a")], &spec).unwrap();
    assert_eq!(data.kept_rows().len(), 100);
}
