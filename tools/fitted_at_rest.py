# SPDX-License-Identifier: Apache-2.0
"""Writes docs/explanation/fitted-imus.md: ``python -m tools.fitted_at_rest FOLDER``.

The folder has the recordings by the names in `DEVICES`; those of IMUs are written by
`tools.recordings_at_rest`. None is part of the repository. Of each, the table compares the Allan
deviation of the recording with that of Groundlink's own IMU or receiver with the fitted sheet.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from groundlink.fitting import imu_sheet, receiver_sheet
from groundlink.fitting.allan import CurveFit
from groundlink.fitting.imu_sheet import read_readings
from groundlink.fitting.positions import Positions, read_positions
from groundlink.fitting.series import AllanBands, Reals, Series, allan_bands
from groundlink.loader.datasheets import load_datasheet
from services.sensors.gnss.spec import Gnss
from services.sensors.imu.spec import InertialUnit
from tools.at_rest import imu_at_rest, receiver_at_rest
from tools.plots.page_style import SERIES, label, save, side_by_side, styled

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "explanation" / "fitted-imus.md"
PICTURE = ROOT / "docs" / "pictures" / "imu_fitted.svg"

_PLACE = {"name": "sensor", "topic": "/topic", "frame": "frame"}

SECONDS = 3600.0
"""Length of the model's recordings, to make their own scatter small."""


class DeviceAtRest(NamedTuple):
    """A device with a recording at rest."""

    title: str
    file: str
    base: str
    source: str
    conditions: str


DEVICES = {
    "imu_vn100": DeviceAtRest(
        "VectorNav VN-100",
        "imu_vn100.csv",
        "imu_vn100",
        "Kiran1510/Robot-Sensing-and-Navigation (MIT), `Lab 3 IMU VectorNav VN100`, "
        "`stationary_data_5min_0.csv`",
        "On a table. Its gyroscope subtracts a bias of its own.",
    ),
    "imu_mpu9150": DeviceAtRest(
        "InvenSense MPU-9150",
        "imu_mpu9150.csv",
        "imu_mpu6000",
        "mikoff/imu-calib (MIT), `data/imu0.log` to `imu4.log`",
        "Five units, each put down some twelve times.",
    ),
    "imu_xsens_mti": DeviceAtRest(
        "Xsens MTi",
        "imu_xsens_mti.csv",
        "imu_mti1",
        "Kyle-ak/imu_tk (BSD), `bin/test_data/xsens_acc.mat` and `xsens_gyro.mat`",
        "Before the maker's calibration, put down 38 times.",
    ),
    "imu_auav_x21": DeviceAtRest(
        "AUAV-X2.1 autopilot",
        "imu_auav_x21.csv",
        "imu_mpu6000",
        "PX4/pyulog (BSD-3-Clause), `test/sample.ulg`, `sensor_combined`",
        "Its first IMU, of PX4's driver for MPU-6000 and ICM-20608, behind PX4's low pass.",
    ),
    "gnss_bu353n": DeviceAtRest(
        "GlobalSat BU-353N",
        "gnss_bu353n.mcap",
        "gnss_single_point",
        "Kiran1510/Robot-Sensing-and-Navigation (MIT), `Lab 1 GPS BU-353N`, "
        "`occluded_stationary__data_0.mcap`",
        "Between buildings.",
    ),
}
"""Devices by the name of their data sheet, without `_fitted`."""


class Group(NamedTuple):
    """Axes that are alike: what was fitted, and what the model with the sheet does."""

    title: str
    fit: CurveFit
    model: AllanBands


class RestComparison(NamedTuple):
    """A recording, and Groundlink's sensor with the fitted sheet."""

    seconds: float
    rate_hz: float
    groups: list[Group]


class Kind(NamedTuple):
    """How a kind of sensor is read, fitted and simulated."""

    read: Callable[[Path], tuple[Series, str]]
    """Returns the readings and the type of solution."""

    fit: Callable[[Series, str, Any], Mapping[str, CurveFit]]
    """Returns the fits by the field of the sheet."""

    simulate: Callable[[Mapping[str, Any], float], Series]
    """Returns readings of the figures of a sheet at a rate."""

    axes: Mapping[str, tuple[int, int]]
    titles: Mapping[str, str]


def _fit_imu(series: Series, _: str, base: Any) -> Mapping[str, CurveFit]:
    return {name: triad.curve for name, triad in imu_sheet.fit(series, base).items()}


def _fit_receiver(series: Series, solution: str, base: Any) -> Mapping[str, CurveFit]:
    return receiver_sheet.fit(Positions(series, solution, 0), base).curves


def _read_positions(path: Path) -> tuple[Series, str]:
    found = read_positions(path)
    return found.series, found.solution


KINDS = {
    "imu": Kind(
        lambda path: (read_readings(path), ""),
        _fit_imu,
        lambda figures, rate_hz: imu_at_rest(
            msgspec.convert(_PLACE | dict(figures) | {"rate_hz": rate_hz}, InertialUnit), SECONDS
        ),
        {"accelerometer": (0, 3), "gyroscope": (3, 6)},
        {"accelerometer": "accelerometer, m/s^2", "gyroscope": "gyroscope, rad/s"},
    ),
    "gnss": Kind(
        _read_positions,
        _fit_receiver,
        lambda figures, rate_hz: receiver_at_rest(
            msgspec.convert(_PLACE | dict(figures) | {"rate_hz": rate_hz}, Gnss), SECONDS
        ),
        receiver_sheet.GROUPS,
        {"horizontal": "east and north, m", "vertical": "altitude, m"},
    ),
}


def compare(name: str, folder: Path) -> RestComparison:
    """Return the Allan deviations of a device's recording and of its fitted sheet."""
    device, sheet = DEVICES[name], load_datasheet(f"{name}_fitted")
    kind = KINDS[sheet.kind]
    series, solution = kind.read(folder / device.file)
    fits = kind.fit(series, solution, load_datasheet(device.base))
    model = kind.simulate(sheet.figures, round(1 / series.period_s, 3))
    groups = [
        Group(kind.titles[field], fit, allan_bands(model.axes(*kind.axes[field])))
        for field, fit in fits.items()
    ]
    return RestComparison(series.seconds, 1 / series.period_s, groups)


def held_out(name: str, folder: Path) -> Reals:
    """Return the curve's deviation over that of a recording's second half, less 1, by band.

    The curve is fitted to the first half; bands with vibration are left out.
    """
    device = DEVICES[name]
    base = load_datasheet(device.base)
    kind = KINDS[base.kind]
    series, solution = kind.read(folder / device.file)
    first, second = series.halves()
    apart = []
    for field, fit in kind.fit(first, solution, base).items():
        bands = allan_bands(second.axes(*kind.axes[field]))
        expected = fit.curve.variance(bands.seconds)
        apart.append((np.sqrt(expected / bands.variance) - 1)[bands.is_noise])
    return np.concatenate(apart)


def rows(group: Group) -> Iterator[str]:
    """Yield the rows of a group's table."""
    bands = group.fit.bands
    # The model's recording is longer, so it has every band of the device's.
    model = np.sqrt(group.model.variance[: len(bands.seconds)])
    recorded = np.sqrt(bands.variance)
    for band, seconds in enumerate(bands.seconds):
        vibrates = "" if bands.is_noise[band] else "vibration"
        cells = [f"{seconds:.3g} s", f"{bands.clusters[band]:,}", f"{recorded[band]:.3g}"]
        cells += [f"{model[band]:.3g}", f"{model[band] / recorded[band] - 1:+.0%}", vibrates]
        yield "| " + " | ".join(cells) + " |"


def plot(found: Mapping[str, RestComparison]) -> Figure:
    """Return the Allan deviations of the IMUs: recording as dots, model as lines."""
    figure, axes = side_by_side(2, height=3.6)
    imus = {name: one for name, one in found.items() if name.startswith("imu_")}
    for (name, comparison), color in zip(imus.items(), SERIES, strict=False):
        for one, group in zip(axes, comparison.groups, strict=True):
            _draw(one, group, color, DEVICES[name].title)
    label(axes[0], "Accelerometer", "averaging time, s", "Allan deviation, m/s²")
    label(axes[1], "Gyroscope", "averaging time, s", "Allan deviation, rad/s")
    axes[0].legend()
    return figure


def _draw(axes: Axes, group: Group, color: str, title: str) -> None:
    bands, count = group.fit.bands, len(group.fit.bands.seconds)
    recorded = np.sqrt(bands.variance)
    for kept, face in ((bands.is_noise, color), (~bands.is_noise, "none")):
        axes.loglog(bands.seconds[kept], recorded[kept], "o", color=color, markerfacecolor=face)
    axes.loglog(bands.seconds, np.sqrt(group.model.variance[:count]), color=color, label=title)


_HEAD = """\
# IMUs and satellite receivers fitted to recordings

For users who want a sensor with the noise of a real device, or who want to fit a sheet to their
own device. The tables compare the Allan deviation of a recording at rest with that of Groundlink's
sensor with the fitted sheet, for each averaging time with at least ten independent means.

**Method.** `groundlink fit` ([reference](../reference/commands.md#groundlink-fit)) computes the
overlapping Allan variance of each axis and takes the mean of axes that are alike. It fits the sum
of white noise, wandering bias (a Gauss-Markov process), random walk, and rounding, with the low
pass if there is one. `groundlink/fitting/allan.py` has the formulas. A parameter is fitted if the
recording shows it; otherwise the value of the base sheet stays, and the sheet says so. Beside each
fitted parameter the sheet has its error, 1 sigma.

**Vibration.** The variance of noise falls by at most half from one averaging time to its double.
Where it falls by more, the device was shaken. Such bands are left out of the fit and marked in the
tables.

**Held out.** With curves fitted to the first half of each recording, {within} of the {bands} bands
of the second halves are within 20 %, and the median difference is {percent:.0f} %.

**Limits.** The recordings last one to six minutes, so none shows the time constant of a wandering
bias of minutes, or a random walk. A turn-on bias from one unit has an error of 41 %. A receiver
that smooths its positions has errors that grow faster than those of white noise and drift
together: of a u-blox ZED-F9P without corrections (gpsd, `test/daemon/ublox-zed-f9p_hpg1.11.log`)
the fit is up to 74 % off, so no sheet of it is shipped. `groundlink fit` prints the difference of
each band.

**Fit your own.** [Add the noise of your device](../how-to/device-noise.md#fit-a-recording).

![Allan deviation of four IMUs](../pictures/imu_fitted.svg)

Dots are the recordings, hollow where they have vibration; lines are the model. This page is written
by `python -m tools.fitted_at_rest FOLDER`, after `python -m tools.recordings_at_rest FOLDER` has
made CSV files of the originals. The recordings are not part of Groundlink.
"""

_SECTION = """
## {device.title}

`datasheet: {name}_fitted`. Recording: {device.source}. {seconds:.0f} s at {rate_hz:.0f} Hz.
{device.conditions} Made by

    groundlink fit {device.file} --sheet {device.base} --out {name}_fitted.yaml
"""

_TABLE = """
| {title} | means | recorded | model | difference | |
|--:|--:|--:|--:|--:|---|
"""


def main(arguments: list[str]) -> None:
    """Write the page and its picture."""
    (folder,) = map(Path, arguments)
    found = {name: compare(name, folder) for name in DEVICES}
    apart = np.abs(np.concatenate([held_out(name, folder) for name in DEVICES]))
    page = _HEAD.format(
        within=np.sum(apart <= 0.2), bands=len(apart), percent=100 * float(np.median(apart))
    )
    for name, one in found.items():
        page += _SECTION.format(
            device=DEVICES[name], name=name, seconds=one.seconds, rate_hz=one.rate_hz
        )
        for group in one.groups:
            page += _TABLE.format(title=group.title) + "\n".join(rows(group)) + "\n"
    PAGE.write_text(page)
    with styled():
        save(plot(found), PICTURE)
    print(f"wrote {PAGE} and {PICTURE}: {PICTURE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
