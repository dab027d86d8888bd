# SPDX-License-Identifier: Apache-2.0
"""Specification of wheel encoders in a scenario. The defaults are those of ideal ones."""

from typing import ClassVar

from groundlink.messages.base import WheelEncoders
from groundlink.scenario.every_sensor import Carrier
from groundlink.scenario.faults import EACH_WHEEL, Quantity
from groundlink.scenario.wheel_encoders import IncrementalEncoders


class Encoders(IncrementalEncoders, frozen=True, tag="encoders"):
    """Incremental encoders, counted by the motor controller.

    They are on every driven wheel, on each track's sprocket, or on the wheels of a car that are not
    steered.
    """

    quantities: ClassVar = {"ticks": Quantity("ticks", EACH_WHEEL)}

    def largest_message(self, carrier: Carrier) -> WheelEncoders:
        """Return the counters of all shafts."""
        frame, shafts = carrier.frame_prefix + self.frame, carrier.shafts
        return WheelEncoders(0, frame, shafts, (0,) * len(shafts))
