# SPDX-License-Identifier: Apache-2.0
"""Data sheets of IMUs from recordings at rest.

Of each triad of axes the white noise, the wandering bias and the random walk are fitted to the mean
Allan variance of the axes. The quantization step is read off the readings. The constant bias of the
gyroscope is the root mean square over the axes; that of the accelerometer cannot be told from
gravity. Scale errors, misalignment and effects of the temperature do not show at rest.
"""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.loader.datasheets import CheckedDatasheet
from groundlink.ros.types import nanos

from .allan import DRIFT_PEAK, CurveFit, NoiseCurve, allan_table, fit_curves
from .messages import MESSAGES, UNREADABLE, found_file, one_topic
from .series import Reals, Series, allan_bands, of_samples, step
from .sheet_file import FittedSheet, short

IMU = "sensor_msgs/msg/Imu"

TRIADS = {
    "accelerometer": ("linear_acceleration", "m/s^2"),
    "gyroscope": ("angular_velocity", "rad/s"),
}
"""Field of the message and unit by the field of the sheet, in the order of the series' axes."""

TIMES = {"stamp": 1 / NANOS, "t": 1.0}
"""Seconds of the unit of a CSV file's column of times, by its name."""

CHOICES = [
    (*levels, *low_pass)
    for low_pass in ((), ("low_pass_hz",))
    for levels in (
        ("white",),
        ("white", "drift"),
        ("white", "drift", "walk"),
        ("white", "drift", "time_s"),
        ("white", "drift", "time_s", "walk"),
    )
]

FIELDS = {
    "white": ("noise_density", 1.0),
    "drift": ("bias_instability", DRIFT_PEAK),
    "time_s": ("bias_time_constant_s", 1.0),
    "walk": ("random_walk", 1.0),
    "low_pass_hz": ("bandwidth_hz", 1.0),
}
"""Field of the sheet by that of `NoiseCurve`, and its value over the curve's."""


class TriadFit(NamedTuple):
    """What a recording says about a triad of axes."""

    curve: CurveFit
    step: float
    """Quantization step; 0 for none."""

    mean: Reals
    """Mean of each axis, shape (3,)."""


def fit_sheet(recording: Path, topic: str | None, base: CheckedDatasheet) -> FittedSheet:
    """Return the sheet of a recording, a `Fitter`.

    Raises
    ------
    UserError
        as `read_readings` does.
    """
    return fitted_sheet(read_readings(recording, topic), base)


def fitted_sheet(readings: Series, base: CheckedDatasheet) -> FittedSheet:
    """Return a base sheet's figures with those of a recording in their place."""
    found = fit(readings, base)
    figures, notes = dict(base.figures), {}
    printed, document = [], {}
    for name, triad in found.items():
        fields = fitted_fields(name, triad)
        figures[name] = figures.get(name, {}) | fields
        kept = [field for field, _ in FIELDS.values() if field not in fields]
        notes[name] = [
            *allan_table(f"the {name}, {TRIADS[name][1]}", triad.curve, "xyz"),
            f"Fitted: {_fitted(triad, fields)}.",
            *(
                [f"The base's, as the recording does not show them: {', '.join(kept)}."]
                if kept
                else []
            ),
        ]
        printed += notes[name]
        document[name] = {"figures": fields, "bands": triad.curve.rows()}
    size = (
        f"{readings.seconds:.0f} s at rest, {readings.readings} readings at "
        f"{1 / readings.period_s:.4g} Hz, {len(readings.segments)} segment(s)"
    )
    return FittedSheet(
        "noise and bias", [f"Length: {size}."], figures, notes, [*printed, size], document
    )


def fit(readings: Series, base: CheckedDatasheet) -> dict[str, TriadFit]:
    """Return what a recording says about each triad, by its field in the sheet.

    Parameters
    ----------
    readings : Series
        Six axes: specific force (m/s^2), then angular rate (rad/s).
    base : CheckedDatasheet
        Values of what the recording is too short for.
    """
    sensor: Any = base.sensor()
    found = {}
    for number, name in enumerate(TRIADS):
        axes = readings.axes(3 * number, 3 * number + 3)
        values = np.concatenate(axes.segments)
        steps = [step(values[:, axis]) for axis in range(3)]
        found[name] = TriadFit(
            fit_curves(
                [allan_bands(axes)],
                [_curve(getattr(sensor, name), max(steps), readings.period_s)],
                CHOICES,
            )[0],
            max(steps),
            values.mean(axis=0),
        )
    return found


def _curve(noise: Any, rounding: float, period_s: float) -> NoiseCurve:
    """Return the errors of a sheet's triad, with the rounding of a recording."""
    values = {of: getattr(noise, field) / factor for of, (field, factor) in FIELDS.items()}
    return NoiseCurve(**values, rounding=rounding * (period_s / 12) ** 0.5)


def fitted_fields(name: str, triad: TriadFit) -> dict[str, float]:
    """Return the fields of the sheet's triad that the recording shows."""
    curve = triad.curve
    fields = {
        field: short(getattr(curve.curve, of) * factor)
        for of, (field, factor) in FIELDS.items()
        if of in curve.fitted
    }
    # Where no step shows, the noise of rounding is in the white noise.
    fields["resolution"] = short(triad.step)
    if name == "gyroscope":
        fields["turn_on_bias"] = short(float(np.sqrt(np.mean(triad.mean**2))))
    return fields


def _fitted(triad: TriadFit, fields: Mapping[str, float]) -> str:
    """Return the fitted fields with their errors."""
    errors = {FIELDS[of][0]: error for of, error in triad.curve.errors.items()}
    # A mean square of three numbers scatters by sqrt(2 / 3).
    errors["turn_on_bias"] = 0.41
    return ", ".join(
        f"{field} +-{100 * errors[field]:.0f} %" if field in errors else field for field in fields
    )


def read_readings(path: Path, topic: str | None = None) -> Series:
    """Return the readings of a recording: specific force in m/s^2, then angular rate in rad/s.

    Parameters
    ----------
    path : Path
        A bag or an MCAP file with sensor_msgs/Imu; or a CSV file with the columns
        `linear_acceleration.x` .. `angular_velocity.z` and `stamp` (ns) or `t` (s), as `groundlink
        export` writes it.
    topic : str or None
        Needed where a bag has several IMUs.

    Raises
    ------
    UserError
        when there are none, or too few, or nothing says which.
    """
    path = found_file(path)
    try:
        if path.suffix in MESSAGES:
            return _of_messages(path, topic)
        if path.suffix == ".csv":
            return _of_table(path)
    except UNREADABLE as error:
        raise UserError(f"{path}: cannot be read: {error}") from None
    raise UserError(f"{path}: expected a .bag, .db3, .mcap or .csv file, or the folder of a bag")


def _of_messages(path: Path, topic: str | None) -> Series:
    times, values = [], []
    for message in one_topic(path, lambda m: m.ros_type == IMU, topic, "sensor_msgs/Imu"):
        imu = message.content()
        times.append(nanos(imu.header.stamp))
        vectors = [getattr(imu, field) for field, _ in TRIADS.values()]
        values.append([part for v in vectors for part in (v.x, v.y, v.z)])
    # The differences of integers are exact; stamps in seconds as floats are not.
    seconds = (np.array(times, np.int64) - times[0]) / NANOS
    return of_samples(seconds, np.array(values, np.float64), str(path))


def _of_table(path: Path) -> Series:
    wanted = [f"{field}.{axis}" for field, _ in TRIADS.values() for axis in "xyz"]
    with path.open(newline="", encoding="utf-8") as file:
        names = next(csv.reader(file), [])
        times = [name for name in TIMES if name in names]
        missing = [name for name in wanted if name not in names] + ["stamp or t"] * (not times)
        if missing:
            raise UserError(
                f"{path}:1: no column {', '.join(missing)}; expected {', '.join(wanted)}, and "
                "stamp (nanoseconds) or t (seconds)"
            )
        columns = [names.index(name) for name in (times[0], *wanted)]
        try:
            table = np.loadtxt(file, delimiter=",", quotechar='"', usecols=columns, ndmin=2)
        except ValueError as error:
            raise UserError(f"{path}: not numbers: {error}") from None
    return of_samples((table[:, 0] - table[0, 0]) * TIMES[times[0]], table[:, 1:], str(path))
