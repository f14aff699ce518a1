//! Hands the memory map and the linker scripts to the linker, for the firmware only: host builds of
//! the pure half link like any program.

use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=memory.x");
    if env::var("CARGO_CFG_TARGET_OS")? != "none" {
        return Ok(());
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("memory.x", out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    // cortex-m-rt's sections, defmt's symbols. Here rather than in .cargo/config.toml, which would
    // have to name a target and break host builds.
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    // Page alignment means nothing in flash and would only pad the image.
    println!("cargo:rustc-link-arg-bins=--nmagic");
    Ok(())
}
