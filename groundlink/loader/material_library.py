# SPDX-License-Identifier: Apache-2.0
"""Library of materials: definitions of names that neither the world nor a vehicle defines.

Only materials that a scenario uses are added to it. A scenario that defines all of its materials
keeps its hash, and a resolved scenario does not depend on the library.
"""

from functools import cache
from pathlib import Path

import msgspec
from msgspec.structs import replace

from groundlink.scenario.schema import Scenario
from groundlink.scene.build import material_uses
from groundlink.world.solids import Material

from .document import read

FILE = (Path(__file__).parents[1] / "shipped" / "materials" / "library.yaml").resolve()


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
