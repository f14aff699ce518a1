"""Data frames and arrays in the form that the extension module takes: bytes of 64-bit floats, all checks of shape done."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

# Seconds of a unit of numpy's times.
_SECONDS = {"D": 86_400.0, "h": 3600.0, "m": 60.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def vector(values: Any, count: int, what: str, unit: str) -> list[float]:
    """`count` numbers as a list."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} is {values!r}: give {count} numbers in {unit}") from error
    if array.shape != (count,):
        raise ValueError(f"{what} has the shape {array.shape}: give {count} numbers in {unit}")
    return array.tolist()


def rows(values: Any, columns: int, what: str, unit: str) -> np.ndarray:
    """An array of `n` rows of `columns` numbers."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what}: give rows of {columns} numbers in {unit}") from error
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{what} has the shape {array.shape}: give rows of {columns} numbers in {unit}")
    return np.ascontiguousarray(array)


def series(values: Any, what: str) -> np.ndarray:
    """One number for each row."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} has values that are not numbers: {error}") from error
    if array.ndim != 1:
        raise ValueError(f"{what} has the shape {array.shape}: give one number for each row")
    return array


def floats(data: bytes) -> np.ndarray:
    """An array of what the extension module gives."""
    return np.frombuffer(data, dtype=float).copy()


def is_frame(value: Any) -> bool:
    """Whether it has columns: a frame of pandas or polars, or a mapping of names to arrays."""
    if hasattr(value, "iloc") or hasattr(value, "get_columns"):
        return True
    return isinstance(value, Mapping) and not any(is_frame(part) for part in value.values())


def table(name: str, frame: Any) -> tuple[str, list, list, list]:
    """A frame as (name, columns of numbers, columns of times, columns of text)."""
    numbers: list[tuple[str, bytes]] = []
    times: list[tuple[str, str, bytes]] = []
    text: list[tuple[str, str]] = []
    for column, values in _columns(frame):
        kind, content = _column(column, values)
        if kind == "number":
            numbers.append((column, content.tobytes()))
        elif kind == "text":
            text.append((column, content))
        else:
            times.append((column, kind, content.tobytes()))
    return name, numbers, times, text


def _columns(frame: Any) -> list[tuple[str, Any]]:
    if hasattr(frame, "iloc"):
        if not hasattr(frame, "columns"):
            raise TypeError("a Series has no columns with names: give a data frame, as series.to_frame()")
        columns = [(str(name), frame.iloc[:, at]) for at, name in enumerate(frame.columns)]
        known = {name for name, _ in columns}
        # As to_parquet keeps them.
        for level, name in enumerate(frame.index.names):
            if name is not None and str(name) not in known:
                columns.append((str(name), frame.index.get_level_values(level).to_series()))
        return columns
    if hasattr(frame, "get_columns"):
        return [(column.name, column) for column in frame.get_columns()]
    if isinstance(frame, Mapping):
        return [(str(name), values) for name, values in frame.items()]
    raise TypeError(
        f"a data frame of pandas or polars is needed, or a mapping of names to arrays, and this is of the type {type(frame).__name__}"
    )


def _column(name: str, values: Any) -> tuple[str, Any]:
    """What a column holds: "number" or "duration" or "timestamp" with an array, or "text" with a cell."""
    array = _array(values)
    if array.ndim != 1:
        raise ValueError(f"column `{name}` has the shape {array.shape}: a column has one value for each row")
    if array.dtype.kind in "mM":
        unit, count = np.datetime_data(array.dtype)
        if unit not in _SECONDS:
            raise ValueError(f"column `{name}` has the type {array.dtype}: give times in s, ms, us or ns")
        seconds = array.astype(np.int64).astype(float) * (_SECONDS[unit] * count)
        seconds[np.isnat(array)] = math.nan
        return ("duration" if array.dtype.kind == "m" else "timestamp"), seconds
    if array.dtype.kind in "biuf":
        return "number", np.ascontiguousarray(array, dtype=float)
    cells = [None if _is_missing(cell) else cell for cell in array.tolist()]
    first = next((cell for cell in cells if cell is not None), None)
    if not isinstance(first, (str, bytes)):
        try:
            numbers = [math.nan if cell is None else float(cell) for cell in cells]
            return "number", np.array(numbers, dtype=float)
        except (TypeError, ValueError):
            pass
    return "text", str(first)


def _is_missing(cell: Any) -> bool:
    # NaN, NaT and pandas.NA: none of them equals itself, and the last says so with itself.
    return cell is None or (not isinstance(cell, (str, bytes, list, dict)) and (cell == cell) is not True)


def _array(values: Any) -> np.ndarray:
    if hasattr(values, "iloc"):
        return _pandas(values)
    if type(values).__module__.startswith("polars"):
        import polars

        numeric = values.dtype.is_numeric() or values.dtype == polars.Boolean
        return (values.cast(polars.Float64) if numeric else values).to_numpy()
    return np.asarray(values)


def _pandas(values: Any) -> np.ndarray:
    from pandas.api import types

    dtype = values.dtype
    if types.is_bool_dtype(dtype) or types.is_numeric_dtype(dtype) and not types.is_complex_dtype(dtype):
        return values.to_numpy(dtype=float, na_value=math.nan)
    if types.is_datetime64_any_dtype(dtype) and getattr(dtype, "tz", None) is not None:
        values = values.dt.tz_convert(None)
    return np.asarray(values)
