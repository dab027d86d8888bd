# SPDX-License-Identifier: Apache-2.0
"""States of all joints of a vehicle in one message, as ros2_control reads them.

`topic_based_ros2_control` keeps the newest message only, so that each has to hold every joint.
Wheels with encoders have the encoders' angles and speeds, with their errors; the other joints have
ideal sensors. Each message is returned as soon as the ground truth of its instant is known.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from groundlink.core.frames import Floats
from groundlink.messages.base import floats, packed
from groundlink.messages.navigation import JointState
from groundlink.scenario.schema import Vehicle

WAITING = 1024
"""Limit of readings that wait for the ground truth of their instant."""


class _TrueJoints(NamedTuple):
    """Ground truth of all wheels and joints at an instant."""

    nanos: int
    rows: Floats
    """Positions, velocities and efforts, shape (3, wheels and joints); NaN where unknown."""


class AllJoints:
    """States of the joints that take commands, and of the wheels that encoders count.

    Parameters
    ----------
    has_encoders
        whether messages are due with the readings of encoders instead of the ground truth.
    """

    def __init__(self, vehicle: Vehicle, *, has_encoders: bool) -> None:
        model, self._has_encoders = vehicle.model, has_encoders
        wheels = [wheel.name for wheel in model.wheels]
        self._places = {name: i for i, name in enumerate((*wheels, *vehicle.true_joints))}
        counted = model.counted if has_encoders else ()
        names = [joint.name for joint in model.joint_interfaces()]
        names += [wheels[i] for shaft in counted for i in shaft.wheels]
        self.names = tuple(dict.fromkeys(names))
        """Joints of every message, in its order."""

        self._tracks = {
            shaft.name: [(i, shaft.radius_m / model.wheels[i].radius_m) for i in shaft.wheels]
            for shaft in model.drive.shafts(model.wheels)
        }
        """Wheels of each shaft, with the turns of the wheel for one turn of the shaft."""

        self._needed = 2 if vehicle.true_joints else 1
        self.restart()

    def restart(self) -> None:
        """Reset the state."""
        self._parts: dict[int, dict[str, JointState]] = {}
        """Messages of ground truth by instant and role. They come in any order across roles, and
        those of two instants may be mixed."""

        self._truths: deque[_TrueJoints] = deque(maxlen=WAITING)
        self._readings: deque[tuple[int, JointState | None]] = deque(maxlen=WAITING)

    def receive(
        self, role: str, message: JointState, nanos: int
    ) -> Iterator[tuple[int, JointState]]:
        """Take a message of its instant; yield the messages that it completes, with instants.

        Parameters
        ----------
        role
            `encoders` for wheels' angles and speeds as measured, `wheels` or `joints` for the
            ground truth.
        """
        if role == "encoders":
            self._readings.append((nanos, message))
        else:
            self._add_truth(role, message, nanos)
        while self._readings and self._truths and self._truths[-1].nanos >= self._readings[0][0]:
            at, reading = self._readings.popleft()
            if self._truths[0].nanos <= at:
                stamp_nanos = at if reading is None else reading.stamp_nanos
                yield at, self._joined(stamp_nanos, self._true_rows(at), reading)

    def _add_truth(self, role: str, message: JointState, nanos: int) -> None:
        """Take a message of ground truth; keep that of its instant once all of it has come."""
        if self._truths and nanos < self._truths[-1].nanos:
            self.restart()  # Time jumped back, as in a replay that loops.
        parts = self._parts.setdefault(nanos, {})
        parts[role] = message
        if len(parts) < self._needed:
            return
        # What came of earlier instants stays incomplete: its other messages were lost.
        self._parts = {at: later for at, later in self._parts.items() if at > nanos}
        rows = np.full((3, len(self._places)), np.nan)
        for part in parts.values():
            places = [self._places[name] for name in part.names]
            for row, values in enumerate((part.positions, part.velocities, part.efforts)):
                if len(values):
                    rows[row, places] = floats(values)
        self._truths.append(_TrueJoints(nanos, rows))
        if not self._has_encoders:
            self._readings.append((nanos, None))

    def _true_rows(self, at: int) -> Floats:
        """Return the ground truth at an instant, with positions between two known ones."""
        while len(self._truths) > 1 and self._truths[1].nanos <= at:
            self._truths.popleft()
        before = self._truths[0]
        if before.nanos == at:
            return before.rows.copy()
        after = self._truths[1]
        rows = after.rows.copy()
        fraction = (at - before.nanos) / (after.nanos - before.nanos)
        rows[0] = before.rows[0] + fraction * (after.rows[0] - before.rows[0])
        return rows

    def _joined(self, stamp_nanos: int, rows: Floats, reading: JointState | None) -> JointState:
        """Return the state of all joints: as measured where there is a reading, else as true."""
        if reading is not None:
            places = [self._places[name] for name in reading.names]
            rows[0, places], rows[1, places] = floats(reading.positions), floats(reading.velocities)
        columns = np.array([self._column(name, rows) for name in self.names])
        positions, velocities, efforts = map(packed, columns.T)
        return JointState(stamp_nanos, "", self.names, positions, velocities, efforts)

    def _column(self, name: str, rows: Floats) -> Floats:
        """Return position, velocity and effort of a joint."""
        if (place := self._places.get(name)) is not None:
            column: Floats = rows[:, place]
            return column
        wheels, ratios = map(list, zip(*self._tracks[name], strict=True))
        position, velocity = rows[:2, wheels[0]] / ratios[0]
        return np.array([position, velocity, rows[2, wheels] @ ratios])
