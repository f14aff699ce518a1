//! The command line.

use std::path::PathBuf;

/// What `--help` prints; `cargo xtask closed-loop --help` as well.
pub const HELP: &str = include_str!("help.txt");

/// The command line.
pub struct Options {
    pub forcectl: PathBuf,
    pub seeds: (u64, u64),
    pub drive: String,
    pub hold: String,
    pub size: f64,
    pub out: PathBuf,
    pub markdown: Option<PathBuf>,
    pub reuse: bool,
}

/// Reads the command line; `None` for `--help`.
pub fn options() -> Result<Option<Options>, String> {
    let mut options = Options {
        forcectl: PathBuf::new(),
        seeds: (1, 10),
        drive: "40".to_owned(),
        hold: "16".to_owned(),
        size: 1.0,
        out: PathBuf::from("target/closed-loop"),
        markdown: None,
        reuse: false,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || {
            words
                .next()
                .ok_or(format!("{word} needs a value\n\n{HELP}"))
        };
        match word.as_str() {
            "--forcectl" => options.forcectl = value()?.into(),
            "--seeds" => {
                let text = value()?;
                let (first, last) = text.split_once("..").unwrap_or((&text, &text));
                let seed = |t: &str| t.trim_start_matches('=').parse::<u64>().ok();
                options.seeds = seed(first)
                    .zip(seed(last))
                    .filter(|(first, last)| (1..=*last).contains(first))
                    .ok_or(format!(
                        "--seeds {text}: give FIRST..LAST, whole numbers from 1"
                    ))?;
            }
            "--drive-duration" => options.drive = value()?,
            "--duration" => options.hold = value()?,
            "--size" => {
                let text = value()?;
                let size = text.parse().ok().filter(|x| (0.1..=1.0).contains(x));
                options.size = size.ok_or(format!("--size {text}: give 0.1 to 1"))?;
            }
            "--out" => options.out = value()?.into(),
            "--reuse" => options.reuse = true,
            "--markdown" => options.markdown = Some(value()?.into()),
            "-h" | "--help" => return Ok(None),
            other => return Err(format!("{other} is not an option\n\n{HELP}")),
        }
    }
    if options.forcectl.as_os_str().is_empty() {
        return Err(format!("--forcectl is missing\n\n{HELP}"));
    }
    Ok(Some(options))
}
