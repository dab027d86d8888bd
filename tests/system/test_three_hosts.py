# SPDX-License-Identifier: Apache-2.0
"""Physics, sensors, and the gateway with ROS on three hosts, and a cable that is pulled."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from groundlink.scenario import load
from groundlink.topics import process_names

from .hosts import Hosts, hosts
from .rig import Observer, Rig, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.stack]

NEAR = "rover/encoders"
"""The sensor that is with physics, and not on the hosts that are cut off."""

PERIODS_NANOS = {"/points": 100_000_000, "/imu": 2_500_000, "/wheel_encoders": 20_000_000}
CUTS_SECONDS = (5.0, 15.0)
"""Shorter and longer than the 10 s after which Zenoh takes who is silent for gone."""

BACK_WITHIN_SECONDS = 5.0


class Spread(NamedTuple):
    """A run on three hosts."""

    hosts: Hosts
    rig: Rig
    observer: Observer

    def start(self, host: str, name: str, *command: str) -> None:
        """Start a process on a host."""
        log = f"{name.replace('/', '_')}.log"
        self.rig.start("-m", *command, log=log, through=self.hosts.inside(host))

    def wait_for_topics(self, since: float) -> None:
        """Wait until each topic has come on after an instant."""
        for topic in PERIODS_NANOS:
            self._wait_for(topic, since)

    def _wait_for(self, topic: str, since: float) -> None:
        wait_for(lambda: self.seen(topic, since).size > 5, 30, f"{topic} comes on")

    def cut(self, host: str, seconds: float) -> tuple[float, float]:
        """Pull a host's cable for a while; return when, and when it was put in again."""
        pulled = time.monotonic()
        self.hosts.cut(host)
        wait_for(lambda: time.monotonic() > pulled + seconds, seconds + 5, "a while passes")
        self.hosts.restore(host)
        return pulled, time.monotonic()

    def seen(self, topic: str, since: float) -> np.ndarray:
        """Return when messages of a topic arrived, from an instant on."""
        return np.array([m["seen"] for m in self.observer.read()[topic] if m["seen"] >= since])

    def stamps(self, topic: str) -> np.ndarray:
        return np.array([m["stamp"] for m in self.observer.read()[topic]])


@pytest.fixture
def spread(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Spread]:
    folder = tmp_path_factory.mktemp("spread")
    time_section = "time: {overload: skip}\n"  # who is cut off is not waited for
    with (
        hosts("simulator", "sensors", "ros") as three,
        rig(folder, time_section=time_section) as it,
    ):
        it.environment["GROUNDLINK_ROUTER"] = f"tcp/{three.addresses['simulator']}:7447"
        run = Spread(three, it, Observer(it, through=three.inside("ros")))
        run.start("simulator", "router", "services.router", "--listen", "tcp/0.0.0.0:7447")
        wait_for(lambda: "listens" in it.log("router.log"), 30, "the router listens")
        run.start("simulator", "physics", "services.physics", str(it.scenario))
        for name, module in process_names(load(str(it.scenario))).items():
            if "/" in name:
                host = "simulator" if name == NEAR else "sensors"
                run.start(host, name, module, "--name", name)
        run.start("ros", "gateway", "services.gateway")
        run.start("ros", "node", "udp_bridge_ros2", "--bind", it.address(it.peer))
        for topic in PERIODS_NANOS:
            run.observer.wait(topic, beyond=5, seconds=90)
        yield run


@pytest.mark.parametrize("seconds", CUTS_SECONDS[:1])
def test_sensors_that_are_cut_off_come_back_and_the_rest_goes_on(
    spread: Spread, seconds: float
) -> None:
    pulled, put_in = spread.cut("sensors", seconds)
    spread.wait_for_topics(put_in)
    near = spread.seen("/wheel_encoders", pulled)
    assert np.diff(near).max() < 1.0, "who was not cut off keeps its rate"
    for topic in ("/points", "/imu"):
        seen = spread.seen(topic, pulled)
        cut_off = int(np.diff(seen).argmax())
        assert np.diff(seen)[cut_off] > seconds / 2, "it was cut off"
        assert seen[cut_off + 1] < put_in + BACK_WITHIN_SECONDS
        assert np.diff(spread.stamps(topic)).min() > 0, "nothing old is told as new"


@pytest.mark.parametrize("seconds", CUTS_SECONDS)
def test_ros_that_is_cut_off_comes_back_and_nobody_waits_for_it(
    spread: Spread, seconds: float
) -> None:
    pulled, put_in = spread.cut("ros", seconds)
    spread.wait_for_topics(put_in)
    for topic, period_nanos in PERIODS_NANOS.items():
        seen, stamps = spread.seen(topic, pulled), spread.stamps(topic)
        cut_off = int(np.diff(seen).argmax())
        assert seen[cut_off + 1] < put_in + BACK_WITHIN_SECONDS
        assert np.diff(stamps).min() >= period_nanos, "in order, and none twice"
    log = spread.rig.log("router.log")
    assert "gateway" in log
    assert not [line for line in log.splitlines() if " went" in line and "gateway" not in line]
