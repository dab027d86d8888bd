# SPDX-License-Identifier: Apache-2.0
"""Loader: reads scenario files, data sheets and URDF, checks them and resolves every reference.

Imported by the command line and by physics alone; other processes get a resolved scenario.
"""

from .document import ScenarioError
from .scenario_files import load

__all__ = ["ScenarioError", "load"]
