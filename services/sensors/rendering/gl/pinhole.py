# SPDX-License-Identifier: Apache-2.0
"""Pinhole camera: projection of points of the optical frame to pixels.

Pixel centers are at integers, as in ROS and OpenCV: the picture spans from -0.5 to width - 0.5. The
optical frame is x right, y down, z forward (REP 103).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario.cameras import Optics

NEAR_M = 0.02
"""Near plane in meters. A 24-bit depth buffer then resolves 3 mm at 30 m."""

VERTICAL_FOV_DEG = 60.0
"""Vertical field of view without one in the scenario."""


@dataclass(frozen=True)
class Pinhole:
    """Size and intrinsics of a camera, in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    near_m: float = NEAR_M

    @classmethod
    def of(cls, spec: Optics, *, radius: Callable[[float], float] = math.tan) -> "Pinhole":
        """Return the pinhole of a scenario's camera: from its K, or from angles about its middle.

        An angle spans from edge to edge: f = size / 2 / radius(angle / 2). `radius` is the distance
        from the center at which a lens projects an angle off its axis.
        """
        width, height = spec.width, spec.height
        if spec.intrinsics is not None:
            return cls(width, height, *spec.intrinsics)
        across_deg, down_deg = spec.horizontal_fov_deg, spec.vertical_fov_deg
        if across_deg is None and down_deg is None:
            down_deg = VERTICAL_FOV_DEG
        fx = across_deg and width / 2 / radius(math.radians(across_deg) / 2)
        fy = down_deg and height / 2 / radius(math.radians(down_deg) / 2)
        fx, fy = fx or fy, fy or fx  # with one angle, pixels are square
        assert fx is not None
        assert fy is not None
        return cls(width, height, fx, fy, (width - 1) / 2, (height - 1) / 2)

    def matrix(self) -> Floats:
        """Return K, shape (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def clip_from_optical(self) -> Floats:
        """Return OpenGL's projection, shape (4, 4), with the first pixel row at the top.

        The far plane is at infinity: z becomes 1 - 2 near / z.
        """
        w, h = self.width, self.height
        return np.array(
            [
                [2 * self.fx / w, 0.0, 2 * (self.cx + 0.5) / w - 1, 0.0],
                [0.0, 2 * self.fy / h, 2 * (self.cy + 0.5) / h - 1, 0.0],
                [0.0, 0.0, 1.0, -2 * self.near_m],
                [0.0, 0.0, 1.0, 0.0],
            ]
        )

    def ray_from_clip(self) -> Floats:
        """Return the matrix from a point (x, y, 1) of clip space to its ray, shape (3, 3)."""
        return np.linalg.inv(self.clip_from_optical()[[0, 1, 3], :3]).astype(np.float64)

    def rays(self) -> NDArray[np.float64]:
        """Return each pixel's ray with z = 1, shape (height, width, 3)."""
        x = (np.arange(self.width) - self.cx) / self.fx
        y = (np.arange(self.height) - self.cy) / self.fy
        rays = np.ones((self.height, self.width, 3))
        rays[..., 0], rays[..., 1] = x, y[:, None]
        return rays
