//! `forcectl`: the command line of the force rig.
// `println!` and `eprintln!` panic where the reader is gone; `cli::output` does not.
#![deny(clippy::print_stdout, clippy::print_stderr)]
// The first build leaves commands out, and with them the users of what all commands share.
#![cfg_attr(not(feature = "record"), allow(dead_code))]

mod cli;

/// In the residual analysis columns come and go by the thousand; the system's allocator gives their
/// memory back each time.
#[cfg(feature = "residual")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    cli::main()
}
