"""The analysis from Python is that of `forcectl residual`."""

import pathlib
import signal
import threading
import time

import forcerig
import numpy as np
import pandas as pd
import polars
import pytest

MODEL = """
title = "A cable"
[roles]
time = { column = "t", unit = "s" }
target = { column = "force", unit = "N" }
command = { column = "command", unit = "N" }
velocity = { column = "speed", unit = "m/s" }
[selection]
only = ["coulomb", "viscous", "gain"]
[[terms]]
name = "force"
expr = "command"
fixed = 1.0
"""


def log(run, friction=-0.4, rows=300):
    """A run with dry friction against the motion, and 1 % of noise that is none."""
    random = np.random.default_rng(run)
    t = 0.02 * np.arange(rows)
    command = 3.0 + np.sin(5.0 * t + 0.3 * run)
    speed = np.cos(2.6 * t + run)
    force = command + friction * np.sign(speed) + random.normal(0.0, 0.01, rows)
    force[7] = np.nan
    return pd.DataFrame({"t": t, "command": command, "speed": speed, "force": force, "note": "a text"})


# Named as the command is given them: findings tell the path.
LOGS = {f"logs/run{run}.parquet": log(run) for run in range(4)}


@pytest.fixture
def files(tmp_path):
    (tmp_path / "logs").mkdir()
    for name, frame in LOGS.items():
        frame.to_parquet(tmp_path / name)
    (tmp_path / "MODEL.toml").write_text(MODEL)
    return tmp_path


def test_frames_files_and_the_command_give_one_report(files, forcectl, monkeypatch):
    monkeypatch.chdir(files)
    check = log(9)
    check.to_parquet(files / "other.parquet")
    command = forcectl.json("residual", "--data", "logs", "--model", "MODEL.toml", "--check", "other.parquet")["report"]
    assert command["effects"][0]["name"] == "coulomb"
    of_frames = forcerig.residual(LOGS, MODEL, check={"other.parquet": check})
    assert of_frames.json == command
    of_files = forcerig.residual("logs", pathlib.Path("MODEL.toml"), check="other.parquet")
    assert of_files.json == command
    assert of_frames.verdict == "effect" and abs(of_frames.effects[0]["params"]["friction"] + 0.4) < 0.01
    assert of_frames.names == ["coulomb (sign of velocity)"]
    assert of_frames.figures["final"]["heldout_rmse"] < 0.1 * of_frames.figures["baseline"]["heldout_rmse"]
    assert "coulomb" in of_frames.extended_model and str(of_frames) == of_frames.summary
    of_frames.write(files / "found")
    assert (files / "found" / "report.html").is_file()


def test_every_kind_of_frame_and_of_model_is_the_same():
    expected = forcerig.residual(LOGS, MODEL).json
    nullable = {name: frame.convert_dtypes() for name, frame in LOGS.items()}
    assert forcerig.residual(nullable, MODEL).json == expected
    of_polars = {name: polars.from_pandas(frame) for name, frame in LOGS.items()}
    assert forcerig.residual(of_polars, MODEL).json == expected
    arrays = {name: {key: frame[key].to_numpy() for key in frame} for name, frame in LOGS.items()}
    assert forcerig.residual(arrays, MODEL).json == expected
    indexed = {name: frame.set_index("t") for name, frame in LOGS.items()}
    assert forcerig.residual(indexed, MODEL).json == expected
    roles = {"time": "s", "target": "N", "command": "N", "velocity": "m/s"}
    columns = {"time": "t", "target": "force", "command": "command", "velocity": "speed"}
    model = {
        "title": "A cable",
        "roles": {role: {"column": columns[role], "unit": unit} for role, unit in roles.items()},
        "selection": {"only": ["coulomb", "viscous", "gain"]},
        "terms": [{"name": "force", "expr": "command", "fixed": 1.0}],
    }
    assert forcerig.residual(LOGS, model).json == expected


@pytest.mark.parametrize("kind", ["datetime64[ns]", "datetime64[us]", "timedelta64[ms]", "utc"])
def test_a_column_of_times_is_read_as_parquet_has_it(kind, files, forcectl):
    logs = {}
    for name, frame in LOGS.items():
        ms = (1000 * frame["t"]).round().astype("int64").to_numpy()
        if kind == "timedelta64[ms]":
            times = pd.Series(ms.astype(kind))
        else:
            stamps = np.datetime64("2026-01-01", "ms") + ms.astype("timedelta64[ms]")
            times = pd.Series(stamps.astype("datetime64[us]" if kind == "utc" else kind))
            times = times.dt.tz_localize("UTC") if kind == "utc" else times
        times[5] = pd.NaT
        logs[name] = frame.assign(t=times)
        logs[name].to_parquet(files / name)
    command = forcectl.json("residual", "--data", "logs", "--model", "MODEL.toml")["report"]
    assert forcerig.residual(logs, MODEL).json == command
    scaled = MODEL.replace('column = "t", unit = "s"', 'column = "t", unit = "s", scale = 0.001')
    with pytest.raises(forcerig.Refused, match="converted to seconds by its type"):
        forcerig.residual(logs, scaled)


@pytest.mark.parametrize(
    "change",
    [
        lambda frame: frame.drop(columns="speed"),
        lambda frame: frame.iloc[:0],
        lambda frame: frame.iloc[:5],
        lambda frame: frame.assign(force=np.nan),
        lambda frame: frame.assign(force=1e200),
        lambda frame: frame.assign(t=frame["t"].where(frame.index != 150, 0.0)),
    ],
    ids=["no column", "no row", "five rows", "all NaN", "too large", "one time falls"],
)
def test_bad_logs_are_refused_in_the_commands_words(change, files, forcectl):
    # Parquet logs are read without their text.
    logs = {name: change(frame.drop(columns="note")) for name, frame in LOGS.items()}
    for name, frame in logs.items():
        frame.to_parquet(files / name)
    code, words = forcectl.refusal("residual", "--data", "logs", "--model", "MODEL.toml")
    with pytest.raises(forcerig.Refused) as refused:
        forcerig.residual(logs, MODEL)
    assert refused.value.exit_code == code and isinstance(refused.value, ValueError)
    assert str(refused.value) == words


def test_frames_with_the_newest_row_first_are_read_from_their_end():
    expected = forcerig.residual(LOGS, MODEL)
    report = forcerig.residual({name: frame.iloc[::-1] for name, frame in LOGS.items()}, MODEL)
    assert report.figures == expected.figures


def test_bad_models_are_refused_in_the_commands_words(files, forcectl):
    for text in [MODEL.replace("force", "forced", 1).replace('expr = "command"', 'expr = "orders"'), "x = [\n", MODEL.replace("fixed", "fixt")]:
        (files / "MODEL.toml").write_text(text)
        code, words = forcectl.refusal("residual", "--data", "logs", "--model", "MODEL.toml")
        with pytest.raises(forcerig.Refused) as refused:
            forcerig.residual(files / "logs", files / "MODEL.toml")
        assert refused.value.exit_code == code
        assert str(refused.value).replace(f"{files}/", "") == words


@pytest.mark.parametrize("column", ["t", "force", "command", "speed"])
@pytest.mark.parametrize(
    "values",
    [
        np.full(300, np.nan),
        np.full(300, np.inf),
        np.full(300, -np.inf),
        np.zeros(300),
        np.full(300, 1e308),
        np.full(300, 5e-324),
        np.arange(300) % 2 == 0,
        np.array(["x"] * 300, dtype=object),
        np.array([None] * 300, dtype=object),
        np.array([1.0, None, "x"] * 100, dtype=object),
        np.array([b"x"] * 300),
        np.full(300, np.datetime64("NaT")),
        np.zeros(300, dtype=complex),
        np.zeros(299),
        np.zeros((300, 2)),
        np.zeros(0),
        np.float64(3.0),
        ["a", "b"],
        {"a": 1},
        None,
    ],
    ids=str,
)
def test_no_input_panics(column, values):
    frame = {name: LOGS["logs/run0.parquet"][name].to_numpy() for name in ("t", "command", "speed", "force")}
    frame[column] = values
    logs = {"a": frame, "b": LOGS["logs/run1.parquet"]}
    try:
        report = forcerig.residual(logs, MODEL)
    except (ValueError, TypeError) as error:
        assert str(error)
    else:
        assert report.verdict


@pytest.mark.parametrize("data", [None, 3, "", [], {}, [3], {"a": 3}, [[]], pd.DataFrame(), polars.DataFrame(), pd.Series([1.0]), "no/such/file"])
def test_what_is_no_log_is_named(data):
    with pytest.raises((ValueError, TypeError, FileNotFoundError)) as error:
        forcerig.residual(data, MODEL)
    assert str(error.value)


def test_progress_is_told_and_its_exception_ends_the_analysis():
    told = []
    forcerig.residual(LOGS, MODEL, progress=told.append)
    assert "which names the data support" in told

    def fails(_):
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        forcerig.residual(LOGS, MODEL, progress=fails)


def test_ctrl_c_ends_an_analysis_and_others_run_meanwhile():
    everything = MODEL.replace('only = ["coulomb", "viscous", "gain"]', "")
    long = {name: log(run, rows=20_000) for run, name in enumerate(LOGS)}
    counted = []
    pressed = []

    def press():
        # Once the search runs: the interpreter is free meanwhile.
        while not counted:
            time.sleep(0.001)
        pressed.append(True)
        signal.raise_signal(signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    stages = []

    def progress(text):
        stages.append(text)
        counted.append(text)

    with pytest.raises(KeyboardInterrupt):
        forcerig.residual(long, everything, progress=progress)
    thread.join()
    assert pressed and "which names the data support" not in stages
    # Nothing is left behind: the next analysis is whole.
    assert forcerig.residual(LOGS, MODEL).verdict == "effect"
