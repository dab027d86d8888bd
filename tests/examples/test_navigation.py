# SPDX-License-Identifier: Apache-2.0
"""The parts of the navigation example: map files, localization, planner and controller."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("skimage", reason="no scikit-image here")

FOLDER = Path(__file__).parents[2] / "examples/navigation"
MODULES = ("poses", "occupancy_map", "localization", "planner", "controller")
WALL, FREE, UNKNOWN = 0, 254, 205


@pytest.fixture(scope="module")
def navigation() -> Iterator[Any]:
    """The modules of the example, which import each other by their bare names."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        yield SimpleNamespace(**{name: importlib.import_module(name) for name in MODULES})
    for name in MODULES:
        del sys.modules[name]


@pytest.fixture(scope="module")
def room(navigation: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A room of 8 x 6 m with a wall across it that leaves 1.5 m free in the north."""
    pixels = np.full((140, 180), UNKNOWN, np.uint8)
    pixels[10:130, 10:170] = WALL
    pixels[12:128, 12:168] = FREE
    pixels[42:128, 90:92] = WALL  # rows begin in the north
    folder = tmp_path_factory.mktemp("map")
    (folder / "room.pgm").write_bytes(b"P5\n180 140\n255\n" + pixels.tobytes())
    (folder / "room.yaml").write_text(
        "image: room.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return navigation.occupancy_map.read_map(folder / "room.yaml")


def test_a_map_has_the_cells_of_its_image(navigation: Any, room: Any) -> None:
    assert room.occupied.sum() == 120 * 160 - 116 * 156 + 86 * 2
    assert room.free.sum() == 116 * 156 - 86 * 2
    corners = np.array([[-1.0, -2.0], [8.0, 5.0]])
    assert room.cells(corners).tolist() == [[-0.5, -0.5], [139.5, 179.5]]
    assert room.centers(room.cells(corners)) == pytest.approx(corners)
    rows, columns = room.nearest_cells(np.array([[-0.49, 0.0], [99.0, 0.0]]))
    assert (rows.tolist(), columns.tolist()) == ([40], [10])
    assert room.occupied[40, 10]


def test_poses_compose(navigation: Any) -> None:
    poses = navigation.poses
    a, b = np.array([1.0, 2.0, np.pi / 2]), np.array([3.0, 0.5, 0.2])
    assert poses.compose(a, b) == pytest.approx([0.5, 5.0, np.pi / 2 + 0.2])
    assert poses.compose(poses.inverse(a), poses.compose(a, b)) == pytest.approx(b)
    assert poses.transformed(a, np.array([[1.0, 0.0]])) == pytest.approx(np.array([[1.0, 3.0]]))
    # A quarter of a circle with a radius of 2 m, and a straight line.
    assert poses.arc(np.pi, np.pi / 2, np.array([1.0]))[0] == pytest.approx([2, 2, np.pi / 2])
    assert poses.arc(0.5, 0.0, np.array([-2.0]))[0] == pytest.approx([-1.0, 0.0, 0.0])


def scan(pose: np.ndarray[Any, Any], room: Any, navigation: Any) -> Any:
    """Return the points of a perfect scan in the base frame."""
    reach = np.arange(0.0, 9.0, 0.02)
    points = []
    for angle in np.radians(np.arange(0.0, 360.0, 2.0)):
        ray = np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])
        cells = np.rint(room.cells(navigation.poses.transformed(pose, ray))).astype(int)
        hit = np.argmax(room.occupied[tuple(cells.T.clip(0, [[139], [179]]))])
        points.append(ray[hit])
    return np.array(points)


def test_scans_correct_the_first_pose_and_the_odometry(navigation: Any, room: Any) -> None:
    """Odometry turns 2 % too much, from another origin; unknown obstacles stop one ray in four."""
    localizer = navigation.localization.Localizer(room, np.array([1.25, 0.8, 0.15]))
    rng = np.random.default_rng(3)
    errors = []
    for step in range(12):
        pose = np.array([1.0 + 0.1 * step, 1.0 + 0.02 * step, 0.1 * step])
        odometry = navigation.poses.compose(np.array([5.0, -3.0, 2.0]), pose)
        odometry[2] += 0.02 * pose[2]
        points = scan(pose, room, navigation)
        points[rng.random(len(points)) < 0.25] *= 0.5
        found = localizer.locate(points, odometry)
        errors.append(np.abs(found - pose))
    assert np.max(errors[1:], axis=0) == pytest.approx(0, abs=0.04)
    unknown = np.array([[1.0, 1.0]])
    wall = room.centers(np.array([[40.0, 10.0]]))
    assert localizer.distances(unknown) == navigation.localization.FAR_M
    assert localizer.distances(wall) == pytest.approx(0, abs=1e-9)


def test_a_path_keeps_clear_of_walls_and_of_obstacles_seen_lately(
    navigation: Any, room: Any
) -> None:
    planner = navigation.planner.Planner(room, 0.3, 0.5)
    start, goal = np.array([1.0, 0.0]), np.array([6.0, 0.0])
    path = planner.plan(start, goal, 0.0)
    assert path[0] == pytest.approx(start, abs=0.1)
    assert path[-1] == pytest.approx(goal, abs=0.1)
    assert path[:, 1].max() > 3.0  # through the gap in the north
    rows, columns = np.nonzero(room.occupied)
    walls = room.centers(np.column_stack([rows, columns]).astype(float))
    gaps = np.hypot(*(path[:, None] - walls[None]).transpose(2, 0, 1)).min(axis=1)
    assert gaps.min() > 0.5

    door = np.column_stack([np.full(30, 3.5), np.linspace(2.7, 4.2, 30)])
    planner.see(door, 1.0)
    assert planner.plan(start, goal, 2.0) is None
    assert planner.plan(start, goal, 1.1 + navigation.planner.REMEMBERED_S) is not None
    assert planner.plan(start, np.array([60.0, 0.0]), 100.0) is None  # off the map


NOTHING = np.empty((0, 2))


def drive(navigation: Any, pose: Any, path: Any, yaw: float) -> Any:
    """Return the poses of an ideal robot until the controller has arrived, every 0.1 s."""
    controller = navigation.controller.PurePursuit()
    poses = [np.array(pose)]
    for _ in range(600):
        command = controller.command(poses[-1], path, yaw, NOTHING)
        if command is None:
            return np.array(poses)
        moved = navigation.poses.arc(*command, np.array([0.1]))[0]
        poses.append(navigation.poses.compose(poses[-1], moved))
    raise AssertionError(f"not there: {poses[-1]}")


def test_the_controller_follows_a_path_to_its_end_and_turns(navigation: Any) -> None:
    corner = [[x, 0.0] for x in np.arange(0, 3, 0.05)] + [[3.0, y] for y in np.arange(0, 2, 0.05)]
    path = np.array(corner)
    poses = drive(navigation, [0.0, 0.1, 3.0], path, -2.0)
    assert poses[-1, :2] == pytest.approx(path[-1], abs=0.05)
    assert navigation.poses.wrapped(poses[-1, 2] + 2.0) == pytest.approx(0, abs=0.05)
    beside = np.hypot(*(poses[:, None, :2] - path[None]).transpose(2, 0, 1)).min(axis=1)
    assert beside.max() < 0.25


def test_the_controller_stops_for_what_is_ahead(navigation: Any) -> None:
    controller = navigation.controller.PurePursuit()
    path = np.column_stack([np.linspace(0, 5, 101), np.zeros(101)])

    def speed(points: list[list[float]]) -> float:
        command = controller.command(np.zeros(3), path, 0.0, np.array(points).reshape(-1, 2))
        return float(command[0])

    assert speed([]) == speed([[1.0, 0.6], [-0.7, 0.0]]) == controller.speed_mps
    assert 0 < speed([[1.0, 0.3]]) < controller.speed_mps
    assert speed([[0.6, 0.0]]) == 0.0
