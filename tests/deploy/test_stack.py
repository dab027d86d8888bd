# SPDX-License-Identifier: Apache-2.0
"""The stack for real: all of it healthy, each topic at its rate, back within 5 s of a fault."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from tests.system.rig import REPOSITORY

from . import stack as stacks
from .ledger import Ledger
from .stack import Observer, Seen, Stack, docker, needs_docker, up

pytestmark = [pytest.mark.system, pytest.mark.stack, pytest.mark.timeout(600)]

DECLARED_HZ = {
    "/clock": 100.0,
    "/points": 10.0,
    "/imu": 400.0,
    "/wheel_encoders": 50.0,
    "/camera/image_raw/compressed": 30.0,
    "/camera/camera_info": 30.0,
}

BACK_SECONDS = 5.0

TOPICS_OF = {
    "rover-lidar": ["/points"],
    "rover-imu": ["/imu"],
    "rover-encoders": ["/wheel_encoders"],
    "rover-camera": ["/camera/image_raw/compressed", "/camera/camera_info"],
}


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    needs_docker()
    with up() as found:
        yield found
    for kind in ("container", "network", "volume"):
        of_project = f"label=com.docker.compose.project={stacks.PROJECT}"
        assert not docker(kind, "ls", "-q", *stacks.ALL[kind], "--filter", of_project), kind


@pytest.fixture(scope="module")
def observer(stack: Stack) -> Iterator[Observer]:
    found = Observer(stack)
    try:
        found.waits_for(lambda seen: set(seen) == set(DECLARED_HZ), 30)
        yield found
    finally:
        found.close()


def assert_back(observer: Observer, topics: Iterable[str], since: float) -> None:
    """Data flow again on these topics, at least a quarter of a second of them."""
    time.sleep(max(0.0, since + 0.5 - time.monotonic()))  # what was under way has come
    before = observer.look()

    def flow(seen: Seen) -> bool:
        return all(seen[t][0] - before[t][0] >= max(2, DECLARED_HZ[t] / 4) for t in topics)

    observer.waits_for(flow, BACK_SECONDS * 3)
    seconds = time.monotonic() - since
    print(f"back after {seconds:.1f} s")
    assert seconds < BACK_SECONDS


def assert_kept(before: Seen, after: Seen, topics: Iterable[str]) -> None:
    """No topic of these has lost more than a twentieth of what was due between two looks."""
    elapsed = (after["/clock"][1] - before["/clock"][1]) * 1e-9
    for topic in topics:
        due = DECLARED_HZ[topic] * elapsed
        assert after[topic][0] - before[topic][0] >= 0.95 * due - 2, topic


def others_of(service: str) -> list[str]:
    return [topic for topic in DECLARED_HZ if topic not in TOPICS_OF[service]]


def test_every_container_is_healthy(stack: Stack) -> None:
    for service, row in stack.containers().items():
        assert row["State"] == "running", service
        assert row["Health"] == "healthy", service


def test_every_topic_has_its_rate_in_another_container(observer: Observer) -> None:
    rates = observer.rates(20)
    print(rates)
    for topic, declared in DECLARED_HZ.items():
        assert rates[topic] == pytest.approx(declared, rel=0.05), rates


def test_no_container_may_write_or_has_rights(stack: Stack) -> None:
    for service in stack.containers():
        format_ = "{{.Config.User}} {{.HostConfig.ReadonlyRootfs}} {{.HostConfig.CapDrop}}"
        assert docker("inspect", "-f", format_, stack.name(service)).split() == [
            "65532:65532",
            "true",
            "[ALL]",
        ], service


@pytest.mark.parametrize("service", sorted(TOPICS_OF))
def test_a_sensor_that_crashes_comes_back_and_the_others_go_on(
    stack: Stack, observer: Observer, service: str
) -> None:
    with Ledger(stack.endpoint) as ledger:
        ledger.hears(service.replace("-", "/"))
        restarts, before = stack.restarts(service), observer.look()
        begun = time.monotonic()
        stack.crash(service)
        assert_back(observer, TOPICS_OF[service], begun)
        assert stack.restarts(service) == restarts + 1
        assert_kept(before, observer.look(), others_of(service))
        told, untold = ledger.missing(service.replace("-", "/"))
    assert set(told) <= {"restarted", "not there", "overloaded"}
    assert not untold


@pytest.mark.parametrize("service", ["gateway", "ros2", "physics", "router"])
def test_what_all_need_comes_back(stack: Stack, observer: Observer, service: str) -> None:
    restarts = stack.restarts(service)
    begun = time.monotonic()
    stack.crash(service)
    assert_back(observer, DECLARED_HZ, begun)
    assert stack.restarts(service) == restarts + 1


@pytest.mark.parametrize("order", [("ros2", "gateway"), ("gateway", "ros2")])
def test_ros_may_be_restarted_first_or_last(
    stack: Stack, observer: Observer, order: tuple[str, ...]
) -> None:
    for service in order:
        stack.compose("restart", "-t", "2", service)
    assert_back(observer, DECLARED_HZ, time.monotonic())


@pytest.mark.parametrize("seconds", [5, 25])
def test_a_sensor_that_was_cut_off_goes_on_with_what_is_new(
    stack: Stack, observer: Observer, seconds: float
) -> None:
    with Ledger(stack.endpoint) as ledger:
        ledger.hears("rover/imu")
        before = observer.look()
        with stack.cut_off("rover-imu"):
            time.sleep(seconds)
        begun = time.monotonic()
        assert_back(observer, ["/imu"], begun)
        after = observer.look()
        assert abs(after["/imu"][1] - after["/clock"][1]) < 0.5e9
        assert_kept(before, after, others_of("rover-imu"))
        told, untold = ledger.missing("rover/imu")
    print(told)
    assert sum(told.values()) > (seconds - 2) * DECLARED_HZ["/imu"]
    assert not untold


def test_physics_that_stands_still_for_three_seconds_goes_on(
    stack: Stack, observer: Observer
) -> None:
    with Ledger(stack.endpoint) as ledger:
        ledger.hears("rover/imu")
        docker("pause", stack.name("physics"))
        time.sleep(3)
        docker("unpause", stack.name("physics"))
        assert_back(observer, DECLARED_HZ, time.monotonic())
        _, untold = ledger.missing("rover/imu")
    assert not untold


def test_what_the_gateway_sent_arrived_or_is_accounted_for(stack: Stack) -> None:
    for row in stack.streams():
        arrived_or_lost = row["messages"] + row["lost"]
        assert row["sent"] == arrived_or_lost + row["dropped"] + row["in_flight"], row


@pytest.mark.parametrize(
    "file", sorted(REPOSITORY.glob("deploy/compose.*.yaml")), ids=lambda file: file.name
)
def test_what_may_be_laid_over_fits(file: Path) -> None:
    needs_docker()
    docker("compose", "-f", "compose.yaml", "-f", str(file), "config", "-q")
