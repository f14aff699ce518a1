//! `forcectl`: the command line of the force rig.
#![forbid(unsafe_code)]

mod cli;

/// In the residual analysis columns come and go by the thousand; the system's allocator gives their memory back each
/// time.
#[cfg(feature = "residual")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    cli::main()
}
