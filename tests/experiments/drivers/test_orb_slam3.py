# SPDX-License-Identifier: Apache-2.0
"""What ORB-SLAM3 did with the frames is told as it was; a stand-in does it here."""

import argparse
import sys
from collections.abc import Iterator
from enum import Enum, auto
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from .scripts import script


class State(Enum):
    SYSTEM_NOT_READY = auto()
    NO_IMAGES_YET = auto()
    NOT_INITIALIZED = auto()
    OK = auto()
    RECENTLY_LOST = auto()


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Any:
    program = ModuleType("pyorbslam3")
    program.TrackingState = State  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pyorbslam3", program)
    return script("orb_slam3")


class Slam:
    """Is in one state after the other."""

    def __init__(self, states: list[State]) -> None:
        self._states = iter(states)

    def track_monocular(self, gray: Any, stamp: float) -> Any:
        state = next(self._states)
        return SimpleNamespace(state=state, ok=state is State.OK)


BEGUN = [State.NO_IMAGES_YET, State.NOT_INITIALIZED, State.OK, State.OK]


@pytest.mark.parametrize(
    ("more", "tracked", "map_begun_s"),
    [
        ([State.OK, State.RECENTLY_LOST, State.OK], 4, 0.002),
        ([State.RECENTLY_LOST, State.NO_IMAGES_YET, State.NOT_INITIALIZED, State.OK], 3, 0.007),
    ],
    ids=["found again", "lost for good"],
)
def test_new_map_is_reported(
    driver: Any,
    monkeypatch: pytest.MonkeyPatch,
    more: list[State],
    tracked: int,
    map_begun_s: float,
) -> None:
    states = BEGUN + more

    def frames(_: argparse.Namespace) -> Iterator[tuple[float, None, None]]:
        for number in range(len(states)):
            yield 5.0 + 0.001 * number, None, None

    monkeypatch.setattr(driver, "frames", frames)
    told = driver.feed(argparse.Namespace(), Slam(states), len(states))
    assert told["frames"] == len(states)
    assert told["tracked"] == tracked
    assert told["map_begun_s"] == pytest.approx(map_begun_s)
    assert 0.0 < told["pace"] <= 1.1
