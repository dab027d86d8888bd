# SPDX-License-Identifier: Apache-2.0
"""Section 6.3 of the paper: a decontamination robot in a room, by laser scans and by a camera.

Rule: `indoor_paper` as it is shipped, for two laps of its six. What an experiment changes of it
stands in its setup.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from groundlink.errors import UserError

from . import environments, figures
from .evaluation import Result
from .experiment import Options, Way, judged, lost
from .programs import YAG_SLAM
from .recordings import Recording, record
from .setups import Setup

SECONDS = 115.0
"""Two laps."""

SHORT_SECONDS = 20.0


def _record(options: Options, seed: int, name: str, sensors: Mapping[str, Any]) -> Recording:
    """Return a recording of the robot's drive; nothing may be missing in it."""
    recording = record(
        Setup(
            name=name,
            scenario="indoor_paper",
            seconds=SHORT_SECONDS if options.short else SECONDS,
            seed=seed,
            sensors=sensors,
        ),
        options.out,
        options.say,
    )
    if words := lost(recording.accounts):
        raise UserError(f"{name}, seed {seed}: not all came to the bag: {words}")
    return recording


def scans(options: Options) -> Sequence[Result]:
    """2D graph SLAM with loop closure on scans and odometry; odometry alone to compare."""
    results = []
    for seed in options.seeds:
        recording = _record(options, seed, "indoor_scans", {"camera": None})
        ways = []
        folder = options.folder("runs", recording.folder.name)
        for case, more in {"": [], "odometry alone": ["--odometry-alone"]}.items():
            tum = folder / (f"yag_slam{'_odometry' if more else ''}.tum")
            began_s = time.monotonic()
            environments.run(
                YAG_SLAM,
                [recording.bag, tum, *more],
                options.out,
                options.say,
                label=f"indoor_scans, seed {seed}",
                log=tum.with_suffix(".log"),
            )
            result, way = judged(
                options,
                recording,
                tum,
                frame="scan_link",
                seed=seed,
                experiment="indoor_scans",
                program=YAG_SLAM.name,
                case=case,
                took_s=time.monotonic() - began_s,
                limit_m=0.0 if more else 0.02,
            )
            results.append(result)
            ways.append(way)
        if seed == options.seeds[0]:
            _draw(options, "indoor_scans", recording, ways)
            figures.map_beside_plan(
                options.folder("figures") / "indoor_map.png",
                recording.scenario,
                folder / "yag_slam.yaml",
                ways[0],
            )
    return results


def _draw(options: Options, name: str, recording: Recording, ways: Sequence[Way]) -> Path:
    file = options.folder("figures") / f"{name}.png"
    figures.trajectories(file, recording.scenario, ways)
    return file
