//! What other commands do for a page: `forcectl zero`, and `forcectl record` until it is ended.
//! They are clients of the same service.

use rustix::process::{kill_process, Pid, Signal};
use serde_json::{json, Value};
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};
use tokio::process::{Child, Command};
use tokio::sync::{oneshot, watch};
use tokio::time::{sleep, timeout};

/// What a recorder writes first: Ctrl-C ends it as it should from then on.
const FIRST_FILE: &str = "run.mcap";
/// Longest wait for that file: a recorder that waits for its link longer has nothing to lose.
const STARTS: Duration = Duration::from_secs(10);
/// Time between two looks.
const LOOK: Duration = Duration::from_millis(20);

/// Starts the commands, and knows of the recording.
pub(crate) struct Tools {
    program: PathBuf,
    link: String,
    /// Where recordings are made.
    folder: PathBuf,
    recording: Mutex<Option<Recording>>,
    /// Parameters of the notification `recording`, for all pages.
    state: watch::Sender<Value>,
}

/// A recording that runs.
struct Recording {
    /// Its folder.
    place: PathBuf,
    /// Ends it; `None`: it was asked to end.
    end: Option<oneshot::Sender<()>>,
}

impl Tools {
    pub(crate) fn new(program: PathBuf, link: String) -> Self {
        Self {
            program,
            link,
            folder: std::env::current_dir().unwrap_or_default(),
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
        let place = self.folder.join(&folder);
        let child = self
            .command(&["record", &folder])
            .current_dir(&self.folder)
            .spawn()
            .map_err(|error| format!("the recording does not start: {error}"))?;
        let (end, asked) = oneshot::channel();
        *recording = Some(Recording {
            place: place.clone(),
            end: Some(end),
        });
        let on = json!({"on": true, "folder": place.to_string_lossy()});
        self.state.send_replace(on.clone());
        let tools = Arc::clone(self);
        tokio::spawn(async move {
            let ended = result(until_ended(child, &place, asked).await);
            let folder = place.to_string_lossy();
            let state = match ended {
                Ok(said) => json!({"on": false, "folder": folder, "samples": said["samples"]}),
                Err(error) => json!({"on": false, "folder": folder, "error": error}),
            };
            // Under the lock: a recording that begins now tells its state after this one.
            let mut recording = (tools.recording.lock()).unwrap_or_else(PoisonError::into_inner);
            *recording = None;
            tools.state.send_replace(state);
        });
        Ok(on)
    }

    /// Ends the recording as Ctrl-C does: what was received is kept. Asked again while it ends, it
    /// answers the same and does nothing: a second Ctrl-C would end the recorder while it writes.
    ///
    /// # Errors
    /// None runs.
    pub(crate) fn end_recording(&self) -> Result<Value, String> {
        let mut recording = self
            .recording
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let recording = recording.as_mut().ok_or("no recording runs")?;
        if let Some(end) = recording.end.take() {
            // Fails where it has ended by itself just now.
            let _ = end.send(());
            let folder = recording.place.to_string_lossy();
            self.state
                .send_replace(json!({"on": true, "ending": true, "folder": folder}));
        }
        Ok(json!({}))
    }
}

/// Waits for a recorder, and sends it one Ctrl-C when that is asked for.
async fn until_ended(
    child: Child,
    place: &Path,
    asked: oneshot::Receiver<()>,
) -> std::io::Result<Output> {
    let id = child.id().and_then(|id| i32::try_from(id).ok());
    let process = id.and_then(Pid::from_raw);
    let mut output = std::pin::pin!(child.wait_with_output());
    let begun_and_asked = async {
        // Without a sender nobody asks any more.
        if asked.await.is_err() {
            std::future::pending::<()>().await;
        }
        let begins = async {
            while !place.join(FIRST_FILE).exists() {
                sleep(LOOK).await;
            }
        };
        // Before, the signal would kill a process without a handler.
        let _ = timeout(STARTS, begins).await;
    };
    tokio::select! {
        biased;
        ended = &mut output => return ended,
        () = begun_and_asked => {}
    }
    // Not waited for yet, so the number is still its own.
    if let Some(process) = process {
        kill_process(process, Signal::INT)?;
    }
    output.await
}

/// What a command said as JSON; its error in words where it failed.
fn result(output: std::io::Result<std::process::Output>) -> Result<Value, String> {
    let output = output.map_err(|error| error.to_string())?;
    let said: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    // 130: ended by Ctrl-C, as asked.
    if output.status.success() || output.status.code() == Some(130) {
        return Ok(said);
    }
    // A recording that was ended before the first sample: the page tells that there are none.
    if said["error"].is_null() && said["samples"] == 0 {
        return Ok(said);
    }
    let words = said["error"].as_str().map(str::to_owned);
    Err(words.unwrap_or_else(|| format!("the command ended: {}", output.status)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A recorder that takes its time to start and to write, and notes each Ctrl-C. It is a script
    /// for `sh`, which gets `record FOLDER`.
    const RECORDER: &str = r#"
# A shell can't trap what was ignored when it began, as for a job in the background.
if [ -z "$AGAIN" ] && env --default-signal=INT true 2> /dev/null; then
    AGAIN=1 exec env --default-signal=INT sh "$0" "$@"
fi
sleep 0.3
trap 'echo signal >> signals' INT
mkdir "$1"
: > "$1/run.mcap"
while ! [ -e signals ]; do sleep 0.02; done
while ! [ -e written ]; do sleep 0.02; done
echo '{"samples": 7}'
"#;

    fn tools(folder: &Path) -> Arc<Tools> {
        std::fs::write(folder.join("record"), RECORDER).unwrap();
        let mut tools = Tools::new("/bin/sh".into(), "fast".to_owned());
        tools.folder = folder.to_owned();
        Arc::new(tools)
    }

    /// Longest wait: the machine may be busy.
    const PATIENCE: Duration = Duration::from_secs(60);

    async fn there(path: &Path) {
        let there = async {
            while !path.exists() {
                sleep(LOOK).await;
            }
        };
        timeout(PATIENCE, there).await.expect("it never came");
    }

    #[tokio::test]
    async fn a_recording_that_is_ended_twice_gets_one_signal_and_writes_its_files() {
        for at_once in [true, false] {
            let folder = tempfile::tempdir().unwrap();
            let tools = tools(folder.path());
            assert!(tools.end_recording().is_err(), "none runs");
            let place = tools.record().unwrap()["folder"].clone();
            let begun = Path::new(place.as_str().unwrap()).join(FIRST_FILE);
            let signals = folder.path().join("signals");
            if !at_once {
                there(&begun).await;
            }
            assert_eq!(tools.end_recording(), Ok(json!({})));
            let ending = json!({"on": true, "ending": true, "folder": place});
            assert_eq!(*tools.recording().borrow(), ending);
            there(&signals).await;
            // It writes its files now.
            assert_eq!(tools.end_recording(), Ok(json!({})));
            assert!(tools.record().is_err(), "one runs");
            sleep(10 * LOOK).await;
            std::fs::write(folder.path().join("written"), "").unwrap();
            let mut state = tools.recording();
            let ended = state.wait_for(|state| state["on"] == false);
            let ended = timeout(PATIENCE, ended).await.expect("it ends").unwrap();
            let wanted = json!({"on": false, "folder": place, "samples": 7});
            assert_eq!(*ended, wanted, "{at_once}");
            let signals = std::fs::read_to_string(&signals).unwrap();
            assert_eq!(signals, "signal\n", "{at_once}");
        }
    }
}
