# SPDX-License-Identifier: Apache-2.0
"""World replica: a sensor's copy of the world and of the motion of its vehicles and actors.

It is built from the scenario and updated only by states. LiDARs and cameras share this class.
"""

import math
from collections import deque
from typing import ClassVar, NamedTuple

import numpy as np
from msgspec import UnsetType

from groundlink.core.clock import TICK_NANOS
from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats, matrix_from_quaternion, nlerp
from groundlink.messages.base import BadBusMessage, Ruts, State
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scene.bodies import link_solids as links_of
from groundlink.scene.build import solids
from groundlink.world.actors import form_solids
from groundlink.world.ruts import NO_RUTS, TILE, RutGrid
from groundlink.world.solids import Box, Cylinder, Mesh, Solid, Sphere
from groundlink.world.terrain import load_ground

POSE_BYTES = 7 * 8
"""Columns of a pose in a state: position and quaternion, float64."""

_NOTHING = memoryview(b"")


class _Joined(NamedTuple):
    """Poses of all links of a scenario in a state, one after the other."""

    state: State
    scenario: Scenario
    poses: Floats


class WorldReplica:
    """World around one sensor.

    Parameters
    ----------
    scenario : Scenario
    vehicle : Vehicle
        Vehicle of the sensor; it is as solid as the other vehicles.
    mount : Mount
        Mount of the sensor. Visuals of the link that enclose its place are the sensor's housing.
        They are left out so that they do not block the view.

    Attributes
    ----------
    static : tuple of Solid
        Static solids of the world.
    links : list of list of Solid
        Solids of all vehicles' links, then of the actors, in the scenario's order, each in its own
        frame.
    movers : list of str
        Name of each link's vehicle, or of the actor.
    carrier : int
        Index of the link that the sensor is mounted on.
    ruts : RutGrid or None
        Of soft terrain, as of the last `press`.
    """

    _newest: ClassVar[_Joined | None] = None
    """Shared by the sensors of a process: joining poses takes longer with each vehicle."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, mount: Mount) -> None:
        self._scenario = scenario
        self.static = solids(scenario)
        self.links: list[list[Solid]] = []
        self.movers: list[str] = []
        self._bytes_of: dict[str, int] = {}
        for other in scenario.vehicles:
            links = links_of(other.model)
            if other.name == vehicle.name:
                place = other.model.link_of(mount)
                self.carrier = len(self.links) + place
                links[place] = [s for s in links[place] if not _encloses(s, mount.xyz_m)]
            self.links += links
            self.movers += [other.name] * len(links)
            self._bytes_of[other.name] = POSE_BYTES * len(links)
        actors = scenario.world.actors
        self.links += [form_solids(actor.form) for actor in actors]
        self.movers += [actor.name for actor in actors]
        self._bytes_of_actors = POSE_BYTES * len(actors)
        self._sizes = [*self._bytes_of.values(), self._bytes_of_actors]
        terrain, materials = scenario.world.terrain, scenario.world.materials
        self.ruts: RutGrid | None = None
        if terrain and terrain.is_soft(materials):
            self.ruts = RutGrid(*load_ground(terrain).grid)
        self._rut_changes: deque[tuple[int, Ruts | UnsetType]] = deque()
        self._known_ruts, self._has_new_ruts = NO_RUTS, False
        self.restart()

    def restart(self) -> None:
        """Forget all states; ruts stay."""
        if self._rut_changes:
            self._apply_ruts(self._rut_changes[-1][0])
        self._first_tick = 0
        self._poses: list[Floats] = []

    def take(self, state: State) -> None:
        """Store the pose of every link at the next tick.

        Raises
        ------
        BadBusMessage
            when a vehicle, a link or an actor is missing, or a rut lies beside the terrain.
        """
        if self.ruts is not None:
            self._take_ruts(self.ruts, state)
        newest = WorldReplica._newest
        if newest is None or newest.state is not state or newest.scenario is not self._scenario:
            WorldReplica._newest = newest = _Joined(state, self._scenario, self._joined(state))
        if not self._poses:
            self._first_tick = state.tick
        self._poses.append(newest.poses)

    def _joined(self, state: State) -> Floats:
        vehicles = map(state.vehicles.get, self._bytes_of)
        rows = [vehicle.link_poses if vehicle else _NOTHING for vehicle in vehicles]
        rows.append(state.actors)
        if [row.nbytes for row in rows] != self._sizes:
            expected = {**self._bytes_of, "actors": self._bytes_of_actors}
            for row, (name, size) in zip(rows, expected.items(), strict=True):
                if row.nbytes != size:
                    raise BadBusMessage(
                        f"state of tick {state.tick}: expected {size // POSE_BYTES} link poses "
                        f"of `{name}`"
                    )
        return np.frombuffer(b"".join(rows), np.float64).reshape(-1, 7)

    def _take_ruts(self, grid: RutGrid, state: State) -> None:
        digest = state.ruts.digest if state.ruts else NO_RUTS
        if digest == self._known_ruts:
            return
        if state.ruts and not grid.are_on_map(np.frombuffer(state.ruts.tiles, TILE)):
            raise BadBusMessage(f"state of tick {state.tick}: a rut lies beside the terrain")
        self._known_ruts = digest
        self._rut_changes.append((state.tick, state.ruts))

    def press(self, tick: int) -> bool:
        """Let the terrain have the ruts of a tick; return if they differ from the last call's."""
        self._apply_ruts(tick)
        changed, self._has_new_ruts = self._has_new_ruts, False
        return changed

    def _apply_ruts(self, tick: int) -> None:
        changes = self._rut_changes
        while self.ruts is not None and changes and changes[0][0] <= tick:
            _, ruts = changes.popleft()
            if not ruts or ruts.before == NO_RUTS:
                self.ruts.clear()
            if ruts:
                self.ruts.put(np.frombuffer(ruts.tiles, TILE))
            self._has_new_ruts = True

    def motion(self, first_tick: int, last_tick: int) -> Floats:
        """Return world_from_link for a range of ticks, shape (ticks, links, 7).

        Ticks before the first or after the last known state get the pose of the nearest known tick.
        """
        first, newest = first_tick - self._first_tick, len(self._poses) - 1
        ticks = range(first, first + last_tick - first_tick + 1)
        return np.stack([self._poses[min(max(tick, 0), newest)] for tick in ticks])

    def at(self, nanos: int) -> Floats:
        """Return world_from_link at a sim time, interpolated between states, shape (links, 7)."""
        tick, beyond = divmod(nanos, TICK_NANOS)
        before, after = self.motion(tick, tick + 1)
        share = np.array(beyond / TICK_NANOS)
        positions = before[:, :3] + share * (after[:, :3] - before[:, :3])
        return np.hstack([positions, nlerp(before[:, 3:], after[:, 3:], share)])

    def forget(self, before_tick: int) -> None:
        """Drop the states of earlier ticks."""
        dropped = min(max(0, before_tick - self._first_tick), len(self._poses))
        del self._poses[:dropped]
        self._first_tick += dropped


def _encloses(solid: Solid, point: Vector3) -> bool:
    """Return whether a point is inside a solid, both in the same frame."""
    offset = np.subtract(point, solid.position_m)
    x, y, z = (float(v) for v in matrix_from_quaternion(solid.orientation).T @ offset)
    match solid.shape:
        case Box(size_m=(length, width, height)):
            return abs(x) <= length / 2 and abs(y) <= width / 2 and abs(z) <= height / 2
        case Cylinder(radius_m=radius, length_m=length):
            return math.hypot(x, y) <= radius and abs(z) <= length / 2
        case Sphere(radius_m=radius):
            return math.hypot(x, y, z) <= radius
        case Mesh(low_m=low, high_m=high):  # bounding box; nearly all housings are boxes
            return all(a <= b <= c for a, b, c in zip(low, (x, y, z), high, strict=True))
