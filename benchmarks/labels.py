# SPDX-License-Identifier: Apache-2.0
"""Cost of labels of a camera and of a LiDAR: `python -m benchmarks.labels`.

The sensors of the laboratory's rover drive a curve: its camera of 640 x 480 without labels, with
each form alone and with all of them, and its LiDAR without and with labels. The models take turns,
each in a process of its own. Each line has the processor time in milliseconds that a picture or a
revolution takes with its messages: summed over all threads, the median of the readings.
"""

import multiprocessing
import sys
import time
from multiprocessing.connection import Connection

import numpy as np
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from services.sensors.camera.model import CameraModel
from services.sensors.camera.spec import Camera
from services.sensors.lidar.model import LidarModel
from services.sensors.lidar.spec import Lidar

from .lidar.driving import states

READINGS, WARM_UP = 24, 4
FORMS: dict[str, tuple[str, ...]] = {
    "camera": (),
    "camera, segmentation": ("segmentation",),
    "camera, boxes_2d": ("boxes_2d",),
    "camera, all labels": ("segmentation", "boxes_2d", "boxes_3d"),
    "lidar": (),
    "lidar, all labels": ("points", "boxes_3d"),
}
"""Labels of each measured sensor."""


def measure(what: str, pipe: Connection) -> None:
    """Make a reading for each message of the pipe; reply with its processor time."""
    name = what.partition(",")[0]
    scenario = load(SHIPPED / "indoor_lab.yaml")
    vehicle, spec = scenario.sensor(f"rover/{name}") or (None, None)
    assert vehicle is not None
    model: CameraModel | LidarModel
    if isinstance(spec, Camera):
        model = CameraModel(scenario, vehicle, replace(spec, labels=FORMS[what]))
    else:
        assert isinstance(spec, Lidar)
        model = LidarModel(scenario, vehicle, replace(spec, labels=FORMS[what]))
    run = states(scenario)
    while pipe.recv():
        spent_s, made = 0.0, False
        while not made:
            state = next(run)
            since = time.process_time()
            made = bool(list(model.readings(state)))
            spent_s += time.process_time() - since
        pipe.send(1e3 * spent_s)


def main() -> int:
    """Measure and print."""
    context = multiprocessing.get_context("spawn")
    pipes: dict[str, Connection] = {}
    for what in FORMS:
        pipes[what], there = context.Pipe()
        context.Process(target=measure, args=(what, there), daemon=True).start()
        there.close()  # so that the end of the process is noticed
    spent: dict[str, list[float]] = {what: [] for what in FORMS}
    for _ in range(READINGS + WARM_UP):
        for what, pipe in pipes.items():
            pipe.send(True)
            spent[what].append(pipe.recv())
    for pipe in pipes.values():
        pipe.send(False)
    for what, times_ms in spent.items():
        print(f"{what:24} {np.median(times_ms[WARM_UP:]):6.1f} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())
