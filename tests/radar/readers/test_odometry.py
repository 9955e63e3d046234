"""Reference motions in files: trajectories and odometries."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from d2d.radar import Track, load_reference


def written(folder, text: str):
    path = folder / "reference.txt"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_trajectory_gives_the_velocities_of_its_frame(tmp_path):
    """Breaks if velocities are along the axes of the world, or a quaternion is misread."""
    times, turn = np.arange(0.0, 4.0, 0.1), 0.3
    true = Track(
        times[1:],
        np.diff(times),
        np.tile([5.0, -0.2, turn], (len(times) - 1, 1)),
        np.tile(np.eye(3), (len(times) - 1, 1, 1)),
        np.ones(len(times) - 1, dtype=bool),
    )
    true.write_tum(tmp_path / "path.tum", start=(3.0, -7.0, 2.5))
    found = load_reference(tmp_path / "path.tum")
    assert_allclose(found.theta, np.tile([5.0, -0.2, turn], (len(found.times), 1)), atol=0.01)
    assert len(found.times) > 30


def test_an_odometry_is_read_in_both_units(tmp_path):
    """Breaks if deg/s are taken for rad/s, or the order of the columns matters."""
    rows = [(0.0, 5.0, 0.1), (0.1, 5.5, -0.2)]
    plain = "time,speed,yaw_rate\n" + "\n".join(f"{t},{v},{w}" for t, v, w in rows)
    degrees = "# yaw_rate_deg;time;speed\n" + "\n".join(
        f"{np.rad2deg(w)};{t};{v}" for t, v, w in rows
    )
    for text in (plain, degrees):
        found = load_reference(written(tmp_path, text))
        assert_allclose(found.times, [0.0, 0.1])
        assert_allclose(found.theta, [[5.0, 0.0, 0.1], [5.5, 0.0, -0.2]], rtol=1e-12)
        assert np.isnan(found.poses).all()


def test_what_an_odometry_lacks_is_nan(tmp_path):
    """Breaks if a gyro alone stands still, or a speed alone drives straight ahead."""
    for text, theta in (
        ("time,yaw_rate\n0,0.1\n1,0.2\n", [[np.nan, np.nan, 0.1], [np.nan, np.nan, 0.2]]),
        ("time,speed\n0,5\n1,6\n", [[5.0, 0.0, np.nan], [6.0, 0.0, np.nan]]),
    ):
        assert_array_equal(load_reference(written(tmp_path, text)).theta, theta)


def test_what_is_neither_is_named(tmp_path):
    """Breaks if a wrong file gives a reference, or a traceback."""
    pose = "0 1 2 0 0 0 0 1\n"
    for text, said in (
        ("", "is empty"),
        ("time,range\n0,1\n", "must name the columns time, speed or time, yaw_rate"),
        ("speed,yaw_rate\n0,1\n", "must name the columns time, speed or time, yaw_rate"),
        ("time,speed,yaw_rate\n0,1,2\n1,x,0\n", "line 3: speed must be a number, but is 'x'"),
        ("time,speed,yaw_rate\n0,1,12\n", "line 2: yaw_rate must be in rad/s, at most"),
        ("time,speed,yaw_rate\n0,1,0\n0,1,0\n", "line 3: times must increase"),
        ("time,speed,yaw_rate\n", "two lines or more"),
        (pose + "1 2 3\n", "line 2: there must be t x y z qx qy qz qw"),
        (pose + "1 1 2 0 0 0 0 0\n", "line 2: .* a quaternion that is not zero"),
        (pose + "1 1 2 0 0 0 0 nan\n", "line 2: pose must be finite"),
        (pose, "two lines or more"),
        (pose + "1000" + pose[1:], "times must be in s, but are 1000 apart"),
        (pose + "2" + pose[1:] + "1" + pose[1:], "line 3: times must increase, but 1 follows 2.0"),
    ):
        path = written(tmp_path, text)
        with pytest.raises(ValueError, match=f"^{re.escape(str(path))}.*{said}"):
            load_reference(path)
