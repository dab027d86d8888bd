# SPDX-License-Identifier: Apache-2.0
"""Expectations: conditions that a run passes or fails, such as a place that a vehicle reaches.

Each kind of expectation is a class; its tag is the kind. `groundlink.expectations` judges them.
Times are sim time of the episode.
"""

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Fraction01, NonNegative, Positive, Spec

from .every_sensor import Name, RosTopic

FailureKind = Literal["stuck", "drowned", "tipped over", "falling", "left the map"]
"""Failures of a vehicle that its mission verdict knows."""


def _check_span(from_s: float, until_s: float | None) -> None:
    if until_s is not None and until_s <= from_s:
        raise ValueError(f"`until_s` is {until_s:g}; expected more than `from_s`, {from_s:g}")


class ExpectationSpec(Spec, frozen=True, tag_field="kind", kw_only=True):
    """Base of all expectations."""

    name: Name | None = None
    """Name in tables, JSON and JUnit XML, and for `--set`, unique; none: made of the kind and what
    it is about."""

    @property
    def kind(self) -> str:
        """Kind of the expectation, as in a scenario."""
        return str(self.__struct_config__.tag)

    @property
    def subject(self) -> str:
        """What the expectation is about, for its name; empty for the only vehicle."""
        return ""

    @property
    def title(self) -> str:
        """The given name, or one made of the kind and the subject."""
        return self.name or " ".join(filter(None, (self.kind, self.subject)))


class VehicleExpectation(ExpectationSpec, frozen=True, kw_only=True):
    """Base of expectations of a vehicle."""

    vehicle: Name | None = None
    """Vehicle; none: the only one of the scenario."""

    @property
    def subject(self) -> str:
        """The vehicle."""
        return self.vehicle or ""


class VehicleSpan(VehicleExpectation, frozen=True, kw_only=True):
    """Base of expectations of a vehicle in a span of sim time, both ends included."""

    from_s: NonNegative = 0.0
    """Begin of the span in which it is judged."""

    until_s: Positive | None = None
    """End of the span in which it is judged; none: the end of the run."""

    def __post_init__(self) -> None:
        _check_span(self.from_s, self.until_s)


class Reaches(VehicleExpectation, frozen=True, tag="reaches", kw_only=True):
    """The base of the vehicle comes near a place."""

    place: Name | tuple[float, float]
    """Name of one of the world's `poses` or `checkpoints`, or x and y in meters in the world."""

    within_m: Positive = 0.5
    """Horizontal distance at which the place counts as reached."""

    by_s: Positive | None = None
    """Latest sim time; none: the end of the run."""

    @property
    def subject(self) -> str:
        """The vehicle and the place."""
        place = self.place if isinstance(self.place, str) else "{:g},{:g}".format(*self.place)
        return " ".join(filter(None, (self.vehicle, place)))


class CompletesRoute(VehicleExpectation, frozen=True, tag="completes_route", kw_only=True):
    """The vehicle drives its route."""

    at_least_share: Fraction01 = 0.98
    """Share of the route's length at which it counts as driven."""

    by_s: Positive | None = None
    """Latest sim time; none: the end of the run."""


class NeverTouches(VehicleSpan, frozen=True, tag="never_touches", kw_only=True):
    """The vehicle touches nothing. Contact of wheels with the ground does not count."""

    allowed: tuple[str, ...] = ()
    """Names of what may be touched: solids, furniture and other entities, actors, vehicles."""


class StaysWithin(VehicleSpan, frozen=True, tag="stays_within", kw_only=True):
    """The base of the vehicle stays in an area."""

    polygon_m: Annotated[tuple[tuple[float, float], ...], Meta(min_length=3)]
    """Corners of the area in order, x and y in the world."""


class StaysOnRoute(VehicleSpan, frozen=True, tag="stays_on_route", kw_only=True):
    """The base of the vehicle stays near its route."""

    within_m: Positive
    """Largest horizontal distance from the route."""


class NeverFails(VehicleSpan, frozen=True, tag="never_fails", kw_only=True):
    """The vehicle is never stuck, drowned, tipped over, falling or off the map."""

    allowed: tuple[FailureKind, ...] = ()
    """Failures that do not count."""


class TopicExpectation(ExpectationSpec, frozen=True, kw_only=True):
    """Base of expectations of a ROS topic."""

    topic: RosTopic
    """ROS topic."""

    @property
    def subject(self) -> str:
        """The topic."""
        return self.topic


class TopicSpan(TopicExpectation, frozen=True, kw_only=True):
    """Base of expectations of a ROS topic in a span of sim time, both ends included."""

    from_s: NonNegative = 0.0
    """Begin of the span in which it is judged."""

    until_s: Positive | None = None
    """End of the span in which it is judged; none: the end of the run."""

    def __post_init__(self) -> None:
        _check_span(self.from_s, self.until_s)


class PoseExpectation(TopicSpan, frozen=True, kw_only=True):
    """Base of expectations of an estimated pose."""

    topic: RosTopic
    """ROS topic of the estimate: `from_ros.pose` or `from_ros.odometry` of a vehicle, its wheel
    odometry, or a stream of kind `pose` or `odometry`."""

    origin: Literal["first", "world"] = "first"
    """`first`: the first estimate is laid on the true pose, for estimates whose frame begins
    anywhere. `world`: estimates are poses in the world."""


class PositionError(PoseExpectation, frozen=True, tag="position_error", kw_only=True):
    """Estimated positions are near the true ones of the same instants."""

    at_most_m: Positive
    """Largest horizontal distance."""


class HeadingError(PoseExpectation, frozen=True, tag="heading_error", kw_only=True):
    """Estimated headings are near the true ones of the same instants."""

    at_most_deg: Annotated[float, Meta(gt=0, le=180)]
    """Largest difference."""


class TopicRate(TopicExpectation, frozen=True, tag="rate", kw_only=True):
    """A topic has a rate, by the stamps of its messages: as published in ROS, or as recorded."""

    at_least_hz: Positive
    """Lowest rate from the first message to the last."""


class TopicAge(TopicSpan, frozen=True, tag="age", kw_only=True):
    """Messages of a topic are young when ROS publishes them: 99 % of those of the last 10 s."""

    at_most_ms: Positive
    """Largest age, from the instant of measurement to publication on the ROS side."""


Expectation = (
    Reaches
    | CompletesRoute
    | NeverTouches
    | StaysWithin
    | StaysOnRoute
    | NeverFails
    | PositionError
    | HeadingError
    | TopicRate
    | TopicAge
)
