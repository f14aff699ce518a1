"""Kinematics of the patient side manipulator (PSM) of a da Vinci Research Kit, with the large needle driver 400006.

Joints in the order of the dVRK's `measured_js`: yaw rad, pitch rad, insertion m, roll rad, wrist pitch rad, wrist yaw rad. The base
frame stands at the remote centre of motion, as that of the arm's `local/measured_cp`; the tip is the origin of the frame that the dVRK
reports. It lies on the axis of the wrist's yaw. `tip_m` moves it along the jaws: 0.0102 in older configurations of the dVRK.

Source of all figures: `share/kinematic/PSM.json` and `share/tool/LARGE_NEEDLE_DRIVER_400006.json` of jhu-dvrk/sawIntuitiveResearchKit.
Those of the Si model are others. How well a real arm agrees with them (some millimetres after its calibration, estimate) is not in here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import _columns
from ._native import Refused

__all__ = ["JOINT_NAMES", "LIMITS", "forward", "inverse", "jacobian"]

JOINT_NAMES: tuple[str, ...] = ("yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw")
"""Names of the joints."""
LIMITS: np.ndarray = np.array(
    [
        [-1.588, 1.588],
        [-0.925025, 0.925025],
        [0.0, 0.24],
        [-4.53786, 4.53786],
        [-1.39626, 1.39626],
        [-1.39626, 1.39626],
    ]
)
"""Lower and upper limits of the joints, in their units, shape (6, 2)."""

_QUARTER = np.pi / 2
# Modified Denavit and Hartenberg, a row for each joint: T = Rx(alpha) Tx(a) Rz(theta) Tz(d). Alpha rad, a m, theta rad, d m; the joint
# is added to theta, in the third row to d.
_TABLE = (
    (_QUARTER, 0.0, _QUARTER, 0.0),
    (-_QUARTER, 0.0, -_QUARTER, 0.0),
    (_QUARTER, 0.0, 0.0, -0.4318),
    (0.0, 0.0, 0.0, 0.4162),
    (-_QUARTER, 0.0, -_QUARTER, 0.0),
    (-_QUARTER, 0.0091, -_QUARTER, 0.0),
)
_INSERTION = 2
# From the last joint's frame to the one that the dVRK reports. The jaws point along the y axis of the first.
_REPORTED = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
_JOINTS = "rad, rad, m, rad, rad, rad"


def _turn(alpha: float, theta: float) -> np.ndarray:
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array([[ct, -st, 0.0], [ca * st, ca * ct, -sa], [sa * st, sa * ct, ca]])


def _frames(joints: np.ndarray, tip_m: float) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Origin and rotation of each joint's frame, and the tip."""
    at, turned = np.zeros(3), np.eye(3)
    frames = []
    for joint, (alpha, a, theta, d) in enumerate(_TABLE):
        slides = joint == _INSERTION
        at = at + turned @ [a, 0.0, 0.0]
        turned = turned @ _turn(alpha, theta + (0.0 if slides else joints[joint]))
        at = at + turned[:, 2] * (d + (joints[joint] if slides else 0.0))
        frames.append((at, turned))
    return frames, at + turned[:, 1] * tip_m


def _refused(why: str) -> Refused:
    error = Refused(why)
    # That of arguments which can't be used.
    error.exit_code = 2
    return error


def _finite(values: Any, count: int, what: str, unit: str) -> np.ndarray:
    found = np.array(_columns.vector(values, count, what, unit))
    if not np.isfinite(found).all():
        raise _refused(f"{what} is {found.tolist()}: give finite numbers in {unit}")
    return found


def _given(joints: Any, tip_m: float) -> tuple[np.ndarray, float]:
    return _finite(joints, 6, "joints", _JOINTS), float(_finite([tip_m], 1, "tip_m", "m")[0])


def forward(joints: Any, tip_m: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Position of the tip in the base frame, m, shape (3,), and the orientation that the dVRK reports, shape (3, 3).

    Args:
        joints: Joint positions, shape (6,).
        tip_m: Distance of the tip from the axis of the wrist's yaw along the jaws, m.
    """
    joints, tip_m = _given(joints, tip_m)
    frames, tip = _frames(joints, tip_m)
    return tip, frames[-1][1] @ _REPORTED


def jacobian(joints: Any, tip_m: float = 0.0) -> np.ndarray:
    """Geometric Jacobian of the tip in the base frame, shape (6, 6): rows 0 to 2 m/s, rows 3 to 5 rad/s, a column for each joint.

    A force F at the tip loads the joints with its transpose times F: N m, for the insertion N.

    Args:
        joints: Joint positions, shape (6,).
        tip_m: Distance of the tip from the axis of the wrist's yaw along the jaws, m.
    """
    joints, tip_m = _given(joints, tip_m)
    frames, tip = _frames(joints, tip_m)
    columns = [
        np.concatenate([turned[:, 2], np.zeros(3)])
        if joint == _INSERTION
        else np.concatenate([np.cross(turned[:, 2], tip - at), turned[:, 2]])
        for joint, (at, turned) in enumerate(frames)
    ]
    return np.stack(columns, axis=1)


def inverse(position_m: Any, tool: Any = (0.0, 0.0, 0.0), tip_m: float = 0.0) -> np.ndarray:
    """The first three joints (rad, rad, m), shape (3,), that bring the tip to a position, within the joints' limits.

    Args:
        position_m: Position of the tip in the base frame, m, shape (3,).
        tool: Roll, wrist pitch and wrist yaw, rad, shape (3,).
        tip_m: Distance of the tip from the axis of the wrist's yaw along the jaws, m.

    Raises:
        Refused: No joints reach it, or none within their limits.
    """
    position = _finite(position_m, 3, "position_m", "m")
    joints, tip_m = _given(np.concatenate([np.zeros(3), _finite(tool, 3, "tool", "rad")]), tip_m)
    # The tip in the frame of the insertion, with nothing inserted: the shaft slides along its z.
    frames, tip = _frames(joints, tip_m)
    shaft_at, shaft = frames[_INSERTION]
    across = shaft.T @ (tip - shaft_at)
    away = position @ position - across[:2] @ across[:2]
    found = []
    wanted = _turn(_TABLE[0][0], 0.0).T @ position

    def turned(second: float, local: np.ndarray) -> np.ndarray:
        return _turn(_TABLE[1][0], _TABLE[1][2] + second) @ _turn(_TABLE[2][0], 0.0) @ local

    # With little of the shaft inserted, the tip may be on either side of the remote centre.
    for reach in (np.sqrt(max(away, 0.0)), -np.sqrt(max(away, 0.0))):
        inserted = reach - across[2] - _TABLE[_INSERTION][3]
        local = np.array([across[0], across[1], reach])
        # A turn about the first axis keeps the part along it, which gives the second joint.
        cosine, sine = turned(0.0, local)[2], turned(_QUARTER, local)[2]
        size = np.hypot(cosine, sine)
        if away < 0.0 or size == 0.0 or abs(wanted[2]) > size:
            continue
        middle, half = np.arctan2(sine, cosine), np.arccos(wanted[2] / size)
        for second in (middle + half, middle - half):
            there = turned(second, local)
            first = np.arctan2(wanted[1], wanted[0]) - np.arctan2(there[1], there[0]) - _TABLE[0][2]
            angles = np.remainder(np.array([first, second]) + np.pi, 2 * np.pi) - np.pi
            found.append(np.append(angles, inserted))
    # Rounding at a limit.
    lower, upper = LIMITS[:3, 0] - 1e-9, LIMITS[:3, 1] + 1e-9
    for joints in found:
        if ((lower <= joints) & (joints <= upper)).all():
            return joints
    why = "no joints reach it" if not found else "the joints that reach it are beyond their limits"
    raise _refused(f"position_m is {position.tolist()} m: {why}")
