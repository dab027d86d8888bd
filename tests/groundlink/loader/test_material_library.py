# SPDX-License-Identifier: Apache-2.0
"""The library of materials defines what a scenario uses and leaves undefined, and nothing else."""

import re
from pathlib import Path

import msgspec
import pytest

from groundlink.loader import ScenarioError, load, material_library
from groundlink.loader.material_library import material_library as library
from groundlink.loader.partial_scenario import load_partial
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.schema import Scenario
from groundlink.scene.build import material_uses, world_hash
from groundlink.world.objects.indoor_specs import Clutter, Door, Furniture, Room
from groundlink.world.objects.outdoor_specs import OutdoorObject
from groundlink.world.solids import Soil
from tests.groundlink.scenario.test_defaults import structs

ROOT = Path(__file__).resolve().parents[3]

NAMES = [
    file.stem for folder in ("worlds", "vehicles") for file in (SHIPPED / folder).glob("*.yaml")
]

ROOM = """\
name: test
world:
  name: bare
  {materials}
  room: {{size_m: [8, 6, 3], floor_material: {floor}}}
vehicles:
  - {{name: rover, model: rover, sensors: []}}
"""


def room(folder: Path, *, materials: str = "", floor: str = "concrete") -> Scenario:
    file = folder / "test.yaml"
    file.write_text(ROOM.format(materials=materials, floor=floor), encoding="utf-8")
    return load(file)


def test_a_room_needs_no_materials_of_its_own(tmp_path: Path) -> None:
    scenario = room(tmp_path)
    materials = scenario.world.materials
    assert materials["concrete"] == library()["concrete"]
    assert materials["plaster"] == library()["plaster"]
    assert set(materials) == {"concrete", "plaster", *scenario.vehicles[0].model.materials}


def test_definitions_of_the_world_and_of_vehicles_win(tmp_path: Path) -> None:
    scenario = room(tmp_path, materials="materials: {concrete: {reflectivity: 0.7}}")
    materials = scenario.world.materials
    assert materials["concrete"].reflectivity == 0.7
    own = scenario.vehicles[0].model.materials
    assert "rubber" in own.keys() & library().keys()
    assert materials["rubber"] == own["rubber"] != library()["rubber"]


def test_an_unknown_material_is_named_with_the_nearest_of_the_library(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        room(tmp_path, floor="asfalt")
    assert str(caught.value) == (
        f"{tmp_path / 'test.yaml'}:5: `world.room.floor_material`: no material `asfalt` in "
        "world.materials; did you mean `asphalt`?"
    )


def test_objects_have_defaults_of_the_library() -> None:
    members = (Room, Door, Furniture, Clutter, OutdoorObject)
    known = set[type]()
    defaults = set[str]()
    for member in members:
        for struct in structs(msgspec.inspect.type_info(member), known):
            for field in struct.fields:
                if field.name.endswith("material") and not field.required:
                    defaults.add(field.default)
                if field.name == "materials":
                    defaults.update(field.default)
    assert {"linoleum", "roof_tiles", "cardboard"} <= defaults
    assert defaults - library().keys() == set()


@pytest.mark.parametrize("name", sorted(NAMES))
def test_what_is_shipped_does_not_depend_on_the_library(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """A correction of the library changes no hash of a shipped world or vehicle."""
    monkeypatch.setattr(material_library, "material_library", dict)
    scenario = load_partial(name)[1]
    assert {name for _, name in material_uses(scenario)} <= scenario.world.materials.keys()


def test_the_page_of_worlds_lists_the_library() -> None:
    page = (ROOT / "docs" / "reference" / "worlds.md").read_text(encoding="utf-8")
    section = page.partition("\n## Materials\n")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| ")]
    assert re.findall(r"`(\w+)`", "".join(rows)) == list(library())


def soft(folder: Path, soil: str) -> Scenario:
    return room(folder, materials=f"materials: {{dunes: {{soil: {soil}}}}}", floor="dunes")


def test_the_name_of_a_soil_means_its_parameters(tmp_path: Path) -> None:
    named = soft(tmp_path, "dry_sand")
    fields = material_library.soil_library()["dry_sand"]
    stated = soft(tmp_path, str(fields).replace("'", ""))
    assert named.world.materials["dunes"].soil == msgspec.convert(fields, Soil)
    assert named == stated
    assert world_hash(named) == world_hash(stated)


def test_an_unknown_soil_is_named_with_the_nearest_of_the_library(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError) as caught:
        soft(tmp_path, "dry_sant")
    assert str(caught.value) == (
        f"{tmp_path / 'test.yaml'}:4: `soil`: no soil `dry_sant`; did you mean `dry_sand`?"
    )


def test_a_soil_counts_in_the_hash_and_no_soil_does_not(tmp_path: Path) -> None:
    firm = room(tmp_path, materials="materials: {dunes: {}}", floor="dunes")
    assert "soil" not in msgspec.to_builtins(firm)["world"]["materials"]["dunes"]
    hashes = {world_hash(firm)}
    hashes |= {world_hash(soft(tmp_path, name)) for name in ("dry_sand", "lete_sand")}
    assert len(hashes) == 3


def test_the_page_of_worlds_lists_all_soils() -> None:
    page = (ROOT / "docs" / "reference" / "worlds.md").read_text(encoding="utf-8")
    section = page.partition("\n## Soils\n")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| ")]
    assert sorted(re.findall(r"`(\w+)`", "".join(rows))) == sorted(material_library.soil_library())


def test_a_definition_has_a_texture_and_a_color() -> None:
    for name, fields in msgspec.yaml.decode(material_library.FILE.read_bytes()).items():
        assert fields.keys() >= {"reflectivity", "friction", "color", "texture"}, name
    assert library().keys() >= {"concrete", "wood", "glass", "asphalt", "grass"}
