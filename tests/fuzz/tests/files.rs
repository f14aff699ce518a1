//! Files that people write and programs read: rig files, model files with their expressions, logs.

use fuzz::{check, damaged, damaged_text, damages};
use proptest::collection::vec;
use proptest::prelude::{any, Strategy};
use proptest::sample::select;
use residual::expr::Expr;
use residual::spec::Spec;
use rig::{Rig, DEFAULT_TEXT as RIG};

const MODEL: &str = r#"
[roles]
time = { column = "t", unit = "s" }
target = { column = "y", unit = "N" }
command = { column = "c", unit = "N" }
velocity = { column = "v", unit = "rad/s" }
[selection]
decoys = 32
[[terms]]
name = "tension"
expr = "command"
fixed = 1.0
[[terms]]
name = "friction"
expr = "sign(velocity) * (0.9 + 0.15 * command)"
"#;

#[test]
fn rig_files() {
    assert!(Rig::parse("rig.toml", RIG).is_ok());
    check(2, damages(), |damages| {
        let _ = Rig::parse("rig.toml", &damaged_text(RIG, &damages));
    });
}

#[test]
fn model_files() {
    assert!(Spec::parse(MODEL).is_ok());
    check(1, damages(), |damages| {
        let _ = Spec::parse(&damaged_text(MODEL, &damages));
    });
}

/// Words of the language, and what is none, in any order.
fn words() -> impl Strategy<Value = String> {
    let known = select(vec![
        "+", "-", "*", "/", "^", "(", ")", ",", "&&", "||", "==", "<", "!", "x", "v", "1", "2.5e3",
        ".", "e", "1e", "pi", "abs", "sign", "lowpass", "delay", "play", "min", "max", "\u{fc}",
        " ", "\0",
    ]);
    vec(known, 0..60).prop_map(|words| words.concat())
}

#[test]
fn expressions() {
    check(1, words(), |text| {
        if let Ok(expression) = Expr::parse(&text) {
            // What is written is read as the same.
            let again = Expr::parse(&expression.to_string());
            assert_eq!(
                again.as_ref().map(ToString::to_string).ok(),
                Some(expression.to_string())
            );
        }
    });
}

/// Each kind of nesting, far deeper than anyone writes: an error, and no end of the stack.
#[test]
fn deep_nesting() {
    const DEEP: usize = 60_000;
    let around = |open: &str, close: &str| open.repeat(DEEP) + "x" + &close.repeat(DEEP);
    for text in [
        around("(", ")"),
        around("-", ""),
        around("!", ""),
        around("abs(", ")"),
        around("", "+0*x"),
        around("", "^2"),
        around("x^", ""),
        around("x+(", ")"),
        around("min(x,", ")"),
        around("", "&&x"),
    ] {
        assert!(Expr::parse(&text).is_err(), "{}", &text[..20]);
        let model = MODEL.replace("sign(velocity)", &text);
        assert!(Spec::parse(&model).is_err(), "{}", &text[..20]);
    }
    for (open, close) in [("[", "]"), ("{a=", "}")] {
        let text = format!("a = {}", around(open, close));
        assert!(Spec::parse(&text).is_err());
        assert!(Rig::parse("rig.toml", &text).is_err());
    }
    // As deep as it may be: the deepest that is read must also be printed and dropped.
    for depth in [100, 150, 190] {
        let text = "(".repeat(depth) + "x" + &")".repeat(depth);
        assert_eq!(
            Expr::parse(&text).map(|e| e.to_string()).ok().as_deref(),
            Some("x")
        );
    }
}

#[test]
fn logs() {
    let mut log = String::from("t,y,c,v\n");
    for row in 0..200 {
        let t = f64::from(row) * 0.01;
        log += &format!(
            "{t:.2},{:.4},{:.4},{:.4}\n",
            t.sin(),
            t.cos(),
            3.0 * t.cos()
        );
    }
    let spec = Spec::parse(MODEL).expect("the model");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("log.csv");
    check(4, (damages(), any::<bool>()), |(damages, header)| {
        let skip = if header { 0 } else { 8 };
        std::fs::write(&path, damaged(&log.as_bytes()[skip..], &damages)).expect("written");
        let _ = residual::load::load(std::slice::from_ref(&path), &spec);
    });
}
