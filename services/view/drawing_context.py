# SPDX-License-Identifier: Apache-2.0
"""What the drawing of one message may know: the recording, the vehicles' past, the frames.

Rule: knows Rerun and no message but poses of the truth. Frames have their ROS names; what comes
from a vehicle's stack is in a frame of its own, which is laid on the truth at the first pose of the
stack: from there on the two may differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.core.frames import Floats, transform
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.sensors import RotatingLidar, SensorSpec

from .colors import Coloring
from .plots import TIMELINE, Plots
from .point_placement import PoseHistory

WORLD = "world"

MOST_POINTS = 2000
"""Of a trajectory; beyond it every second point goes, and the next ones come half as densely."""

AHEAD_NANOS = 60 * NANOS
"""Farther ahead of the newest state is no stamp of the run's clock."""

LEAST_STEP_M = 0.03
"""Between two points of a trajectory, at first."""


class Trail:
    """A line that grows: where something was, as densely as a bounded number of points allows."""

    def __init__(self, least_step: float = LEAST_STEP_M) -> None:
        self._step = least_step
        self.points: list[tuple[float, ...]] = []

    def add(self, point: Sequence[float]) -> bool:
        """Take a point; return whether it is far enough from the last one to be kept."""
        if self.points and np.linalg.norm(np.subtract(point, self.points[-1])) < self._step:
            return False
        self.points.append(tuple(point))
        if len(self.points) > MOST_POINTS:
            del self.points[1::2]
            self._step *= 2
        return True


@dataclass
class VehicleHistory:
    """What was history of a vehicle."""

    spec: Vehicle
    base: PoseHistory = field(default_factory=PoseHistory)
    trail: Trail = field(default_factory=Trail)
    """Of the truth."""

    world_from_stack: Floats | None = None
    """Where the frame of the vehicle's own stack was laid; None before its first pose."""

    @property
    def base_frame(self) -> str:
        """The ROS name of the base frame."""
        return self.spec.frame_prefix + self.spec.model.base_frame

    @property
    def stack_frame(self) -> str:
        """The viewer's name of the frame in which the vehicle's stack tells poses."""
        return f"{self.spec.name}/from_ros"

    def sensor(self, path: str) -> SensorSpec | None:
        """Return the sensor whose messages are drawn at an entity."""
        of_sensor = path.removesuffix("/truth")
        return next((s for s in self.spec.sensors if of_sensor.endswith(f"/{s.name}")), None)

    def base_from(self, frame: str) -> Floats | None:
        """Return base_from_frame, shape (4, 4), of a sensor's frame; None for an unknown one."""
        prefix = self.spec.frame_prefix
        if frame == self.base_frame:
            return np.eye(4)
        for sensor in self.spec.sensors:
            if sensor.mounted and prefix + sensor.frame == frame:
                turn = sensor.mount.quaternion(optical=sensor.optical)
                return transform(sensor.mount.xyz_m, turn)
        return None


class DrawingContext:
    """A recording with what is needed to draw on it."""

    def __init__(
        self, recording: rr.RecordingStream, scenario: Scenario, coloring: Coloring
    ) -> None:
        self.recording = recording
        self.scenario = scenario
        self.coloring = coloring
        self.plots = Plots(recording)
        self.vehicles = {v.name: VehicleHistory(v) for v in scenario.vehicles}
        self.epoch_nanos: int | None = None
        """None before the first state."""

        self.now_nanos = 0
        """Sim time of the newest state."""

        self.not_drawn = 0
        """Messages whose place is not known, or whose format cannot be drawn."""

        self.trails: dict[str, Trail] = {}
        """Of what is told by messages, by entity."""

        self._blocks: dict[str, list[tuple[NDArray[Any], ...]]] = {}
        """Parts of LiDAR revolutions that wait for the others, by entity."""

        self.last: dict[str, object] = {}
        """The message before, by entity, for those that are drawn as differences."""

        self._framed: dict[str, str] = {}

    def sim_nanos(self, stamp_nanos: int) -> int:
        """Return the sim time of a stamp, or now where the stamp is of another clock.

        ROS nodes without `use_sim_time` have their own, and some stamp nothing at all: drawn there,
        one map would stretch the time line by decades.
        """
        assert self.epoch_nanos is not None
        at_nanos = stamp_nanos - self.epoch_nanos
        return at_nanos if 0 <= at_nanos <= self.now_nanos + AHEAD_NANOS else self.now_nanos

    def log(self, path: str, stamp_nanos: int, drawn: rr.AsComponents) -> None:
        """Log something at an instant."""
        now = np.timedelta64(self.sim_nanos(stamp_nanos), "ns")
        self.recording.set_time(TIMELINE, duration=now)
        self.recording.log(path, drawn)

    def revolution(
        self, history: VehicleHistory, path: str, *part: NDArray[Any]
    ) -> list[NDArray[Any]] | None:
        """Take arrays of a block of a LiDAR's revolution; with its last block return all of it."""
        parts = self._blocks.setdefault(path, [])
        parts.append(part)
        spec = history.sensor(path)
        if isinstance(spec, RotatingLidar) and len(parts) < spec.blocks_per_revolution:
            return None
        del self._blocks[path]
        return [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]

    def in_frame(self, path: str, frame: str) -> None:
        """Say once in which frame an entity is drawn."""
        if self._framed.get(path) != frame:
            self._framed[path] = frame
            self.recording.log(path, rr.CoordinateFrame(frame), static=True)

    def move(self, child: str, parent: str, pose: Sequence[float], stamp_nanos: int) -> None:
        """Say where a frame is: parent_from_child as x, y, z, qx, qy, qz, qw."""
        self.log(f"tf/{child}", stamp_nanos, _transform(child, parent, pose))

    def fix(self, child: str, parent: str, pose: Sequence[float]) -> None:
        """Say where a frame always is."""
        self.recording.log(f"tf/{child}", _transform(child, parent, pose), static=True)


def _transform(child: str, parent: str, pose: Sequence[float]) -> rr.Transform3D:
    return rr.Transform3D(
        translation=pose[:3],
        quaternion=rr.Quaternion(xyzw=pose[3:]),
        parent_frame=parent,
        child_frame=child,
    )
