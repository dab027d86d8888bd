# SPDX-License-Identifier: Apache-2.0
"""Fault effects on wheel counters."""

import numpy as np
from msgspec.structs import replace

from groundlink.messages.base import WheelEncoders
from services.sensors.faults.offsets import Offsets
from services.sensors.runtime.wheel_counters import wrapped


def offset_ticks(reading: WheelEncoders, offsets: Offsets) -> WheelEncoders:
    """Add whole ticks to each counter."""
    more = np.rint(offsets(1, len(reading.ticks))[0]).tolist()
    ticks = tuple(wrapped(t + int(m)) for t, m in zip(reading.ticks, more, strict=True))
    return replace(reading, ticks=ticks)
