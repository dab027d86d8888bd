# SPDX-License-Identifier: Apache-2.0
"""Trajectories: between two poses, from another frame, and in a file."""

from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest

from groundlink.core.errors import UserError
from groundlink.data.trajectory import Trajectory, read_tum, write_tum

SECONDS = np.linspace(0.0, 2 * pi, 629)


def circle(seconds: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Trajectory:
    """A body that drives a circle of 2 m around the origin, looking ahead."""
    zero = np.zeros_like(seconds)
    yaw = seconds + pi / 2
    return Trajectory(
        seconds,
        np.column_stack((2 * np.cos(seconds), 2 * np.sin(seconds), zero)),
        np.column_stack((zero, zero, np.sin(yaw / 2), np.cos(yaw / 2))),
    )


def test_between_two_poses_it_is_where_the_body_was() -> None:
    wanted = np.array([-1.0, 0.005, 1.234, 6.2, 7.0])
    found = circle(SECONDS).at(wanted)
    expected = circle(wanted[1:4])
    np.testing.assert_allclose(found.seconds, expected.seconds)
    np.testing.assert_allclose(found.positions_m, expected.positions_m, atol=3e-5)
    turned = np.abs((found.orientations * expected.orientations).sum(axis=1))
    np.testing.assert_allclose(turned, 1.0, atol=1e-9)


def test_one_pose_is_a_trajectory_too() -> None:
    alone = circle(SECONDS[:1])
    found = alone.at(np.array([-1.0, 0.0, 1.0]))
    assert found.rows.tolist() == alone.rows.tolist()


def test_a_frame_on_the_left_of_the_body_drives_a_smaller_circle() -> None:
    quarter = (0.0, 0.0, sin(pi / 4), cos(pi / 4))
    seen = circle(SECONDS).seen_from((0.0, 0.5, 0.3, *quarter))
    np.testing.assert_allclose(np.hypot(*seen.positions_m[:, :2].T), 1.5, atol=1e-12)
    np.testing.assert_allclose(seen.positions_m[:, 2], 0.3)
    # Looking to the left of the way is looking at the middle.
    x, y, z, w = seen.orientations.T
    ahead = np.column_stack((1 - 2 * (y * y + z * z), 2 * (x * y + z * w)))
    np.testing.assert_allclose(ahead, -seen.positions_m[:, :2] / 1.5, atol=1e-9)


def test_its_length_and_its_parts() -> None:
    assert circle(SECONDS).length_m == pytest.approx(4 * pi, rel=1e-4)
    part = circle(SECONDS).between(1.0, 2.0)
    assert 1.0 <= part.seconds[0] <= part.seconds[-1] <= 2.0
    assert part.length_m == pytest.approx(2.0, abs=0.05)


def test_written_trajectory_is_read_back(tmp_path: Path) -> None:
    write_tum(tmp_path / "way.tum", circle(SECONDS))
    found = read_tum(tmp_path / "way.tum")
    np.testing.assert_allclose(found.seconds, SECONDS, atol=1e-9)
    np.testing.assert_allclose(found.positions_m, circle(SECONDS).positions_m, atol=1e-7)


@pytest.mark.parametrize("text", ["", "1 2 3\n", None], ids=["empty", "short", "no file"])
def test_a_file_without_poses_is_refused_in_one_line(tmp_path: Path, text: str | None) -> None:
    file = tmp_path / "way.tum"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=r"way\.tum: no trajectory"):
        read_tum(file)
