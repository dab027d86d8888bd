# SPDX-License-Identifier: Apache-2.0
"""Writes CSV files for `groundlink fit`: ``python -m tools.recordings_at_rest FOLDER``.

The folder has the original files of the recordings by the names below; they are not part of the
repository. Their sources are in `tools.fitted_at_rest`.
"""

import csv
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from groundlink.fitting.imu_sheet import TRIADS
from groundlink.fitting.series import Reals

COLUMNS = ["t", *(f"{field}.{axis}" for field, _ in TRIADS.values() for axis in "xyz")]

STILL_S = 0.25
"""Length of the windows that are at rest or not."""


def standstill(rates: Reals, rate_hz: float, least_s: float) -> NDArray[np.bool_]:
    """Return where a device that is turned and put down again and again rests, shape (n,).

    Windows whose standard deviation is at most three times that of the quietest, without the first
    and last of each rest.
    """
    size = int(rate_hz * STILL_S)
    windows = rates[: len(rates) // size * size].reshape(-1, size, rates.shape[1])
    loud = windows.std(axis=1).max(axis=1)
    quiet = loud < 3 * np.quantile(loud, 0.125)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(int), [0]]))).reshape(-1, 2)
    kept = np.zeros(len(rates), np.bool_)
    for first, last in edges:
        if (last - first - 2) * STILL_S >= least_s:
            kept[(first + 1) * size : (last - 1) * size] = True
    return kept


def vn100(folder: Path) -> Reals:
    """Return the readings in the device's own sentences, $VNYMR."""
    with (folder / "stationary_data_5min_0.csv").open(newline="") as file:
        rows = [
            [float(row["ros_t"]), *map(float, row["raw"].split("*")[0].split(",")[7:13])]
            for row in csv.DictReader(file)
        ]
    return np.array(rows)


def mpu9150(folder: Path) -> Reals:
    """Return the rests of five devices, 100 readings a second."""
    parts, begin = [], 0.0
    for number in range(5):
        values = np.loadtxt(folder / f"imu{number}.log")
        times = begin + np.arange(len(values)) * 0.01
        begin = times[-1] + 60
        parts.append(np.column_stack([times, values])[standstill(values[:, 3:], 100, 2)])
    return np.concatenate(parts)


def xsens_mti(folder: Path) -> Reals:
    """Return the rests of a device that sends the counts of its converter.

    Scales and biases of the accelerometer are those with which all rests measure gravity, by Gauss
    and Newton. The gyroscope has 6258 counts a rad/s about 32768 (imu_tk, test_imu_calib.cpp).
    """
    force, rate = (np.loadtxt(folder / f"xsens_{part}.mat") for part in ("acc", "gyro"))
    kept = standstill(rate[:, 1:], 100, 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], kept.astype(int), [0]]))).reshape(-1, 2)
    means = np.array([force[first:last, 1:].mean(axis=0) for first, last in edges])
    gravity = 9.81744
    bias, scale = np.full(3, 32768.0), np.full(3, gravity / 4000)
    for _ in range(50):
        felt = (means - bias) * scale
        size = np.linalg.norm(felt, axis=1, keepdims=True)
        slopes = np.hstack([-felt * scale / size, felt * (means - bias) / size])
        change = np.linalg.lstsq(slopes, gravity - size[:, 0])[0]
        bias, scale = bias + change[:3], scale + change[3:]
    parts = [force[:, :1], (force[:, 1:] - bias) * scale, (rate[:, 1:] - 32768) / 6258]
    readings: Reals = np.hstack(parts)[kept]
    return readings


def auav_x21(folder: Path) -> Reals:
    """Return the minute after the vehicle was put down. Needs pyulog."""
    from pyulog import ULog

    log = ULog(str(folder / "sample.ulg"), ["sensor_combined"])
    (data,) = (one.data for one in log.data_list)
    times = (data["timestamp"] - data["timestamp"][0]) * 1e-6
    names = [f"{part}[{i}]" for part in ("accelerometer_m_s2", "gyro_rad") for i in range(3)]
    readings: Reals = np.column_stack([times, *(data[name] for name in names)])[times > 9]
    return readings


RECORDINGS: dict[str, Callable[[Path], Reals]] = {
    "imu_vn100": vn100,
    "imu_mpu9150": mpu9150,
    "imu_xsens_mti": xsens_mti,
    "imu_auav_x21": auav_x21,
}
"""Readings by the name of the CSV file: seconds, m/s^2, rad/s."""


def main(arguments: list[str]) -> None:
    """Write the files into the folder of the originals."""
    (folder,) = map(Path, arguments)
    for name, read in RECORDINGS.items():
        file = folder / f"{name}.csv"
        readings = read(folder)
        readings[:, 0] -= readings[0, 0]
        np.savetxt(file, readings, "%.10g", ",", header=",".join(COLUMNS), comments="")
        print(f"wrote {file}: {len(readings)} readings")


if __name__ == "__main__":
    main(sys.argv[1:])
