# SPDX-License-Identifier: Apache-2.0
"""Viewpoints of pictures: of a whole world, behind a vehicle, from a place towards another."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from groundlink.core.frames import Floats
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.portrait.picture import direction, view

from .recorded import RecordedDrive


@dataclass(frozen=True, kw_only=True)
class OverviewEye:
    """The whole world from one side; nothing moves but vehicles and points."""

    azimuth_deg: float
    elevation_deg: float

    def towards_eye(self) -> Floats:
        """Return the unit vector towards the eye."""
        return direction(self.azimuth_deg, self.elevation_deg)

    def eye(
        self, drive: RecordedDrive, corners: Floats, at_s: float, size: tuple[int, int]
    ) -> tuple[Pinhole, Floats]:
        """Return the camera, and its world_from_optical, shape (4, 4)."""
        return view(corners, self.towards_eye(), *size)


@dataclass(frozen=True, kw_only=True)
class ChaseEye:
    """From behind and above the vehicle, turned to its side."""

    behind_m: float
    above_m: float
    aside_deg: float
    ahead_m: float
    """Distance of the point in the middle of the picture from the vehicle."""

    field_deg: ClassVar[float] = 52.0
    smooth_s: ClassVar[float] = 1.5
    """Half of the time over which the vehicle's way is smoothed."""

    def towards_eye(self) -> Floats:
        """Return a unit vector upwards: outdoors nothing is left out."""
        return np.array([0.0, 0.0, 1.0])

    def eye(
        self, drive: RecordedDrive, corners: Floats, at_s: float, size: tuple[int, int]
    ) -> tuple[Pinhole, Floats]:
        """Return the camera, and its world_from_optical, shape (4, 4)."""
        way = drive.base_at(at_s + np.linspace(-self.smooth_s, self.smooth_s, 31))
        along = way[-1] - way[0]
        heading = math.atan2(along[1], along[0])
        target = way.mean(axis=0) + self.ahead_m * np.array(
            [math.cos(heading), math.sin(heading), 0.0]
        )
        back = heading + math.pi + math.radians(self.aside_deg)
        eye = way.mean(axis=0) + np.array(
            [self.behind_m * math.cos(back), self.behind_m * math.sin(back), self.above_m]
        )
        return pinhole(self.field_deg, *size), looking(eye, target)


def pinhole(field_deg: float, width: int, height: int) -> Pinhole:
    """Return a camera with a vertical field of view."""
    focal = height / 2 / math.tan(math.radians(field_deg) / 2)
    return Pinhole(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, near_m=0.3)


def looking(eye: Floats, target: Floats) -> Floats:
    """Return world_from_optical, shape (4, 4), of an eye that is turned to a target."""
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    world_from_optical = np.eye(4)
    world_from_optical[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=-1)
    world_from_optical[:3, 3] = eye
    return world_from_optical
