# SPDX-License-Identifier: Apache-2.0
"""Which acknowledgements count in one episode of a run."""

from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Ack, decode
from groundlink.scenario.schema import Time
from services.physics.run.episode import Episode
from services.physics.run.publishers import silent_publishers

EPISODE = 5
LAB = load(SHIPPED / "indoor_lab.yaml")


@pytest.fixture(params=["fast", "realtime"])
def episode(request: pytest.FixtureRequest) -> Iterator[Episode]:
    scenario = replace(LAB, time=Time(mode=request.param))
    episode = Episode(scenario, "run", silent_publishers(), required=(), wall_nanos=EPISODE)
    episode.begin(EPISODE, 0.0)
    yield episode
    episode.end()


def heard(episode: Episode, process: str) -> int:
    """Return how far a process is, as it would hear itself."""
    return decode(episode.history_for(process)[0], Ack).tick


def says(episode: Episode, process: str, tick: int) -> None:
    episode.acknowledged(process, Ack(EPISODE, tick, tick))
    episode.apply_acks()


def test_disconnected_sensor_counts_again_after_requesting_missed_states(episode: Episode) -> None:
    says(episode, "rover/imu", 3)
    episode.process_left("rover/imu")
    says(episode, "rover/imu", 7)
    waits = episode.scenario.time.mode == "fast"
    assert heard(episode, "rover/imu") == (3 if waits else 7), "what it said in between may be lost"
    says(episode, "rover/imu", 8)
    assert heard(episode, "rover/imu") == 8


def test_others_than_sensors_and_drivers_have_nothing_to_repeat(episode: Episode) -> None:
    episode.process_left("gateway")
    says(episode, "gateway", 7)
    assert episode.journal().acks["gateway"].tick == 7


@pytest.mark.parametrize(
    ("time", "begins_nanos"),
    [
        (Time(), 7),
        (Time("fast"), 10**18),
        (Time("lockstep"), 10**18),
        (Time("fast", epoch="wall"), EPISODE),
        (Time(epoch="fixed"), 10**18),
        (Time(epoch="zero"), 0),
        (Time("fast", epoch="zero"), 0),
    ],
)
def test_a_run_that_does_not_follow_the_wall_clock_begins_at_the_same_stamp(
    time: Time, begins_nanos: int
) -> None:
    episode = Episode(
        replace(LAB, time=time), "run", silent_publishers(), required=(), wall_nanos=EPISODE
    )
    episode.begin(7, 0.0)
    assert episode.epoch_nanos == begins_nanos
    episode.end()
