# SPDX-License-Identifier: Apache-2.0
"""Image sensor: shot noise, read noise, black level, full scale.

Noise acts on linear light, because electrons are counted before coding: a coded value is squared,
noise is added, and the square root is taken (see `developed.glsl`; the renderer's tone curve
counts as the sensor's own). Each pixel has its own noise after the color filter; red, green and
blue pictures are read as if there were three sensors.

A pixel of light s, relative to full scale, holds s N / g electrons for a full well N at gain g.
Their number has Poisson noise, and reading adds its own (EMVA 1288, release 4.0, section 2): the
variance of s is s g / N + (g r / N)^2.
"""

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario.cameras import Imager
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rays.kernels import kernels

from .shutter import LIGHT

IDEAL_EXPOSURE_S = 0.01
"""Brightness at which the world's own light is shown."""

STEPS_PER_SIGMA = 32
"""Scale of 8-bit normal numbers: up to 4 sigma."""

STARTS = 1 << 20
"""Places in the noise pool where a picture's noise may begin."""


class Electronics:
    """The noise of one camera.

    Parameters
    ----------
    spec : Imager
    values : int
        Numbers in a picture, all colors together.
    streams : RandomStreams

    Raises
    ------
    KernelsMissingError
        when there is noise and Groundlink was installed without a C compiler (a `UserError`).

    Attributes
    ----------
    brightness : float
        Factor of light by exposure and gain.
    """

    def __init__(self, spec: Imager, values: int, streams: RandomStreams) -> None:
        exposure_s = spec.exposure_s or IDEAL_EXPOSURE_S
        self.brightness = exposure_s / IDEAL_EXPOSURE_S * spec.gain
        self._streams, self._values = streams, values
        self._coded = coded(spec)
        self._ideal = not spec.full_well_electrons and not spec.black_level
        self._pool = np.zeros(0, np.uint8)
        if not self._ideal:
            normals = streams.at("grain", 0).standard_normal(values + STARTS, np.float32)
            steps = np.clip(np.rint(STEPS_PER_SIGMA * normals), -127, 127)
            self._pool = (steps + 128).astype(np.uint8)
            self._add = kernels().groundlink_grain

    def read(self, pixels: NDArray[np.uint8], tick: int) -> NDArray[np.uint8]:
        """Return noisy values at a tick for the noiseless `pixels`, in the same shape."""
        if self._ideal:
            return pixels
        start = int(self._streams.at("noise", tick).integers(STARTS))
        noise = self._pool[start : start + self._values].reshape(pixels.shape)
        pixels = np.ascontiguousarray(pixels)
        read = np.empty_like(pixels)
        arrays = pixels, noise, self._coded, read
        self._add(self._values, *(array.ctypes.data for array in arrays))
        return read


def coded(spec: Imager) -> NDArray[np.uint8]:
    """Return the coded value by value and noise, shape (65536,): 256 noise steps for each value."""
    light = LIGHT.astype(np.float64)[:, None]
    sigma = np.zeros((256, 1))
    if spec.full_well_electrons:
        per_electron = spec.gain / spec.full_well_electrons
        sigma = np.sqrt(light * per_electron + (spec.read_noise_electrons * per_electron) ** 2)
    noise = (np.arange(256) - 128) / STEPS_PER_SIGMA
    read = np.clip(spec.black_level + light + sigma * noise, 0.0, 1.0)
    return np.asarray(np.rint(255 * np.sqrt(read)), np.uint8).ravel()
