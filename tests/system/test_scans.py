# SPDX-License-Identifier: Apache-2.0
"""System tests of planar scanners: all scans arrive in a real ROS 2 and are plausible."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

from .rig import REPOSITORY, Observer, Rig, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.alone]

INDOOR_2D = REPOSITORY / "scenarios" / "indoor_2d.yaml"

ROOM_M = (12.0, 8.0)


class Expected(NamedTuple):
    """What a data sheet promises."""

    rays: int
    period_nanos: int
    first_rad: float
    step_rad: float
    frame: str


SCANNERS = {
    "/scan": Expected(1081, 25_000_000, math.radians(-135), math.radians(0.25), "scan_link"),
    "/scan_cheap": Expected(800, 100_000_000, math.pi, math.radians(-0.45), "scan_cheap_link"),
}


@pytest.fixture(scope="module")
def observed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, list[dict[str, Any]]]]:
    """Return what a ROS node has seen of some seconds of the rover's tour."""
    with rig(tmp_path_factory.mktemp("run")) as it:
        _with_scanners(it)
        observer = Observer(it)
        it.up()
        for topic in SCANNERS:
            wait_for(lambda t=topic: observer.count(t) > 2, 60, f"{topic} arrives in ROS")
        begin = {topic: observer.count(topic) for topic in SCANNERS}
        wait_for(lambda: observer.count("/scan") > begin["/scan"] + 200, 30, "200 scans more")
        yield {topic: observer.messages[topic][begin[topic] :] for topic in SCANNERS}


def _with_scanners(it: Rig) -> None:
    own = it.scenario.read_text(encoding="utf-8")
    gateway = own[own.index("\ngateway:") :]
    it.scenario.write_text(INDOOR_2D.read_text(encoding="utf-8") + gateway, encoding="utf-8")


@pytest.mark.parametrize(("topic", "expected"), SCANNERS.items())
def test_scans_arrive_complete_and_in_order(
    topic: str, expected: Expected, observed: dict[str, list[dict[str, Any]]]
) -> None:
    scans = observed[topic]
    stamps = np.array([scan["stamp"] for scan in scans])
    assert stamps[-1] - stamps[0] > 4.5e9
    assert set(np.diff(stamps).tolist()) == {expected.period_nanos}
    for scan in scans:
        assert scan["frame"] == expected.frame
        assert len(scan["ranges"]) == scan["intensities"] == expected.rays
        first, step, last = scan["angles"]
        assert first == pytest.approx(expected.first_rad, abs=1e-6)
        assert step == pytest.approx(expected.step_rad, rel=1e-5)
        assert last == pytest.approx(first + (expected.rays - 1) * step, abs=1e-3)
        increment, period = scan["times"]
        assert period == pytest.approx(expected.period_nanos * 1e-9)
        assert increment == pytest.approx(period * abs(step) / math.tau, rel=1e-4)


@pytest.mark.parametrize("topic", SCANNERS)
def test_scans_show_the_room_and_not_the_rover(
    topic: str, observed: dict[str, list[dict[str, Any]]]
) -> None:
    for scan in observed[topic]:
        ranges = np.array(scan["ranges"])
        assert not np.isnan(ranges).any()
        met = ranges[np.isfinite(ranges)]
        assert len(met) > 0.8 * len(ranges)
        # The tour stays away from everything; nothing is farther than across the room.
        assert met.min() > 0.4
        assert met.max() < math.hypot(*ROOM_M) + 0.5
