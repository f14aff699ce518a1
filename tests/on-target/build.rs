//! Linker scripts for the test image, as in `board/build.rs`, which also provides the memory map.

fn main() {
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("none") {
        println!("cargo:rustc-link-arg-tests=-Tlink.x");
        println!("cargo:rustc-link-arg-tests=-Tdefmt.x");
        println!("cargo:rustc-link-arg-tests=--nmagic");
    }
}
