# SPDX-License-Identifier: Apache-2.0
"""Groundlink, a real-time test rig for unmanned ground vehicles.

`open` reads a recorded run, `run` starts one that a program steps. The packages below are what the
processes of a run share: topics, messages, bus, time, scenario, world.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from groundlink.core import VERSION as __version__

if TYPE_CHECKING:
    from pathlib import Path

    from groundlink.data.dataset import Dataset
    from groundlink.sim.sim_time import Mode
    from groundlink.sim.stepped_run import SteppedRun


__all__ = ["__version__", "open", "run"]


def open(path: str | Path) -> Dataset:
    """Open a recorded run, a file of `groundlink record`, for reading as arrays.

    Raises
    ------
    groundlink.core.errors.UserError
        when the file is missing or no recording of a run.
    """
    from groundlink.data.dataset import Dataset  # no process of a run needs it

    return Dataset(path)


def run(
    scenario: str | Path,
    *,
    mode: Mode = "fast",
    sensors_together: bool = False,
    record: str | Path | None = None,
    name: str | None = None,
) -> SteppedRun:
    """Start a run that a program steps; see `groundlink.sim.stepped_run.SteppedRun`."""
    from groundlink.sim.stepped_run import SteppedRun

    return SteppedRun(
        scenario, mode=mode, sensors_together=sensors_together, record=record, name=name
    )
