//! What other commands do for a page: `forcectl zero`, and `forcectl record` until it is ended.
//! They are clients of the same service.

use rustix::process::{kill_process, Pid, Signal};
use serde_json::{json, Value};
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;
use tokio::process::Command;
use tokio::sync::watch;

/// Starts the commands, and knows of the recording.
pub(crate) struct Tools {
    program: PathBuf,
    link: String,
    /// The process that records.
    recording: Mutex<Option<Pid>>,
    /// Parameters of the notification `recording`, for all pages.
    state: watch::Sender<Value>,
}

impl Tools {
    pub(crate) fn new(program: PathBuf, link: String) -> Self {
        Self {
            program,
            link,
            recording: Mutex::new(None),
            state: watch::Sender::new(json!({"on": false})),
        }
    }

    /// State of the recording from now on.
    pub(crate) fn recording(&self) -> watch::Receiver<Value> {
        self.state.subscribe()
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(&self.program);
        command
            .args(words)
            .args(["--link", &self.link, "--json"])
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .stdout(Stdio::piped());
        command
    }

    /// Measures the zeros.
    ///
    /// # Errors
    /// The command's words.
    pub(crate) async fn zero(&self) -> Result<Value, String> {
        result(self.command(&["zero"]).output().await)
    }

    /// Starts a recording; its folder has the time as its name.
    ///
    /// # Errors
    /// One runs, or the command does not start.
    pub(crate) fn record(self: &Arc<Self>) -> Result<Value, String> {
        let mut recording = self
            .recording
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if recording.is_some() {
            return Err("a recording runs already".to_owned());
        }
        let now = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
        let folder = format!("recording-{}", now.replace(':', "-"));
        let child = self
            .command(&["record", &folder])
            .spawn()
            .map_err(|error| format!("the recording does not start: {error}"))?;
        let id = child.id().and_then(|id| i32::try_from(id).ok());
        *recording = id.and_then(Pid::from_raw);
        let here = std::env::current_dir().unwrap_or_default();
        let place = here.join(&folder).to_string_lossy().into_owned();
        let on = json!({"on": true, "folder": place});
        self.state.send_replace(on.clone());
        let tools = Arc::clone(self);
        tokio::spawn(async move {
            let ended = result(child.wait_with_output().await);
            *(tools.recording.lock()).unwrap_or_else(PoisonError::into_inner) = None;
            let state = match ended {
                Ok(said) => json!({"on": false, "folder": place, "samples": said["samples"]}),
                Err(error) => json!({"on": false, "folder": place, "error": error}),
            };
            tools.state.send_replace(state);
        });
        Ok(on)
    }

    /// Ends the recording as Ctrl-C does: what was received is kept.
    ///
    /// # Errors
    /// None runs.
    pub(crate) fn end_recording(&self) -> Result<Value, String> {
        let recording = self
            .recording
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let process = recording.ok_or("no recording runs")?;
        kill_process(process, Signal::INT).map_err(|error| error.to_string())?;
        Ok(json!({}))
    }
}

/// What a command said as JSON; its error in words where it failed.
fn result(output: std::io::Result<std::process::Output>) -> Result<Value, String> {
    let output = output.map_err(|error| error.to_string())?;
    let said: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    // 130: ended by Ctrl-C, as asked.
    if output.status.success() || output.status.code() == Some(130) {
        return Ok(said);
    }
    let words = said["error"].as_str().map(str::to_owned);
    Err(words.unwrap_or_else(|| format!("the command ended: {}", output.status)))
}
