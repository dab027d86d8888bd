# SPDX-License-Identifier: Apache-2.0
"""URDF import: turns a URDF file into the plain data of a vehicle's model.

Imported by the scenario loader. A URDF is read once, at load; never at run time.
"""

from .model import expand, refuse_bare_urdf

__all__ = ["expand", "refuse_bare_urdf"]
