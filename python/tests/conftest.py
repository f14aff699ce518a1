"""What the tests share. `cargo xtask test python` runs them in a clean environment with the package installed."""

import json
import os
import shutil
import subprocess

import pytest

FORCECTL = os.environ.get("FORCECTL") or shutil.which("forcectl")


class Forcectl:
    """The command, in a folder and with a state of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.env = {**os.environ, "FORCECTL_STATE_DIR": str(folder / "state"), "FORCECTL_RUNTIME_DIR": str(folder / "run")}

    def run(self, *arguments):
        """Its result, whatever the exit code."""
        return subprocess.run(
            [FORCECTL, *map(str, arguments)], cwd=self.folder, env=self.env, capture_output=True, text=True, check=False
        )

    def json(self, *arguments):
        """The object that `--json` prints."""
        done = self.run("--json", *arguments)
        assert done.stdout, done.stderr
        return json.loads(done.stdout)

    def refusal(self, *arguments):
        """Exit code, and the words of the error."""
        done = self.run("--json", *arguments)
        return done.returncode, json.loads(done.stdout)["error"]


@pytest.fixture
def forcectl(tmp_path):
    if FORCECTL is None:
        pytest.skip("no forcectl on the path, and FORCECTL names none")
    return Forcectl(tmp_path)
