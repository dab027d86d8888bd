# SPDX-License-Identifier: Apache-2.0
"""Actions of `osc.groundlink` that take sim time: drive, and wait for a distance."""

from collections.abc import Mapping
from math import atan2, cos, dist, hypot, remainder, tau

from py_trees.common import Status

from groundlink.core.quaternions import heading_rad

from .actions import EntityAction, OscActor

TURN_GAIN_PER_S = 2.0
"""Turn rate of `drive_to` for each radian between the heading and the place."""

MAX_TURN_RADPS = 1.0
SLOWEST_SHARE = 0.2
"""Share of the speed of `drive_to` while the place is beside or behind the vehicle."""


class DrivingAction(EntityAction):
    """An action that commands a vehicle until it ends or is abandoned."""

    def request_cancel(self) -> bool:
        """Stop the vehicle if the action is under way."""
        if self.status == Status.RUNNING:
            self.simulation.command(self.entity, 0.0, 0.0)
        return True

    def arrived(self) -> Status:
        """Stop the vehicle, and succeed."""
        self.simulation.command(self.entity, 0.0, 0.0)
        return Status.SUCCESS


class DriveFor(DrivingAction):
    """Drives with a constant velocity for some time."""

    def execute(
        self, associated_actor: OscActor, speed: float, turn_rate: float, duration: float
    ) -> None:
        """Take the arguments of `vehicle.drive`."""
        self.velocity = speed, turn_rate
        self.end_s = self.clock.now() + duration

    def tick_action(self) -> Status:
        """Command the velocity, or stop."""
        if self.clock.now() >= self.end_s:
            return self.arrived()
        self.simulation.command(self.entity, *self.velocity)
        return Status.RUNNING


class DriveTo(DrivingAction):
    """Drives to a place."""

    def execute(
        self,
        associated_actor: OscActor,
        position: Mapping[str, float],
        speed: float,
        tolerance: float,
    ) -> None:
        """Take the arguments of `vehicle.drive_to`."""
        self.goal = position["x"], position["y"]
        self.speed_mps, self.tolerance_m = speed, tolerance

    def tick_action(self) -> Status:
        """Command a velocity towards the place, or stop."""
        now = self.simulation.entity(self.entity)
        x, y = (goal - at for goal, at in zip(self.goal, now.position_m[:2], strict=True))
        self.feedback_message = f"{hypot(x, y):.2f} m to go"
        if hypot(x, y) <= self.tolerance_m:
            return self.arrived()
        error = remainder(atan2(y, x) - heading_rad(now.orientation), tau)
        turn = max(-MAX_TURN_RADPS, min(MAX_TURN_RADPS, TURN_GAIN_PER_S * error))
        speed = self.speed_mps * max(SLOWEST_SHARE, cos(error))
        self.simulation.command(self.entity, speed, turn)
        return Status.RUNNING


class WaitTraveled(EntityAction):
    """Waits until an entity has traveled a distance."""

    def execute(self, associated_actor: OscActor, distance: float) -> None:
        """Take the arguments of `entity.wait_traveled`."""
        self.distance_m, self.traveled_m = distance, 0.0
        self.last_m = self.simulation.entity(self.entity).position_m

    def tick_action(self) -> Status:
        """Add the way since the last tick."""
        now_m = self.simulation.entity(self.entity).position_m
        self.traveled_m += dist(now_m, self.last_m)
        self.last_m = now_m
        self.feedback_message = f"{self.traveled_m:.2f} m of {self.distance_m:g} m"
        return Status.SUCCESS if self.traveled_m >= self.distance_m else Status.RUNNING


class WaitNear(EntityAction):
    """Waits until an entity is near to another one."""

    def execute(self, associated_actor: OscActor, other: str, distance: float) -> None:
        """Take the arguments of `entity.wait_near`."""
        self.other, self.distance_m = other, distance

    def tick_action(self) -> Status:
        """Measure the distance."""
        now_m = dist(*(self.simulation.entity(n).position_m for n in (self.entity, self.other)))
        self.feedback_message = f"{now_m:.2f} m to `{self.other}`"
        return Status.SUCCESS if now_m <= self.distance_m else Status.RUNNING
