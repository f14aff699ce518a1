"""Every notebook runs to its end, and is stored without outputs."""

import pathlib
import shutil
import tempfile

import nbclient
import nbformat
import pytest

NOTEBOOKS = sorted((pathlib.Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def test_there_are_notebooks_without_outputs():
    assert NOTEBOOKS
    for path in NOTEBOOKS:
        notebook = nbformat.read(path, as_version=4)
        nbformat.validate(notebook)
        for cell in notebook.cells:
            assert cell.cell_type != "code" or (not cell.outputs and cell.execution_count is None), path.name


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(path, tmp_path, forcectl, monkeypatch):
    from conftest import FORCECTL

    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "forcectl").symlink_to(FORCECTL)
    # The path of a socket is short.
    with tempfile.TemporaryDirectory() as runtime:
        for name, value in {
            "PATH": f"{programs}:{pathlib.Path(shutil.which('sh')).parent}",
            "FORCECTL_RUNTIME_DIR": runtime,
            "FORCECTL_STATE_DIR": str(tmp_path / "state"),
            "MPLBACKEND": "agg",
            "IPYTHONDIR": str(tmp_path / "ipython"),
        }.items():
            monkeypatch.setenv(name, value)
        notebook = nbformat.read(path, as_version=4)
        client = nbclient.NotebookClient(notebook, timeout=None, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}})
        try:
            client.execute()
        finally:
            # A notebook that failed leaves its rig.
            forcectl.env["FORCECTL_RUNTIME_DIR"] = runtime
            forcectl.run("serve", "--end", "--name", "rig")
