# SPDX-License-Identifier: Apache-2.0
"""Memory of a vehicle: all that its next tick depends on, as plain data."""

from msgspec import Struct
from msgspec.structs import replace

from services.physics.dynamics.backend import Pose, Twist
from services.physics.dynamics.chassis_contacts import NamedContact
from services.physics.running_gear.running_gear import GroundContact

from .controller import ControllerMemory
from .servos import ServosMemory


class VehicleMemory(Struct, frozen=True, array_like=True):
    """Inner state of a vehicle between two ticks."""

    pose: Pose
    """Of its center of mass, in the world."""

    twist: Twist
    springs: tuple[tuple[float, float], ...]
    """Position (m) and velocity (m/s) of each wheel along the base's z."""

    ground_contacts: tuple[GroundContact | None, ...]
    """Of the wheels, in the last step."""

    roughness_under: tuple[float, ...]
    """Of the ground that each wheel touched in the last step; empty without roughness."""

    bumper_points: int
    """Number of contact points that share the bumper; 0 without a bumper."""

    contacts: tuple[NamedContact, ...]
    """Of the chassis, since they were last reported."""

    drive: ControllerMemory
    servos: ServosMemory
    numbers: tuple[float, ...]
    """Of all other parts, see `numbers_of`."""

    def stamped_before(self, nanos: int) -> "VehicleMemory":
        """Return it without commands that have this stamp or a later one."""
        drive, servos = self.drive.stamped_before(nanos), self.servos.stamped_before(nanos)
        return replace(self, drive=drive, servos=servos)
