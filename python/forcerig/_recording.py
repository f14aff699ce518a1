"""Recordings and data sets as data frames."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

_TABLES = ("samples", "cycles", "clock", "counters", "events")
_NEEDS = {"pandas": ("pandas", "pyarrow"), "polars": ("polars",)}


class Recording(Mapping):
    """The tables of a folder by name, each read when it is asked for.

    A recording (docs/recordings.md) has `samples`, `cycles`, `clock`, `counters` and `events`; a data set (docs/dataset.md) has
    `trial-01` and so on. Their columns, with units, are on these pages.
    """

    def __init__(self, folder: Path, paths: dict[str, Path], metadata: dict[str, Any], frames: str) -> None:
        self.folder = folder
        """Where it lies."""
        self.metadata = metadata
        """`configuration.json` of a recording, `card.json` of a data set."""
        self._paths = paths
        self._frames = frames
        self._read: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._paths:
            raise KeyError(f"{self.folder} has no table `{name}`; there are {', '.join(self._paths)}")
        if name not in self._read:
            self._read[name] = _frame(self._paths[name], self._frames)
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    def __repr__(self) -> str:
        return f"<forcerig.Recording {self.folder}: {', '.join(self._paths)}>"


def read(folder: str | os.PathLike[str], *, frames: str = "pandas") -> Recording:
    """The tables of a recording, or of a data set of `forcectl experiment run`.

    Args:
        folder: Folder of the recording, of the experiment, or its `dataset`.
        frames: `pandas` or `polars`.

    Raises:
        ImportError: pandas with pyarrow, or polars, is not installed; the text names the extra to install.
        FileNotFoundError: It is no such folder, or its tables were never written; the text says what to do.
    """
    if frames not in _NEEDS:
        raise ValueError(f"frames is {frames!r}: there are `pandas` and `polars`")
    _check_installed(frames)
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: this folder does not exist; give the folder of a recording or of a data set")
    inner = folder / "dataset"
    trials = sorted((inner if inner.is_dir() else folder).glob("trial-*.parquet"))
    if trials:
        return Recording(folder, {path.stem: path for path in trials}, _json(trials[0].with_name("card.json")), frames)
    paths = {name: folder / f"{name}.parquet" for name in _TABLES}
    paths = {name: path for name, path in paths.items() if path.is_file()}
    if not paths and (folder / "run.mcap").is_file():
        raise FileNotFoundError(
            f"{folder}: it has no tables, because the run was killed; `forcectl recording export {folder}` writes them from run.mcap"
        )
    if not paths:
        raise FileNotFoundError(
            f"{folder}: it is neither a recording (samples.parquet, ...) nor a data set (dataset/trial-01.parquet, ...)"
        )
    return Recording(folder, paths, _json(folder / "configuration.json"), frames)


def _check_installed(frames: str) -> None:
    for name in _NEEDS[frames]:
        try:
            __import__(name)
        except ImportError as error:
            raise ImportError(
                f"frames of {frames} need {' and '.join(_NEEDS[frames])}, and {name} is not installed: "
                f"pip install 'forcerig[{frames}]'"
            ) from error


def _json(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _frame(path: Path, frames: str) -> Any:
    try:
        if frames == "polars":
            import polars

            return polars.read_parquet(path)
        import pandas

        return pandas.read_parquet(path)
    except Exception as error:
        raise ValueError(f"{path} can't be read: {error}; `sha256sum --check SHA256SUMS` tells whether the file is whole") from error
