# SPDX-License-Identifier: Apache-2.0
"""A vehicle on a backend that touches what a test says."""

import numpy as np
import pytest

from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import floats
from services.physics.dynamics.backend import BASE, GRAVITY_MPS2
from services.physics.dynamics.bodies import ContactPoint
from services.physics.trials.track import FLOOR, NAME, put
from tests.services.physics.free_bodies import FreeBodies
from tests.services.physics.grounds import shipped

UP = (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)


def test_without_contacts_it_falls_and_turns_no_wheel() -> None:
    with put(shipped("rover"), new_backend=FreeBodies) as simulation:
        for _ in range(400):
            simulation.step()
        state = simulation.vehicle_states()[NAME]
    assert floats(state.base_velocity)[2] == pytest.approx(-GRAVITY_MPS2 * 400 * TICK_SECONDS)
    assert not np.any(floats(state.joint_positions))


def test_contacts_of_the_chassis_are_recorded_and_those_of_wheels_are_not() -> None:
    with put(shipped("rover"), new_backend=FreeBodies) as simulation:
        backend = simulation._backend
        assert isinstance(backend, FreeBodies)
        vehicle = simulation._vehicles[NAME]
        [floor] = simulation._statics
        of = vehicle.body
        wheel = ContactPoint(of, vehicle.articulated.joints[0].link, floor, ORIGIN, UP, 135.0)
        backend.touching = [wheel]
        simulation.step()
        assert simulation.vitals(0)[0].contacts == ()
        backend.touching = [wheel, ContactPoint(of, BASE, floor, ORIGIN, UP, 7.0)]
        simulation.step()
        [contact] = simulation.vitals(0)[0].contacts
    assert (contact.name, contact.force_n) == (FLOOR.name, 7.0)
