"""Contact force without a force sensor: estimators trained on a data set (docs/estimation.md)."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Optional

import numpy as np

from . import _columns, _native


@dataclass(frozen=True)
class Estimate:
    """Force of a row."""

    force_n: np.ndarray
    """Force on the tool, N, frame of the training data, a value for each of the model's `axes`."""
    half_width_n: Optional[float]
    """Half width of the 90 % interval, N; None: the model has no intervals."""
    valid: bool
    """Whether it can be used: the state of the friction is known, and the model fits the robot."""
    misfits: bool
    """Whether the motors' torques are not what the model expects of this robot, whatever the force."""


class Stream:
    """A model that runs row by row, at its rate. Made by `Estimator.stream`."""

    def __init__(self, native: _native.Stream) -> None:
        self._native = native

    def step(self, position: Any, velocity: Any, effort: Any) -> Estimate:
        """Takes the next row.

        Args:
            position: Positions of the first three joints: rad, rad, m, shape (3,).
            velocity: Velocities: rad/s, rad/s, m/s, shape (3,).
            effort: Efforts of the drives at the joints: N·m, N·m, N, shape (3,).
        """
        inputs = np.array(
            [
                _columns.vector(position, 3, "position", "rad, rad, m"),
                _columns.vector(velocity, 3, "velocity", "rad/s, rad/s, m/s"),
                _columns.vector(effort, 3, "effort", "N·m, N·m, N"),
            ]
        )
        force, half, valid, misfits = self._native.step(inputs.tobytes())
        return Estimate(np.array(force), half, valid, misfits)

    def gap(self, elapsed_s: float) -> None:
        """Rows are missing: the next one comes `elapsed_s` (s) after the last one."""
        self._native.gap(float(elapsed_s))

    def reset(self) -> None:
        """Forgets the past: the next row begins anew."""
        self._native.reset()


class Estimator:
    """A trained model. `Estimator.train` and `Estimator.load` make one."""

    def __init__(self, native: _native.Estimator) -> None:
        self._native = native

    @classmethod
    def train(
        cls,
        data: str | os.PathLike[str],
        model: str = "hybrid",
        *,
        test: Iterable[int] = (),
        rate_hz: float = 50.0,
        seed: int = 1,
        intervals: bool = True,
        all_axes: bool = False,
        mapping: str | os.PathLike[str] | None = None,
        progress: Callable[[str], object] | None = None,
    ) -> Estimator:
        """Trains a model, as `forcectl estimate train` does, and evaluates it on the test trials.

        Args:
            data: Folder of an experiment or of logs, or a log (CSV, Parquet).
            model: zero, mean, linear, trees, physics or hybrid.
            test: Numbers of the trials for testing [default: the last two of nine].
            rate_hz: Rows per second, Hz; the data's rate is a multiple of it.
            seed: Seed of everything random.
            intervals: Whether intervals are calibrated: the model is then trained once more for each trial.
            all_axes: Estimate all three components, also where the experiment pulls along one axis.
            mapping: Mapping file (TOML) for logs other than an experiment's data set.
            progress: Called with a line of text at each stage.

        Raises:
            Refused: The data can't be used; with file and column.
            KeyboardInterrupt: Ctrl-C, at the next stage.
        """
        choice = {
            "model": model,
            "rate_hz": float(rate_hz),
            "test": list(test),
            "seed": seed,
            "intervals": intervals,
            "all_axes": all_axes,
        }
        return cls(_native.Estimator.train(os.fspath(data), choice, _optional(mapping), progress))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Estimator:
        """Reads a model file of `save` or `forcectl estimate train`."""
        return cls(_native.Estimator.load(os.fspath(path)))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the model file, and its card beside it, as `forcectl estimate train --out` does."""
        self._native.save(os.fspath(path))

    @cached_property
    def _about(self) -> dict[str, Any]:
        return json.loads(self._native.json())

    @property
    def model(self) -> str:
        """Name of the model."""
        return self._about["model"]

    @property
    def robot(self) -> str:
        """Name of the robot that it was trained on. It is for this one alone."""
        return self._about["robot"]

    @property
    def rate_hz(self) -> float:
        """Rows per second, Hz."""
        return self._about["rate_hz"]

    @property
    def axes(self) -> list[str]:
        """Components of the force that it estimates, of `x`, `y`, `z`."""
        return ["xyz"[axis] for axis in self._about["axes"]]

    @property
    def card(self) -> dict[str, Any] | None:
        """What it was trained on and what it reached; None: there is no card beside its file."""
        return self._about["card"]

    def evaluate(
        self,
        data: str | os.PathLike[str],
        trials: Iterable[int],
        *,
        any_robot: bool = False,
        mapping: str | os.PathLike[str] | None = None,
    ) -> dict[str, Any]:
        """Figures on trials of a data set, as `forcectl estimate eval --json` gives them. Name trials that it has not seen."""
        return json.loads(self._native.evaluate(os.fspath(data), list(trials), any_robot, _optional(mapping)))

    def run(
        self,
        log: str | os.PathLike[str],
        *,
        any_robot: bool = False,
        mapping: str | os.PathLike[str] | None = None,
    ) -> dict[str, np.ndarray]:
        """Runs over a log, as `forcectl estimate run --replay` does: columns by name, for `pandas.DataFrame(...)`.

        `trial`, `t_s` (s), `estimate_y_n` (N) for each axis, `half_width_n` (N), `valid` and `misfits` (1: yes), and `force_y_n`
        (N), the measured force where the log has it.
        """
        columns = self._native.run(os.fspath(log), any_robot, _optional(mapping))
        return {name: _columns.floats(data) for name, data in columns}

    def stream(self) -> Stream:
        """Runs row by row from now on, without a past."""
        return Stream(self._native.stream())

    def __repr__(self) -> str:
        return f"<forcerig.Estimator {self.model} of {self.robot}>"


def _optional(path: str | os.PathLike[str] | None) -> str | None:
    return None if path is None else os.fspath(path)
