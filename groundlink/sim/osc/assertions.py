# SPDX-License-Identifier: Apache-2.0
"""Assertions of `osc.groundlink`: they hold at the tick at which they are reached, or fail."""

from collections.abc import Mapping
from math import degrees, dist, remainder, tau
from typing import Any

from py_trees.common import Status

from groundlink.core.quaternions import heading_rad

from .actions import EntityAction, OscActor


class AssertPose(EntityAction):
    """Asserts where an entity is."""

    def execute(
        self,
        associated_actor: OscActor,
        pose: Mapping[str, Any],
        tolerance: float,
        angle_tolerance: float,
    ) -> None:
        """Take the arguments of `entity.assert_pose`."""
        self.place_m = pose["position"]["x"], pose["position"]["y"]
        self.heading_rad: float = pose["orientation"]
        self.tolerance_m, self.angle_tolerance_rad = tolerance, angle_tolerance

    def tick_action(self) -> Status:
        """Compare the pose."""
        now = self.simulation.entity(self.entity)
        x, y, _ = now.position_m
        off_m = dist((x, y), self.place_m)
        if off_m > self.tolerance_m:
            wanted = ", ".join(f"{part:g}" for part in self.place_m)
            return self.failed(
                f"at {x:.3f}, {y:.3f}, which is {off_m:.3f} m from {wanted}; "
                f"expected at most {self.tolerance_m:g} m"
            )
        turned = abs(remainder(heading_rad(now.orientation) - self.heading_rad, tau))
        if turned > self.angle_tolerance_rad:
            return self.failed(
                f"heading {degrees(heading_rad(now.orientation)):.1f} deg, which is "
                f"{degrees(turned):.1f} deg from {degrees(self.heading_rad):g} deg; "
                f"expected at most {degrees(self.angle_tolerance_rad):g} deg"
            )
        return Status.SUCCESS


class AssertDistance(EntityAction):
    """Asserts how far an entity is from another one."""

    def execute(
        self, associated_actor: OscActor, other: str, at_least: float, at_most: float
    ) -> None:
        """Take the arguments of `entity.assert_distance`."""
        self.other = other
        self.at_least_m, self.at_most_m = at_least, at_most

    def tick_action(self) -> Status:
        """Compare the distance."""
        now_m = dist(*(self.simulation.entity(n).position_m for n in (self.entity, self.other)))
        if not self.at_least_m <= now_m <= self.at_most_m:
            return self.failed(
                f"{now_m:.3f} m from `{self.other}`; "
                f"expected {self.at_least_m:g} m to {self.at_most_m:g} m"
            )
        return Status.SUCCESS


class AssertUntouched(EntityAction):
    """Asserts that a vehicle has touched nothing but the ground."""

    def execute(self, associated_actor: OscActor) -> None:
        """Take the arguments of `vehicle.assert_untouched`."""

    def tick_action(self) -> Status:
        """Look at all contacts so far."""
        if touched := self.simulation.touched(self.entity):
            return self.failed(
                "touched "
                + ", ".join(f"`{name}` by {at_s:.2f} s" for name, at_s in touched.items())
            )
        return Status.SUCCESS
