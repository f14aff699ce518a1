"""A rig file from Python: what its cables can do."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Union

import numpy as np

from . import _columns, _native

UNITS = 6


@dataclass(frozen=True)
class Allocation:
    """Tensions for a force, and what they do."""

    tension_n: np.ndarray
    """Cable tensions, N, shape (6,); 0 for a unit that takes no part."""
    force_n: np.ndarray
    """Force that they apply at the tip, N, robot base frame, shape (3,)."""
    residual_n: float
    """Distance between that and the force asked for, N."""
    feasible: bool
    """Whether the force asked for is within reach of the cables."""
    fraction: Union[float, str]
    """How much of it the cables can apply in exactly its direction, 0 to 1; or `not even zero` or `unknown`."""
    lower_n: np.ndarray
    """Least tensions, N, shape (6,)."""
    upper_n: np.ndarray
    """Largest tensions, N, shape (6,)."""
    direction: np.ndarray
    """Unit vectors from the tip to where the cables leave their reels, shape (6, 3): force = tension @ direction."""
    tip_m: np.ndarray
    """The tip, m, robot base frame, shape (3,)."""
    text: str
    """How the force compares with what the cables can apply, in words."""


@dataclass(frozen=True)
class Workspace:
    """Feasible forces over a ball about the workspace's centre."""

    poses: int
    """Poses that were looked at."""
    least_n: float
    """Force that is feasible in every direction at the worst pose, N."""
    mean_n: float
    """The same on average, N."""
    along_n: np.ndarray
    """Force that is feasible along +x, -x, +y, -y, +z, -z at the worst pose, N, shape (6,)."""


@dataclass(frozen=True)
class Feasible:
    """Feasible forces at given tips."""

    radius_n: np.ndarray
    """Every force up to this size is feasible, N, shape (n,); negative where not even zero force is."""
    along_n: np.ndarray
    """Largest force along +x, -x, +y, -y, +z, -z, N, shape (n, 6); NaN where none is feasible."""
    volume_n3: np.ndarray
    """Volume of the set of feasible forces, N^3, shape (n,)."""


class Rig:
    """A checked rig file.

    Args:
        file: Its path; None: the built-in example.

    Raises:
        Refused: The file is wrong; every problem with its line, in the words of `forcectl check`.
    """

    def __init__(self, file: str | os.PathLike[str] | None = None) -> None:
        self._native = _native.Rig.load(None if file is None else os.fspath(file))

    @classmethod
    def from_text(cls, text: str, name: str = "rig file") -> Rig:
        """Checks the text of a rig file; `name` stands for it in errors."""
        rig = cls.__new__(cls)
        rig._native = _native.Rig.parse(name, text)
        return rig

    @cached_property
    def _content(self) -> dict[str, Any]:
        return json.loads(self._native.json())

    @property
    def settings(self) -> dict[str, Any]:
        """Everything that the file says, in SI units: `units`, `controller`, `workspace`, ..."""
        return self._content["rig"]

    @property
    def name(self) -> str:
        """Name of the rig."""
        return self.settings["name"]

    @property
    def hash(self) -> str:
        """SHA-256 of everything that the file says, as in recordings."""
        return self._content["hash"]

    @property
    def exit_m(self) -> np.ndarray:
        """Where the cables leave their reels, m, robot base frame, shape (6, 3)."""
        return np.array([unit["exit_m"] for unit in self.settings["units"]])

    def allocate(self, force_n: Any, tip_m: Any = None, available: Any = None) -> Allocation:
        """Cable tensions for a force at the tip, as the controller shares it out.

        Args:
            force_n: Force at the tip, N, robot base frame, shape (3,).
            tip_m: The tip, m, robot base frame, shape (3,) [default: the clamped tip of the rig file, else the middle of its
                workspace].
            available: Whether each unit can pull, six booleans [default: those that are enabled].

        Raises:
            Refused: A force that is not finite or above the rig's limit, a tip outside the workspace, no unit.
        """
        if available is not None:
            given = np.asarray(available)
            if given.shape != (UNITS,) or given.dtype != bool:
                raise ValueError(f"available is {available!r}: give six booleans, one for each unit")
            available = given.tolist()
        found = json.loads(
            self._native.allocate(
                _columns.vector(force_n, 3, "force_n", "N"),
                None if tip_m is None else _columns.vector(tip_m, 3, "tip_m", "m"),
                available,
            )
        )
        for key in ("tension_n", "force_n", "lower_n", "upper_n", "direction", "tip_m"):
            found[key] = np.array(found[key])
        return Allocation(**found)

    def workspace(self, radius_m: float | None = None, across: int = 9) -> Workspace:
        """Feasible forces over the workspace: the figures of `forcectl workspace`.

        Args:
            radius_m: Poses within this distance of the workspace's centre, m [default: half of `radius_m` of the rig file].
            across: Poses along a diameter, 3 to 41.
        """
        found = json.loads(self._native.workspace(radius_m, across))
        found["along_n"] = np.array(found["along_n"])
        return Workspace(**found)

    def feasible(self, tips_m: Any) -> Feasible:
        """Feasible forces at each tip.

        Args:
            tips_m: Tips, m, robot base frame, shape (n, 3).
        """
        found = json.loads(self._native.feasible(_columns.rows(tips_m, 3, "tips_m", "m").tobytes()))
        return Feasible(**{key: np.array([at[key] for at in found], dtype=float) for key in found[0]})

    def __repr__(self) -> str:
        return f"<forcerig.Rig {self.name}, hash {self.hash[:8]}>"
