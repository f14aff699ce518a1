//! `residual --data PATH... --model MODEL.toml --out DIR`: the analysis by itself.

use residual::{clear, run, spec::Spec, Console, Error, Options};
use std::path::PathBuf;
use std::process::ExitCode;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[cfg(feature = "programs")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const USAGE: &str = "usage: residual --data PATH... --model MODEL.toml [--out DIR]";

struct Arguments {
    data: Vec<PathBuf>,
    model: PathBuf,
    out: Option<PathBuf>,
}

fn arguments() -> Result<Arguments, String> {
    let (mut data, mut model, mut out) = (vec![], None, None);
    let mut args = std::env::args_os().skip(1).peekable();
    while let Some(a) = args.next() {
        let mut value = |name: &str| {
            args.next()
                .map(PathBuf::from)
                .ok_or(format!("{name} needs a path"))
        };
        match a.to_str() {
            Some("--model") => model = Some(value("--model")?),
            Some("--out") => out = Some(value("--out")?),
            Some("--data") => {
                while let Some(path) =
                    args.next_if(|x| !x.to_str().is_some_and(|x| x.starts_with("--")))
                {
                    data.push(PathBuf::from(path));
                }
            }
            _ => return Err(format!("`{}` is not an option", a.to_string_lossy())),
        }
    }
    let model = model.ok_or("--model is missing")?;
    if data.is_empty() {
        return Err("--data is missing".into());
    }
    Ok(Arguments { data, model, out })
}

fn analyse(a: Arguments) -> Result<String, Error> {
    if let Some(out) = &a.out {
        clear(out)?;
    }
    let options = Options {
        data: a.data,
        model: Spec::load(&a.model)?,
        out: a.out,
    };
    Ok(run(&options, &mut Console::default())?.summary())
}

fn main() -> ExitCode {
    let arguments = match arguments() {
        Ok(a) => a,
        Err(e) => {
            eprintln!("error: {e}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    match analyse(arguments) {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(e.exit_code())
        }
    }
}
