# SPDX-License-Identifier: Apache-2.0
"""Vocabulary of ORB-SLAM3, trained from pictures of other scenes.

Training and test scenes differ: indoor studies use pictures of the hamlet, outdoor studies those of
the room. A vocabulary is trained once for each recording.
"""

from pathlib import Path

from experiments.experiment import ExperimentOptions
from experiments.recording.recordings import record
from experiments.recording.setups import Setup

from . import environments
from .programs import ORB_SLAM3

OUTDOORS = Setup(
    name="vocabulary_hamlet",
    scenario="outdoor_paper",
    seconds=40.0,
    sensors={"lidar": None, "gnss": None, "camera": {"rate_hz": 5.0}},
)
INDOORS = Setup(
    name="vocabulary_room",
    scenario="indoor_paper",
    seconds=60.0,
    sensors={"scanner": None, "camera": {"rate_hz": 4.0}},
)


def vocabulary(options: ExperimentOptions, scenes: Setup) -> Path:
    """Return the file of a vocabulary; it is trained where there is none yet."""
    recording = record(scenes, options.out, options.console)
    file = recording.folder / "vocabulary.txt"
    if not file.exists():
        printed = environments.run(
            ORB_SLAM3,
            [recording.bag, part := file.with_suffix(".part")],
            options.out,
            options.console,
            label=scenes.name,
            log=file.with_suffix(".log"),
            script="train_vocabulary.py",
        )
        part.rename(file)
        options.console.print(f"{scenes.name}: {printed.strip().splitlines()[-1]}")
    return file
