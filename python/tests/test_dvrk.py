"""Kinematics of a dVRK's PSM against another program, and against themselves."""

import forcerig
import numpy as np
import pytest
from forcerig import dvrk

# Joints, and the tip that `dvrkKinematics.fk` of BerkeleyAutomation/FLSpegtransferHO printed for them, m. Its tip is 9.5 mm from the
# axis of the wrist's yaw.
BY_ANOTHER = [
    ([0.0, 0.0, 0.1, 0.0, 0.0, 0.0], [0.0, 0.0, -0.103]),
    ([0.3, -0.2, 0.15, 1.0, 0.4, -0.5], [0.035758644, 0.030052338, -0.143259946]),
    ([-0.9, 0.6, 0.2, -2.0, -0.8, 0.7], [-0.135107195, -0.109997651, -0.090334894]),
]
TIP_M = 0.0095


@pytest.mark.parametrize(("joints", "tip"), BY_ANOTHER)
def test_the_tip_is_where_another_program_has_it(joints, tip):
    np.testing.assert_allclose(dvrk.forward(joints, TIP_M)[0], tip, atol=1e-9)


def test_the_orientation_at_home_is_the_one_that_the_dvrk_reports():
    position, rotation = dvrk.forward(np.zeros(6))
    np.testing.assert_allclose(rotation, [[0, 1, 0], [1, 0, 0], [0, 0, -1]], atol=1e-12)
    # The shaft leaves the remote centre downwards: 416.2 + 9.1 mm from the joint's zero, which is 431.8 mm above.
    np.testing.assert_allclose(position, [0, 0, 0.4318 - 0.4162 - 0.0091], atol=1e-12)


def test_jacobian_and_inverse_agree_with_the_forward_kinematics():
    random = np.random.default_rng(5)
    lower, upper = dvrk.LIMITS.T
    for _ in range(200):
        joints = lower + (upper - lower) * random.random(6)
        position, rotation = dvrk.forward(joints, TIP_M)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        jacobian = dvrk.jacobian(joints, TIP_M)
        for joint in range(6):
            step = np.zeros(6)
            step[joint] = 1e-6
            (before, was), (after, now) = dvrk.forward(joints - step, TIP_M), dvrk.forward(joints + step, TIP_M)
            np.testing.assert_allclose(jacobian[:3, joint], (after - before) / 2e-6, atol=1e-8)
            turned = now @ was.T
            skew = (turned - turned.T) / 4e-6
            np.testing.assert_allclose(jacobian[3:, joint], [skew[2, 1], skew[0, 2], skew[1, 0]], atol=1e-8)
        found = dvrk.inverse(position, joints[3:], TIP_M)
        assert (lower[:3] - 1e-8 <= found).all() and (found <= upper[:3] + 1e-8).all()
        np.testing.assert_allclose(dvrk.forward([*found, *joints[3:]], TIP_M)[0], position, atol=1e-9)
    assert len(dvrk.JOINT_NAMES) == 6


@pytest.mark.parametrize(
    "call",
    [
        lambda: dvrk.forward([0.0] * 5),
        lambda: dvrk.forward([np.nan] * 6),
        lambda: dvrk.forward([0.0] * 6, np.inf),
        lambda: dvrk.jacobian([np.inf] * 6),
        lambda: dvrk.jacobian("joints"),
        lambda: dvrk.inverse([np.nan, 0.0, 0.0]),
        lambda: dvrk.inverse([0.1, 0.1, 0.1], [np.nan] * 3),
        lambda: dvrk.inverse([0.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
        lambda: dvrk.inverse([0.0, 0.0, -0.9]),
        lambda: dvrk.inverse([0.0, 0.0, 0.2]),
    ],
)
def test_what_can_not_be_is_refused(call):
    with pytest.raises(ValueError):
        call()


def test_out_of_reach_is_refused_as_the_commands_refuse():
    with pytest.raises(forcerig.Refused, match="beyond their limits") as refused:
        dvrk.inverse([0.0, 0.0, -0.9])
    assert refused.value.exit_code == 2
