//! `cargo xtask inspect`: what the image's machine code can do, whatever the sources say. No panic
//! can be reached from the sample path, and the stack is large enough.

mod calls;
mod stack;
mod thumb;

use std::fmt::Write as _;
use std::fs;

use crate::report::{grouped, Failure, Result};
use crate::workspace::Workspace;
use calls::Calls;
use stack::{Depths, EXCEPTION};

/// From where a sample takes its way: the interrupts of its level, and the stage of the superloop.
const SAMPLE_PATH: [&str; 12] = [
    "EXTI0",
    "EXTI1",
    "EXTI2",
    "EXTI3",
    "EXTI4",
    "EXTI9_5",
    "I2C1_EV",
    "I2C1_ER",
    "TIM2",
    "SPI1",
    "SysTick",
    "5Board7samples",
];

/// Interrupts of the links' level.
const LINKS: [&str; 2] = ["DMA_STR0", "OTG_FS"];

/// What a panic calls: the symbol of `#[panic_handler]`.
const PANIC: &str = "rust_begin_unwind";

/// Reads the image, prints what was found.
///
/// # Errors
/// A panic can be reached from the sample path, the stack is too small, or the image lacks what
/// this looks for.
pub fn run(workspace: &Workspace) -> Result<()> {
    print!("{}", report(&image(workspace)?)?);
    Ok(())
}

/// The most bytes of stack that the image can take.
///
/// # Errors
/// The image can't be read, or lacks what this looks for.
pub fn stack_bound(workspace: &Workspace) -> Result<u32> {
    let calls = image(workspace)?;
    let panic = address(&calls, PANIC)?;
    let (levels, _) = levels(&calls, panic)?;
    Ok(levels.iter().map(|(_, bytes)| bytes).sum())
}

fn image(workspace: &Workspace) -> Result<Calls> {
    let path = workspace.firmware_elf();
    let bytes = fs::read(&path).map_err(|error| {
        Failure::new(format!("{} can't be read: {error}", workspace.show(&path)))
    })?;
    Calls::read(&bytes)
}

fn address(calls: &Calls, name: &str) -> Result<u32> {
    calls.find(name).ok_or_else(|| {
        Failure::new(format!("the image has no function {name}")).remedy(
            "where it was inlined, mark it #[inline(never)]; where it has another name, change xtask/src/inspect",
        )
    })
}

fn addresses(calls: &Calls, names: &[&str]) -> Result<Vec<u32>> {
    names.iter().map(|name| address(calls, name)).collect()
}

fn report(calls: &Calls) -> Result<String> {
    let roots = addresses(calls, &SAMPLE_PATH)?;
    let panic = address(calls, PANIC)?;
    let (way, reached) = calls.way(&roots, panic);
    if let Some(way) = way {
        let names: Vec<String> = way.iter().map(|at| calls.name(*at)).collect();
        return Err(Failure::new(format!(
            "a panic can be reached from the sample path:\n  {}",
            names.join("\n  ")
        ))
        .remedy("an index wants get(), a division a divisor that the compiler knows, a log another place"));
    }
    let mut text = format!(
        "panics: none can be reached from the {} entries of the sample path ({reached} functions of {})\n",
        roots.len(),
        calls.functions.len()
    );
    text.push_str(&stack_report(calls, panic)?);
    Ok(text)
}

/// Stack of each level that can interrupt the one before it: its name, and bytes at most.
type Levels = [(&'static str, u32); 4];

/// The stack of each level, and the functions that can call each other.
fn levels(calls: &Calls, panic: u32) -> Result<(Levels, Vec<u32>)> {
    let mut depths = Depths::new(calls, panic);
    let mut deepest = |names: &[&str]| -> Result<u32> {
        let roots = addresses(calls, names)?;
        Ok(roots.into_iter().map(|at| depths.of(at)).max().unwrap_or(0))
    };
    // `samples` belongs to the superloop.
    let interrupts = &SAMPLE_PATH[..SAMPLE_PATH.len() - 1];
    let levels = [
        ("superloop", deepest(&["main"])?),
        ("interrupts of the links", EXCEPTION + deepest(&LINKS)?),
        (
            "interrupts of the sample path",
            EXCEPTION + deepest(interrupts)?,
        ),
        ("NMI", EXCEPTION + deepest(&["NonMaskableInt"])?),
    ];
    Ok((levels, depths.recursive))
}

fn stack_report(calls: &Calls, panic: u32) -> Result<String> {
    let (levels, recursive) = levels(calls, panic)?;
    let edge = |name: &str| {
        (calls.symbol(name)).ok_or_else(|| Failure::new(format!("the image has no symbol {name}")))
    };
    let room = edge("_stack_start")?.saturating_sub(edge("_stack_end")?);
    let sum: u32 = levels.iter().map(|(_, bytes)| bytes).sum();
    let mut text = format!("\n{:<32}{:>10}\n", "stack, at most", "bytes");
    for (name, bytes) in levels {
        let _ = writeln!(text, "{name:<32}{:>10}", grouped(bytes.into()));
    }
    let _ = writeln!(
        text,
        "{:<32}{:>10} of {}",
        "all",
        grouped(sum.into()),
        grouped(room.into())
    );
    if let Some(first) = recursive.first() {
        let _ = writeln!(
            text,
            "{} functions can call each other and count once each: {} and others",
            recursive.len(),
            calls.name(*first)
        );
    }
    for function in calls.functions.values().filter(|f| f.takes_any_amount) {
        let _ = writeln!(
            text,
            "not counted, an amount at run time: {}",
            function.name
        );
    }
    if sum > room {
        return Err(Failure::new(format!(
            "{text}\nthe stack has {room} bytes and can need {sum}"
        )));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The entries, a superloop and a panic; `samples` goes to `next`.
    fn image(next: &'static [&'static str]) -> Calls {
        let mut functions: Vec<(&str, u32, &[&str])> = vec![
            ("main", 512, &["5Board7samples"]),
            ("NonMaskableInt", 8, &[]),
            ("helper", 16, &[PANIC]),
            (PANIC, 64, &[]),
        ];
        for name in SAMPLE_PATH.into_iter().chain(LINKS) {
            let goes: &[&str] = if name == "5Board7samples" { next } else { &[] };
            functions.push((name, 32, goes));
        }
        Calls::of(&functions)
    }

    #[test]
    fn a_panic_behind_the_sample_path_is_an_error_that_names_the_way() {
        let error = report(&image(&["helper"])).unwrap_err().to_string();
        assert!(error.contains("5Board7samples\n  helper\n"), "{error}");
    }

    #[test]
    fn a_missing_entry_is_an_error() {
        let mut calls = image(&[]);
        calls
            .functions
            .retain(|_, function| function.name != "SPI1");
        let error = report(&calls).unwrap_err().to_string();
        assert!(error.contains("no function SPI1"), "{error}");
    }
}
