"""Calibration from arrays: gain and zero of a load cell."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np

from . import _columns, _native

NOMINAL_N_PER_CODE = 6.85e-6
"""Scale of the thesis's cells at gain 128, N per code."""


@dataclass(frozen=True)
class Gain:
    """Gain of a load cell: force = n_per_code c + n_per_code2 c^2 of a code c above the zero."""

    n_per_code: float
    """Scale at no load, N per code."""
    n_per_code_sd: float
    """Its standard uncertainty, everything included, N per code."""
    n_per_code_half_95: float
    """Half width of its 95 % interval for forces up to 12 N, N per code."""
    within_half_95: float
    """The same for forces that the weights reach, N per code."""
    n_per_code2: float
    """Quadratic term, N per code^2; 0 for a straight cell."""
    zero_code: float
    """Code of the empty cell."""
    zero_code_se: float
    """Its standard error, codes."""
    curve_per_n: Optional[float]
    """Curve, relative per N; None: the readings show none."""
    creep: Optional[float]
    """Share of a lasting load by which the reading grows; None: the readings show none."""
    creep_s: Optional[float]
    """Time constant of that, s."""
    linearity_n: float
    """Largest deviation from a straight line, N."""
    hysteresis_n: Optional[float]
    """Largest difference between loading and unloading, N; None without directions."""
    repeatability_n: float
    """Scatter beyond the readings' own standard errors, N."""
    chi_square: float
    degrees_of_freedom: int
    parts_relative: Mapping[str, float]
    """Relative standard uncertainties of the scale from `readings`, `weights`, `gravity`, `beyond` the largest weight, `remounting` of
    the cell and a `pulley`."""
    readings: int
    """Number of readings."""
    residuals: list
    """For each reading: `line`, `force_n`, `residual_n`, `sd_n`."""


@dataclass(frozen=True)
class Zero:
    """Zero of a load cell with a slack cable, in codes."""

    zero_code: float
    """Zero at the end of the stream: the value to use."""
    zero_code_se: float
    mean_code: float
    """Robust mean over the stream."""
    mean_code_se: float
    drift_codes: float
    """Change from the first to the last code."""
    drift_codes_se: float
    noise_codes: float
    """Standard deviation of one code."""
    correlation_samples: float
    """Autocorrelation time, samples; 1 for independent ones."""
    used: int
    spikes: int
    """Codes that were left out."""


def gain(
    weight_g: Any,
    code: Any,
    *,
    standard_error: Any = None,
    direction: Iterable[str] | None = None,
    time_s: Any = None,
    since_s: Any = None,
    since_sd_s: Any = None,
    temperature_c: Any = None,
    weights_g: Iterable[float] = (),
    weight_class: str | None = None,
    tolerance: float | None = None,
    correlation: float = 1.0,
    gravity_m_per_s2: float | None = None,
    gravity_relative_sd: float | None = None,
    nominal_n_per_code: float | None = NOMINAL_N_PER_CODE,
    leave_out: Iterable[int] = (),
    correct: Mapping[int, float] | None = None,
) -> Gain:
    """The gain of a load cell from readings under weights: the fit of `forcectl calibrate gain` (docs/calibration.md).

    The readings are a table with a header: errors and results name line 2 for the first reading.

    Args:
        weight_g: Weight of each reading, g, shape (n,); 0: the empty cell.
        code: Mean code of each reading, shape (n,).
        standard_error: Standard error of each mean code, codes; None: from the scatter of repeated weights.
        direction: `loading`, `unloading` or an empty text for each reading.
        time_s: Middle of each reading, s.
        since_s: When each load came on, s from the same start.
        since_sd_s: Standard error of that, s.
        temperature_c: Temperature of the cell, degrees Celsius.
        weights_g: Weights that may have been meant beside those of the thesis, g.
        weight_class: Class of the weights, OIML R 111: E2, F1, F2, M1, M2 or M3 [default: M2].
        tolerance: Largest relative error of the weights, where they are of no class.
        correlation: Correlation of the errors of different weights, 0 to 1.
        gravity_m_per_s2: Local acceleration of gravity [default: 9.80665 with 0.27 %, for an unknown place].
        gravity_relative_sd: Relative standard uncertainty of it.
        nominal_n_per_code: A scale further than a factor of 2 from it is refused; None: any is accepted.
        leave_out: Lines to leave out.
        correct: Right weight in g of lines that were entered with a wrong one.

    Raises:
        Refused: Readings that can't be used, a reading that belongs to another weight, a wrong unit; with the line.
    """
    columns: dict[str, list[str]] = {}
    numbers = {
        "weight_g": weight_g,
        "code": code,
        "standard_error": standard_error,
        "time_s": time_s,
        "since_s": since_s,
        "since_sd_s": since_sd_s,
        "temperature_c": temperature_c,
    }
    for name, values in numbers.items():
        if values is not None:
            columns[name] = [repr(float(value)) for value in _columns.series(values, name)]
    if direction is not None:
        columns["direction"] = [_word(word) for word in direction]
    lengths = {name: len(cells) for name, cells in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"the arrays have different lengths ({', '.join(f'{k} {n}' for k, n in lengths.items())}): give one value for each reading")
    lines = [",".join(columns), *(",".join(row) for row in zip(*columns.values()))]
    choice = {
        "gravity_m_per_s2": gravity_m_per_s2,
        # A local value without an uncertainty has that of a survey, as for the command.
        "gravity_relative_sd": 2e-5 if gravity_relative_sd is None and gravity_m_per_s2 is not None else gravity_relative_sd,
        "class": weight_class,
        "tolerance": tolerance,
        "correlation": correlation,
        "nominal_n_per_code": nominal_n_per_code,
        "weights_g": [float(weight) for weight in weights_g],
        "left_out": list(leave_out),
        "corrections_g": list((correct or {}).items()),
    }
    return Gain(**json.loads(_native.gain("readings", "\n".join(lines) + "\n", choice)))


def zero(codes: Any, *, nominal_n_per_code: float = NOMINAL_N_PER_CODE) -> Zero:
    """The zero of a load cell from a stream of codes with a slack cable (docs/calibration.md).

    Args:
        codes: Codes of the converter in their order, whole numbers of 24 bits, shape (n,), 64 or more.
        nominal_n_per_code: Scale, N per code, for the limits of noise and drift in N.

    Raises:
        Refused: The stream gives no zero: it drifts, is noisy, stands still or is too short.
    """
    values = _columns.series(codes, "codes")
    wrong = np.flatnonzero(~(np.abs(values) <= 2**23) | (values != np.round(values)))
    if wrong.size:
        raise ValueError(f"code {wrong[0]} is {values[wrong[0]]}: codes are whole numbers from -8388608 to 8388607")
    return Zero(**json.loads(_native.zero(values.astype(int).tolist(), float(nominal_n_per_code))))


def _word(value: Any) -> str:
    """A cell of text. What would part or end it is refused by the table's reader, under this name."""
    return "".join(" " if mark in ',;\t\r\n"' else mark for mark in str(value))
