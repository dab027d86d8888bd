# SPDX-License-Identifier: Apache-2.0
"""Vehicles made by others: a URDF file becomes the plain data of a vehicle's model.

Rule: a URDF is read once, at load; behind it there is one kind of vehicle only.
"""

from .model import expand, refuse_bare_urdf

__all__ = ["expand", "refuse_bare_urdf"]
