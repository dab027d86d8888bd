# SPDX-License-Identifier: Apache-2.0
"""Merge of the materials of vehicles into those of the world.

A material of the world takes precedence. Two vehicles may share a name only for the same material.
"""

from .document import DataPath, Document, ScenarioError


def merge_materials(document: Document) -> None:
    """Add the materials of all vehicles to those of the world.

    Raises
    ------
    ScenarioError
        when two vehicles define a material differently.
    """
    world: DataPath = ("world", "materials")
    listed, vehicles = document.at(world), document.at(("vehicles",))
    if not isinstance(listed, dict) or not isinstance(vehicles, list):
        return
    added: dict[str, DataPath] = {}
    for v in range(len(vehicles)):
        path: DataPath = ("vehicles", v, "model", "materials")
        own = document.at(path)
        for name, material in own.items() if isinstance(own, dict) else ():
            here = (*path, name)
            if name not in listed:
                marks = {p[len(here) :]: m for p, m in document.marks.items() if p[:5] == here}
                document.put((*world, name), Document(material, marks))
                added[name] = here
            elif name in added and document.at(added[name]) != material:
                raise ScenarioError(
                    f"{document.mark(here)}: another `{name}` is defined by the vehicle at "
                    f"{document.mark(added[name])}; rename one, or list `{name}` in the "
                    "world's materials, which then counts for both"
                )
