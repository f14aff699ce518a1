//! `residual --data PATH... --model MODEL.toml --out DIR`: the analysis by itself.

use residual::{run, Console, Error, Options};
use std::path::PathBuf;
use std::process::ExitCode;

fn options() -> Result<Options, String> {
    let (mut data, mut model, mut out) = (vec![], None, None);
    let mut args = std::env::args().skip(1).peekable();
    while let Some(a) = args.next() {
        match a.as_str() {
            "--data" => {
                while let Some(path) = args.next_if(|x| !x.starts_with("--")) {
                    data.push(PathBuf::from(path));
                }
            }
            "--model" => model = args.next().map(PathBuf::from),
            "--out" => out = args.next().map(PathBuf::from),
            other => return Err(format!("`{other}` is not an option")),
        }
    }
    let model = model.ok_or("--model is missing")?;
    if data.is_empty() {
        return Err("--data is missing".into());
    }
    let model = residual::spec::Spec::load(&model).map_err(|e: Error| e.to_string())?;
    Ok(Options { data, model, out })
}

fn main() -> ExitCode {
    let options = match options() {
        Ok(o) => o,
        Err(e) => {
            eprintln!("error: {e}\nusage: residual --data PATH... --model MODEL.toml [--out DIR]");
            return ExitCode::from(2);
        }
    };
    match run(&options, &mut Console::default()) {
        Ok(report) => {
            println!("{}", report.summary());
            ExitCode::SUCCESS
        }
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(e.exit_code())
        }
    }
}
