//! Where things are: the workspace root, the target directory and the files in it.

use std::env;
use std::path::{Path, PathBuf};

/// Paths of one checkout.
#[derive(Debug, Clone)]
pub struct Workspace {
    root: PathBuf,
    target: PathBuf,
}

impl Workspace {
    /// Finds the checkout that this xtask runs in: that of the package which cargo runs. A copied
    /// clone has the program of the first one in its target directory, and cargo does not build it
    /// again.
    pub fn locate() -> Self {
        let root = root(
            env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from),
            Path::new(env!("CARGO_MANIFEST_DIR")),
        );
        // xtask runs as <target>/<profile>/xtask, so its own path gives the target directory
        // however it was chosen (default, CARGO_TARGET_DIR, a user's cargo configuration).
        let target = env::current_exe()
            .ok()
            .and_then(|exe| Some(exe.parent()?.parent()?.to_path_buf()))
            .filter(|dir| dir.join("CACHEDIR.TAG").is_file())
            .unwrap_or_else(|| root.join("target"));
        Self { root, target }
    }

    /// Another folder with a copy of the sources, and where to build it.
    pub fn of_copy(root: PathBuf, target: PathBuf) -> Self {
        Self { root, target }
    }

    /// The folder with the workspace's `Cargo.toml`.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Cargo's target directory for host programs.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// The firmware's own target directory. Another compiler with other flags works here; apart
    /// from the host's directory the two never wait for each other's lock nor spoil each other's
    /// fingerprints.
    pub fn firmware_target(&self) -> PathBuf {
        self.target.join("firmware")
    }

    /// The finished firmware image, ELF with debug information.
    pub fn firmware_elf(&self) -> PathBuf {
        self.firmware_target().join("force-board.elf")
    }

    /// The finished firmware image as raw flash contents.
    pub fn firmware_bin(&self) -> PathBuf {
        self.firmware_target().join("force-board.bin")
    }

    /// The host programs and libraries. All are built in the profile `dev`, whose folder is
    /// `debug`.
    pub fn programs(&self) -> PathBuf {
        self.target.join("debug")
    }

    /// A host program.
    pub fn program(&self, name: &str) -> PathBuf {
        self.programs()
            .join(format!("{name}{}", env::consts::EXE_SUFFIX))
    }

    /// xtask's own notes: logs of the test steps, attempts that failed.
    pub fn notes(&self) -> PathBuf {
        self.target.join("xtask")
    }

    /// The project's own files whose names end with `ending`, sorted; without build products, data
    /// and hidden folders.
    pub fn files(&self, ending: &str) -> Vec<PathBuf> {
        let mut files = Vec::new();
        collect(&self.root, ending, &mut files);
        files.sort();
        files
    }

    /// A path as shown to people: relative to the root where it lies below it.
    pub fn show(&self, path: &Path) -> String {
        path.strip_prefix(&self.root)
            .unwrap_or(path)
            .display()
            .to_string()
    }
}

fn collect(folder: &Path, ending: &str, files: &mut Vec<PathBuf>) {
    let Ok(entries) = folder.read_dir() else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with('.') || name == "target" || name == "data" {
            continue;
        }
        if path.is_dir() {
            collect(&path, ending, files);
        } else if name.ends_with(ending) {
            files.push(path);
        }
    }
}

/// The workspace's root, from the manifest's folder as cargo names it at run time, or from the one
/// of the build where xtask was started without cargo.
fn root(at_run: Option<PathBuf>, at_build: &Path) -> PathBuf {
    let manifest = at_run.unwrap_or_else(|| at_build.to_path_buf());
    manifest
        .parent()
        .map_or_else(|| manifest.clone(), Path::to_path_buf)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copied_clone_is_its_own_workspace() {
        let build = Path::new("/first/xtask");
        assert_eq!(root(Some("/copy/xtask".into()), build), Path::new("/copy"));
        assert_eq!(root(None, build), Path::new("/first"));
        // Cargo sets the variable for tests as well.
        assert_eq!(
            Workspace::locate().root(),
            Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
        );
    }
}
