# SPDX-License-Identifier: Apache-2.0
"""Meshes of standing water: its surface alone, which is as opaque as its material."""

import numpy as np

from groundlink.world.cover import WaterArea
from groundlink.world.solids import Material
from groundlink.world.terrain import Ground
from groundlink.world.triangles import of_water

from .mesh import VERTEX, Skin, SkinnedMesh
from .textures import period_m, texture


def surface(area: WaterArea, ground: Ground, material: Material, label: int) -> SkinnedMesh:
    """Return the surface of water as far as there is terrain, in the world's frame."""
    sheet = of_water(area, ground, label=label)
    vertices = np.zeros(len(sheet.vertices), VERTEX)
    vertices["position"] = sheet.vertices
    vertices["normal"] = 0.0, 0.0, 1.0
    vertices["uv"] = sheet.vertices[:, :2] / period_m(material)
    vertices["tint"] = material.color
    vertices["label"] = label
    return SkinnedMesh(vertices, sheet.faces, Skin(texture(material.texture)))
