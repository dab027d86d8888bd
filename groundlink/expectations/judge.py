# SPDX-License-Identifier: Apache-2.0
"""Judge of a run's expectations: messages of the bus in, results out.

Live and from a recording the same messages come in. Vitals tell where an episode begins, and each
episode is judged anew; expectations of topics alone are judged over the whole run.
"""

from collections import deque
from collections.abc import Mapping, Sequence

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.episode.mission_tracker import commanded_twist
from groundlink.messages.base import BusMessage
from groundlink.messages.ground_truth import Vitals
from groundlink.messages.navigation import Odometry, PoseStamped
from groundlink.ros.streams import RosStream, incoming, outgoing, recorded_only
from groundlink.scenario.expectations import (
    Expectation,
    NeverFails,
    PoseExpectation,
    TopicAge,
    TopicRate,
    VehicleExpectation,
)
from groundlink.scenario.schema import Scenario, Vehicle

from .planar import PlanarPose, between, planar
from .results import FAILED, UNDECIDED, ExpectationResult
from .scope import estimates, mistakes, vehicle_of
from .trackers import ExpectationTracker, TopicFigures, tracker

HISTORY_SECONDS = 10.0
"""Estimates that come later than this after their instant are not compared with the truth."""

MAX_WAITING = 4096
"""Messages that wait for the first vitals, or estimates for the truth of their instants."""


class ExpectationJudge:
    """Judge of the expectations of a scenario.

    Those that refer to what is not there, as in a world that was loaded later, stay undecided.
    """

    def __init__(self, scenario: Scenario, run: str) -> None:
        self._scenario = scenario
        self._unfit: dict[int, ExpectationTracker] = {}
        for mistake in mistakes(scenario):
            one = ExpectationTracker(scenario.expect[mistake.number])
            one.give_up(mistake.text, is_skipped=False)
            self._unfit[mistake.number] = one
        fit = {n: e for n, e in enumerate(scenario.expect) if n not in self._unfit}
        poses = estimates(scenario, run)
        self._vehicles = [_VehicleJudge(v, scenario, fit, poses) for v in scenario.vehicles]
        self._topics = {
            number: (expectation.topic, tracker(expectation, scenario, None))
            for number, expectation in fit.items()
            if isinstance(expectation, TopicRate | TopicAge)
        }
        self._reported_s: float | None = None
        """Sim time of the newest report of the gateway; None without one."""

        known = (*outgoing(scenario, run), *incoming(scenario, run), *recorded_only(scenario, run))
        self.streams: dict[str, RosStream] = {
            stream.key: stream
            for stream in known
            if any(vehicle.needs(stream) for vehicle in self._vehicles)
        }
        """Streams whose messages are needed, by key on the bus."""

    @property
    def topics(self) -> list[str]:
        """ROS topics whose figures are needed."""
        return [topic for topic, _ in self._topics.values()]

    def take(self, key: str, message: BusMessage) -> None:
        """Take a message of one of `streams`."""
        name = key.split("/")[2]
        for vehicle in self._vehicles:
            if vehicle.name == name:
                vehicle.take(self.streams[key], message)

    def recorded(self, figures: Mapping[str, TopicFigures]) -> None:
        """Take figures of all messages of topics in a recording, by topic."""
        for topic, one in self._topics.values():
            if topic in figures:
                one.measured(0.0, figures[topic])

    def reported(self, seconds: float, figures: Mapping[str, TopicFigures]) -> None:
        """Take figures of topics that the gateway reported at a sim time, by topic."""
        self._reported_s = max(seconds, self._reported_s or 0.0)
        for topic, one in self._topics.values():
            if topic in figures:
                one.measured(seconds, figures[topic])

    def finish(self) -> None:
        """Decide at the end of the run what can be decided."""
        for vehicle in self._vehicles:
            vehicle.finish()
        end_s = max(self._reported_s or 0.0, *(vehicle.end_s for vehicle in self._vehicles))
        for number, (_, one) in self._topics.items():
            if self._reported_s is None and isinstance(self._scenario.expect[number], TopicAge):
                one.give_up("no gateway took part, so messages have no ages", is_skipped=True)
            else:
                one.finish(end_s)

    @property
    def is_settled(self) -> bool:
        """Whether the verdict on the run is known before its end.

        One expectation has failed, or all that can pass before the end have passed.
        """
        trackers = self._trackers().values()
        early = [one for one in trackers if not one.is_open_ended]
        return any(one.verdict == FAILED for one in trackers) or (
            bool(early) and all(one.verdict != UNDECIDED for one in early)
        )

    def results(self) -> list[ExpectationResult]:
        """Return the results so far, in the order of the scenario."""
        return [one.result() for _, one in sorted(self._trackers().items())]

    def _trackers(self) -> dict[int, ExpectationTracker]:
        """Return all trackers by the number of their expectation."""
        found = self._unfit | {number: one for number, (_, one) in self._topics.items()}
        for vehicle in self._vehicles:
            found |= vehicle.trackers
        return found


class _VehicleJudge:
    """Judge of the expectations of one vehicle in the present episode."""

    def __init__(
        self,
        vehicle: Vehicle,
        scenario: Scenario,
        fit: Mapping[int, Expectation],
        poses: Mapping[str, tuple[Vehicle, RosStream]],
    ) -> None:
        self.name = vehicle.name
        self._vehicle, self._scenario = vehicle, scenario
        self._truth_topic = scenario.ground_truth_topic(vehicle)
        self._vitals_topic = scenario.vitals_topic(vehicle)
        self._expected = {
            number: expectation
            for number, expectation in fit.items()
            if (isinstance(expectation, VehicleExpectation) and self._is_of(expectation))
            or (isinstance(expectation, PoseExpectation) and poses[expectation.topic][0] is vehicle)
        }
        self._estimates: dict[str, list[int]] = {}
        for number, expectation in self._expected.items():
            if isinstance(expectation, PoseExpectation):
                self._estimates.setdefault(expectation.topic, []).append(number)
        self._begun: tuple[int, int] | None = None
        """Epoch (ns) and newest tick of the episode; None until the first vitals."""

        self._early: deque[tuple[RosStream, BusMessage]] = deque(maxlen=MAX_WAITING)
        self._restart()

    def _is_of(self, expectation: VehicleExpectation) -> bool:
        return vehicle_of(expectation, self._scenario) is self._vehicle

    def _restart(self) -> None:
        self.trackers = {
            number: tracker(expectation, self._scenario, self._vehicle)
            for number, expectation in self._expected.items()
        }
        self.end_s = 0.0
        self._truth: deque[PlanarPose] = deque()
        self._waiting: deque[tuple[str, PlanarPose]] = deque(maxlen=MAX_WAITING)

    def needs(self, stream: RosStream) -> bool:
        """Return whether messages of a stream are needed."""
        if not self._expected or stream.key.split("/")[2] != self.name:
            return False
        needed = {self._truth_topic, self._vitals_topic, *self._estimates}
        if any(isinstance(expectation, NeverFails) for expectation in self._expected.values()):
            return stream.topic in needed or stream.is_command
        return stream.topic in needed

    def take(self, stream: RosStream, message: BusMessage) -> None:
        """Take a message. Before the first vitals it waits, since the episode is not known."""
        if isinstance(message, Vitals):
            epoch_nanos = message.stamp_nanos - message.tick * TICK_NANOS
            if self._begun is not None and (
                epoch_nanos != self._begun[0] or message.tick < self._begun[1]
            ):
                self._restart()
            self._begun = epoch_nanos, message.tick
            while self._early:
                self._use(*self._early.popleft())
        if self._begun is None:
            self._early.append((stream, message))
        else:
            self._use(stream, message)

    def _use(self, stream: RosStream, message: BusMessage) -> None:
        assert self._begun is not None
        trackers = self.trackers.values()
        if isinstance(message, Vitals):
            names = [contact.name for contact in message.contacts]
            for one in trackers:
                one.touched(message.tick * TICK_NANOS / NANOS, names)
                if message.has_drowned:
                    one.drowned()
        elif isinstance(message, Odometry | PoseStamped):
            seconds = (message.stamp_nanos - self._begun[0]) / NANOS
            pose = planar(seconds, message.position_m, message.orientation)
            if stream.topic == self._truth_topic:
                self._moved(pose, message)
            else:
                self._waiting.append((stream.topic, pose))
            self._compare()
        elif twist := commanded_twist(self._vehicle.model, message):
            stamp_nanos: int = message.stamp_nanos  # type: ignore[attr-defined]
            for one in trackers:
                one.commanded((stamp_nanos - self._begun[0]) / NANOS, *twist)

    def _moved(self, pose: PlanarPose, message: Odometry | PoseStamped) -> None:
        self.end_s = max(pose.seconds, self.end_s)
        for one in self.trackers.values():
            one.moved(pose)
            one.posed(pose.seconds, message.position_m, message.orientation)
        self._truth.append(pose)
        while self._truth[0].seconds < pose.seconds - HISTORY_SECONDS:
            self._truth.popleft()

    def _compare(self) -> None:
        """Compare the waiting estimates whose instants the truth has passed."""
        while self._waiting and self._truth and self._waiting[0][1].seconds <= self.end_s:
            topic, estimate = self._waiting.popleft()
            if (truth := _at(estimate.seconds, self._truth)) is not None:
                for number in self._estimates[topic]:
                    self.trackers[number].estimated(estimate, truth)

    def finish(self) -> None:
        """Decide at the end of the run what can be decided."""
        for one in self.trackers.values():
            one.finish(self.end_s)


def _at(seconds: float, truth: Sequence[PlanarPose]) -> PlanarPose | None:
    """Return the true pose at an instant; None before the first known one."""
    if seconds < truth[0].seconds:
        return None
    # Most estimates are of the newest instants.
    number = len(truth) - 1
    while truth[number].seconds > seconds:
        number -= 1
    return between(truth[number], truth[min(number + 1, len(truth) - 1)], seconds)
