//! `cargo xtask residual-report`: see the library of this package.

use measured_rig::arguments::{self, Request, USAGE};
use measured_rig::data::Data;
use std::path::Path;
use std::process::ExitCode;

/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    let (data, page) = match arguments::parse(std::env::args_os().skip(1)) {
        Ok(Request::Page { data, page }) => (data, page),
        Ok(Request::Help) => {
            println!("{USAGE}");
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("error: {error}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    let data = match Data::locate(data, Path::new("")) {
        Ok(data) => data,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::from(3);
        }
    };
    match measured_rig::write(&data, &page) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
