# SPDX-License-Identifier: Apache-2.0
"""Key figures of a run: what a sweep tables of each.

Each is a name with its unit and a number, in the terms of the report's page.
"""

from pathlib import Path

import numpy as np

from groundlink.recording.reader import Recording

from .completeness import IN_TRANSIT
from .gather import RunSummary, gather
from .sensors import EstimatedTrajectory


def key_figures_of(recording: Path) -> dict[str, float]:
    """Return the figures of a recorded run by name.

    Raises
    ------
    UserError
        when the recording cannot be read.
    """
    with Recording(recording) as opened:
        return key_figures(gather(opened, lambda share: None))


def key_figures(run: RunSummary) -> dict[str, float]:
    """Return the figures by name, such as `driven m`."""
    figures: dict[str, float] = {}
    missions = {mission.vehicle: mission for mission in run.missions}
    for motion, energy in zip(run.motions, run.energies, strict=True):
        whose = f"{motion.vehicle} " if len(run.motions) > 1 else ""
        figures[f"{whose}driven m"] = motion.distance_m
        figures[f"{whose}top speed m/s"] = motion.top_speed_mps
        if energy.last is not None:
            figures[f"{whose}motor work J"] = energy.last.motor_work_j
        if mission := missions.get(motion.vehicle):
            figures[f"{whose}stuck s"] = mission.stuck_seconds
            if mission.route_share is not None:
                figures[f"{whose}route %"] = 100 * mission.route_share
        figures[f"{whose}contacts"] = len(energy.events) + energy.further_events
        truth = motion.track()
        for reading in run.readings[motion.vehicle]:
            if isinstance(reading, EstimatedTrajectory) and reading.rows and len(truth):
                error_m = reading.beside(truth)[:, 3]
                figures[f"{reading.topic} error RMS m"] = float(np.sqrt(np.mean(error_m**2)))
                figures[f"{reading.topic} error max m"] = float(error_m.max())
    for result in run.expectations:
        if result.value is not None:
            figures[f"{result.name} {result.unit}"] = result.value
    for stream in run.completeness:
        missing = stream.missing()
        del missing[IN_TRANSIT]
        figures[f"{stream.topic} missing"] = missing.total()
    sensors = {stream.topic for stream in run.completeness}
    for times in run.streams:
        if times.topic in sensors and times.messages:
            figures[f"{times.topic} kB/message"] = times.bytes / times.messages / 1e3
    return figures
