//! `forcectl`: the command line of the force rig.
#![forbid(unsafe_code)]

mod cli;
/// Columns come and go by the thousand; the system's allocator gives their memory back each time.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    cli::main()
}
