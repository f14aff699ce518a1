"""Recordings and data sets as frames."""

import sys

import forcerig
import pytest


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    from conftest import FORCECTL, Forcectl

    if FORCECTL is None:
        pytest.skip("no forcectl on the path, and FORCECTL names none")
    folder = tmp_path_factory.mktemp("recording")
    done = Forcectl(folder).run("set-force", 0, 2.5, 0, "--link", "fast", "--duration", 2, "--out", "out", "--record", "recording")
    assert done.returncode in (0, 6), done.stderr
    return folder / "recording"


def test_every_table_is_read_as_either_frame(recording):
    found = forcerig.read(recording)
    assert list(found) == ["samples", "cycles", "clock", "counters", "events"] and len(found) == 5
    held = found["cycles"].query("phase == 'holding'")
    assert abs(held["estimated_n_y"].mean() - 2.5) < 0.1
    assert set(found["samples"]["unit"]) == {1, 2, 3, 4, 5, 6} and found["samples"] is found["samples"]
    assert found.metadata["configurations"]
    other = forcerig.read(str(recording), frames="polars")
    for name in found:
        assert other[name].columns == list(found[name].columns) and len(other[name]) == len(found[name])
    with pytest.raises(KeyError, match="no table `forces`"):
        found["forces"]


def test_a_missing_package_names_its_extra(recording, monkeypatch):
    for frames, name in (("pandas", "pyarrow"), ("pandas", "pandas"), ("polars", "polars")):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, name, None)
            with pytest.raises(ImportError, match=rf"pip install 'forcerig\[{frames}\]'"):
                forcerig.read(recording, frames=frames)


def test_other_folders_are_told_apart(recording, tmp_path):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        forcerig.read(tmp_path / "none")
    with pytest.raises(FileNotFoundError, match="neither a recording"):
        forcerig.read(tmp_path)
    (tmp_path / "run.mcap").write_bytes(b"")
    with pytest.raises(FileNotFoundError, match="recording export"):
        forcerig.read(tmp_path)
    (tmp_path / "samples.parquet").write_bytes(b"PAR1 no more")
    with pytest.raises(ValueError, match="samples.parquet"):
        forcerig.read(tmp_path)["samples"]
    with pytest.raises(ValueError, match="`polars`"):
        forcerig.read(recording, frames="arrow")


def test_a_data_set_has_its_trials(tmp_path, recording):
    inner = tmp_path / "dataset"
    inner.mkdir()
    frame = forcerig.read(recording)["cycles"]
    for number in (1, 2):
        frame.to_parquet(inner / f"trial-0{number}.parquet")
    (inner / "card.json").write_text('{"seed": 3}')
    found = forcerig.read(tmp_path)
    assert list(found) == ["trial-01", "trial-02"] and found.metadata == {"seed": 3}
    assert len(found["trial-02"]) == len(frame)
