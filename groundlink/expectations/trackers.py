# SPDX-License-Identifier: Apache-2.0
"""Trackers of expectations: timed poses, contacts, estimates and figures of topics in, results out.

The same calls give the same results, live and from a recording. Calls of one sort are in order of
time; sorts may be mixed in any order, except commands, which come before the poses they act on.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from math import degrees, hypot
from typing import NamedTuple

from groundlink.core.fields import Quaternion, Vector3
from groundlink.episode.mission_tracker import MissionTracker, RouteProgress, world_box
from groundlink.scenario.expectations import (
    CompletesRoute,
    Expectation,
    ExpectationSpec,
    HeadingError,
    NeverFails,
    NeverTouches,
    PoseExpectation,
    PositionError,
    Reaches,
    StaysOnRoute,
    StaysWithin,
    TopicAge,
    TopicRate,
    TopicSpan,
    VehicleSpan,
)
from groundlink.scenario.schema import Scenario, Vehicle

from .planar import PlanarPose, laid_on, outside_m, wrapped
from .results import FAILED, PASSED, UNDECIDED, ExpectationResult, Verdict
from .scope import parts_of, place_of

PERIOD_SECONDS = 0.1
"""A run that ends less than this before the end of a span has lasted long enough: contacts are
reported ten times per second."""

REPORT_SECONDS = 1.0
"""Figures of topics are reported once per second."""


class TopicFigures(NamedTuple):
    """Figures of a topic at an instant, from the reports of the ROS side or from a recording."""

    rate_hz: float | None
    """By stamps, from the first message so far to the last."""

    age_p99_s: float | None = None
    """Age that 99 % of the messages of the last 10 s do not exceed."""


class ExpectationTracker:
    """Tracker of one expectation. A kind takes what it needs; the rest is ignored.

    One without a limit decides nothing.
    """

    unit = ""

    def __init__(self, expectation: ExpectationSpec, limit: float | None = None) -> None:
        self._expectation = expectation
        self._stated_limit = limit
        self._verdict: Verdict = UNDECIDED
        self._value: float | None = None
        self._at_s: float | None = None
        self._text = ""
        self._is_skipped = False

    @property
    def _limit(self) -> float:
        assert self._stated_limit is not None
        return self._stated_limit

    @property
    def verdict(self) -> Verdict:
        """The verdict, as far as it cannot change any more."""
        return self._verdict

    @property
    def is_open_ended(self) -> bool:
        """Whether only the end of the run can make it pass."""
        return False

    def moved(self, pose: PlanarPose) -> None:
        """Take a true pose of the vehicle."""

    def posed(self, seconds: float, position_m: Vector3, orientation: Quaternion) -> None:
        """Take the same pose in space."""

    def touched(self, seconds: float, names: Sequence[str]) -> None:
        """Take what the vehicle touched since the last call."""

    def drowned(self) -> None:
        """Take that the vehicle's motors have stopped in deep water."""

    def commanded(self, seconds: float, speed_mps: float, turn_radps: float) -> None:
        """Take a command to the vehicle."""

    def estimated(self, estimate: PlanarPose, truth: PlanarPose) -> None:
        """Take an estimated pose with the true one of the same instant."""

    def measured(self, seconds: float, figures: TopicFigures) -> None:
        """Take figures of the topic."""

    def finish(self, end_s: float) -> None:
        """Decide at the end of the run, at this sim time, what can be decided."""

    def give_up(self, reason: str, *, is_skipped: bool) -> None:
        """Stay undecided: what is judged is not in the run, or is skipped in runs of its kind."""
        self._is_skipped, self._text = is_skipped, reason

    def result(self) -> ExpectationResult:
        """Return the result so far."""
        return ExpectationResult(
            name=self._expectation.title,
            kind=self._expectation.kind,
            verdict=self._verdict,
            value=self._value,
            limit=self._stated_limit,
            unit=self.unit,
            at_s=self._at_s,
            text=self._text or "not decided yet",
            skipped=self._is_skipped,
        )

    def _measure(self, seconds: float | None, value: float) -> None:
        self._at_s, self._value = seconds, value

    def _decide(self, verdict: Verdict, text: str) -> None:
        self._verdict, self._text = verdict, text


class _Goal(ExpectationTracker, ABC):
    """Something that has to happen once, by a sim time or by the end of the run."""

    def __init__(
        self, expectation: Reaches | CompletesRoute, limit: float, *, is_met_below: bool
    ) -> None:
        super().__init__(expectation, limit)
        self._by_s = expectation.by_s
        self._sign = 1 if is_met_below else -1

    def _add(self, seconds: float, value: float) -> None:
        if self._verdict != UNDECIDED:
            return
        if self._by_s is not None and seconds > self._by_s + 1e-6:
            self._decide(FAILED, self._missed())
            return
        if self._value is None or self._sign * value < self._sign * self._value:
            self._measure(seconds, value)
        if self._sign * value <= self._sign * self._limit:
            self._decide(PASSED, self._so_far())

    def finish(self, end_s: float) -> None:
        if self._verdict != UNDECIDED:
            return
        if self._value is None:
            self._text = "no true pose of the vehicle"
        elif self._by_s is None or end_s >= self._by_s - PERIOD_SECONDS:
            self._decide(FAILED, self._missed())
        else:
            self._text = f"{self._so_far()}; {_too_short(end_s, self._by_s)}"

    def _missed(self) -> str:
        by = "the end of the run" if self._by_s is None else f"{self._by_s:g} s"
        return f"{self._so_far()}; expected {self._expected()} by {by}"

    @abstractmethod
    def _so_far(self) -> str:
        """Return how near it came."""

    @abstractmethod
    def _expected(self) -> str:
        """Return the limit as text."""


class _ReachTracker(_Goal):
    unit = "m"

    def __init__(self, expectation: Reaches, scenario: Scenario) -> None:
        super().__init__(expectation, expectation.within_m, is_met_below=True)
        place = place_of(expectation, scenario)
        assert place is not None, "the scenario is checked"
        self._place = place
        named = isinstance(expectation.place, str)
        self._name = f"`{expectation.place}`" if named else "x {:g}, y {:g} m".format(*place)

    def moved(self, pose: PlanarPose) -> None:
        self._add(pose.seconds, hypot(pose.x_m - self._place[0], pose.y_m - self._place[1]))

    def _so_far(self) -> str:
        return f"came within {self._value:.2f} m of {self._name} at {self._at_s:.2f} s"

    def _expected(self) -> str:
        return f"{self._limit:g} m"


class _RouteTracker(_Goal):
    unit = "%"

    def __init__(self, expectation: CompletesRoute, vehicle: Vehicle) -> None:
        limit = round(100 * expectation.at_least_share, 9)
        super().__init__(expectation, limit, is_met_below=False)
        self._progress = RouteProgress(vehicle)

    def moved(self, pose: PlanarPose) -> None:
        self._progress.moved(pose.x_m, pose.y_m)
        self._add(pose.seconds, 100 * self._progress.share)

    def _so_far(self) -> str:
        return f"drove {self._value:.0f} % of the route by {self._at_s:.2f} s"

    def _expected(self) -> str:
        return f"{self._limit:g} %"


class _Limit(ExpectationTracker):
    """A value that must not exceed a limit in a span of sim time."""

    missing = "no true pose of the vehicle"
    """Text if nothing was measured."""

    period_s = PERIOD_SECONDS

    def __init__(self, expectation: VehicleSpan | TopicSpan, limit: float) -> None:
        super().__init__(expectation, limit)
        self._from_s, self._until_s = expectation.from_s, expectation.until_s

    @property
    def is_open_ended(self) -> bool:
        return self._until_s is None

    def _add(self, seconds: float, value: float, found: Callable[[], str] = str) -> None:
        """Take a value; `found` returns what happened where it exceeds the limit."""
        if self._verdict != UNDECIDED or seconds < self._from_s - 1e-6:
            return
        if self._until_s is None or seconds <= self._until_s + 1e-6:
            if self._value is None or value > self._value:
                self._measure(seconds, value)
            if value > self._limit:
                self._decide(FAILED, found() or self._beyond())
        elif self._value is not None:
            self._decide(PASSED, self._kept())

    def finish(self, end_s: float) -> None:
        if self._verdict != UNDECIDED:
            return
        until_s = self._until_s
        if until_s is not None and end_s < until_s - self.period_s:
            self._text = _too_short(end_s, until_s)
        elif self._value is None:
            self._text = self.missing
            if end_s < self._from_s:
                self._text = _too_short(end_s, self._from_s)
        else:
            self._decide(PASSED, self._kept())

    def _beyond(self) -> str:
        return f"{self._figure()}; expected at most {self._limit:g} {self.unit}"

    def _kept(self) -> str:
        return f"at most {self._figure()}"

    def _figure(self) -> str:
        return f"{_short(self._value)} {self.unit} at {self._at_s:.2f} s"


class _TouchTracker(_Limit):
    unit = "objects"
    missing = "no report of contacts"

    def __init__(self, expectation: NeverTouches, scenario: Scenario) -> None:
        super().__init__(expectation, 0.0)
        self._allowed = frozenset[str]().union(
            *(parts_of(name, scenario) for name in expectation.allowed)
        )

    def touched(self, seconds: float, names: Sequence[str]) -> None:
        found = [name for name in names if name not in self._allowed]
        words = ", ".join(f"`{name}`" for name in found)
        self._add(seconds, float(len(found)), lambda: f"touched {words} at {seconds:.2f} s")

    def _kept(self) -> str:
        return "touched nothing"


class _AreaTracker(_Limit):
    unit = "m"

    def __init__(self, expectation: StaysWithin) -> None:
        super().__init__(expectation, 0.0)
        self._corners = expectation.polygon_m

    def moved(self, pose: PlanarPose) -> None:
        self._add(
            pose.seconds,
            outside_m((pose.x_m, pose.y_m), self._corners),
            lambda: (
                f"left the area at x {pose.x_m:.2f}, y {pose.y_m:.2f} m at {pose.seconds:.2f} s"
            ),
        )

    def _kept(self) -> str:
        return f"at least {_short(self._value, -1)} m inside, at {self._at_s:.2f} s"


class _OnRouteTracker(_Limit):
    unit = "m"

    def __init__(self, expectation: StaysOnRoute, vehicle: Vehicle) -> None:
        super().__init__(expectation, expectation.within_m)
        self._progress = RouteProgress(vehicle)

    def moved(self, pose: PlanarPose) -> None:
        self._progress.moved(pose.x_m, pose.y_m)
        self._add(pose.seconds, self._progress.apart_m)

    def _figure(self) -> str:
        return f"{_short(self._value)} m from the route at {self._at_s:.2f} s"


class _FailureTracker(_Limit):
    unit = "failures"

    def __init__(self, expectation: NeverFails, vehicle: Vehicle, scenario: Scenario) -> None:
        super().__init__(expectation, 0.0)
        self._allowed = expectation.allowed
        self._mission = MissionTracker(vehicle, world_box(scenario))

    def posed(self, seconds: float, position_m: Vector3, orientation: Quaternion) -> None:
        self._mission.moved(seconds, position_m, orientation)
        self._judge(seconds)

    def touched(self, seconds: float, names: Sequence[str]) -> None:
        self._mission.touched(seconds, names)

    def drowned(self) -> None:
        self._mission.drowned()

    def commanded(self, seconds: float, speed_mps: float, turn_radps: float) -> None:
        self._mission.commanded(seconds, speed_mps, turn_radps)

    def _judge(self, seconds: float) -> None:
        for event in self._mission.present():
            if event.state not in self._allowed:
                # It counts from its begin, which is seconds earlier.
                self._add(max(event.begin_seconds, self._from_s), 1.0, event.described)
                return
        self._add(seconds, 0.0)

    def _kept(self) -> str:
        return "no failure"


class _EstimateTracker(_Limit, ABC):
    missing = "no estimate of the pose"

    def __init__(self, expectation: PoseExpectation, limit: float) -> None:
        super().__init__(expectation, limit)
        self._is_aligned = expectation.origin == "first"
        self._first: tuple[PlanarPose, PlanarPose] | None = None

    def estimated(self, estimate: PlanarPose, truth: PlanarPose) -> None:
        if self._is_aligned:
            self._first = self._first or (estimate, truth)
            estimate = laid_on(estimate, *self._first)
        self._add(estimate.seconds, self._error(estimate, truth))

    @abstractmethod
    def _error(self, estimate: PlanarPose, truth: PlanarPose) -> float:
        """Return the error of an estimate."""


class _PositionTracker(_EstimateTracker):
    unit = "m"

    def _error(self, estimate: PlanarPose, truth: PlanarPose) -> float:
        return hypot(estimate.x_m - truth.x_m, estimate.y_m - truth.y_m)


class _HeadingTracker(_EstimateTracker):
    unit = "deg"

    def _error(self, estimate: PlanarPose, truth: PlanarPose) -> float:
        return degrees(abs(wrapped(estimate.heading_rad - truth.heading_rad)))


class _AgeTracker(_Limit):
    unit = "ms"
    missing = "the ROS side reported no ages of its messages"
    period_s = REPORT_SECONDS

    def __init__(self, expectation: TopicAge) -> None:
        super().__init__(expectation, expectation.at_most_ms)

    def measured(self, seconds: float, figures: TopicFigures) -> None:
        if figures.age_p99_s is not None:
            self._add(seconds, 1e3 * figures.age_p99_s)


class _RateTracker(ExpectationTracker):
    unit = "Hz"

    def __init__(self, expectation: TopicRate) -> None:
        super().__init__(expectation, expectation.at_least_hz)

    @property
    def is_open_ended(self) -> bool:
        return True

    def measured(self, seconds: float, figures: TopicFigures) -> None:
        if figures.rate_hz is not None:
            self._measure(None, figures.rate_hz)

    def finish(self, end_s: float) -> None:
        if self._value is None:
            self._text = "fewer than two messages, or none that the ROS side reported"
        elif self._value >= self._limit:
            self._decide(PASSED, f"{self._value:.2f} Hz")
        else:
            text = f"{self._value:.2f} Hz; expected at least {self._limit:g} Hz"
            self._decide(FAILED, text)


def tracker(
    expectation: Expectation, scenario: Scenario, vehicle: Vehicle | None
) -> ExpectationTracker:
    """Return the tracker of an expectation of a checked scenario; topics need no vehicle."""
    match expectation:
        case TopicRate():
            return _RateTracker(expectation)
        case TopicAge():
            return _AgeTracker(expectation)
        case PositionError():
            return _PositionTracker(expectation, expectation.at_most_m)
        case HeadingError():
            return _HeadingTracker(expectation, expectation.at_most_deg)
    assert vehicle is not None, "the scenario is checked"
    match expectation:
        case Reaches():
            return _ReachTracker(expectation, scenario)
        case CompletesRoute():
            return _RouteTracker(expectation, vehicle)
        case NeverTouches():
            return _TouchTracker(expectation, scenario)
        case StaysWithin():
            return _AreaTracker(expectation)
        case StaysOnRoute():
            return _OnRouteTracker(expectation, vehicle)
        case NeverFails():
            return _FailureTracker(expectation, vehicle, scenario)


def _short(value: float | None, sign: int = 1) -> str:
    """Return a measured value, times a sign, to three digits after the point."""
    assert value is not None
    return f"{round(sign * value, 3) + 0.0:g}"  # No minus zero.


def _too_short(end_s: float, needed_s: float) -> str:
    return f"the run ended at {end_s:.1f} s, before {needed_s:g} s"
