"""Gain and zero from arrays."""

import forcerig
import numpy as np
import pytest

WEIGHTS_G = np.array([0, 10, 20, 50, 100, 200, 500, 1000, 500, 200, 100, 50, 20, 10, 0] * 2, dtype=float)
N_PER_CODE = 6.9e-6


def codes(scatter=5.0):
    random = np.random.default_rng(3)
    force_n = 1e-3 * WEIGHTS_G * 9.80665 * (1 - 1.5e-4)
    return 1234.0 + force_n / N_PER_CODE + random.normal(0.0, scatter, len(WEIGHTS_G))


def test_the_gain_is_that_of_the_command(tmp_path, forcectl):
    readings = codes()
    found = forcerig.gain(WEIGHTS_G, readings, standard_error=np.full(30, 5.0))
    assert abs(found.n_per_code / N_PER_CODE - 1) < 3e-4
    assert found.readings == 30 and [row["line"] for row in found.residuals][:2] == [2, 3]
    rows = [f"{weight!r},{code!r},5.0" for weight, code in zip(WEIGHTS_G.tolist(), readings.tolist())]
    (tmp_path / "readings.csv").write_text("\n".join(["weight_g,code,standard_error", *rows]) + "\n")
    command = forcectl.json("calibrate", "gain", "--unit", "1", "--readings", "readings.csv", "--replace")["gains"][0]
    for key in ("n_per_code", "n_per_code_half_95", "within_half_95", "linearity_n", "repeatability_n", "chi_square", "parts_relative"):
        assert command[key] == pytest.approx(getattr(found, key), rel=1e-12), key
    # A local gravity is as sure as the command takes it.
    command = forcectl.json(
        "calibrate", "gain", "--unit", "1", "--readings", "readings.csv", "--gravity", "9.81", "--class", "F2", "--replace"
    )["gains"][0]
    local = forcerig.gain(WEIGHTS_G, readings, standard_error=np.full(30, 5.0), gravity_m_per_s2=9.81, weight_class="F2")
    assert command["parts_relative"] == pytest.approx(local.parts_relative, rel=1e-12)
    # Without standard errors the scatter of the repeats stands for them.
    assert abs(forcerig.gain(WEIGHTS_G, readings).n_per_code / N_PER_CODE - 1) < 3e-4


def test_a_wrong_entry_is_named_by_its_line():
    weights = WEIGHTS_G.copy()
    weights[4] = 200.0
    with pytest.raises(forcerig.Refused, match="readings:6"):
        forcerig.gain(weights, codes(), standard_error=np.full(30, 5.0))
    assert forcerig.gain(weights, codes(), standard_error=np.full(30, 5.0), correct={6: 100.0}).readings == 30
    assert forcerig.gain(weights, codes(), standard_error=np.full(30, 5.0), leave_out=[6]).degrees_of_freedom == 27


@pytest.mark.parametrize(
    "change",
    [
        {"weight_g": np.full(30, np.nan)},
        {"code": np.full(30, np.inf)},
        {"code": np.zeros(30)},
        {"code": np.zeros(29)},
        {"code": np.zeros((30, 1))},
        {"code": ["x"] * 30},
        {"weight_g": -WEIGHTS_G},
        {"weight_g": [], "code": [], "standard_error": None},
        {"standard_error": np.zeros(30)},
        {"direction": ["up, down"] * 30},
        {"weight_class": "M9"},
        {"tolerance": 3.0},
        {"tolerance": np.nan},
        {"correlation": 2.0},
        {"gravity_m_per_s2": 1.6},
        {"leave_out": [99]},
        {"correct": {2: np.nan}},
        {"nominal_n_per_code": 1.0},
        {"nominal_n_per_code": np.nan},
        {"weights_g": [np.nan]},
    ],
    ids=lambda change: "-".join(change),
)
def test_bad_readings_are_refused_or_do_no_harm(change):
    arguments = {"weight_g": WEIGHTS_G, "code": codes(), "standard_error": np.full(30, 5.0), **change}
    try:
        found = forcerig.gain(arguments.pop("weight_g"), arguments.pop("code"), **arguments)
    except ValueError as error:
        assert str(error)
    else:
        assert abs(found.n_per_code / N_PER_CODE - 1) < 3e-4


def test_a_zero_is_found_where_the_stream_has_one():
    random = np.random.default_rng(4)
    stream = np.round(5000.0 + random.normal(0.0, 300.0, 2000))
    found = forcerig.zero(stream)
    assert abs(found.mean_code - 5000.0) < 4 * found.mean_code_se and found.used == 2000
    assert forcerig.zero(stream.astype(np.int32)) == found


@pytest.mark.parametrize(
    "stream", [[], [1.5] * 100, [7] * 100, [np.nan] * 100, [2.0**24] * 100, [1, 2, 3], "x", np.arange(100) * 1000, [[1, 2]]], ids=str
)
def test_a_stream_without_a_zero_is_refused(stream):
    with pytest.raises(ValueError, match="."):
        forcerig.zero(stream)
    with pytest.raises(ValueError, match="nominal_n_per_code"):
        forcerig.zero(np.arange(100), nominal_n_per_code=np.nan)
