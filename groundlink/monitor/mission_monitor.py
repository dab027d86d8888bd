# SPDX-License-Identifier: Apache-2.0
"""Missions of a run's vehicles, from the ground truth, commands and vitals on its bus."""

from functools import cache, partial
from math import inf
from typing import Protocol

from groundlink.bus.core_topics import COMMAND
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import scenario_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import GROUND_TRUTH, JOINT_GROUP_COMMAND, VITALS, WHEEL_COMMAND
from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.episode.mission import Mission
from groundlink.episode.mission_tracker import MissionTracker, commanded_twist, world_box
from groundlink.messages.base import BusMessage
from groundlink.messages.ground_truth import Vitals
from groundlink.messages.navigation import Odometry
from groundlink.scenario import Scenario
from groundlink.scenario.decoding import decode_scenario
from groundlink.scenario.schema import Vehicle
from groundlink.scene.loaded_world import in_present_world
from groundlink.world.bounds import Bounds

INBOX_DEPTH = 4096
"""Messages of a vehicle that may wait: 2 s of a run at ten times real time."""

SCENARIO_SECONDS = 1.0
"""Timeout for the scenario of a further episode, which may be in another world."""

ABSENT_SECONDS = 2.0
"""A vehicle without a state for this long has been removed."""

# The keys of groups of joints include that of all joints: `joints/**`.
ROWS = (GROUND_TRUTH, COMMAND, WHEEL_COMMAND, JOINT_GROUP_COMMAND, VITALS)


class MissionMonitor:
    """Tracks the vehicles of a run through its episodes: each one begins new missions.

    Vehicles that are spawned later are not tracked.

    Parameters
    ----------
    scenario
        None: there is nothing to track.
    until_seconds
        sim time after which states are ignored.
    """

    def __init__(self, scenario: Scenario | None = None, *, until_seconds: float = inf) -> None:
        self._vehicles: list[_VehicleMonitor] = []
        self._present = cache(lambda: scenario)
        """Scenario at present: one query for all vehicles that begin an episode together."""

        if scenario is not None:
            self._know(scenario)
            self._vehicles += [
                _VehicleMonitor(vehicle, self._of_episode, until_seconds)
                for vehicle in scenario.vehicles
            ]

    def subscribe(self, bus: Bus, run: str) -> None:
        """Receive the messages of a run."""

        def present() -> Scenario | None:
            replies = bus.query(scenario_key(run), seconds=SCENARIO_SECONDS).values()
            return next(map(decode_scenario, replies), None)

        self._present = cache(present)
        for vehicle in self._vehicles:
            for row in ROWS:
                key = row.key_in(run, vehicle=vehicle.name)
                bus.subscribe(key, row.message, vehicle.inbox)

    def update(self) -> None:
        """Process all messages that have come."""
        self._present.cache_clear()
        for vehicle in self._vehicles:
            vehicle.update()

    def _know(self, scenario: Scenario) -> None:
        self._scenario = scenario
        # When the first vehicle moves: it takes up to 50 ms, and processes start meanwhile.
        self._box = cache(partial(world_box, scenario))

    def _of_episode(self, vehicle: Vehicle, *, is_first: bool) -> tuple[Vehicle, Bounds | None]:
        """Return a vehicle with its start, and the box around its world, in the present episode."""
        if not is_first and (present := self._present()) is not None:
            known = in_present_world(self._scenario, present)
            if known != self._scenario:
                self._know(known)
        here = {known.name: known for known in self._scenario.vehicles}
        return here[vehicle.name], self._box()

    def missions(self) -> list[Mission]:
        """Return the mission of each vehicle that is there."""
        found = [vehicle.tracker.mission() for vehicle in self._vehicles if vehicle.tracker]
        newest = max((mission.seconds for mission in found), default=0.0)
        return [mission for mission in found if mission.seconds > newest - ABSENT_SECONDS]


class OfEpisode(Protocol):
    """Type of `MissionMonitor._of_episode`."""

    def __call__(self, vehicle: Vehicle, *, is_first: bool) -> tuple[Vehicle, Bounds | None]:
        """Return a vehicle with its start, and the box around its world."""


class _VehicleMonitor:
    """The mission of one vehicle in the present episode."""

    def __init__(self, vehicle: Vehicle, of_episode: OfEpisode, until_seconds: float) -> None:
        self.name = vehicle.name
        self._until_seconds = until_seconds
        self.inbox: BusInbox[BusMessage] = BusInbox(depth=INBOX_DEPTH)
        self._vehicle, self._of_episode = vehicle, of_episode
        self._epoch_nanos, self._tick = 0, -1
        self.tracker: MissionTracker | None = None
        """None until the first vitals, which tell the time of the run."""

    def update(self) -> None:
        while len(self.inbox) and (arrived := self.inbox.get(seconds=0)):
            self._take(arrived[1])

    def _take(self, message: BusMessage) -> None:
        """Take a message; all before the first vitals are skipped."""
        if isinstance(message, Vitals):
            names = (contact.name for contact in message.contacts)
            tracker = self._tracker_of_episode(message)
            tracker.touched(message.tick * TICK_NANOS / NANOS, names)
            if message.has_drowned:
                tracker.drowned()
        elif self.tracker is None:
            return
        elif isinstance(message, Odometry):
            seconds = self._seconds(message.stamp_nanos)
            if seconds <= self._until_seconds:
                self.tracker.moved(seconds, message.position_m, message.orientation)
        elif twist := commanded_twist(self._vehicle.model, message):
            stamp_nanos: int = message.stamp_nanos  # type: ignore[attr-defined]
            self.tracker.commanded(self._seconds(stamp_nanos), *twist)

    def _tracker_of_episode(self, vitals: Vitals) -> MissionTracker:
        """Return the tracker; a new one if vitals are of another episode."""
        epoch_nanos = vitals.stamp_nanos - vitals.tick * TICK_NANOS
        is_other = epoch_nanos != self._epoch_nanos or vitals.tick < self._tick
        if self.tracker is None or is_other:
            found = self._of_episode(self._vehicle, is_first=self.tracker is None)
            self.tracker = MissionTracker(*found)
        self._epoch_nanos, self._tick = epoch_nanos, vitals.tick
        return self.tracker

    def _seconds(self, stamp_nanos: int) -> float:
        return (stamp_nanos - self._epoch_nanos) / NANOS
