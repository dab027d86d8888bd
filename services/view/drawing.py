# SPDX-License-Identifier: Apache-2.0
"""What the functions that draw messages share: the Rerun recording, pose histories and frames.

Frames have their ROS names. Poses from a vehicle's own stack are in a frame of their own. It is
aligned with the ground truth at the first pose of the stack; from then on the two may differ.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.core.frames import Floats, transform
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.scenario.schema import Vehicle

from .colors import Coloring
from .plots import TIMELINE, Plots
from .point_placement import PoseHistory

WORLD = "world"

MOST_POINTS = 2000
"""Points of a trajectory; beyond it every second point is removed and the spacing doubles."""

AHEAD_NANOS = 60 * NANOS
"""Later stamps are assumed to come from another clock."""

LEAST_STEP_M = 0.03
"""Initial distance between two points of a trajectory."""


class Trail:
    """A trajectory with a bounded number of points."""

    def __init__(self, least_step: float = LEAST_STEP_M) -> None:
        self._step = least_step
        self.points: list[tuple[float, ...]] = []

    def add(self, point: Sequence[float]) -> bool:
        """Add a point if it is far enough from the last one; return whether it was added."""
        if self.points and np.linalg.norm(np.subtract(point, self.points[-1])) < self._step:
            return False
        self.points.append(tuple(point))
        if len(self.points) > MOST_POINTS:
            del self.points[1::2]
            self._step *= 2
        return True


@dataclass
class Track:
    """Poses and frames of a vehicle."""

    spec: Vehicle
    links: dict[int, PoseHistory] = field(init=False)
    """Poses of the links that carry sensors, and of the base, by their places in the model."""

    trail: Trail = field(default_factory=Trail)
    """The true trajectory."""

    world_from_stack: Floats | None = None
    """Pose of the stack's frame; None before the first pose of the stack."""

    def __post_init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Forget all poses."""
        places = {0, *(self.spec.model.link_of(sensor.mount) for sensor in self.spec.sensors)}
        self.links = {place: PoseHistory() for place in sorted(places)}

    def take(self, stamp_nanos: int, poses: Floats) -> None:
        """Take the poses of all links at the next tick, shape (links, 7)."""
        for place, history in self.links.items():
            history.add(stamp_nanos, poses[place])

    @property
    def base_frame(self) -> str:
        """The ROS name of the base frame."""
        return self.spec.frame_prefix + self.spec.model.base_frame

    @property
    def stack_frame(self) -> str:
        """Name in the viewer of the frame of the stack's poses."""
        return f"{self.spec.name}/from_ros"

    def sensor(self, path: str) -> SensorSpec | None:
        """Return the sensor of an entity."""
        of_sensor = path.removesuffix("/truth").removesuffix("/labeled_points")
        return next((s for s in self.spec.sensors if of_sensor.endswith(f"/{s.name}")), None)

    def link_from(self, frame: str) -> tuple[int, Floats] | None:
        """Return the place of a link and link_from_frame, shape (4, 4), of a sensor's frame.

        None for an unknown frame.
        """
        prefix = self.spec.frame_prefix
        if frame == self.base_frame:
            return 0, np.eye(4)
        for sensor in self.spec.sensors:
            if sensor.mounted and prefix + sensor.frame == frame:
                turn = sensor.mount.quaternion(optical=sensor.optical)
                place = self.spec.model.link_of(sensor.mount)
                return place, transform(sensor.mount.xyz_m, turn)
        return None


class Drawing:
    """A Rerun recording with the state that drawing functions need."""

    def __init__(
        self, recording: rr.RecordingStream, scenario: Scenario, coloring: Coloring
    ) -> None:
        self.recording = recording
        self.scenario = scenario
        self.coloring = coloring
        self.plots = Plots(recording)
        self.vehicles = {v.name: Track(v) for v in scenario.vehicles}
        self.epoch_nanos: int | None = None
        """None before the first state."""

        self.now_nanos = 0
        """Sim time of the newest state."""

        self.not_drawn = 0
        """Messages with an unknown pose or a format that cannot be drawn."""

        self.trails: dict[str, Trail] = {}
        """Trajectories from messages, by entity."""

        self._blocks: dict[str, list[tuple[NDArray[Any], ...]]] = {}
        """Parts of LiDAR revolutions that wait for the others, by entity."""

        self.last: dict[str, object] = {}
        """Last message, by entity, for those that are drawn as differences."""

        self._framed: dict[str, str] = {}

    def sim_nanos(self, stamp_nanos: int) -> int:
        """Return the simulation time of a stamp, or now if the stamp is of another clock.

        ROS nodes without `use_sim_time` use the wall clock, and some set no stamps. Drawn at such a
        time, one map would stretch the time line by decades.
        """
        assert self.epoch_nanos is not None
        at_nanos = stamp_nanos - self.epoch_nanos
        return at_nanos if 0 <= at_nanos <= self.now_nanos + AHEAD_NANOS else self.now_nanos

    def log(self, path: str, stamp_nanos: int, drawn: rr.AsComponents) -> None:
        """Log something at an instant."""
        now = np.timedelta64(self.sim_nanos(stamp_nanos), "ns")
        self.recording.set_time(TIMELINE, duration=now)
        self.recording.log(path, drawn)

    def revolution(self, track: Track, path: str, *part: NDArray[Any]) -> list[NDArray[Any]] | None:
        """Take arrays of a block of a revolution; with its last block return the revolution."""
        parts = self._blocks.setdefault(path, [])
        parts.append(part)
        spec = track.sensor(path)
        if isinstance(spec, RotatingLidar) and len(parts) < spec.blocks_per_revolution:
            return None
        del self._blocks[path]
        return [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]

    def in_frame(self, path: str, frame: str) -> None:
        """Set the frame of an entity, if it has changed."""
        if self._framed.get(path) != frame:
            self._framed[path] = frame
            self.recording.log(path, rr.CoordinateFrame(frame), static=True)

    def move(self, child: str, parent: str, pose: Sequence[float], stamp_nanos: int) -> None:
        """Set the pose of a frame: parent_from_child as x, y, z, qx, qy, qz, qw."""
        self.log(f"tf/{child}", stamp_nanos, _transform(child, parent, pose))

    def fix(self, child: str, parent: str, pose: Sequence[float]) -> None:
        """Set the static pose of a frame."""
        self.recording.log(f"tf/{child}", _transform(child, parent, pose), static=True)


def _transform(child: str, parent: str, pose: Sequence[float]) -> rr.Transform3D:
    return rr.Transform3D(
        translation=pose[:3],
        quaternion=rr.Quaternion(xyzw=pose[3:]),
        parent_frame=parent,
        child_frame=child,
    )
