"""Kinematics of the Raven-II's left arm, as the virtual arm and the estimators use them (docs/robot.md).

Joints: shoulder rad, elbow rad, insertion m, roll rad, wrist rad, mean of the jaws rad. Frame 0 stands at the remote centre of
motion, gravity along its -x. The CRTK frame is that of the arm's CRTK topics: x = -y0, y = -z0, z = x0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _columns, _native

__all__ = [
    "HOME",
    "JOINT_NAMES",
    "LIMITS",
    "forward",
    "from_crtk",
    "inverse",
    "jacobian",
    "joints_from_motors",
    "motors_from_joints",
    "to_crtk",
]

_NAMES, _LIMITS, _HOME = _native.limits()

JOINT_NAMES: tuple[str, ...] = tuple(_NAMES)
"""Names of the joints."""
LIMITS: np.ndarray = np.array(_LIMITS)
"""Lower and upper limits of the joints, in their units, shape (6, 2)."""
HOME: np.ndarray = np.array(_HOME)
"""Home: 30 degrees, 90 degrees, 0.4 m, tool straight, shape (6,)."""

_JOINTS = "rad, rad, m, rad, rad, rad"


def forward(joints: Any) -> tuple[np.ndarray, np.ndarray]:
    """Position of the tool's tip in frame 0, m, shape (3,), and its orientation, shape (3, 3).

    Args:
        joints: Joint positions, shape (6,).
    """
    position, rotation = _native.forward(_columns.vector(joints, 6, "joints", _JOINTS))
    return np.array(position), np.array(rotation)


def jacobian(joints: Any) -> np.ndarray:
    """Geometric Jacobian of the tip in frame 0, shape (6, 6): rows 0 to 2 m/s, rows 3 to 5 rad/s, a column for each joint.

    Args:
        joints: Joint positions, shape (6,).
    """
    return np.array(_native.jacobian(_columns.vector(joints, 6, "joints", _JOINTS)))


def inverse(position_m: Any, tool: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    """The first three joints (rad, rad, m), shape (3,), that bring the tip to a position, within the joints' limits.

    Args:
        position_m: Position of the tip in frame 0, m, shape (3,).
        tool: Roll, wrist and jaws, rad, shape (3,).

    Raises:
        Refused: No joints reach it, or none within their limits.
    """
    tool = _columns.vector(tool, 3, "tool", "rad")
    return np.array(_native.inverse(_columns.vector(position_m, 3, "position_m", "m"), tool))


def motors_from_joints(joints: Any) -> np.ndarray:
    """Motor angles, rad, shape (3,), for the first three joints (rad, rad, m): transmission and coupling of the cables."""
    return np.array(_native.motors_from_joints(_columns.vector(joints, 3, "joints", "rad, rad, m")))


def joints_from_motors(motors_rad: Any) -> np.ndarray:
    """The first three joints (rad, rad, m), shape (3,), for motor angles in rad."""
    return np.array(_native.joints_from_motors(_columns.vector(motors_rad, 3, "motors_rad", "rad")))


def to_crtk(vector: Any) -> np.ndarray:
    """A vector of frame 0 in the CRTK frame, shape (3,)."""
    return np.array(_native.to_crtk(_columns.vector(vector, 3, "vector", "its unit")))


def from_crtk(vector: Any) -> np.ndarray:
    """A vector of the CRTK frame in frame 0, shape (3,)."""
    return np.array(_native.from_crtk(_columns.vector(vector, 3, "vector", "its unit")))
