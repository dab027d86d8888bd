# SPDX-License-Identifier: Apache-2.0
"""Pictures of everything that is shipped: all of it in the picture, with its frames."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.__main__ import main
from groundlink.loader.partial_scenario import FileKind, load_partial
from groundlink.loader.scenario_files import SHIPPED
from services.sensors.rendering.portrait.__main__ import FROM_DEG
from services.sensors.rendering.portrait.picture import (
    BLUE,
    GREEN,
    MARGIN,
    RED,
    direction,
    mark,
    portrait,
    view,
)
from services.sensors.rendering.portrait.scene import NamedFrame, scene

SIZE = (480, 320)
WORLDS = sorted(file.stem for file in (SHIPPED / "worlds").glob("*.yaml"))
VEHICLES = sorted(file.stem for file in (SHIPPED / "vehicles").glob("*.yaml"))


def near(picture: NDArray[np.uint8], color: tuple[int, int, int]) -> int:
    """Return the pixels of a color."""
    return int((np.abs(picture.astype(int) - color).max(axis=-1) < 12).sum())


@pytest.mark.parametrize("name", [*WORLDS, *VEHICLES])
def test_everything_shipped_has_a_picture(name: str) -> None:
    kind, scenario = load_partial(name)
    assert kind is (FileKind.WORLD if name in WORLDS else FileKind.VEHICLE)
    picture = portrait(kind, scenario, FROM_DEG[kind], SIZE)
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    assert picture.std(axis=(0, 1)).min() > 5
    for color in (RED, GREEN, BLUE):
        assert near(picture, color) > 15
    assert np.array_equal(picture, portrait(kind, scenario, FROM_DEG[kind], SIZE))


def test_all_points_are_in_view_and_as_near_as_can_be() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        points = rng.normal(0, 1, (30, 3)) * rng.uniform(0.1, 9, 3) + rng.normal(0, 50, 3)
        towards = direction(rng.uniform(0, 360), rng.uniform(0, 90))
        pinhole, pose = view(points, towards, *SIZE)
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        assert (local[:, 2] > pinhole.near_m).all()
        _, _, z, w = pinhole.clip_from_optical() @ (0.0, 0.0, pinhole.near_m, 1.0)
        assert z == pytest.approx(-w), "there the view begins"
        pixels = local[:, :2] / local[:, 2:] * pinhole.fx
        filled = np.abs(pixels).max(axis=0) * 2 / SIZE
        assert filled.max() == pytest.approx(MARGIN, abs=1e-6)
        assert pose[:3, 2] == pytest.approx(-towards)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        assert pose[2, 1] <= 1e-9, "up is up"


def test_directions_are_those_of_a_compass() -> None:
    assert direction(90.0, 0.0) == pytest.approx([1.0, 0.0, 0.0], abs=1e-12)
    assert direction(0.0, 30.0) == pytest.approx([0.0, np.sqrt(0.75), 0.5])


def test_a_frame_is_drawn_where_it_is() -> None:
    pinhole, pose = view(np.array([[-1.0, -1, -1], [1, 1, 1]]), direction(225.0, 35.0), *SIZE)
    picture = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
    mark(picture, [NamedFrame("here", np.eye(4))], 0.5, pinhole, pose)
    middles = [
        np.argwhere(np.abs(picture.astype(int) - color).max(axis=-1) < 5).mean(axis=0)
        for color in (RED, GREEN, BLUE)
    ]
    (row, column) = (SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2
    # From the south-west x points right, y left, both away, z up.
    assert middles[0][1] > column + 10
    assert middles[1][1] < column - 10
    assert middles[2][0] < row - 10
    assert middles[2][1] == pytest.approx(column, abs=2)
    behind = np.full_like(picture, 128)
    away = np.eye(4)
    away[:2, 3] = -100.0
    mark(behind, [NamedFrame("behind", away)], 0.5, pinhole, pose)
    assert (behind == 128).all()


def test_names_do_not_cover_each_other() -> None:
    pinhole, pose = view(np.array([[-1.0, -1, -1], [1, 1, 1]]), direction(180.0, 20.0), *SIZE)
    blank = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    white = []
    for count in (1, 2, 3):
        picture = blank.copy()
        mark(picture, [NamedFrame("mmmm", np.eye(4))] * count, 1e-6, pinhole, pose)
        white.append(near(picture, (255, 255, 255)))
    assert white[1] > 1.6 * white[0]
    assert white[2] > 2.4 * white[0]


def test_a_room_is_open_towards_the_eye() -> None:
    _, scenario = load_partial("lab")
    for azimuth, hidden in ((180.0, {"south"}), (45.0, {"north", "east"})):
        shown = scene(FileKind.WORLD, scenario, direction(azimuth, 35.0)).static
        names = [solid.name for solid in shown]
        walls = {name.split("_")[1] for name in names if name.startswith("wall_")}
        assert walls == {"north", "east", "south", "west"} - hidden
        assert "room_ceiling" not in names
        assert ("door_leaf" in names) is ("south" in walls)


def test_a_scenario_shows_its_vehicles_where_they_start() -> None:
    kind, scenario = load_partial("indoor_lab")
    assert kind is FileKind.SCENARIO
    with_rover = portrait(kind, scenario, FROM_DEG[kind], SIZE)
    shown = scene(kind, scenario, direction(200.0, 38.0))
    assert [frame.name for frame in shown.frames] == ["world", "rover"]
    start = scenario.vehicles[0].placement
    assert shown.poses[0, :2] == pytest.approx([start.x_m, start.y_m])
    empty = replace(scenario, vehicles=())
    assert (with_rover != portrait(kind, empty, FROM_DEG[kind], SIZE)).any(axis=-1).sum() > 200


@pytest.fixture
def show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """`groundlink world show`, as a function that returns its code, its output and its errors."""

    def show(*words: str) -> tuple[int, str, str]:
        monkeypatch.chdir(tmp_path)
        try:
            code = main(["world", "show", *words])
        except SystemExit as end:
            code = int(end.code or 0)
        return code, *capfd.readouterr()

    return show


def test_the_command_writes_a_file(
    show: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    assert show("rover", "--size", "200x160", "--from", "300,10")[:2] == (0, "rover.png\n")
    picture = cv2.imread(str(tmp_path / "rover.png"))
    assert picture is not None
    assert picture.shape == (160, 200, 3)


@pytest.mark.parametrize(
    ("name", "begins"), [("rover.jpg", b"\xff\xd8\xff"), ("rover.PNG", b"\x89PNG")]
)
def test_the_file_is_what_its_ending_says(
    show: Callable[..., tuple[int, str, str]], name: str, begins: bytes, tmp_path: Path
) -> None:
    assert show("rover", "--size", "200x160", "--out", name)[:2] == (0, f"{name}\n")
    assert (tmp_path / name).read_bytes().startswith(begins)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["rover", "--out", "rover.gif"],
            "`rover.gif`: expected a file name that ends in .png, .jpg",
        ),
        (["labb"], "no world, vehicle or scenario `labb` is shipped; did you mean `lab`?"),
        (["no.yaml"], "no.yaml: no such file"),
        (["odd.yaml"], "odd.yaml:1: expected a scenario (`vehicles`), a vehicle"),
        (["rover", "--out", "no/folder/rover.png"], "--out no/folder/rover.png: no such file"),
        (["rover", "--size", "9"], "expected WIDTHxHEIGHT such as 960x640"),
        (["rover", "--from", "up"], "expected AZIMUTH,ELEVATION such as 200,35"),
    ],
)
def test_mistakes_are_one_line(
    show: Callable[..., tuple[int, str, str]], words: list[str], said: str, tmp_path: Path
) -> None:
    (tmp_path / "odd.yaml").write_text("kind: imu\n", encoding="utf-8")
    code, _, error = show(*words)
    assert code == 2
    assert said in error.strip().splitlines()[-1], error
    assert "Traceback" not in error
