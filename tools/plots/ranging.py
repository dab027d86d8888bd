# SPDX-License-Identifier: Apache-2.0
"""Plots of LiDARs and range finders."""

import math
from typing import Any

import msgspec
import numpy as np
from matplotlib.figure import Figure
from msgspec.structs import replace
from numpy.typing import ArrayLike

from groundlink.core.frames import Floats, quaternion_from_rpy
from groundlink.world.solids import Box, Solid
from groundlink.world.weather import Sun, Weather
from services.sensors.lidar.spec import Lidar
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.range.model import RangeModel
from services.sensors.range.spec import RangeFinder
from services.sensors.rays.scene import Hits
from services.sensors.scanning.beams import Rays
from services.sensors.scanning.draws import RevolutionDraws
from services.sensors.scanning.foreign_light import ForeignLight, threshold
from services.sensors.scanning.returns import LidarReceiver, Returns
from services.sensors.scanning.stray_light import StrayLight
from services.sensors.scanning.sweep import Sweep
from services.sensors.scanning.weather import atmosphere_of

from .cart import bench, sheet, states
from .page_style import GRAY, SERIES, label, side_by_side

FIRINGS = 36_000
"""Shots of one laser in a revolution, the most that a data sheet may have."""

_TURNING = (
    *("rotation_rate_hz", "kind", "datasheet", "name", "topic", "frame", "field_of_view_deg"),
    *("start_deg", "azimuth_resolution_deg", "firings_per_azimuth", "elevations_deg"),
    *("vertical_offsets_m", "laser_times_us", "rotation", "divergence_mrad", "prisms"),
)
"""Fields of a sheet that are left out: the bench has one laser that shoots at what it is given."""


def _receiver(name: str, **fields: Any) -> Lidar:
    """Return the receiver of a data sheet behind one laser of `FIRINGS` shots."""
    kept = {key: value for key, value in sheet(name).items() if key not in _TURNING}
    laser = {"name": "it", "topic": "/it", "frame": "it_link", "elevations_deg": [0.0]}
    return msgspec.convert({**kept, **laser, "firings_per_revolution": FIRINGS, **fields}, Lidar)


def _received(
    spec: Lidar,
    ranges_m: ArrayLike,
    *,
    reflectivity: float = 0.8,
    incidence_rad: ArrayLike = 0.0,
    weather: Weather | None = None,
    sun: Sun | None = None,
) -> Returns:
    """Return what a receiver reports of surfaces at some ranges, with arrays of shape (FIRINGS,).

    Parameters
    ----------
    ranges_m, incidence_rad
        Of each shot, shape (FIRINGS,) or a number for all.
    """
    shape = 1, FIRINGS
    ranges = np.broadcast_to(np.asarray(ranges_m, np.float32), shape).copy()
    slant = np.broadcast_to(np.asarray(incidence_rad, np.float64), shape)
    directions = np.zeros((3, *shape), np.float32)
    directions[0] = 1.0
    normals = np.stack([-np.cos(slant), np.sin(slant), 0 * slant]).astype(np.float32)
    hits = Hits(ranges, normals, np.zeros(shape, np.int32), np.full(shape, -1, np.int32))
    rays = Rays(np.zeros_like(directions), directions, np.zeros(shape, np.float32))
    streams = RandomStreams(1, "cart/lidar")
    sweep = Sweep(spec)
    receiver = LidarReceiver(
        spec,
        sweep,
        np.array([reflectivity], np.float32),
        atmosphere_of(spec, weather or Weather()),
        StrayLight(spec, sweep.rings),
        ForeignLight(spec, sun, 1),
        streams,
        RevolutionDraws(streams),
    )
    made = receiver.measure(hits, rays, range(FIRINGS), 0)
    return Returns._make(array[0, 0] for array in made)


def lidar_range() -> Figure:
    """Range noise against the range, and the reach against the angle of incidence."""
    figure, (left, right) = side_by_side(2)
    for name, color in zip(("vlp16", "utm30lx", "rplidar_a2"), SERIES, strict=False):
        spec = _receiver(name, full_range_reflectivity=0.0)
        places = np.geomspace(0.6, 0.97 * spec.max_range_m, 12)
        errors = (_received(spec, place) for place in places)
        found = [np.std(one.range_m - one.true_range_m) for one in errors]
        step = spec.range_resolution_m
        sigma = np.sqrt(
            spec.range_stddev_m**2 + (spec.range_stddev_share * places) ** 2 + step**2 / 12
        )
        left.loglog(places, 1e3 * sigma, color=color)
        left.loglog(places, 1e3 * np.array(found), "o", color=color, label=name)
    label(left, "Range noise", "range, m", "1 sigma, mm")
    left.legend()

    spec = _receiver("vlp16")
    degrees = np.linspace(0, 85, 18)
    for reflectivity, color in zip((0.8, 0.3, 0.1, 0.03), SERIES, strict=False):
        shots = np.linspace(spec.min_range_m, spec.max_range_m, FIRINGS)
        reach = []
        for slant in np.radians(degrees):
            seen = _received(spec, shots, reflectivity=reflectivity, incidence_rad=slant)
            reach.append(shots[seen.returned].max())
        ideal = spec.max_range_m * np.sqrt(
            reflectivity * np.cos(np.radians(np.linspace(0, 88, 200))) / 0.5
        )
        right.plot(np.linspace(0, 88, 200), np.minimum(spec.max_range_m, ideal), color=color)
        right.plot(degrees, reach, "o", color=color, label=f"reflectivity {reflectivity:g}")
    label(right, "Reach of vlp16", "angle of incidence, degrees", "farthest return, m")
    right.set_ylim(0, 140)
    right.legend(ncols=2)
    return figure


def lidar_light() -> Figure:
    """Intensity against range and angle of incidence, and the share of returns that are lost."""
    figure, (left, middle, right) = side_by_side(3)
    places = np.geomspace(1, 90, 12)
    smooth = np.geomspace(1, 90, 100)
    for form, color in zip(("calibrated", "received"), SERIES, strict=False):
        spec = _receiver("vlp16", intensity=form, full_range_reflectivity=0.0)
        found = [_received(spec, place, reflectivity=0.5).intensity[0] for place in places]
        law = np.full_like(smooth, 50) if form == "calibrated" else 50 * (10 / smooth) ** 2
        left.loglog(smooth, law, color=color)
        left.loglog(places, found, "o", color=color, label=form)
    label(left, "Intensity, reflectivity 0.5", "range, m", "intensity")
    left.legend()

    spec = _receiver("vlp16", full_range_reflectivity=0.0)
    degrees = np.linspace(0, 88, 23)
    for reflectivity, color in zip((1.0, 0.5, 0.1), SERIES, strict=False):
        slant = np.radians(degrees)
        seen = [
            _received(spec, 10.0, reflectivity=reflectivity, incidence_rad=angle).intensity[0]
            for angle in slant
        ]
        middle.plot(degrees, 100 * reflectivity * np.cos(slant), color=color)
        middle.plot(degrees, seen, "o", color=color, label=f"reflectivity {reflectivity:g}")
    label(middle, "Calibrated intensity", "angle of incidence, degrees", "intensity")
    middle.legend()

    shares = np.linspace(0, 0.5, 11)
    sheets = [_receiver("vlp16", dropout=share) for share in shares.tolist()]
    kept = [_received(spec, 10.0).returned.mean() for spec in sheets]
    right.plot(shares, 1 - shares, color=SERIES[0])
    right.plot(shares, kept, "o", color=SERIES[0])
    label(right, "Dropout", "dropout", "share of returns")
    return figure


def lidar_weather() -> Figure:
    """Share of shots that return the surface, and ranges of false returns in rain."""
    figure, (left, right) = side_by_side(2)
    spec = _receiver("vlp16", divergence_mrad=[3.0, 1.5])
    places = np.linspace(1, 99, 99)
    skies = {
        "clear": Weather(),
        "rain 10 mm/h": Weather(rain_mm_per_h=10.0),
        "rain 50 mm/h": Weather(rain_mm_per_h=50.0),
        "fog, visibility 200 m": Weather(fog_visibility_m=200.0),
        "fog, visibility 60 m": Weather(fog_visibility_m=60.0),
    }
    for (name, sky), color in zip(skies.items(), SERIES, strict=True):
        shots = [_received(spec, place, weather=sky) for place in places]
        seen = [(shot.returned & (shot.label >= 0)).mean() for shot in shots]
        left.plot(places, seen, color=color, label=name)
    label(left, "A wall of reflectivity 0.8", "range of the wall, m", "share that returns the wall")
    left.legend()

    edges = np.linspace(0, 5, 26)
    for rate, color in zip((10.0, 50.0), SERIES[1:], strict=False):
        sky = Weather(rain_mm_per_h=rate)
        shot = _received(spec, 99.0, reflectivity=0.01, weather=sky)
        drops = shot.range_m[shot.returned & (shot.label < 0)]
        counted = np.histogram(drops, edges)[0] / FIRINGS / np.diff(edges)
        right.stairs(100 * counted, edges, color=color, label=f"rain {rate:g} mm/h")
        air = atmosphere_of(spec, sky)
        assert air is not None
        first = 1 - np.exp(-np.interp(edges, air.drop_ranges_m, air.drops))
        middles = (edges[1:] + edges[:-1]) / 2
        right.plot(middles, 100 * np.diff(first) / np.diff(edges), "--", color=GRAY, linewidth=0.9)
    label(right, "Returns of drops", "range of the drop, m", "percent of shots per meter")
    right.legend()
    return figure


def lidar_sun() -> Figure:
    """Reach of the Avia in the dark and in sunlight, and the noise that sunlight adds."""
    figure, (left, right) = side_by_side(2)
    manual = {
        "dark": ((0.1, 190), (0.2, 260), (0.8, 450)),
        "sunlight": ((0.1, 190), (0.2, 230), (0.8, 320)),
    }
    spec = _receiver("avia", laser_stddevs_m=[], range_resolution_m=0.0)
    assert spec.sun is not None
    behind = Sun(azimuth_deg=270.0, elevation_deg=5.0)
    lit = math.cos(math.radians(5))
    noise = (spec.sun.reach_share**-4 - 1) / spec.full_range_reflectivity
    smooth = np.geomspace(0.05, 0.8, 100)
    shots = np.linspace(20, spec.max_range_m, FIRINGS)
    for (name, points), sun, color in zip(manual.items(), (None, behind), SERIES, strict=False):
        background = noise * lit * smooth if sun else 0 * smooth
        reach = spec.max_range_m * np.sqrt(smooth / 0.8 / np.sqrt(1 + background))
        left.plot(smooth, reach, color=color)
        found = []
        for reflectivity in (0.05, 0.1, 0.2, 0.4, 0.8):
            seen = _received(spec, shots, reflectivity=reflectivity, sun=sun)
            found.append((reflectivity, shots[seen.returned & (seen.label >= 0)].max()))
        left.plot(*np.array(found).T, "o", color=color, label=name)
        left.plot(*np.array(points).T, "x", color=color, label=f"{name}, manual")
    label(left, "Reach of avia", "reflectivity", "farthest return, m")
    left.legend()

    at_threshold = spec.cell_m / math.sqrt(2) / threshold(spec, spec.sun.false_share)
    for reflectivity, color in zip((0.8, 0.1), SERIES, strict=False):
        places = np.geomspace(5, 280 if reflectivity > 0.5 else 130, 12)
        seen_at = [
            _received(spec, place, reflectivity=reflectivity, sun=behind) for place in places
        ]
        errors = [
            (one.range_m - one.true_range_m)[one.returned & (one.label >= 0)] for one in seen_at
        ]
        sunlit = at_threshold * math.sqrt(noise * lit * reflectivity)
        added = sunlit * spec.least_power / (100 * reflectivity / places**2)
        right.loglog(places, 1e3 * np.hypot(spec.range_stddev_m, added), color=color)
        found_mm = [1e3 * one.std() for one in errors]
        right.loglog(places, found_mm, "o", color=color, label=f"reflectivity {reflectivity:g}")
    label(right, "Range noise of avia in sunlight", "range, m", "1 sigma, mm")
    right.legend()
    return figure


def _wall(distance_m: float, yaw_rad: float) -> Solid:
    """Return a wall whose face crosses x at a distance, turned about that point."""
    half = 0.5
    middle = distance_m + half * math.cos(yaw_rad), half * math.sin(yaw_rad), 0.5
    turn = quaternion_from_rpy(0.0, 0.0, yaw_rad)
    return replace(Solid("wall", Box((2 * half, 60.0, 60.0)), "gray", middle), orientation=turn)


def _exact(**fields: Any) -> dict[str, Any]:
    """Return fields that take all errors from a range finder."""
    none = ("range_stddev_m", "range_stddev_share", "range_stddev_per_m", "turn_on_bias_m")
    return {**dict.fromkeys((*none, "range_resolution_m", "dropout"), 0.0), **fields}


def _reported(fields: dict[str, Any], wall: Solid) -> float:
    """Return the distance that a range finder at the world's origin reports."""
    made = bench(fields, wall)
    spec = made.vehicles[0].sensors[0]
    assert isinstance(spec, RangeFinder)
    (state,) = states()
    (reading,) = RangeModel(made, made.vehicles[0], spec).readings(state)
    return reading.range_m


def range_finder() -> Figure:
    """Distance of a slanted wall as sound and as light report it, and the noise of both."""
    figure, (left, right) = side_by_side(2)
    at_m = 0.7
    degrees = np.linspace(0, 45, 31)
    above = {"mount": {"xyz_m": [0.0, 0.0, 0.5]}, "rays": 2048}
    kinds = (("srf08", "nearest"), ("hc_sr04", "nearest"), ("gp2y0a21yk", "mean"))
    for (name, echo), color in zip(kinds, SERIES, strict=False):
        fields = sheet(name, **_exact(**above))
        found = [_reported(fields, _wall(at_m, float(yaw))) for yaw in np.radians(degrees)]
        left.plot(degrees, found, "o", color=color, label=f"{name}: {echo}")
        half_deg = fields["field_of_view_deg"] / 2
        if echo == "nearest":
            yaw = np.radians(degrees)
            off = np.radians(np.maximum(0, degrees - half_deg))
            heard = degrees - half_deg <= fields["max_incidence_deg"]
            law = at_m * np.cos(yaw) / np.cos(off)
            left.plot(degrees[heard], law[heard], color=color)
        else:
            left.plot(degrees, np.full_like(degrees, at_m), color=color)
    label(
        left, f"A wall across the axis at {at_m:g} m", "slant of the wall, degrees", "reported, m"
    )
    left.legend()

    for (name, _), color in zip(kinds, SERIES, strict=False):
        fields = sheet(name)
        places = np.linspace(fields["min_range_m"], fields["max_range_m"], 100)
        right.plot(places, 1e3 * _range_sigma(fields, places), color=color, label=name)
    label(right, "Noise", "distance, m", "1 sigma, mm")
    right.legend()
    return figure


def _range_sigma(fields: dict[str, Any], ranges_m: Floats) -> Floats:
    """Return the standard deviation of a range finder's white noise."""
    constant, share, per_m = (
        fields.get(name, 0.0)
        for name in ("range_stddev_m", "range_stddev_share", "range_stddev_per_m")
    )
    sigma: Floats = np.sqrt(constant**2 + (share * ranges_m) ** 2 + (per_m * ranges_m**2) ** 2)
    return sigma
