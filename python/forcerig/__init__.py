"""The open force rig from Python.

| name | what it is for |
| --- | --- |
| `connect` | a client of the rig's service: forces, tensions, telemetry, stop |
| `read` | the tables of a recording or of a data set as data frames |
| `residual`, `first_model` | what a force model lacks, from logs |
| `Rig` | a rig file: tensions for a force, feasible forces |
| `raven` | kinematics of the Raven-II's left arm |
| `dvrk` | kinematics of a dVRK's PSM |
| `gain`, `zero` | calibration of a load cell from arrays |
| `Estimator` | contact force from the state of a robot |

Everything but the client and the reading of tables is done by the crates of the rig's own programs. What these refuse is
`Refused`, in their words. SI units throughout; names carry them (`force_n`, `tip_m`).
"""

from importlib import import_module as _import_module

from ._client import Client, RigError, connect

# Loaded at their first use: the client alone needs neither numpy nor the extension module.
_LATER = {
    "Allocation": "._rig",
    "Estimate": "._estimator",
    "Estimator": "._estimator",
    "Feasible": "._rig",
    "Gain": "._calibration",
    "Recording": "._recording",
    "Refused": "._native",
    "Report": "._residual",
    "Rig": "._rig",
    "Stream": "._estimator",
    "Workspace": "._rig",
    "Zero": "._calibration",
    "dvrk": ".dvrk",
    "first_model": "._residual",
    "gain": "._calibration",
    "raven": ".raven",
    "read": "._recording",
    "residual": "._residual",
    "zero": "._calibration",
}

__all__ = ["Client", "RigError", "connect", *_LATER]


def __getattr__(name):
    if name not in _LATER:
        raise AttributeError(f"module 'forcerig' has no attribute {name!r}")
    module = _import_module(_LATER[name], __name__)
    return module if name in ("dvrk", "raven") else getattr(module, name)


def __dir__():
    return sorted([*globals(), *_LATER])
