# SPDX-License-Identifier: Apache-2.0
"""System tests of three hosts (physics, sensors, gateway with ROS) with disconnected cables."""

import subprocess
import time
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from groundlink.bus.topics import process_names
from groundlink.loader import load
from groundlink.recording.reader import Recording
from groundlink.report.analysis.completeness import IN_TRANSIT, UNEXPLAINED
from groundlink.report.analysis.gather import RunSummary, gather

from .hosts import Hosts, hosts
from .rig import Observer, Rig, rig, wait_for

# A repeated test builds the run and all that happens in it again.
pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

NEAR = "rover/encoders"
"""The sensor that is with physics, and not on the hosts that are cut off."""

PERIODS_NANOS = {"/points": 100_000_000, "/imu": 2_500_000, "/wheel_encoders": 20_000_000}
CUT_SECONDS = {"sensors": 10.5, "ros": 5.0}
"""Longer and shorter than the 10 s after which Zenoh takes who is silent for gone; just longer, so
that who comes back meets a router that still ends the old link."""

TOLD_SECONDS = 3.0
"""Within so long a process has told its counters, once a second, and they are recorded."""

UNDER_WAY_SECONDS = 1.0
"""Of readings that were on a cable that is pulled, or in a router that is killed."""

BACK_WITHIN_SECONDS = 5.0
DEAF_SECONDS = 20.0
"""The same for a process whose session was deaf afterwards (see `RouterCheck`)."""

STALL_SECONDS = 2.0
"""More than a router waits for who is cut off, far less than the cut."""


class Spread(NamedTuple):
    """A run on three hosts, with a recorder beside physics."""

    hosts: Hosts
    rig: Rig
    observer: Observer

    def start(self, host: str, name: str, *command: str) -> subprocess.Popen[str]:
        """Start a process on a host."""
        log = f"{name.replace('/', '_')}.log"
        return self.rig.start("-m", *command, log=log, through=self.hosts.inside(host))

    def start_router(self) -> subprocess.Popen[str]:
        return self.start("simulator", "router", "services.router", "--listen", "tcp/0.0.0.0:7447")

    def seen(self, topic: str, since: float) -> np.ndarray:
        """Return when messages of a topic arrived, from an instant on."""
        return np.array([m["seen"] for m in self.observer.read()[topic] if m["seen"] >= since])

    def wait_for_topics(self, since: float) -> None:
        """Wait until each topic has come on after an instant."""
        for topic in PERIODS_NANOS:
            wait_for(partial(self._has_come_on, topic, since), 30, f"{topic} comes on")

    def assert_topics_are_back(self, since: float) -> None:
        """Each topic has come on after an instant, within the time for it."""
        logs = self.rig.folder.glob("*.log")
        was_deaf = any("sends nothing; starting again" in log.read_text() for log in logs)
        within = DEAF_SECONDS if was_deaf else BACK_WITHIN_SECONDS
        for topic in PERIODS_NANOS:
            assert self.seen(topic, since)[0] < since + within, topic

    def _has_come_on(self, topic: str, since: float) -> bool:
        return self.seen(topic, since).size > 5

    def cut(self, host: str) -> "Event":
        """Pull a host's cable for a while, and wait until all topics come on."""
        log_before = self.rig.log("router.log")
        self.hosts.cut(host)
        pulled = time.monotonic()
        until = pulled + CUT_SECONDS[host]
        wait_for(lambda: time.monotonic() > until, CUT_SECONDS[host] + 5, "a while passes")
        put_in = time.monotonic()
        self.hosts.restore(host)
        self.wait_for_topics(put_in)
        return Event(pulled, put_in, self.rig.log("router.log").removeprefix(log_before))

    def assert_nothing_old_is_new(self) -> None:
        for topic, period_nanos in PERIODS_NANOS.items():
            stamps = np.array([m["stamp"] for m in self.observer.read()[topic]])
            assert np.diff(stamps).min() >= period_nanos - 1, f"{topic}: in order, and none twice"


@pytest.fixture(scope="module")
def spread(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Spread]:
    folder = tmp_path_factory.mktemp("spread")
    time_section = "time: {overload: skip}\n"  # who is cut off is not waited for
    with (
        hosts("simulator", "sensors", "ros") as three,
        rig(folder, time_section=time_section) as it,
    ):
        it.environment["GROUNDLINK_ROUTER"] = f"tcp/{three.addresses['simulator']}:7447"
        run = Spread(three, it, Observer(it, through=three.inside("ros")))
        run.start_router()
        wait_for(lambda: "listening" in it.log("router.log"), 30, "the router listens")
        run.start("simulator", "physics", "services.physics", str(it.scenario))
        for name, module in process_names(load(str(it.scenario))).items():
            if "/" in name:
                host = "simulator" if name == NEAR else "sensors"
                run.start(host, name, module, "--name", name)
        out = str(folder / "run.mcap")
        run.start("simulator", "recorder", "services.recorder", "--out", out)
        run.start("ros", "gateway", "services.gateway")
        run.start("ros", "node", "udp_bridge_ros2", "--bind", it.address(it.peer))
        for topic in PERIODS_NANOS:
            run.observer.wait(topic, beyond=5, seconds=90)
        yield run


class Event(NamedTuple):
    """A cut or the end of the router, in the run of all tests."""

    begun: float
    over: float
    """When the cable was put in again, or another router listened."""

    router_said: str
    """The lines of the router since it began."""


@pytest.fixture(scope="module")
def sensors_cut(spread: Spread) -> Event:
    return spread.cut("sensors")


@pytest.fixture(scope="module")
def ros_cut(spread: Spread, sensors_cut: Event) -> Event:
    return spread.cut("ros")


@pytest.fixture(scope="module")
def router_killed(spread: Spread, ros_cut: Event) -> Event:
    (router,) = (p for p in spread.rig.started if "services.router" in str(p.args))
    killed = time.monotonic()
    router.kill()
    router.wait(10)
    spread.start_router()
    wait_for(lambda: "listening" in spread.rig.log("router.log"), 30, "the router listens")
    listens = time.monotonic()
    spread.wait_for_topics(listens)
    spread.wait_for_topics(time.monotonic() + TOLD_SECONDS)
    return Event(killed, listens, spread.rig.log("router.log"))


def test_sensors_that_are_cut_off_come_back_and_the_rest_goes_on(
    spread: Spread, sensors_cut: Event
) -> None:
    spread.assert_topics_are_back(sensors_cut.over)
    near = spread.seen("/wheel_encoders", sensors_cut.begun)
    assert np.diff(near).max() < STALL_SECONDS, "who was not cut off goes on"
    spread.assert_nothing_old_is_new()


def test_ros_that_is_cut_off_comes_back_and_only_it_went(spread: Spread, ros_cut: Event) -> None:
    spread.assert_topics_are_back(ros_cut.over)
    spread.assert_nothing_old_is_new()
    left = [line for line in ros_cut.router_said.splitlines() if " left" in line]
    assert not [line for line in left if "gateway" not in line]


def test_router_restart_is_survived(spread: Spread, router_killed: Event) -> None:
    spread.assert_topics_are_back(router_killed.over)
    spread.assert_nothing_old_is_new()


@pytest.fixture(scope="module")
def recorded(spread: Spread, router_killed: Event) -> RunSummary:
    """What the recorder beside physics has of all that, now that all processes have ended."""
    spread.rig.stop()
    with Recording(spread.rig.folder / "run.mcap") as recording:
        return gather(recording, lambda share: None)


def test_the_sums_add_up_beside_physics(recorded: RunSummary) -> None:
    """Every reading that was due was recorded, or its sensor told why not, or a link lost it."""
    for stream in recorded.completeness:
        missing = stream.missing()
        print(stream.topic, stream.due, stream.published, dict(missing))
        assert stream.due == stream.published + missing.total()
        assert missing[UNEXPLAINED] * PERIODS_NANOS[stream.topic] < UNDER_WAY_SECONDS * 1e9
        if stream.sensor == NEAR:
            lost = [hole for hole in stream.holes() if hole.cause == "states lost"]
            assert len(lost) == 1, "it lacks what the router's end has cost"
        else:
            due_in_cut = CUT_SECONDS["sensors"] * 1e9 / PERIODS_NANOS[stream.topic]
            assert missing.total() - missing[IN_TRANSIT] > 0.5 * due_in_cut


def test_the_sums_add_up_in_ros(spread: Spread, recorded: RunSummary) -> None:
    """Every reading arrived in ROS, or the gateway counted it as one that did not come.

    What the gateway has sent is no measure: one whose session was deaf starts to count again.
    """
    counters = recorded.diagnostics.processes["gateway"]
    for topic, period_nanos in PERIODS_NANOS.items():
        stamps = [m["stamp"] for m in spread.observer.read()[topic]]
        due = (stamps[-1] - stamps[0]) // period_nanos + 1
        not_come = int(counters[f"not_come_{topic}"])
        print(topic, due, len(stamps), not_come)
        due_in_cut = CUT_SECONDS["ros"] * 1e9 / period_nanos
        assert not_come > 0.5 * due_in_cut
        # The counters were told within the last seconds.
        assert len(stamps) + not_come == pytest.approx(due, abs=0.8 * due_in_cut)
