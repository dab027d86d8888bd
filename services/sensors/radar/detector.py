# SPDX-License-Identifier: Apache-2.0
"""Detector: from echoes to the detections of a frame.

1. Echoes in the same cell of range, angles and velocity add up in power. The cell's position and
   velocity are their mean, weighted with the power. Velocities are folded into the unambiguous
   interval before.
2. Receiver noise is complex Gaussian with a mean power of 1, so powers are signal-to-noise ratios.
   Of an echo with SNR S the power |sqrt(S) + n|^2 is measured; with `swerling1` the echo itself is
   complex Gaussian, too. A detection has more than the threshold T. So its probability is Marcum's
   Q_1(sqrt(2 S), sqrt(2 T)), or exp(-T / (1 + S)) with `swerling1` (Richards 2014, "Fundamentals of
   Radar Signal Processing", 6.3).
3. With `cfar_cells` the threshold follows the surroundings: it is T times the mean power of the N
   cells before and behind in range, with a guard cell on each side (cell-averaging CFAR, Richards
   2014, 6.5). Even clutter that fluctuates, such as the ground, is then a detection with a
   probability of (1 + T / N)^-N.
4. Thermal noise shifts a measured value by D / sqrt(2 S), 1 sigma, in a cell of size D, an angle by
   D / (1.6 sqrt(2 S)) (Barton 1988, "Modern Radar System Analysis"; Curry 2005, "Radar System
   Performance Modeling", 8). The device's own errors come on top.
5. False alarms are noise alone above the threshold: their power is T plus an exponential number.
   They lie anywhere.

Angles are those of an antenna array: direction cosines along y and z, in which noise and cells are
even. `x` follows from them.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.messages.imagery import RADAR_POINT
from services.sensors.noise.random_streams import RandomStreams

from .echoes import RadarEquation
from .spec import Radar

ANGLE_SLOPE = 1.6
"""Slope of the error signal of an angle measurement, per beam width (Barton 1988)."""


class Echoes(NamedTuple):
    """Echoes of a frame, one of each ray that hit something; all arrays have shape (N,)."""

    range_m: Floats
    y: Floats
    """Direction cosine to the left."""

    z: Floats
    """Direction cosine upwards."""

    velocity_mps: Floats
    """Radial velocity; positive: the distance grows."""

    snr: Floats
    """Signal-to-noise ratio, not in dB."""


class Detector:
    """Detector of one device; parameters: its specification, its sensitivity, its noise."""

    def __init__(self, spec: Radar, equation: RadarEquation, streams: RandomStreams) -> None:
        self._spec, self._equation, self._streams = spec, equation, streams
        self._threshold = 10 ** (spec.threshold_db / 10)
        across, upward = spec.azimuth_resolution_deg, spec.elevation_resolution_deg
        self._cells = Echoes(
            np.array(spec.range_resolution_m),
            np.sin(np.radians(across)),
            np.sin(np.radians(upward)) if upward else np.array(math.inf),
            np.array(spec.velocity_resolution_mps),
            np.array(1.0),
        )
        self._own_errors = (
            spec.range_stddev_m,
            math.radians(spec.azimuth_stddev_deg),
            math.radians(spec.elevation_stddev_deg),
            spec.velocity_stddev_mps,
        )

    def detections(self, echoes: Echoes, tick: int) -> NDArray[np.void]:
        """Return the detections of the frame at a tick, dtype `RADAR_POINT`."""
        spec = self._spec
        echoes = echoes._replace(velocity_mps=self._folded(echoes.velocity_mps))
        cells, number, per_range = self._in_cells(echoes)
        power = self._measured(cells.snr, self._streams.at("power", tick))
        seen = power > self._threshold * self._surroundings(power, number, per_range)
        found = Echoes._make(values[seen] for values in (*cells[:4], power))
        found = self._with_errors(found, self._streams.at("errors", tick))
        alarms = self._false_alarms(self._streams.at("false_alarms", tick))
        range_m, y, z, velocity, snr = map(np.concatenate, zip(found, alarms, strict=True))
        kept = np.flatnonzero((range_m >= spec.min_range_m) & (range_m <= spec.max_range_m))
        kept = np.sort(kept[np.argsort(-snr[kept], kind="stable")[: spec.max_detections]])
        points = np.empty(len(kept), RADAR_POINT)
        range_m, y, z, snr = range_m[kept], y[kept], z[kept], snr[kept]
        points["x"] = range_m * np.sqrt(np.maximum(1 - y**2 - z**2, 0))
        points["y"], points["z"] = range_m * y, range_m * z
        points["velocity"] = self._folded(velocity[kept])
        points["rcs"] = 10 * np.log10(self._equation.rcs(snr, range_m))
        points["snr"] = 10 * np.log10(snr)
        return points

    def _folded(self, velocity_mps: Floats) -> Floats:
        """Return velocities as they appear in the unambiguous interval."""
        least, span = self._spec.min_velocity_mps, self._spec.max_velocity_mps
        return least + np.mod(velocity_mps - least, span - least)

    def _in_cells(self, echoes: Echoes) -> tuple[Echoes, NDArray[np.int64], int]:
        """Return one echo for each cell by increasing range, cell numbers, and cells per range."""
        key, counts = np.zeros(len(echoes.snr), np.int64), []
        for values, size in zip(echoes[:4], self._cells[:4], strict=True):
            number = np.rint(values / size).astype(np.int64)  # cells lie about multiples of it
            first = number.min(initial=0)
            counts.append(int(number.max(initial=0) - first + 1))
            key = key * counts[-1] + number - first
        numbers, cell = np.unique(key, return_inverse=True)
        snr = np.bincount(cell, echoes.snr)
        means = (np.bincount(cell, echoes.snr * values) / snr for values in echoes[:4])
        return Echoes._make((*means, snr)), numbers, math.prod(counts[1:])

    def _surroundings(self, power: Floats, number: NDArray[np.int64], per_range: int) -> Floats:
        """Return the mean power around each cell in range; cells without an echo have noise, 1."""
        side = self._spec.cfar_cells
        if not side or not len(power):
            return np.ones(len(power))
        excess = np.zeros(len(power))
        for cells in range(2, side + 2):
            for wanted in (number - cells * per_range, number + cells * per_range):
                at = np.minimum(np.searchsorted(number, wanted), len(number) - 1)
                excess += np.where(number[at] == wanted, power[at] - 1, 0.0)
        return 1 + excess / (2 * side)

    def _measured(self, snr: Floats, generator: np.random.Generator) -> Floats:
        """Return the measured power of echoes in noise of a mean power of 1."""
        parts = generator.standard_normal((2, len(snr), 2)) * math.sqrt(0.5)
        (echo, noise) = parts[..., 0] + 1j * parts[..., 1]
        if self._spec.fluctuation == "none":
            echo = np.ones(len(snr))
        return np.asarray(np.abs(np.sqrt(snr) * echo + noise) ** 2, np.float64)

    def _with_errors(self, found: Echoes, generator: np.random.Generator) -> Echoes:
        """Return detections with the errors of thermal noise and of the device."""
        normal = generator.standard_normal((4, len(found.snr)))
        thermal = 1 / np.sqrt(2 * found.snr)
        slopes = 1.0, ANGLE_SLOPE, ANGLE_SLOPE, 1.0
        shifted = []
        for values, size, own, slope, draw in zip(
            found[:4], self._cells[:4], self._own_errors, slopes, normal, strict=True
        ):
            if math.isinf(size):
                shifted.append(np.zeros_like(values))
            else:
                shifted.append(values + draw * np.hypot(thermal * size / slope, own))
        return Echoes._make((*shifted, found.snr))

    def _false_alarms(self, generator: np.random.Generator) -> Echoes:
        """Return detections of noise alone."""
        spec = self._spec
        count = generator.poisson(spec.false_alarms)
        y = math.sin(math.radians(spec.horizontal_fov_deg / 2))
        z = math.sin(math.radians(spec.vertical_fov_deg / 2)) * bool(spec.elevation_resolution_deg)
        return Echoes(
            generator.uniform(spec.min_range_m, spec.max_range_m, count),
            generator.uniform(-y, y, count),
            generator.uniform(-z, z, count),
            generator.uniform(spec.min_velocity_mps, spec.max_velocity_mps, count),
            self._threshold + generator.standard_exponential(count),
        )
