# SPDX-License-Identifier: Apache-2.0
"""`groundlink world import`: says what it finds, and the world that it writes can be used."""

import os
from pathlib import Path

import pytest
import trimesh

from groundlink.__main__ import main
from groundlink.importing.world_files import open_edges
from groundlink.loader import load
from groundlink.world.mesh_asset import load_mesh
from groundlink.world.terrain import load_ground
from tests.groundlink.importing.files import HEIGHTMAPS, MESHES, png, sixteen_bits, write

SCENARIO = "name: it\nworld: worlds/new.yaml\nvehicles: [{name: rover, model: rover}]\n"
MAP = ("--heights-m", "0", "100", "--cell-m", "2.5")


def imported(folder: Path, name: str, content: bytes, *options: str) -> Path:
    """Write a file, import it into a world in another folder, return a scenario there."""
    for part in ("files", "worlds"):
        (folder / part).mkdir()
    write(folder / "files", name, content)
    os.chdir(folder)
    assert main(["world", "import", f"files/{name}", "--out", "worlds/new.yaml", *options]) == 0
    text = (folder / "worlds/new.yaml").read_text()
    materials = "materials:\n  rubber: {}\n  yellow_paint: {}\n  dark_metal: {}\n"
    (folder / "worlds/new.yaml").write_text(text.replace("materials:\n", materials))
    (folder / "it.yaml").write_text(SCENARIO)
    return folder / "it.yaml"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_heightmap_becomes_a_world_with_the_origin_on_the_ground(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = load(imported(tmp_path, "it's a map.png", HEIGHTMAPS["map.png"], *MAP))
    said = capsys.readouterr().out
    assert "9 x 6 heights, cells of 2.5 m: 20 x 12.5 m" in said
    assert "80 triangles" in said
    assert scenario.world.name == "it_s_a_map"
    assert scenario.world.terrain is not None
    here = load_ground(scenario.world.terrain)
    assert here.height_at(0.0, 0.0) == pytest.approx(0.0, abs=1e-3)
    assert here.cell_m == 2.5


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_or_scan_becomes_a_world(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    content = MESHES[name]
    content = content if isinstance(content, bytes) else content.encode()
    scenario = load(imported(tmp_path, name, content))
    said = capsys.readouterr().out
    assert ("points without faces" in said) == (name.partition(".")[0] in ("cloud", "packed")
                                                or name == "ascii.pcd")  # fmt: skip
    floor, mesh = scenario.world.solids
    assert floor.name == "floor"
    low, high = mesh.shape.low_m, mesh.shape.high_m  # type: ignore[union-attr]
    assert mesh.position_m[2] + low[2] == pytest.approx(0.0, abs=1e-3)
    assert mesh.position_m[0] + (low[0] + high[0]) / 2 == pytest.approx(0.0, abs=1e-3)


def test_units_follow_the_option(tmp_path: Path) -> None:
    scenario = load(imported(tmp_path, "box.stl", MESHES["box.stl"], "--scale", "0.5", "--up", "y"))
    shape = scenario.world.solids[1].shape
    assert shape.high_m == pytest.approx((0.25, 0.75, 0.5))  # type: ignore[union-attr]


def test_holes_are_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ball = trimesh.creation.icosphere(2)
    top, bottom = ball.vertices[:, 2].argmax(), ball.vertices[:, 2].argmin()
    around = [int((ball.faces == v).any(axis=1).sum()) for v in (top, bottom)]
    ball.update_faces(~((ball.faces == top) | (ball.faces == bottom)).any(axis=1))
    scenario = load(imported(tmp_path, "ball.stl", ball.export(file_type="stl")))
    assert f"open: {sum(around)} edges" in capsys.readouterr().out
    shape = scenario.world.solids[1].shape
    assert open_edges(load_mesh(shape.asset)) == (sum(around), 2)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("map.png",), "--heights-m: is missing"),
        (("map.png", *MAP, "--scale", "2"), "--scale: does not apply to map.png"),
        (("box.stl", "--cell-m", "2"), "--cell-m: does not apply to box.stl"),
        (("box.stl", "--scale", "-2"), "--scale: expected `float` > 0.0"),
        (("box.stl", "--out", "box.stl"), "file exists"),
        (("box.stl", "--out", "none/w.yaml"), "no such folder: none"),
        (("none.stl",), "none.stl: there is no such file"),
        (("new.txt",), "new.txt: unknown format; expected one of .png"),
        (("new.yaml",), "new.yaml: no such file or directory"),
    ],
)
def test_a_mistake_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], problem: str
) -> None:
    write(tmp_path, "map.png", png(sixteen_bits()))
    write(tmp_path, "box.stl", MESHES["box.stl"])
    assert main(["world", "import", *arguments]) == 2
    said = capsys.readouterr().err
    assert problem in said
    assert said.count("\n") == 1


ROOM = "name: it\nroom: {size_m: [4, 3, 2.5], wall_thickness_m: 0.1}\n"


def test_the_map_of_a_world_is_written_and_becomes_a_world_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("room.yaml").write_text(ROOM)
    assert main(["world", "map", "room.yaml", "--out", "one.yaml"]) == 0
    assert capsys.readouterr().out == (
        "room.yaml:\n  200 x 180 cells of 0.05 m\n  obstacles from 0.1 to 1 m above the ground\n"
        "  576 cells occupied, 35,424 free, 0 unknown\n  wrote one.yaml and one.pgm\n"
    )
    assert main(["world", "import", "one.yaml", "--out", "again.yaml"]) == 0
    assert capsys.readouterr().out == (
        "one.yaml:\n  200 x 180 cells of 0.05 m: 10 x 9 m\n"
        "  576 cells occupied, 35,424 free, 0 unknown\n  4 boxes as walls\n"
        "  wrote again.yaml; use it in a scenario of the same folder: `world: again.yaml`\n"
    )
    assert main(["world", "map", "again.yaml", "--out", "two.yaml", "--like", "one.yaml"]) == 0
    assert Path("two.pgm").read_bytes() == Path("one.pgm").read_bytes()
    Path("it.yaml").write_text("name: it\nworld: again.yaml\nvehicles: [{name: a, model: rover}]\n")
    assert load("it.yaml").world.name == "one"


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["room.yaml", "--out", "it.pgm"], "--out it.pgm: expected a file name that ends in .yaml"),
        (["room.yaml", "--out", "room.yaml"], "--out room.yaml: file exists"),
        (["room.yaml", "--out", "a.yaml", "--resolution-m", "0"], "--resolution-m 0.0: expected"),
        (["room.yaml", "--out", "a.yaml", "--heights-m", "1", "0"], "--heights-m: expected the"),
        (["room.yaml", "--out", "a.yaml", "--resolution-m", "1e-4"], "cells is too large"),
        (["room.yaml", "--out", "a.yaml", "--like", "no.yaml"], "no.yaml: no such file"),
        (["rover", "--out", "a.yaml"], "rover: a vehicle; expected a world or a scenario"),
    ],
)
def test_a_map_that_cannot_be_written_is_one_line(
    options: list[str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("room.yaml").write_text(ROOM)
    assert main(["world", "map", *options]) == 2
    said = capsys.readouterr().err
    assert problem in said
    assert said.count("\n") == 1
    assert not Path("a.yaml").exists()


def test_options_of_other_files_do_not_apply_to_maps(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["world", "import", "map.yaml", "--cell-m", "1"]) == 2
    assert "--cell-m: does not apply to map.yaml" in capsys.readouterr().err
