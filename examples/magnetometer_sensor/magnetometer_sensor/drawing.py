# SPDX-License-Identifier: Apache-2.0
"""Drawing: the three axes as lines over sim time."""

from __future__ import annotations

from services.view.drawing_context import DrawingContext, VehicleHistory

from .message import MagneticField


def draw(
    context: DrawingContext, history: VehicleHistory, path: str, message: MagneticField
) -> None:
    """Plot the field."""
    at_nanos = context.sim_nanos(message.stamp_nanos)
    context.plots.add(f"{path}/field", at_nanos, message.field_t, ("x", "y", "z"))
