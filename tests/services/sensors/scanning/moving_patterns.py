# SPDX-License-Identifier: Apache-2.0
"""Checks of patterns that do not repeat themselves, on a vehicle that drives and turns."""

from typing import Any

import numpy as np

from tests.services.sensors.lidar import rooms


def check_blocks_of_a_drive(fields: dict[str, Any]) -> None:
    """Check that blocks have the points of whole messages, and that these lie on the walls."""
    way = rooms.driving(speed_mps=2.0, turn_radps=1.0)
    whole = rooms.clouds(rooms.scenario(**fields), way, 81)
    blocks = rooms.clouds(rooms.scenario(**fields, block_deg=45.0), way, 81)
    assert (len(whole), len(blocks)) == (2, 16)
    for number, cloud in enumerate(whole):
        parts = [block.records() for block in blocks[8 * number : 8 * number + 8]]
        for field in ("x", "y", "z", "ring"):
            np.testing.assert_array_equal(cloud.records()[field], np.concatenate(parts)[field])
        points = rooms.in_world(way, rooms.sim_seconds(cloud), rooms.points(cloud))
        assert len(points) > 15_000
        assert rooms.off_the_walls(points).max() < 1e-4
