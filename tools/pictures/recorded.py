# SPDX-License-Identifier: Apache-2.0
"""A recorded drive as a moving picture needs it: poses of links, points, camera pictures."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import groundlink
from groundlink.core.clock import NANOS
from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.messages.base import State, floats
from groundlink.recording.playback import Playback
from groundlink.recording.reader import Recording
from groundlink.scenario import Scenario
from services.view.reconstructed_states import ReceivedMessage, StateReconstructor
from services.view.viewer_subscriptions import streams_of

Pixels = NDArray[np.uint8]

TRUTH = ("clock", "bodies", "ground_truth", "ground_truth/wheels", "ground_truth/joints")
"""Streams that states are made from, without the vehicle."""


def record(scenario: str, seconds: float, folder: Path) -> Path:
    """Record a drive, unless the folder has it already; return the file."""
    file = folder / f"{scenario}_{seconds:g}.mcap"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        command = ["record", scenario, "--out", str(file), "--duration", f"{seconds:g}"]
        subprocess.run([sys.executable, "-m", "groundlink", *command], check=True)
    return file


class RecordedDrive:
    """The drive of the first vehicle of a recording.

    Times are sim times in seconds.
    """

    def __init__(self, file: Path) -> None:
        self.run = groundlink.open(file)
        self.scenario: Scenario = self.run.scenario
        self.vehicle = self.scenario.vehicles[0]
        self._states = _states(file)
        self._at = np.array([state.sim_nanos for state in self._states]) / NANOS
        self.base = self.run.truth()
        """world_from_base over time, in seconds from the epoch."""

    def links(self, at_s: float) -> Floats:
        """Return world_from_link of all vehicles and actors at the nearest state, shape (N, 7)."""
        state = self._states[int(np.abs(self._at - at_s).argmin())]
        rows = [state.vehicles[vehicle.name].poses() for vehicle in self.scenario.vehicles]
        return np.concatenate([*rows, floats(state.actors).reshape(-1, 7)])

    def base_at(self, at_s: NDArray[np.float64]) -> Floats:
        """Return positions of the base, shape (N, 3); times outside of the drive get its ends."""
        since = self.base.seconds - self.run.start_nanos / NANOS
        columns = [np.interp(at_s, since, axis) for axis in self.base.positions_m.T]
        return np.stack(columns, axis=-1)

    def speed_mps(self, at_s: float) -> float:
        """Return the true speed."""
        before, after = self.base_at(np.array([at_s - 0.1, at_s + 0.1]))
        return float(np.linalg.norm(after - before)) / 0.2

    def points(self, topic: str, from_s: float, to_s: float) -> Floats:
        """Return the points of clouds with stamps in a span, in the world, shape (N, 3)."""
        found = [np.empty((0, 3))]
        frame = self.run.sensor_frame(topic)
        assert frame is not None
        for stamp, cloud in self.run.contents(topic, start_s=max(0.0, from_s), end_s=to_s):
            seconds = stamp / NANOS + cloud["time"].astype(float)
            sensor = self.run.truth(*frame).at(seconds)
            if len(sensor.seconds) != len(seconds):
                continue  # the drive ends before this cloud
            turns = matrix_from_quaternion(sensor.orientations)
            in_sensor = np.column_stack([cloud[axis] for axis in "xyz"]).astype(float)
            found.append(np.einsum("nij,nj->ni", turns, in_sensor) + sensor.positions_m)
        return np.concatenate(found)

    def image(self, topic: str, at_s: float, period_s: float) -> Pixels | None:
        """Return the newest picture of a camera, red, green, blue; None before the first."""
        newest = None
        images = self.run.messages(topic, start_s=max(0.0, at_s - period_s), end_s=at_s)
        for _, message in images:
            newest = message
        if newest is None:
            return None
        decoded = cv2.imdecode(np.asarray(newest.data), cv2.IMREAD_COLOR)
        assert decoded is not None
        return np.asarray(decoded[..., ::-1], np.uint8)


def _states(file: Path) -> list[State]:
    """Return the states of a recording, made from its ground truth."""
    found: list[State] = []
    with Recording(file) as recording:
        run, scenario = recording.run.run, recording.run.scenario
        streams = {
            path: stream
            for path, stream in streams_of(scenario, run).items()
            if path in TRUTH or path.partition("/")[2] in TRUTH
        }
        paths = {stream.key: path for path, stream in streams.items()}
        truth = StateReconstructor(scenario, run)
        for each in Playback(recording, streams.values()).play(recording.first_nanos):
            path = paths[each.key]
            found += truth.follow([ReceivedMessage(path, streams[path], each.message)])[0]
    return found
