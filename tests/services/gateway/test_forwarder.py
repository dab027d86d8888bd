# SPDX-License-Identifier: Apache-2.0
"""A gateway that waits for nobody in ROS, between clocks of the bus and a stand-in of the rest."""

from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from groundlink.bus.inbox import BusInbox
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Ack, BusMessage, Clock, encode
from services.gateway.forwarder import PILE_MESSAGES, Forwarder

from .test_carrier import IMU_KEY, sample
from .test_gateway import RUN, Bench

SECOND = 1_000_000_000
CLOCK_KEY = f"groundlink/{RUN}/clock"


def test_progress_is_acknowledged_and_lost_clocks_are_counted() -> None:
    acks: list[Ack] = []
    gateway: Any = SimpleNamespace(streams={})
    link: Any = None
    scenario = load(SHIPPED / "indoor_lab.yaml")
    forwarder = Forwarder(scenario, gateway, link, acknowledge=acks.append)
    for episode, tick in ((5, 300), (5, 304), (5, 312), (6, 0), (6, 4)):  # at 100 Hz
        forwarder.handle("clock", Clock(0, 0, tick, episode))
    assert [(ack.episode, ack.tick) for ack in acks][-1] == (6, 4)
    assert forwarder.counts == {"clocks_missed": 1}


def test_physics_that_waits_gets_one_acknowledgement_of_clocks_that_came_together() -> None:
    acks: list[Ack] = []
    gateway: Any = SimpleNamespace(streams={})
    link: Any = SimpleNamespace(flush=lambda seconds: True)
    lab = load(SHIPPED / "indoor_lab.yaml")
    scenario = replace(lab, time=replace(lab.time, mode="fast"))
    forwarder = Forwarder(scenario, gateway, link, acknowledge=acks.append)
    inbox = BusInbox[BusMessage](depth=64)
    for tick in range(0, 120, 4):
        inbox.put("clock", encode(Clock(0, 0, tick, 5)), Clock)
    while arrived := forwarder.listen(inbox):
        forwarder.handle(*arrived)
    # The first of the episode, one each 50 ticks, and the last.
    assert [ack.tick for ack in acks] == [0, 52, 104, 116]


@pytest.mark.parametrize(
    ("seconds", "stale_seconds"), [(2.5, 0.0), (8.0, 5.0)], ids=["stood still", "cut off"]
)
def test_stale_messages_of_a_pile_are_dropped_and_counted(
    seconds: float, stale_seconds: float
) -> None:
    """Samples of 100 a second, each behind its clock, and all of them waiting."""
    bench, inbox = Bench(), BusInbox[BusMessage](depth=8192)
    link: Any = bench.link
    forwarder = Forwarder(
        load(SHIPPED / "indoor_lab.yaml"), bench.gateway, link, acknowledge=lambda ack: None
    )

    def arrives(hundredth: int) -> None:
        stamp = hundredth * SECOND // 100
        inbox.put(CLOCK_KEY, encode(Clock(stamp, 0, hundredth * 4, 7)), Clock)
        inbox.put(IMU_KEY, encode(sample(stamp)), type(sample(0)))

    def hears() -> None:
        while len(inbox) or forwarder._pile:
            arrived = forwarder.listen(inbox)
            assert arrived is not None
            forwarder.handle(*arrived)

    arrives(1)
    hears()
    count = round(seconds * 100)
    assert count > PILE_MESSAGES
    for hundredth in range(2, 2 + count):
        arrives(hundredth)
    hears()
    stale = 2 * round(stale_seconds * 100)
    assert bench.gateway.counts["stale"] == pytest.approx(stale, abs=4)
    sent = [one["stamp"] for one in link.sent if one["topic"] == "/imu"]
    assert len(sent) == pytest.approx(1 + count - stale // 2, abs=2)
    assert sent[-1] == (1 + count) * SECOND // 100
    arrives(2 + count)
    hears()
    assert len([one for one in link.sent if one["topic"] == "/imu"]) == len(sent) + 1
