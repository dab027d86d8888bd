# SPDX-License-Identifier: Apache-2.0
"""Libraries of materials and soils: definitions of names that a scenario uses and does not define.

Only materials that a scenario uses are added to it. A scenario that defines all of its materials
keeps its hash, and a resolved scenario does not depend on the libraries.
"""

from functools import cache
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from groundlink.core.errors import did_you_mean
from groundlink.scenario.schema import Scenario
from groundlink.scene.build import material_uses
from groundlink.world.solids import Material

from .document import DataPath, Document, ScenarioError, read

FILE = (Path(__file__).parents[1] / "shipped" / "materials" / "library.yaml").resolve()

SOILS = FILE.with_name("soils.yaml")


@cache
def material_library() -> dict[str, Material]:
    """Return the materials of the library by name."""
    return msgspec.convert(read(FILE).value, dict[str, Material])


def with_library_materials(scenario: Scenario) -> Scenario:
    """Return the scenario with the library's definitions of undefined materials that it uses."""
    world = scenario.world
    undefined = {name for _, name in material_uses(scenario)} - world.materials.keys()
    if not undefined:
        return scenario
    library = material_library()
    added = {name: library[name] for name in sorted(undefined & library.keys())}
    return replace(scenario, world=replace(world, materials=world.materials | added))


@cache
def soil_library() -> dict[str, dict[str, Any]]:
    """Return the soils of the library by name, as in a file."""
    soils: dict[str, dict[str, Any]] = read(SOILS).value
    return soils


def define_soils(document: Document) -> None:
    """Replace the names of soils in all materials by their definitions.

    Raises
    ------
    ScenarioError
        when the library has no such soil.
    """
    vehicles = document.at(("vehicles",))
    places: list[DataPath] = [("world", "materials")]
    if isinstance(vehicles, list):
        places += [("vehicles", v, "model", "materials") for v in range(len(vehicles))]
    for here in places:
        materials = document.at(here)
        for name in materials if isinstance(materials, dict) else ():
            path = (*here, name, "soil")
            if not isinstance(soil := document.at(path), str):
                continue
            mark = document.mark(path)
            if soil not in soil_library():
                raise ScenarioError(
                    f"{mark}: `soil`: no soil `{soil}`; {did_you_mean(soil, soil_library())}"
                )
            document.put(path, Document(dict(soil_library()[soil]), {(): mark}))
