# SPDX-License-Identifier: Apache-2.0
"""The function that fits a data sheet, by the kind of the sensor."""

from collections.abc import Callable, Mapping
from pathlib import Path

from groundlink.loader.datasheets import CheckedDatasheet

from . import fitted_sheet, inertial, receiver
from .sheet_file import FittedSheet

Fitter = Callable[[Path, str | None, CheckedDatasheet], FittedSheet]
"""Takes a recording, the name of its topic or None, and the base sheet."""

FITTERS: Mapping[str, Fitter] = {
    "gnss": receiver.fit_sheet,
    "imu": inertial.fit_sheet,
    "lidar": fitted_sheet.fit_sheet,
    "lidar_2d": fitted_sheet.fit_sheet,
}
