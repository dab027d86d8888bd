# SPDX-License-Identifier: Apache-2.0
"""System tests of LiDAR blocks: in real time, all Ethernet-sized datagrams reach ROS."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import Health, StreamReport

from .rig import Observer, Rig, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.alone]

BLOCKS_PER_S = 240  # 24 a revolution, 10 revolutions
SECONDS = 5
TRIES = 3
LOSSES = ("superseded", "missing", "incomplete", "late", "dropped")


@dataclass
class Running:
    rig: Rig
    observer: Observer
    report: Callable[[], StreamReport]
    """The gateway's next word about the points."""


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    with rig(tmp_path) as it:
        text = it.scenario.read_text(encoding="utf-8")
        for old, new in (
            ("gateway: {", "gateway: {datagram: mtu, "),
            ("block_deg: 0, ", ""),
        ):
            assert old in text
            text = text.replace(old, new)
        it.scenario.write_text(text, encoding="utf-8")
        observer = Observer(it)
        it.up()
        wait_for(lambda: observer.count("/points") > BLOCKS_PER_S, 60, "blocks arrive in ROS")
        with Bus(connect=it.endpoint) as bus:
            health: BusInbox[Health] = BusInbox(depth=1000)
            bus.subscribe(HEALTH.key_in(it.run), Health, health)

            def report() -> StreamReport:
                while True:
                    arrived = health.get(seconds=5)
                    assert arrived, "the gateway fell silent"
                    for stream in arrived[1].streams:
                        if stream.topic == "/points":
                            return stream

            yield Running(it, observer, report)


def test_five_seconds_of_blocks_reach_ros(running: Running) -> None:
    """None is lost before the node publishes it, and a subscriber sees them one after another."""
    losses: list[dict[str, int]] = []
    # Where something else takes both processors for a quarter of a second, the newest win.
    while len(losses) < TRIES:
        lost, seen = seconds_of_blocks(running)
        if not any(lost.values()):
            break
        losses.append(lost)
    assert len(losses) < TRIES, losses
    gaps = np.unique(np.diff([message["stamp"] for message in seen]))
    assert gaps.tolist() == [4_166_666, 4_166_667], "15 degrees of 10 Hz each"
    assert max(message["data"] for message in seen) <= 150 * 16 * 22, "blocks, no revolutions"


def seconds_of_blocks(running: Running) -> tuple[dict[str, int], list[dict[str, Any]]]:
    """Return how many blocks each kind of loss took within `SECONDS`, and what ROS saw."""
    before = running.report()
    begin = running.observer.count("/points")
    wanted = SECONDS * BLOCKS_PER_S
    wait_for(
        lambda: running.observer.count("/points") > begin + wanted, 2 * SECONDS, f"{wanted} blocks"
    )
    after = before
    while after.sent < before.sent + wanted:
        after = running.report()
    come = after.messages + after.in_flight - before.messages - before.in_flight
    lost = {name: getattr(after, name) - getattr(before, name) for name in LOSSES}
    assert come + sum(lost.values()) - lost["superseded"] == after.sent - before.sent
    return lost, running.observer.messages["/points"][begin : begin + wanted]
