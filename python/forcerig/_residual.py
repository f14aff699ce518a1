"""`forcectl residual` from Python: what a force model lacks, from logs."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Union

from . import _columns, _native

# A model file by its path or its text, or its content as a dict.
Model = Union[str, "os.PathLike[str]", Mapping[str, Any]]


class Report:
    """What an analysis found: the same as `forcectl residual` gives. `print(report)` prints the verdict."""

    def __init__(self, native: _native.Report) -> None:
        self._native = native

    @cached_property
    def json(self) -> dict[str, Any]:
        """Everything, as the key `report` of `forcectl residual --json` (docs/residual/report-json.md)."""
        return json.loads(self._native.json())

    @property
    def verdict(self) -> str:
        """`effect`, `several`, `none`, `unknown` or `not_identifiable` (docs/residual/how-it-works.md)."""
        return self.json["verdict"]

    @property
    def effects(self) -> list[dict[str, Any]]:
        """Effects found, the one that is worth most first: `name`, `params`, `units`, `ci` (95 %), ..."""
        return self.json["effects"]

    @property
    def names(self) -> list[str]:
        """Effects found in words, as the command lists them: "coulomb (sign of velocity)"; "A or B" where the data can't tell."""
        return [f"{name} ({details})" for name, details in self._native.names()]

    @property
    def figures(self) -> dict[str, Any]:
        """Errors of the declared model (`baseline`) and of the model with the effects (`final`), in the target's unit."""
        return {key: self.json[key] for key in ("baseline", "final")}

    @property
    def summary(self) -> str:
        """The verdict in some sentences."""
        return self._native.summary()

    @property
    def extended_model(self) -> str:
        """The model file with the effects added (TOML)."""
        return self.json["extended_model"]

    def markdown(self) -> str:
        """The written report."""
        return self._native.markdown()

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Writes report.html, report.md, report.json and the model files into a folder, as `--out` does."""
        self._native.write(os.fspath(folder))

    def __str__(self) -> str:
        return self.summary

    def __repr__(self) -> str:
        return f"<forcerig.Report: {self.verdict}; {', '.join(self.names) or 'no effect'}>"


def residual(
    data: Any,
    model: Model,
    *,
    check: Any = None,
    progress: Callable[[str], object] | None = None,
) -> Report:
    """Finds what a force model lacks, with the analysis of `forcectl residual`.

    Args:
        data: The logs. A data frame of pandas or polars, or a mapping of column names to arrays; several logs as a mapping of
            their names to such frames, or as a list of them. Or files and folders: a path, or a list of paths. Columns have the
            units of the model file. A missing value is NaN; a time may be a column of numbers or of a type of time.
        model: The model file (docs/residual/model-toml.md): its path, its text, or its content as a dict.
        check: Logs that take no part in the search, of the same form as `data`: the models are evaluated on them, and what was
            found must help there too.
        progress: Called with a line of text at each stage.

    Returns:
        The report. Its `json` equals that of `forcectl residual --json`.

    Raises:
        Refused: The model file is wrong (`exit_code` 2), a log can't be read or lacks a column (3), or the data allow no
            analysis (4), in the command's words.
        KeyboardInterrupt: Ctrl-C, at the next step of the search.
    """
    spec = _spec(model)
    logs = _logs("data", data)
    checks = [] if check is None else _logs("check", check)
    of_files = [all(isinstance(log, str) for log in part) for part in (logs, checks)]
    if checks and of_files[0] != of_files[1]:
        raise TypeError("`data` and `check` have to be of one form: both files, or both frames")
    analyse = _native.analyse_files if of_files[0] else _native.analyse_tables
    return Report(analyse(spec, logs, checks, progress))


def first_model(data: Any) -> str:
    """A first model file (TOML) for logs that nobody has described, with open questions: `forcectl residual --init`.

    Args:
        data: A path of a log or a folder, or a list of paths.
    """
    paths = _logs("data", data)
    if not all(isinstance(path, str) for path in paths):
        raise TypeError("first_model() looks at files; write a frame with to_csv() or to_parquet() first")
    return _native.guess(paths)


def _spec(model: Model) -> _native.Spec:
    if isinstance(model, Mapping):
        return _native.Spec.of_json(json.dumps(model))
    if isinstance(model, str) and "\n" in model:
        return _native.Spec.parse(model)
    if isinstance(model, (str, os.PathLike)):
        return _native.Spec.load(os.fspath(model))
    raise TypeError(f"the model is a path, a text or a dict, and this is of the type {type(model).__name__}")


def _logs(what: str, data: Any) -> list[Any]:
    """All paths, or all tables."""
    if isinstance(data, (str, os.PathLike)):
        return [_path(what, data)]
    if _columns.is_frame(data):
        return [_columns.table("frame", data)]
    if isinstance(data, Mapping):
        return [_columns.table(str(name), frame) for name, frame in data.items()]
    if not isinstance(data, Iterable):
        # The error that says what is needed.
        return [_columns.table("frame", data)]
    logs = list(data)
    if not logs:
        raise ValueError(f"`{what}` is empty: give a log")
    if all(isinstance(log, (str, os.PathLike)) for log in logs):
        return [_path(what, log) for log in logs]
    return [_columns.table(f"frame {number}", frame) for number, frame in enumerate(logs, 1)]


def _path(what: str, path: str | os.PathLike[str]) -> str:
    if not Path(path).exists():
        raise FileNotFoundError(f"{what} {os.fspath(path)}: this file or folder does not exist; check the path")
    return os.fspath(path)
