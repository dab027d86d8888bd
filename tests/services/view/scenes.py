# SPDX-License-Identifier: Apache-2.0
"""A rover that drives straight on at 1 m/s, and a recording that only remembers."""

from collections import defaultdict
from typing import Any

import msgspec
import numpy as np
import rerun as rr
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.loader import load
from groundlink.messages.base import State, VehicleState, packed
from groundlink.messages.navigation import Odometry
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import Stream
from groundlink.world.actors import Actor, CrateForm, FreeMotion
from tests.system.rig import LAB

EPOCH = 1_700_000_000_000_000_000

NO_ERROR = memoryview(bytes(36 * 8))

SCENARIO = load(LAB)
CRATE = Actor(
    name="crate",
    form=CrateForm(material="wood"),
    motion=FreeMotion(at_m=(0.0, 0.0, 0.0), mass_kg=1.0),
)
WITH_CRATE = replace(SCENARIO, world=replace(SCENARIO.world, actors=(CRATE,)))


def state(tick: int, *, epoch: int = EPOCH, yaw: float = 0.0) -> State:
    """Return a state of the rover at 1 m/s along x from the origin."""
    seconds = tick * TICK_NANOS * 1e-9
    poses = np.zeros((5, 7))
    poses[:, 0] = seconds
    poses[:, 5:] = np.sin(yaw / 2), np.cos(yaw / 2)
    vehicle = VehicleState(
        packed(poses), packed(np.array([1.0, 0, 0, 0, 0, 0])), *(packed(np.zeros(4)),) * 2
    )
    return State("run", epoch, epoch, tick, tick * TICK_NANOS, "hash", {"rover": vehicle})


def truth(tick: int) -> Odometry:
    """Return the ground truth of that state."""
    pose = state(tick).vehicles["rover"].poses()[0].tolist()
    return Odometry(
        *(EPOCH + tick * TICK_NANOS, "world", "base_link", tuple(pose[:3]), tuple(pose[3:])),
        *((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), NO_ERROR, NO_ERROR),
    )


class Remembering:
    """Has what of a recording is used, and keeps what it was given by path."""

    def __init__(self) -> None:
        self.logged: dict[str, list[Any]] = defaultdict(list)
        self.columns: dict[str, int] = defaultdict(int)

    def log(self, path: str, drawn: rr.AsComponents, *, static: bool = False) -> None:
        assert drawn.as_component_batches(), path
        self.logged[path].append(drawn)

    def set_time(self, timeline: str, *, duration: np.timedelta64) -> None:
        assert timeline == "sim_time"

    def send_columns(self, path: str, indexes: Any, columns: Any) -> None:
        self.columns[path] += 1


class Nowhere:
    """A destination that keeps its recordings."""

    def __init__(self) -> None:
        self.recordings: list[Any] = []

    def new_recording(self) -> Any:
        self.recordings.append(Remembering())
        return self.recordings[-1]

    def alive(self) -> bool:
        return True

    def close(self) -> None:
        pass


def with_streams(*streams: dict[str, Any]) -> Scenario:
    """Return the laboratory with more streams on the rover."""

    rover = replace(SCENARIO.vehicles[0], streams=msgspec.convert(streams, tuple[Stream, ...]))
    return replace(SCENARIO, vehicles=(rover,))
