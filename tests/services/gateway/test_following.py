# SPDX-License-Identifier: Apache-2.0
"""A gateway that waits for nobody in ROS, between clocks of the bus and a stand-in of the rest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from groundlink.messages import Ack, Clock
from groundlink.scenario import load
from groundlink.scenario.load import SHIPPED
from services.gateway.following import Following


def test_it_tells_how_far_it_is_and_counts_clocks_that_the_bus_has_lost() -> None:
    acks: list[Ack] = []
    gateway: Any = SimpleNamespace(streams={})
    link: Any = None
    scenario = load(SHIPPED / "indoor_lab.yaml")
    following = Following(scenario, gateway, link, acknowledge=acks.append)
    for life, tick in ((5, 300), (5, 304), (5, 312), (6, 0), (6, 4)):  # at 100 Hz
        following.hear("clock", Clock(0, 0, tick, life))
    assert [(ack.life, ack.tick) for ack in acks][-1] == (6, 4)
    assert following.counts == {"clocks_missed": 1}
