# SPDX-License-Identifier: Apache-2.0
"""The function that fits a data sheet, by the kind of the sensor."""

from collections.abc import Callable, Mapping
from pathlib import Path

from groundlink.loader.datasheets import CheckedDatasheet

from . import imu_sheet, lidar_sheet, receiver_sheet
from .sheet_file import FittedSheet

Fitter = Callable[[Path, str | None, CheckedDatasheet], FittedSheet]
"""Takes a recording, the name of its topic or None, and the base sheet."""

FITTERS: Mapping[str, Fitter] = {
    "gnss": receiver_sheet.fit_sheet,
    "imu": imu_sheet.fit_sheet,
    "lidar": lidar_sheet.fit_sheet,
    "lidar_2d": lidar_sheet.fit_sheet,
}
