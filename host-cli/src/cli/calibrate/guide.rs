//! Questions to the user during a step that he does by hand.

use super::super::exit::{self, Failure, Result};
use super::super::output;
use std::io::BufRead;
use std::sync::mpsc::{self, TryRecvError};

/// What the user says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// Done; with what was typed (or what a digitizer streamed).
    Go(String),
    /// The last one was wrong.
    Undo,
    /// Stop here, and go on another day.
    Quit,
}

/// Asks, and waits for a line on standard input. The end of the input is a stop.
pub fn ask(prompt: &str) -> Result<Answer> {
    ask_or(prompt, Answer::Quit)
}

/// The same, and the end of the input is `at_end`.
pub fn ask_or(prompt: &str, at_end: Answer) -> Result<Answer> {
    output::to_stderr(prompt);
    read_answer(at_end)
}

/// The same, and `step` is called again and again until the answer is there.
///
/// # Errors
/// Those of [`ask`], and the first of `step`.
pub fn ask_while(prompt: &str, step: &mut dyn FnMut() -> Result<()>) -> Result<Answer> {
    output::to_stderr(prompt);
    let (sender, receiver) = mpsc::channel();
    // After an error of `step` the thread goes on waiting for a line; it ends with the program.
    std::thread::spawn(move || {
        // Nobody listens any more when the question was broken off.
        let _ = sender.send(read_answer(Answer::Quit));
    });
    loop {
        match receiver.try_recv() {
            Ok(answer) => return answer,
            Err(TryRecvError::Empty) => step()?,
            Err(TryRecvError::Disconnected) => return Ok(Answer::Quit),
        }
    }
}

fn read_answer(at_end: Answer) -> Result<Answer> {
    let mut line = String::new();
    match std::io::stdin().lock().read_line(&mut line) {
        Ok(0) => Ok(at_end),
        Ok(_) => Ok(answer(&line)),
        Err(error) => Err(Failure::usage(format!("the answer can't be read: {error}"))),
    }
}

fn answer(line: &str) -> Answer {
    match line.trim() {
        "u" | "undo" => Answer::Undo,
        "q" | "quit" => Answer::Quit,
        text => Answer::Go(text.to_owned()),
    }
}

/// The step was broken off.
pub fn broken_off(done: usize, of: usize, what: &str) -> Failure {
    Failure::new(
        exit::INTERRUPTED,
        format!(
            "stopped after {done} of {of} {what}; they are kept, and the same command goes on from there (--restart begins anew)"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_the_user() {
        assert_eq!(answer(" u\n"), Answer::Undo);
        assert_eq!(answer("quit"), Answer::Quit);
        assert_eq!(answer("\n"), Answer::Go(String::new()));
        assert_eq!(answer("1 2 3\n"), Answer::Go("1 2 3".to_owned()));
    }
}
