# SPDX-License-Identifier: Apache-2.0
"""Small scenarios and states for sensor models: one vehicle that moves as a test says."""

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import State, VehicleState, packed
from groundlink.scenario.schema import Scenario
from tools.plots.cart import cart_model

EPOCH_NANOS = 1_700_000_000_000_000_000
WHEELS = ("front_left", "front_right")

Floats = NDArray[np.float64]


def scenario(*, seed: int = 1, frame_prefix: str = "") -> Scenario:
    """Return a scenario with one two-wheeled vehicle, `rover`, in an empty world."""
    document: dict[str, Any] = {
        "name": "test",
        "seed": seed,
        "world": {"name": "empty", "materials": {}},
        "vehicles": [
            {
                "name": "rover",
                "frame_prefix": frame_prefix,
                "model": cart_model(WHEELS, drive="skid_steer"),
            }
        ],
    }
    return msgspec.convert(document, Scenario)


def states(
    positions: ArrayLike,
    quaternions: ArrayLike = (0.0, 0.0, 0.0, 1.0),
    *,
    joint_positions: Sequence[Sequence[float]] | Floats = (),
    first_tick: int = 0,
) -> Iterator[State]:
    """Yield one state a tick.

    Parameters
    ----------
    positions, quaternions
        world_from_base of each tick: shape (ticks, 3) and (ticks, 4) or (4,).
    joint_positions
        Of the wheels, shape (ticks, wheels).
    """
    places = np.asarray(positions, np.float64)
    turns = np.broadcast_to(np.asarray(quaternions, np.float64), (len(places), 4))
    poses = np.concatenate([places, turns], axis=1)
    for i, pose in enumerate(poses):
        joints = np.asarray(joint_positions[i] if len(joint_positions) else (), np.float64)
        yield State(
            run="test",
            episode=EPOCH_NANOS,
            epoch_nanos=EPOCH_NANOS,
            tick=first_tick + i,
            sim_nanos=(first_tick + i) * TICK_NANOS,
            world_hash="",
            vehicles={
                "rover": VehicleState(
                    link_poses=packed(pose),
                    base_velocity=packed(np.zeros(6)),
                    joint_positions=packed(joints),
                    joint_velocities=packed(np.zeros_like(joints)),
                )
            },
        )
