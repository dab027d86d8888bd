# SPDX-License-Identifier: Apache-2.0
"""Drawing: the three axes as lines over sim time."""

from services.view.drawing import Drawing, Track

from .message import MagneticField


def draw(drawing: Drawing, track: Track, path: str, message: MagneticField) -> None:
    """Plot the field."""
    at_nanos = drawing.sim_nanos(message.stamp_nanos)
    drawing.plots.add(f"{path}/field", at_nanos, message.field_t, ("x", "y", "z"))
