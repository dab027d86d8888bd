# SPDX-License-Identifier: Apache-2.0
"""Plot of satellites that move, and of their reflected signals."""

import msgspec
import numpy as np
from matplotlib.figure import Figure
from msgspec.structs import replace

from groundlink.core.clock import NANOS
from services.sensors.gnss.dilution import geometry
from services.sensors.gnss.geodesy import Geodetic, TangentPlane
from services.sensors.gnss.multipath import WAVELENGTH_M, code_errors_m
from services.sensors.gnss.sky import MovingSky
from services.sensors.gnss.spec import Gnss, Multipath

from .cart import sheet
from .page_style import SERIES, label, side_by_side

WARSAW = TangentPlane(Geodetic.of_degrees(52.25, 20.9, 140.0))
DAY_S, STEP_S = 86_400, 300
LONGEST_DETOUR_M = 50.0


def gnss_sky() -> Figure:
    """Elevations of GPS satellites, dilution over a day, and errors of reflections."""
    figure, axes = side_by_side(3)
    four = msgspec.convert(sheet("gnss_zed_f9p"), Gnss)
    gps = replace(four, constellations=four.constellations[:1])
    hours = np.arange(0, DAY_S, STEP_S) / 3600
    for color, name, spec in zip(SERIES, ("GPS", "four systems"), (gps, four), strict=False):
        sky = MovingSky(spec, WARSAW)
        towards = [sky.towards(second * NANOS, np.zeros(3)) for second in range(0, DAY_S, STEP_S)]
        least = np.sin(np.radians(spec.elevation_mask_deg))
        found = [geometry(each, each[2] > least) for each in towards]
        dilutions = [np.nan if each is None else each.horizontal_dilution for each in found]
        axes[1].plot(hours, dilutions, color=color, label=name)
        if spec is gps:
            elevations = np.degrees(np.arcsin(np.array(towards)[:, 2]))
            above = np.where(elevations > 0, elevations, np.nan)
            axes[0].plot(hours, above, color=color, linewidth=0.7)
    label(axes[0], "GPS satellites", "sim time, h", "elevation, degrees")
    label(axes[1], "Dilution above 10 degrees", "sim time, h", "HDOP")
    axes[1].set_ylim(0, 4)
    axes[1].legend()
    # In phase and in opposite phase: the envelope.
    detours = np.arange(1, LONGEST_DETOUR_M / WAVELENGTH_M) * WAVELENGTH_M
    for color, name in zip(SERIES, ("gnss_zed_f9p", "gnss_neo_m8n"), strict=False):
        multipath = msgspec.convert(sheet(name), Gnss).multipath or Multipath()
        for phase in (0.0, WAVELENGTH_M / 2):
            shifted = detours + phase
            axes[2].plot(
                shifted,
                code_errors_m(shifted, multipath),
                color=color,
                label=None if phase else name,
            )
    label(axes[2], "Error of a range by code", "detour of the reflection, m", "m")
    axes[2].set_ylim(-16, 24)
    axes[2].legend(loc="upper right")
    return figure
