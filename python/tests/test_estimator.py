"""Estimators: trained, stored and run as `forcectl estimate` does."""

import json
import signal
import threading

import forcerig
import numpy as np
import pandas as pd
import pytest
from forcerig import raven

MODEL = "linear"


def trial(number, seconds=40.0):
    """A moving arm at 50 Hz whose efforts hold a force along y, in the columns of a data set."""
    random = np.random.default_rng(number)
    t = np.arange(0.0, seconds, 0.02)
    q = np.array([0.7 + 0.3 * np.sin(t + number), 1.4 + 0.3 * np.cos(0.7 * t), 0.38 + 0.03 * np.sin(1.3 * t + number)])
    velocity = np.gradient(q, t, axis=1)
    force = 2.0 * np.sin(0.5 * t + number)
    tips, efforts = [], []
    for joints, load in zip(q.T, force):
        joints = [*joints, 0.0, 0.0, 0.0]
        tips.append(raven.to_crtk(raven.forward(joints)[0]))
        efforts.append(-raven.jacobian(joints)[:3, :3].T @ raven.from_crtk([0.0, load, 0.0]))
    columns = {"t_s": t, "trial": float(number), "quality": 1.0}
    for what, rows in (("position", q), ("velocity", velocity), ("effort", np.array(efforts).T)):
        columns.update({f"joint_{what}_{joint + 1}": rows[joint] for joint in range(3)})
    columns.update({f"tip_{axis}_m": np.array(tips)[:, at] for at, axis in enumerate("xyz")})
    columns.update({"force_x_n": 0.0, "force_y_n": force + random.normal(0.0, 0.02, len(t)), "force_z_n": 0.0})
    return pd.DataFrame(columns)


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    folder = tmp_path_factory.mktemp("days")
    for number in range(1, 5):
        trial(number).to_parquet(folder / f"trial-{number:02}.parquet")
    return folder


def test_a_model_is_that_of_the_command(days, forcectl):
    done = forcectl.run("estimate", "train", days, "--model", MODEL, "--out", "command.model", "--test", "4")
    assert done.returncode == 0, done.stderr
    told = []
    found = forcerig.Estimator.train(days, MODEL, test=[4], progress=told.append)
    found.save(forcectl.folder / "python.model")
    of_command = json.loads((forcectl.folder / "command.model").read_text())
    assert json.loads((forcectl.folder / "python.model").read_text()) == of_command
    assert any("training" in line for line in told)
    assert (found.model, found.robot, found.axes, found.rate_hz) == (MODEL, "unnamed", ["x", "y", "z"], 50.0)
    assert found.card["test_trials"] == [4] and (forcectl.folder / "python.card.json").is_file()
    command = forcectl.json("estimate", "eval", "python.model", days, "--trials", "4")
    mine = forcerig.Estimator.load(forcectl.folder / "command.model").evaluate(days, [4])
    assert mine["figures"] == command["figures"] and mine["covered"] == command["covered"]
    replay = forcectl.run("estimate", "run", "command.model", "--replay", days / "trial-04.parquet", "--out", "replay.parquet")
    assert replay.returncode == 0, replay.stderr
    of_command = pd.read_parquet(forcectl.folder / "replay.parquet")
    mine = pd.DataFrame(found.run(days / "trial-04.parquet"))
    pd.testing.assert_frame_equal(mine[of_command.columns], of_command, check_dtype=False)


@pytest.fixture(scope="module")
def estimator(days):
    return forcerig.Estimator.train(days, MODEL, test=[4], intervals=False)


def test_a_stream_gives_what_a_replay_gives(days, estimator):
    rows = pd.read_parquet(days / "trial-04.parquet").iloc[:100]
    replay = estimator.run(days / "trial-04.parquet")
    stream = estimator.stream()
    for _ in range(2):
        stream.reset()
        for at, row in enumerate(rows.to_dict("records")):
            inputs = [[row[f"joint_{what}_{joint}"] for joint in (1, 2, 3)] for what in ("position", "velocity", "effort")]
            found = stream.step(*inputs)
            assert found.force_n[1] == replay["estimate_y_n"][at] and found.valid == bool(replay["valid"][at])
            assert found.half_width_n is None and not found.misfits
    stream.gap(1.0)


def test_bad_rows_are_refused_and_leave_the_stream_as_it_was(estimator):
    stream, other = estimator.stream(), estimator.stream()
    good = ([0.7, 1.4, 0.38], [0.1, 0.1, 0.01], [1.0, 1.0, 1.0])
    stream.step(*good)
    other.step(*good)
    for bad in [([np.nan] * 3, *good[1:]), (good[0], [1.0], good[2]), (*good[:2], ["a", 1, 1]), (*good[:2], [1e300, 0, 0])]:
        with pytest.raises(ValueError, match="."):
            stream.step(*bad)
    for elapsed in (np.nan, -1.0, 0.0):
        with pytest.raises(forcerig.Refused, match="elapsed_s"):
            stream.gap(elapsed)
    np.testing.assert_array_equal(stream.step(*good).force_n, other.step(*good).force_n)


def test_bad_data_are_refused(days, estimator, tmp_path):
    train = forcerig.Estimator.train
    for call in [
        lambda: train(tmp_path),
        lambda: train(tmp_path / "none"),
        lambda: train(days, "oracle"),
        lambda: train(days, "gru"),
        lambda: train(days, MODEL, test=[9]),
        lambda: train(days, MODEL, rate_hz=np.nan),
        lambda: train(days, MODEL, mapping=tmp_path / "none.toml"),
        lambda: estimator.evaluate(days, [77]),
        lambda: estimator.run(tmp_path / "none.parquet"),
        lambda: forcerig.Estimator.load(tmp_path / "none.model"),
        lambda: estimator.save(tmp_path / "none" / "a.model"),
    ]:
        with pytest.raises(forcerig.Refused) as refused:
            call()
        assert str(refused.value)
    (tmp_path / "text.model").write_text("{}")
    with pytest.raises(forcerig.Refused, match="text.model"):
        forcerig.Estimator.load(tmp_path / "text.model")
    trial(1).assign(joint_effort_2=np.nan).to_parquet(tmp_path / "nan.parquet")
    with pytest.raises(forcerig.Refused, match="joint_effort_2"):
        train(tmp_path, MODEL)


@pytest.fixture
def interruptible():
    # Python has no handler where its caller ignores the signal, as a shell does for a background job.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_an_evaluation(days, interruptible):
    found = forcerig.Estimator.train(days, MODEL, test=[4])
    whole = found.evaluate(days, [1, 2, 3, 4])
    # The exception comes from the call, before or while it computes: nothing of it is left behind.
    timer = threading.Timer(0.0, lambda: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        timer.start()
        for _ in range(10_000):
            found.evaluate(days, [1, 2, 3, 4])
    timer.join()
    assert found.evaluate(days, [1, 2, 3, 4])["figures"] == whole["figures"]
