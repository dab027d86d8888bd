# SPDX-License-Identifier: Apache-2.0
"""Writes docs/explanation/fitted-lidars.md: ``python -m tools.fitted_lidars FOLDER``.

The folder has the recordings by the names in `DEVICES`; they are not part of the repository. Of
each, the table compares the recording's noise and dropout with those of Groundlink's receiver with
the fitted sheet, which gets the surfaces and intensities of the recording's windows. Both go
through the same statistics.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from matplotlib.figure import Figure
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.fitting import echo_statistics as statistics
from groundlink.fitting.echo_statistics import WINDOW, Bands, Shots, Windows
from groundlink.fitting.firings import Firings
from groundlink.fitting.lidar_sheet import EchoFit, echo_bands, fit
from groundlink.fitting.recordings import read_firings
from groundlink.loader.datasheets import load_datasheet
from groundlink.scenario.rotating_lidar import EchoBands
from services.sensors.lidar.spec import Lidar
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rays.scene import Hits
from services.sensors.scanning.beams import Rays
from services.sensors.scanning.draws import RevolutionDraws
from services.sensors.scanning.foreign_light import ForeignLight
from services.sensors.scanning.returns import LidarReceiver
from services.sensors.scanning.stray_light import StrayLight
from services.sensors.scanning.sweep import Sweep
from tools.plots.page_style import SERIES, label, save, styled

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "explanation" / "fitted-lidars.md"
PICTURE = ROOT / "docs" / "pictures" / "lidar_fitted.svg"

_NEBULA_VELODYNE = "tier4/nebula (Apache-2.0), `nebula_velodyne`, `decoder_ground_truth/{}`"
_NEBULA_HESAI = "tier4/nebula (Apache-2.0), `nebula_hesai`, `decoder_ground_truth/{}`"

LEAST_LOST = 0.01
"""Share of lost returns from which on a band is in the table."""

ROUNDS = 4
"""Times that the receiver measures each window, to make its own scatter small."""


class RecordedDevice(NamedTuple):
    """A device with a recording."""

    title: str
    file: str
    source: str


DEVICES = {
    "vlp16": RecordedDevice(
        "Velodyne VLP-16", "vlp16.db3", _NEBULA_VELODYNE.format("vlp16/1673400471837873222")
    ),
    "vlp32c": RecordedDevice(
        "Velodyne VLP-32C", "vlp32c.db3", _NEBULA_VELODYNE.format("vlp32/1713492677464078412")
    ),
    "vls128": RecordedDevice(
        "Velodyne VLS-128", "vls128.db3", _NEBULA_VELODYNE.format("vls128/1614315746471294674")
    ),
    "xt32": RecordedDevice(
        "Hesai PandarXT-32", "xt32.db3", _NEBULA_HESAI.format("xt32/1673400677802009732")
    ),
    "pandar64": RecordedDevice(
        "Hesai Pandar64", "pandar64.db3", _NEBULA_HESAI.format("64/1673403880599376836")
    ),
    "pandar_qt64": RecordedDevice(
        "Hesai PandarQT64", "pandar_qt64.db3", _NEBULA_HESAI.format("qt64/1673401195788312575")
    ),
    "os1_128": RecordedDevice(
        "Ouster OS1-128",
        "os1_128.osf",
        "ouster-lidar/ouster-sdk (BSD-3-Clause), `tests/osfs/OS-1-128_v2.3.0_1024x10_lb_n3.osf`",
    ),
}
"""Devices by the name of their data sheet, without `_fitted`."""


class FitComparison(NamedTuple):
    """Noise and dropout of a recording and of the model, in the same bands."""

    recorded: EchoFit
    noise: Bands
    dropout: Bands


def compare(name: str, folder: Path) -> FitComparison:
    """Return the statistics of a device's recording and of its fitted sheet."""
    recorded = fit(read_firings(folder / DEVICES[name].file), name)
    again, lost = measured(_sheet(name), recorded.windows)
    noise = statistics.noise_bands(statistics.find_windows(again))
    return FitComparison(recorded, noise, statistics.dropout_bands(lost))


def held_out(name: str, folder: Path) -> NDArray[np.float64]:
    """Return the model's noise over that of a recording's second half, less 1, by band.

    The sheet is fitted to the first half; only bands that both halves have are compared.
    """
    firings = read_firings(folder / DEVICES[name].file)
    middle = len(firings.range_m) // 2
    first, second = (
        fit(Firings(firings.range_m[half], firings.intensity[half], firings.step_rad), name)
        for half in (slice(0, middle), slice(middle, None))
    )
    spec = replace(_sheet(name), echo_bands=msgspec.convert(echo_bands(first), EchoBands))
    again, _ = measured(spec, second.windows)
    model = statistics.noise_bands(statistics.find_windows(again))
    places = np.meshgrid(second.noise.intensity, second.noise.range_m, indexing="ij")
    of_model, of_first = (
        statistics.at_bands(bands, places[0].ravel(), places[1].ravel())
        for bands in (model, first.noise)
    )
    difference = of_model / second.noise.value.ravel() - 1
    both: NDArray[np.float64] = difference[np.isfinite(of_first) & np.isfinite(difference)]
    return both


def _sheet(name: str) -> Lidar:
    """Return the LiDAR of a fitted data sheet."""
    place = {"name": "lidar", "topic": "/points", "frame": "lidar"}
    return msgspec.convert(load_datasheet(f"{name}_fitted").figures | place, Lidar)


def measured(spec: Lidar, windows: Windows) -> tuple[Firings, Shots]:
    """Return what the receiver of a sheet measures of the windows' surfaces.

    Light that the recording has is light here: every surface is seen perpendicularly, with the
    reflectivity that gives its intensity, and the threshold of power is off.
    """
    spec = replace(spec, full_range_reflectivity=0.0, min_range_m=0.0, laser_bias_m=0.0)
    sweep, streams = Sweep(spec), RandomStreams(1, "fitted/lidar")
    reflectance = _reflectance()
    receiver = LidarReceiver(
        *(spec, sweep, reflectance, None, StrayLight(spec, sweep.rings)),
        *(ForeignLight(spec, None, 0), streams, RevolutionDraws(streams)),
    )
    lasers, firings = len(sweep.rings), sweep.seconds.shape[1] // WINDOW * WINDOW
    size = lasers * firings // WINDOW
    count = len(windows.laser) * ROUNDS
    chosen = np.resize(np.arange(len(windows.laser)), -(-count // size) * size)
    ranges, lights, returned = [], [], []
    for turn, own in enumerate(chosen.reshape(-1, size)):
        shape = lasers, firings
        true = windows.curve_m[own].reshape(shape).astype(np.float32)
        labels = np.rint(windows.intensity[own]).astype(np.int32).reshape(shape)
        made = receiver.measure(*_seen(true, labels), range(firings), turn)
        ranges.append(made.range_m[0].T)
        lights.append(made.intensity[0].T)
        returned.append(made.returned[0].T)
    all_ranges, light = np.concatenate(ranges).astype(float), np.concatenate(lights).astype(float)
    is_there = np.concatenate(returned)
    shots = Shots(all_ranges.ravel(), light.ravel(), ~is_there.ravel())
    return Firings(np.where(is_there, all_ranges, 0), light, 1.0), shots


def _reflectance() -> NDArray[np.float32]:
    """Return the reflectance that a calibrated receiver reports as 0, 1 .. 255."""
    reported = np.arange(256.0)
    retro = (reported - 101 + 0.25) / 154 * 1000
    return np.where(reported <= 100, reported / 100, np.maximum(retro, 1.01)).astype(np.float32)


def _seen(true: NDArray[np.float32], labels: NDArray[np.int32]) -> tuple[Hits, Rays]:
    """Return hits at these ranges, each perpendicular to its ray."""
    along = np.zeros((3, *true.shape), np.float32)
    along[0] = 1
    hits = Hits(true, -along, labels, np.full(true.shape, -1, np.int32))
    return hits, Rays(np.zeros_like(along), along, np.zeros(true.shape, np.float32))


def rows(found: FitComparison) -> Iterator[str]:
    """Yield the rows of a device's table."""
    recorded = found.recorded
    for i, j in zip(*np.nonzero(np.isfinite(recorded.noise.value)), strict=True):
        intensity, range_m = recorded.noise.intensity[i], recorded.noise.range_m[j]
        own, model = recorded.noise.value[i, j], _at(found.noise, intensity, range_m)
        lost = _at(recorded.dropout, intensity, range_m)
        cells = [f"{intensity:.0f}", f"{range_m:.1f} m", f"{recorded.noise.data[i, j]:,}"]
        cells += [f"{1e3 * own:.1f} mm", f"{1e3 * model:.1f} mm", f"{model / own - 1:+.0%}"]
        if lost >= LEAST_LOST:
            cells += [f"{lost:.1%}", f"{_at(found.dropout, intensity, range_m):.1%}"]
        else:
            cells += ["", ""]
        yield "| " + " | ".join(cells) + " |"


def _at(bands: Bands, intensity: float, range_m: float) -> float:
    if not bands.value.size:
        return float("nan")
    return float(statistics.at_bands(bands, np.array([intensity]), np.array([range_m]))[0])


def plot(found: dict[str, FitComparison]) -> Figure:
    """Return the noise over intensity, at the range with most windows: recording and model."""
    figure = Figure(figsize=(11.2, 5.4))
    axes = list(figure.subplots(2, 4, sharex=True, sharey=True).ravel())
    for one, (name, comparison) in zip(axes, found.items(), strict=False):
        noise = comparison.recorded.noise
        for column, color in zip(range(len(noise.range_m)), SERIES, strict=False):
            known = np.isfinite(noise.value[:, column])
            intensity, range_m = noise.intensity[known], noise.range_m[column]
            model = [_at(comparison.noise, light, range_m) for light in intensity]
            one.loglog(intensity, 1e3 * noise.value[known, column], "o", color=color)
            one.loglog(intensity, 1e3 * np.array(model), color=color, label=f"{range_m:.0f} m")
        label(one, DEVICES[name].title, "", "")
        one.legend()
    for one in axes[len(found) :]:
        one.set_visible(False)
    for one in axes[4:]:
        one.set_xlabel("intensity")
    for one in axes[::4]:
        one.set_ylabel("1 sigma, mm")
    return figure


_HEAD = """\
# LiDARs fitted to recordings

For users who want a sensor with the noise of a real device, or who want to fit a sheet to their
own device. Each sheet here has `echo_bands` from a recording of its device: noise and dropout by
intensity and range. The tables compare the recording with Groundlink's receiver of that sheet, in
every band with at least 100 windows.

**Method.** `groundlink fit` ([reference](../reference/commands.md#groundlink-fit)) takes windows of
five firings of one laser. On a plane, 1 / range is a parabola over a few firings. The median of the
residuals' mean square over the windows of a band gives the white noise; errors that last longer
than five firings are not in it. Bands whose windows are a mixture of smooth and rough surfaces are
left out. A lost return is a firing without one between six firings that lie on one smooth surface.
`groundlink/fitting/echo_statistics.py` has the formulas. For the model's figure the receiver gets
the recording's surfaces and intensities, and its output goes through the same statistics.

**Held out.** With sheets fitted to the first half of each recording, {within} of the {bands} bands
of the second halves are within 20 %, and the median difference is {percent:.0f} %.

**Limits.** The recordings last 0.3 to 0.5 s. A texture of the ground that changes from firing to
firing counts as noise: the recordings of the OS1-128 and the VLS-128 are from outdoors, and their
noise beyond 10 m has such a texture in it. Where a table has no band of a range, the value is that
of the nearest range. The recordings are not part of Groundlink.

**Fit your own.** Record the device at rest, in a room with bright and dark walls at several ranges:

    groundlink fit my_device.mcap --topic /points --sheet vlp16 --out my_vlp16.yaml

[IMUs and satellite receivers](fitted-imus.md) are fitted to recordings at rest.

![Noise of seven devices by intensity](../pictures/lidar_fitted.svg)

Dots are the recordings, lines the model, by range. Shares of lost returns are given where the
recording has at least 1 %. This page is written by `python -m tools.fitted_lidars FOLDER`.
"""

_TABLE = """
| intensity | range | windows | recorded | model | difference | lost, recorded | lost, model |
|--:|--:|--:|--:|--:|--:|--:|--:|
"""


def main(arguments: list[str]) -> None:
    """Write the page and its picture."""
    (folder,) = arguments
    found = {name: compare(name, Path(folder)) for name in DEVICES}
    apart = np.abs(np.concatenate([held_out(name, Path(folder)) for name in DEVICES]))
    page = _HEAD.format(
        within=np.sum(apart <= 0.2), bands=len(apart), percent=100 * float(np.median(apart))
    )
    for name, comparison in found.items():
        device = DEVICES[name]
        page += f"\n## {device.title}\n\n`datasheet: {name}_fitted`. Recording: {device.source}.\n"
        page += _TABLE + "\n".join(rows(comparison)) + "\n"
    PAGE.write_text(page)
    with styled():
        save(plot(found), PICTURE)
    print(f"wrote {PAGE} and {PICTURE}: {PICTURE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
