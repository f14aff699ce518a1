"""Allocation and workspace of a rig file, kinematics of the arm."""

import forcerig
import numpy as np
import pytest
from forcerig import raven


def test_tensions_apply_the_force_within_their_limits():
    rig = forcerig.Rig()
    for force_n in ([0.0, 2.5, 0.0], [0.0, 0.0, 0.0], [-1.0, 2.0, 1.5]):
        found = rig.allocate(force_n)
        assert found.feasible and found.fraction == 1.0
        assert (found.tension_n >= found.lower_n - 1e-9).all() and (found.tension_n <= found.upper_n + 1e-9).all()
        np.testing.assert_allclose(found.tension_n @ found.direction, force_n, atol=1e-3)
        np.testing.assert_allclose(found.tension_n @ found.direction, found.force_n, atol=1e-12)
        away = rig.exit_m - found.tip_m
        np.testing.assert_allclose(found.direction, away / np.linalg.norm(away, axis=1, keepdims=True), atol=1e-9)


def test_a_force_out_of_reach_is_said_to_be():
    rig = forcerig.Rig()
    large = rig.allocate([0.0, 11.9, 0.0])
    assert not large.feasible and large.residual_n > 0.1 and "out of reach" in large.text
    edge = 11.9 * large.fraction
    assert rig.allocate([0.0, 0.99 * edge, 0.0]).feasible and not rig.allocate([0.0, 1.01 * edge, 0.0]).feasible
    alone = rig.allocate([0.0, 5.0, 0.0], available=[True, True, False, False, True, True])
    assert not alone.feasible and alone.fraction == "not even zero"
    assert alone.tension_n[2] == 0.0 and alone.upper_n[3] == 0.0


def test_the_workspace_is_that_of_the_command(forcectl):
    command = forcectl.json("workspace", "--across", "5", "--radius", "0.04")
    found = forcerig.Rig().workspace(0.04, 5)
    assert (found.poses, found.least_n, found.mean_n, found.along_n.tolist()) == (
        command["poses"],
        command["least_n"],
        command["mean_n"],
        command["along_n"],
    )
    centre = np.array(forcerig.Rig().settings["workspace"]["center_m"])
    at = forcerig.Rig().feasible([centre, centre + [0.04, 0.0, 0.0]])
    assert at.radius_n.shape == (2,) and at.along_n.shape == (2, 6) and (at.radius_n >= found.least_n - 1e-9).all()


def test_a_rig_file_is_refused_in_the_commands_words(tmp_path, forcectl):
    text = forcectl.run("check", "--print").stdout
    wrong = tmp_path / "rig.toml"
    wrong.write_text(text.replace("tension_max_n", "tension_most_n", 1))
    done = forcectl.run("check", "rig.toml")
    with pytest.raises(forcerig.Refused) as refused:
        forcerig.Rig(wrong)
    assert refused.value.exit_code == done.returncode
    for line in str(refused.value).replace(f"{tmp_path}/", "").splitlines():
        assert line.strip() in done.stdout + done.stderr
    assert forcerig.Rig.from_text(text).hash == forcerig.Rig().hash
    with pytest.raises(forcerig.Refused, match="no such rig|cannot be read"):
        forcerig.Rig(tmp_path / "none.toml")


@pytest.mark.parametrize(
    "arguments",
    [
        ([0.0, 1.0],),
        ([0.0, np.nan, 0.0],),
        ([0.0, 1e9, 0.0],),
        ("abc",),
        (None,),
        ([0, 1, 0], [9.0, 9.0, 9.0]),
        ([0, 1, 0], [np.nan, 0.0, 0.0]),
        ([0, 1, 0], [0.0]),
        ([0, 1, 0], None, [True]),
        ([0, 1, 0], None, [1, 1, 1, 1, 1, 1]),
        ([0, 1, 0], None, [False] * 6),
    ],
)
def test_bad_forces_and_tips_are_refused(arguments):
    with pytest.raises(ValueError, match="."):
        forcerig.Rig().allocate(*arguments)


@pytest.mark.parametrize("arguments", [(-1.0,), (np.nan,), (9.0,), (0.05, 2), (0.05, 42), (0.05, -1)])
def test_bad_workspaces_are_refused(arguments):
    with pytest.raises(ValueError, match="has to be"):
        forcerig.Rig().workspace(*arguments)


@pytest.mark.parametrize("tips", [[], [[0.0, 0.0]], [[np.nan] * 3], "x", [forcerig.Rig().exit_m[0]], [[np.inf, 0, 0]]])
def test_bad_tips_are_refused(tips):
    with pytest.raises(ValueError, match="."):
        forcerig.Rig().feasible(tips)


def test_the_arm_reaches_what_it_computes():
    joints = raven.HOME + [0.1, -0.1, 0.02, 0.3, 0.2, -0.1]
    position, rotation = raven.forward(joints)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(raven.inverse(position, joints[3:]), joints[:3], atol=1e-7)
    step = 1e-6
    for joint in range(6):
        moved = joints.copy()
        moved[joint] += step
        slope = (raven.forward(moved)[0] - position) / step
        np.testing.assert_allclose(raven.jacobian(joints)[:3, joint], slope, atol=1e-5)
    np.testing.assert_allclose(raven.joints_from_motors(raven.motors_from_joints(joints[:3])), joints[:3], atol=1e-12)
    np.testing.assert_allclose(raven.to_crtk([1, 2, 3]), [-2, -3, 1])
    np.testing.assert_allclose(raven.from_crtk(raven.to_crtk(position)), position)
    assert raven.LIMITS.shape == (6, 2) and len(raven.JOINT_NAMES) == 6


@pytest.mark.parametrize(
    "call",
    [
        lambda: raven.forward([0.0] * 5),
        lambda: raven.forward([np.nan] * 6),
        lambda: raven.jacobian([np.inf] * 6),
        lambda: raven.inverse([0.0, 0.0, 0.0]),
        lambda: raven.inverse([np.nan, 0.0, 0.0]),
        lambda: raven.inverse([9.0, 9.0, 9.0]),
        lambda: raven.inverse([0.1, 0.1, 0.1], [np.nan] * 3),
        lambda: raven.motors_from_joints("joints"),
    ],
)
def test_bad_joints_are_refused(call):
    with pytest.raises(ValueError, match="."):
        call()
