# SPDX-License-Identifier: Apache-2.0
"""Deployment tests: healthy containers, topic rates, and recovery from every fault.

Time is that of the run, by stamps, and every missing reading must be reported. A machine with too
few cores therefore fails no test. The duration of each fault is printed.
"""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from groundlink.core.clock import NANOS
from tests.system.rig import REPOSITORY, wait_for

from .ledger import Ledger
from .stack import ALL, PROJECT, Observer, Seen, Stack, docker, needs_docker, up

pytestmark = [pytest.mark.system, pytest.mark.stack, pytest.mark.timeout(600)]

DECLARED_HZ = {
    "/clock": 100.0,
    "/points": 10.0,
    "/imu": 400.0,
    "/wheel_encoders": 50.0,
    "/camera/image_raw/compressed": 30.0,
    "/camera/camera_info": 30.0,
}
TOPICS_OF = {
    "rover/lidar": ["/points"],
    "rover/imu": ["/imu"],
    "rover/encoders": ["/wheel_encoders"],
    "rover/camera": ["/camera/image_raw/compressed", "/camera/camera_info"],
}
SENSOR_OF = {topic: sensor for sensor, topics in TOPICS_OF.items() for topic in topics}

BACK_SECONDS = 25.0
"""Much more than it takes: a machine may have other things to do."""

UNDER_WAY_SECONDS = 0.25
"""Of a stream, may not have come when another one's message has."""

KEPT = 0.95
"""Of what is due and was not told missing, the part that has to come: UDP guarantees nothing."""


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    needs_docker()
    with up() as found:
        yield found
    for kind in ("container", "network", "volume"):
        of_project = f"label=com.docker.compose.project={PROJECT}"
        assert not docker(kind, "ls", "-q", *ALL[kind], "--filter", of_project), kind


@pytest.fixture(scope="module")
def observer(stack: Stack) -> Iterator[Observer]:
    found = Observer()
    try:
        found.waits_for(lambda seen: set(seen) == set(DECLARED_HZ), BACK_SECONDS)
        yield found
    finally:
        found.close()


@pytest.fixture
def ledger(stack: Stack, observer: Observer) -> Iterator[Ledger]:
    with Ledger(stack.endpoint) as found:
        found.hears(TOPICS_OF)
        yield found


class Watch:
    """What has come between two instants, and what should have."""

    def __init__(self, observer: Observer, ledger: Ledger) -> None:
        self._observer, self._ledger = observer, ledger
        self._told = {name: ledger.told(name) for name in TOPICS_OF}
        self._before = observer.look()

    def kept(self, *but: str) -> dict[str, float]:
        """Return the rates of all sensors but these and of the clock; fail if one was not kept."""
        before, after = self._before, self._observer.look()
        elapsed = (after["/clock"][1] - before["/clock"][1]) / NANOS
        rates = {}
        for topic, declared in DECLARED_HZ.items():
            sensor = SENSOR_OF.get(topic)
            if sensor in but:
                continue
            came = after[topic][0] - before[topic][0]
            told = self._ledger.told(sensor) - self._told[sensor] if sensor else 0
            due = declared * (elapsed - UNDER_WAY_SECONDS) - told - 1
            assert came >= KEPT * due, f"{topic}: {came} in {elapsed:.1f} s, {told} told missing"
            rates[topic] = came / elapsed
        return rates


def back(observer: Observer, topics: Iterable[str], what: str, since: float) -> None:
    """Return when data flow again on these topics, half a second of them; print the time."""
    before = observer.look()

    def flow(seen: Seen) -> bool:
        return all(seen[t][0] - before[t][0] >= max(2, DECLARED_HZ[t] / 2) for t in topics)

    observer.waits_for(flow, BACK_SECONDS)
    print(f"{what}: back after {time.monotonic() - since:.1f} s")


def crash(stack: Stack, observer: Observer, service: str, topics: Iterable[str]) -> None:
    """Crash a container and see it come back alone; what was under way is less than `back` wants.

    The engine is not asked meanwhile: that takes half a core.
    """
    before, begun = stack.starts(), time.monotonic()
    stack.crash(service)
    back(observer, topics, f"crash of {service}", begun)
    after = stack.starts()
    assert {name for name in after if after[name] != before[name]} == {service}


def test_every_container_is_healthy(stack: Stack) -> None:
    for service, row in stack.containers().items():
        assert (row["State"], row["Health"]) == ("running", "healthy"), service


def test_no_container_may_write_or_has_rights(stack: Stack) -> None:
    for service in stack.containers():
        format_ = "{{.Config.User}} {{.HostConfig.ReadonlyRootfs}} {{.HostConfig.CapDrop}}"
        rights = docker("inspect", "-f", format_, stack.name(service)).split()
        assert rights == ["65532:65532", "true", "[ALL]"], service


def test_every_topic_has_its_rate_in_another_container(observer: Observer, ledger: Ledger) -> None:
    watch = Watch(observer, ledger)
    time.sleep(10)
    print({topic: round(rate, 1) for topic, rate in watch.kept().items()})
    print({name: dict(ledger.missing(name)) for name in TOPICS_OF})


def test_sensors_fall_out_and_come_back_while_the_others_keep_their_rates(
    stack: Stack, observer: Observer, ledger: Ledger
) -> None:
    with stack.cut_off("rover-imu"):
        cut = time.monotonic()
        watch = Watch(observer, ledger)
        stack.lose_all("rover-encoders", seconds=5)
        back(observer, TOPICS_OF["rover/encoders"], "cut off for 5 s", time.monotonic())
        watch.kept("rover/imu", "rover/encoders")
        watch = Watch(observer, ledger)
        crash(stack, observer, "rover-lidar", TOPICS_OF["rover/lidar"])
        watch.kept("rover/imu", "rover/lidar")
        watch = Watch(observer, ledger)
        crash(stack, observer, "rover-camera", TOPICS_OF["rover/camera"])
        watch.kept("rover/imu", "rover/camera")
        watch = Watch(observer, ledger)
        crash(stack, observer, "rover-encoders", TOPICS_OF["rover/encoders"])
        watch.kept("rover/imu", "rover/encoders")
        time.sleep(max(0.0, cut + 25 - time.monotonic()))
    back(observer, TOPICS_OF["rover/imu"], "cut off for 25 s", time.monotonic())
    after = observer.look()
    assert abs(after["/imu"][1] - after["/clock"][1]) < NANOS
    watch = Watch(observer, ledger)
    crash(stack, observer, "rover-imu", TOPICS_OF["rover/imu"])
    watch.kept("rover/imu")
    missing = {name: ledger.missing(name) for name in TOPICS_OF}
    print({name: dict(of) for name, of in missing.items()})
    assert sum(missing["rover/imu"].values()) > 20 * DECLARED_HZ["/imu"]
    assert sum(missing["rover/encoders"].values()) > 4 * DECLARED_HZ["/wheel_encoders"]


def test_ros_may_crash_or_be_restarted_first_or_last_and_the_bus_does_not_notice(
    stack: Stack, observer: Observer, ledger: Ledger
) -> None:
    crash(stack, observer, "ros2", DECLARED_HZ)
    crash(stack, observer, "gateway", DECLARED_HZ)
    for order in (("ros2", "gateway"), ("gateway", "ros2")):
        for service in order:
            stack.compose("restart", "-t", "2", service)
        back(observer, DECLARED_HZ, f"restart of {' and '.join(order)}", time.monotonic())
    for name in TOPICS_OF:
        assert set(ledger.missing(name)) <= {"overloaded"}, name


def test_physics_that_stands_still_for_three_seconds_goes_on(
    stack: Stack, observer: Observer, ledger: Ledger
) -> None:
    docker("pause", stack.name("physics"))
    time.sleep(3)
    docker("unpause", stack.name("physics"))
    back(observer, DECLARED_HZ, "pause of physics", time.monotonic())
    for name in TOPICS_OF:
        assert set(ledger.missing(name)) <= {"overloaded"}, name


@pytest.mark.parametrize("service", ["router", "physics"])
def test_what_all_need_comes_back_and_nobody_else_is_started_again(
    stack: Stack, observer: Observer, ledger: Ledger, service: str
) -> None:
    crash(stack, observer, service, DECLARED_HZ)
    watch = Watch(observer, ledger)
    time.sleep(2)
    watch.kept()
    print({name: dict(ledger.missing(name)) for name in TOPICS_OF})


def test_all_is_well_in_the_end(stack: Stack) -> None:
    def are_healthy() -> bool:
        return all(row["Health"] == "healthy" for row in stack.containers().values())

    wait_for(are_healthy, BACK_SECONDS, "every container is healthy")
    for row in stack.streams():
        assert row["in_flight"] <= 3 * (row["declared_hz"] or 1) + 3, row


@pytest.mark.parametrize(
    "file", sorted(REPOSITORY.glob("deploy/compose.*.yaml")), ids=lambda file: file.name
)
def test_what_may_be_laid_over_fits(file: Path) -> None:
    needs_docker()
    docker("compose", "-f", "compose.yaml", "-f", str(file), "config", "-q")
