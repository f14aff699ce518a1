//! Prints the ranges from which a virtual arm is drawn, as the table of docs/robot.md, or with a
//! seed one arm's own figures.
//!
//! `cargo run -p robot --example parameters [SEED]`

use robot::arm::parameters::{table, Parameters};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    match std::env::args().nth(1) {
        None => print!("{}", table()),
        Some(seed) => println!("{:#?}", Parameters::draw(seed.parse()?, 1.0)),
    }
    Ok(())
}
