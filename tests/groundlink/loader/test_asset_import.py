# SPDX-License-Identifier: Apache-2.0
"""Terrain and meshes of a scenario's files: resolved to digests, everything on the ground."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import yaml

from groundlink.loader import load
from groundlink.loader.document import ScenarioError
from groundlink.process.asset_exchange import needed
from groundlink.report.analysis.plan import outlines
from groundlink.scenario import Scenario
from groundlink.scene.bodies import body_names
from groundlink.scene.build import WorldError, solids, world_hash
from groundlink.world import assets
from groundlink.world.solids import Mesh
from groundlink.world.terrain import load_ground
from tests.groundlink.importing.files import glb, npy, write

SLOPE = np.add.outer(np.zeros(41), 0.1 * np.arange(81)).astype(np.float32)
"""Rises to the east by 1 in 10; 80 x 40 m at cells of 1 m."""

WORLD: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("slope.yaml").read_text())


def made(folder: Path, **changes: object) -> Path:
    """Write a scenario whose world and its files lie in other folders."""
    for name in ("worlds", "maps"):
        (folder / name).mkdir(exist_ok=True)
    write(folder / "maps", "slope.npy", npy(SLOPE))
    write(folder / "worlds", "house.glb", glb())
    (folder / "worlds" / "slope.yaml").write_text(yaml.safe_dump(WORLD | changes))
    vehicle = {"name": "rover", "model": "rover", "placement": {"x_m": -10.0}}
    scenario = {"name": "it", "world": "worlds/slope.yaml", "vehicles": [vehicle]}
    (folder / "it.yaml").write_text(yaml.safe_dump(scenario))
    return folder / "it.yaml"


def test_files_become_assets_that_are_in_the_store(tmp_path: Path) -> None:
    scenario = load(made(tmp_path))
    house, shed = scenario.world.solids
    assert isinstance(house.shape, Mesh)
    assert house.shape == shed.shape
    assert scenario.world.terrain is not None
    assert (load_ground(scenario.world.terrain).heights == SLOPE).all()
    assert len(needed(scenario)) == 2
    assert assets.missing(needed(scenario)) == []
    packed = msgspec.msgpack.encode(scenario)
    assert len(packed) < SLOPE.nbytes
    assert msgspec.msgpack.decode(packed, type=Scenario) == scenario


def test_the_terrain_is_the_last_body(tmp_path: Path) -> None:
    scenario = load(made(tmp_path))
    names = body_names(scenario, solids(scenario))
    assert names[-3:] == ("house", "shed", "terrain")
    twin = WORLD["solids"][0] | {"name": "terrain"}
    with pytest.raises(ScenarioError, match="two bodies are named `terrain`"):
        load(made(tmp_path, solids=[twin]))


def test_who_keeps_records_needs_no_assets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load(made(tmp_path))
    digest, names = world_hash(scenario), body_names(scenario, solids(scenario))
    monkeypatch.setenv(assets.VARIABLE, str(tmp_path / "nothing"))
    assert assets.missing(needed(scenario)) == needed(scenario)
    load_ground.cache_clear()
    assert world_hash(scenario) == digest
    assert body_names(scenario, solids(scenario)) == names
    assert [o.name for o in outlines(solids(scenario), level=False)] == ["shed", "house"]


def test_the_hash_of_a_world_is_of_its_data(tmp_path: Path) -> None:
    before = world_hash(load(made(tmp_path)))
    assert world_hash(load(made(tmp_path))) == before
    file = made(tmp_path)
    higher = SLOPE.copy()
    higher[0, 0] += 0.001
    write(tmp_path / "maps", "slope.npy", npy(higher))
    assert world_hash(load(file)) != before


def test_what_stands_on_the_ground_is_as_high_as_it(tmp_path: Path) -> None:
    scenario = load(made(tmp_path))
    house, shed = scenario.world.solids
    assert house.position_m == pytest.approx((10.0, 0.0, 6.0))
    assert shed.position_m == pytest.approx((30.0, 0.0, 1.0))


def test_a_vehicle_may_start_within_the_box_of_a_mesh(tmp_path: Path) -> None:
    around = WORLD["solids"][0] | {"position_m": [-10, 0, 0]}
    load(made(tmp_path, solids=[around]))


def changed(name: str, **changes: object) -> dict[str, object]:
    part = WORLD[name][0] if name == "solids" else WORLD[name]
    new = dict(part) | changes
    return {name: [new] if name == "solids" else new}


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        (changed("terrain", file="none.npy"), "slope.yaml:.*none.npy: there is no such file"),
        (changed("terrain", cell_m=-1), "slope.yaml:.*`terrain.cell_m`: expected"),
        (changed("terrain", cell_mm=1), "slope.yaml:.*unknown key `terrain.cell_mm`.*`cell_m`"),
        (changed("terrain", kind="hill"), "slope.yaml:.*unknown kind `hill`; did you mean `hills`"),
        (changed("terrain", heights_m=[0, 1]), "slope.yaml:.*`heights_m`: .*in meters already"),
        (
            changed("terrain", material="gras"),
            "no material `gras` in world.materials; did you mean",
        ),
        (
            changed("solids", shape={"kind": "mesh", "file": "none.obj"}),
            "slope.yaml:.*`world.solids.0..shape`: .*none.obj: there is no such file",
        ),
        (
            changed("solids", shape={"kind": "mesh", "file": "house.glb", "scale": 0}),
            "slope.yaml:.*`shape.scale`: expected",
        ),
        (changed("solids", position_m=[100, 0, 0]), "slope.yaml:.*is outside the terrain"),
        ({"terrain": None}, "slope.yaml:.*`on_ground`: expected terrain"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(
    tmp_path: Path, changes: dict[str, object], problem: str
) -> None:
    with pytest.raises((ScenarioError, WorldError), match=problem) as caught:
        load(made(tmp_path, **changes))
    assert "\n" not in str(caught.value)


def test_doubtful_values_are_warned_about(tmp_path: Path) -> None:
    told: list[str] = []
    file = made(tmp_path)
    scaled = {"kind": "mesh", "file": "house.glb", "scale": 1000.0}
    made(tmp_path, **changed("solids", shape=scaled))
    load(file, warn=told.append)
    assert len(told) == 1
    assert "millimeter" in told[0]


CELLS = ["11111", "1.. 1", "1...1", "11111"]
"""A room of a map from north to south: wall, floor, unknown."""

HILLS = {"kind": "hills", "size_m": [9, 9], "cell_m": 1, "height_m": 1, "longest_m": 5} | {
    "material": "grass"
}

MAP_YAML = (
    "image: room.pgm\nresolution: 0.5\norigin: [-1.0, -1.0, 0.0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


def mapped(folder: Path, text: str = MAP_YAML, **changes: object) -> Path:
    """Write a scenario whose world, map and picture lie in other folders."""
    for name in ("worlds", "maps"):
        (folder / name).mkdir(exist_ok=True)
    grays = bytes({"1": 0, ".": 254, " ": 205}[cell] for row in CELLS for cell in row)
    write(folder / "maps", "room.pgm", b"P5 5 4 255\n" + grays)
    write(folder / "maps", "room.yaml", text.encode())
    world = {"name": "flat", "map": {"file": "../maps/room.yaml"}} | changes
    (folder / "worlds" / "flat.yaml").write_text(yaml.safe_dump(world))
    vehicle = {"name": "rover", "model": "rover", "placement": {"x_m": 0.25}}
    scenario = {"name": "it", "world": "worlds/flat.yaml", "vehicles": [vehicle]}
    (folder / "it.yaml").write_text(yaml.safe_dump(scenario))
    return folder / "it.yaml"


def test_a_map_becomes_solids_before_those_of_the_file(tmp_path: Path) -> None:
    box = {"kind": "box", "size_m": [0.1, 0.1, 0.1]}
    own = {"name": "own", "shape": box, "material": "metal", "position_m": [0.9, 0.4, 0.1]}
    scenario = load(mapped(tmp_path, solids=[own]))
    names = [solid.name for solid in scenario.world.solids]
    assert names == ["map_floor", *(f"map_wall_{i}" for i in range(4)), "own"]
    assert {"plaster", "linoleum"} <= scenario.world.materials.keys()
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(scenario), type=Scenario) == scenario
    assert assets.missing(needed(scenario)) == []
    with pytest.raises(ScenarioError, match=r"flat\.yaml:11: `world.solids\[5\].shape.size_m` is"):
        load(mapped(tmp_path, solids=[own | {"shape": {"kind": "box"}}]))


@pytest.mark.parametrize(
    ("text", "changes", "problem"),
    [
        (MAP_YAML.replace("resolution: 0.5", "resolution: -1"), {}, r"room.yaml:2: `resolution`: "),
        (MAP_YAML.replace("origin: [-1.0, -1.0, 0.0]", "origin: [1, 2]"), {}, r"room.yaml:3: `ori"),
        (MAP_YAML.replace("negate: 0\n", ""), {}, r"room.yaml:1: `negate` is missing; add it"),
        (MAP_YAML.replace("0.196", "0.7"), {}, r"room.yaml:1: `free_thresh` is 0.7; expected less"),
        (
            MAP_YAML + "mode: both\n",
            {},
            r"room.yaml:7: `mode`: unknown value `both`; expected one of raw",
        ),
        (MAP_YAML.replace("room.pgm", "no.pgm"), {}, r"room.yaml:1: `image`: .*there is no such"),
        (MAP_YAML.replace("0.65", "0.19").replace("0.196", "0.1"), {}, r"placement.*starts inside"),
        (MAP_YAML, {"map": {"file": "no.yaml"}}, r"no.yaml: no such file"),
        (MAP_YAML, {"map": {"file": "../maps/room.yaml", "high_m": 2}}, r"unknown key `map.high_m"),
        (MAP_YAML, {"map": {"file": "../maps/room.yaml", "wall_material": "plastr"}}, "`plaster`"),
        (MAP_YAML, {"terrain": HILLS}, r"`map`: the world has `terrain`, too"),
    ],
)
def test_a_mistake_in_a_map_is_one_line(
    tmp_path: Path, text: str, changes: dict[str, object], problem: str
) -> None:
    with pytest.raises(ScenarioError, match=problem) as caught:
        load(mapped(tmp_path, text, **changes))
    assert ".yaml:" in str(caught.value) or "no.yaml" in str(caught.value)
