# SPDX-License-Identifier: Apache-2.0
"""Fault effects on a measured distance."""

import numpy as np
from msgspec.structs import replace

from groundlink.messages.imagery import Range
from services.sensors.faults.offsets import Offsets, within_limits


def offset_range(reading: Range, offsets: Offsets) -> Range:
    """Add an offset to the distance."""
    range_m = np.array([reading.range_m]) + offsets(1, 1)[0]
    [limited_m] = within_limits(range_m, reading.min_range_m, reading.max_range_m).tolist()
    return replace(reading, range_m=limited_m)
