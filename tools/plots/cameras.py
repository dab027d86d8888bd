# SPDX-License-Identifier: Apache-2.0
"""Plots of cameras: shutter, image sensor and depth. Nothing is rendered."""

import msgspec
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.scenario.cameras import Imager
from services.sensors.depth_camera.model import measured
from services.sensors.depth_camera.spec import DepthCamera
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rendering.optics.distortion import lens_pinhole
from services.sensors.rendering.optics.imager import Electronics
from services.sensors.rendering.optics.shutter import LIGHT, Shutter, weights

from .cart import sheet
from .page_style import SERIES, label, side_by_side

HEIGHT, WIDTH = 120, 160
POLE_PX = 8
SPEED_PXPS = 1500.0

ROLLING = Imager(exposure_s=0.008, readout_s=0.022, poses=24)
SHUTTERS = {
    "ideal": Imager(),
    "global, 8 ms": Imager(exposure_s=0.008, poses=8),
    "rolling, 8 + 22 ms": ROLLING,
}


def _pole(offset_nanos: int) -> NDArray[np.uint8]:
    """Return a picture of a bright pole that moves to the right, at an instant."""
    left = 60 + SPEED_PXPS * offset_nanos / NANOS
    columns = np.arange(WIDTH)
    share = np.clip(columns + 1 - left, 0, 1) - np.clip(columns + 1 - left - POLE_PX, 0, 1)
    values = 255 * np.sqrt(0.02 + 0.9 * share)
    return np.tile(np.rint(values).astype(np.uint8)[None, :, None], (HEIGHT, 1, 3))


def shutter() -> Figure:
    """Which drawn picture exposes which row, and a moving pole behind three shutters."""
    figure, axes = side_by_side(4, height=2.4)
    span_ms = 1e3 * ROLLING.span_s
    axes[0].imshow(
        weights(ROLLING, HEIGHT).T, extent=(0, span_ms, HEIGHT, 0), aspect="auto", cmap="Blues"
    )
    begins_ms = 1e3 * ROLLING.readout_s
    axes[0].plot([0, begins_ms], [0, HEIGHT], color=SERIES[1])
    axes[0].plot([1e3 * ROLLING.exposure_s, span_ms], [0, HEIGHT], color=SERIES[1])
    label(axes[0], "Shares of 24 drawings", "time, ms", "row")
    axes[0].grid(visible=False)
    for plot, (name, imager) in zip(axes[1:], SHUTTERS.items(), strict=True):
        plot.imshow(Shutter(imager, HEIGHT).exposed(_pole))
        plot.set_title(name)
        plot.set_axis_off()
    return figure


def noise() -> Figure:
    """Noise of linear light against light, for some gains: the photon transfer curve."""
    figure, (left, right) = side_by_side(2)
    values = np.arange(8, 240, 12, dtype=np.uint8)
    for gain, color in zip((1.0, 4.0, 16.0), SERIES, strict=False):
        spec = Imager(full_well_electrons=10_000.0, read_noise_electrons=5.0, gain=gain)
        pixels = np.repeat(values, 40_000)
        electronics = Electronics(spec, pixels.size, RandomStreams(1, "cart/camera"))
        read = LIGHT[electronics.read(pixels, 0)].reshape(len(values), -1)
        light = LIGHT[values]
        electrons = light * 10_000 / gain
        smooth = np.geomspace(light[0], light[-1], 100)
        variance = smooth * gain / 10_000 + (gain * 5 / 10_000) ** 2
        left.loglog(smooth, 100 * np.sqrt(variance), color=color)
        left.loglog(light, 100 * read.std(axis=1), "o", color=color, label=f"gain {gain:g}")
        ratio = smooth / np.sqrt(variance)
        right.loglog(smooth * 10_000 / gain, ratio, color=color)
        right.loglog(electrons, read.mean(axis=1) / read.std(axis=1), "o", color=color)
    label(left, "Noise", "light, share of full scale", "1 sigma, percent of full scale")
    left.legend()
    label(right, "Signal to noise", "electrons of a pixel", "mean / sigma")
    return figure


def depth_noise() -> Figure:
    """Noise of depth from stereo against depth, of two shipped devices."""
    figure, (plot,) = side_by_side(1)
    for name, color in zip(("realsense_d435i", "zed2_depth"), SERIES, strict=False):
        spec = msgspec.convert(sheet(name, edge_holes_px=0), DepthCamera)
        focal_px = lens_pinhole(spec).fx
        places = np.geomspace(0.5, 0.8 * spec.max_range_m, 14)
        found = []
        for place in places:
            wall = np.full((64, spec.width), place, np.float32)
            seen = measured(wall, focal_px, spec, np.random.default_rng(1))
            found.append(np.std(seen[np.isfinite(seen)]))
        law = places**2 / (focal_px * spec.baseline_m) * spec.disparity_stddev_px
        plot.loglog(places, 1e3 * law, color=color)
        plot.loglog(places, 1e3 * np.array(found), "o", color=color, label=name)
    label(plot, "Noise of depth", "depth, m", "1 sigma, mm")
    plot.legend()
    return figure
