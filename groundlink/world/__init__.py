# SPDX-License-Identifier: Apache-2.0
"""The world that physics and every sensor replicate: solids, how they are built, and their hash."""

from .solids import Box, Cylinder, Material, Mesh, Shape, Solid, Sphere

__all__ = ["Box", "Cylinder", "Material", "Mesh", "Shape", "Solid", "Sphere"]
