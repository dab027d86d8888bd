# SPDX-License-Identifier: Apache-2.0
"""Library `osc.groundlink` of scenario-execution: OpenSCENARIO files that drive a stepped run.

scenario-execution finds library and actions through entry points and steps `GroundlinkSimulation`.
Needs the extra `osc`. Nothing of Groundlink imports this package.
"""

from groundlink.core.extras import needs

with needs("osc"):
    import scenario_execution as _  # noqa: F401

from .simulation import GroundlinkSimulation

__all__ = ["GroundlinkSimulation", "library"]


def library() -> tuple[str, str]:
    """Return the package with the library's file, and the file's name."""
    return __name__, "groundlink.osc"
