# SPDX-License-Identifier: Apache-2.0
"""The stack for real: all of it healthy, each topic at its rate, back within 5 s of a fault."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from . import stack as stacks
from .stack import Observer, Stack, docker, needs_docker, up

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

DECLARED_HZ = {
    "/clock": 100.0,
    "/points": 10.0,
    "/imu": 400.0,
    "/wheel_encoders": 50.0,
    "/camera/image_raw/compressed": 30.0,
    "/camera/camera_info": 30.0,
}

BACK_SECONDS = 5.0

TOPIC_OF = {
    "rover-lidar": "/points",
    "rover-imu": "/imu",
    "rover-encoders": "/wheel_encoders",
    "rover-camera": "/camera/image_raw/compressed",
}


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    needs_docker()
    with up() as found:
        yield found
    left = docker("ps", "-aq", "--filter", f"label=com.docker.compose.project={stacks.PROJECT}")
    assert not left


@pytest.fixture(scope="module")
def observer(stack: Stack) -> Iterator[Observer]:
    found = Observer(stack)
    try:
        found.waits_for(lambda seen: set(seen) == set(DECLARED_HZ), 30)
        yield found
    finally:
        found.close()


def flows_again(observer: Observer, topic: str) -> float:
    """Return after how many seconds data flow again on a topic, at least half a second of them."""
    before = observer.look()[topic][0]
    enough = max(2.0, DECLARED_HZ[topic] / 4)
    return observer.waits_for(lambda seen: seen[topic][0] >= before + enough, 3 * BACK_SECONDS)


def test_every_container_is_healthy(stack: Stack) -> None:
    for service, row in stack.containers().items():
        assert row["State"] == "running", service
        assert row["Health"] == "healthy", service


def test_every_topic_has_its_rate_in_another_container(stack: Stack, observer: Observer) -> None:
    rates = observer.rates(20)
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


@pytest.mark.parametrize("service", sorted(TOPIC_OF))
def test_a_sensor_that_crashes_comes_back_and_the_others_go_on(
    stack: Stack, observer: Observer, service: str
) -> None:
    restarts, before = stack.restarts(service), observer.look()
    begun = time.monotonic()
    stack.crash(service)
    seconds = flows_again(observer, TOPIC_OF[service])
    assert seconds < BACK_SECONDS
    assert stack.restarts(service) == restarts + 1
    time.sleep(max(0.0, 5.0 - (time.monotonic() - begun)))
    after = observer.look()
    for topic, declared in DECLARED_HZ.items():
        if not topic.startswith(TOPIC_OF[service].rpartition("/image")[0] or "/"):
            elapsed = (after["/clock"][1] - before["/clock"][1]) * 1e-9
            assert after[topic][0] - before[topic][0] > 0.9 * declared * elapsed - 2, topic


@pytest.mark.parametrize("service", ["gateway", "ros2", "physics", "router"])
def test_what_all_need_comes_back(stack: Stack, observer: Observer, service: str) -> None:
    stack.crash(service)
    for topic in DECLARED_HZ:
        assert flows_again(observer, topic) < BACK_SECONDS, topic


@pytest.mark.parametrize("seconds", [5, 25])
def test_a_sensor_that_was_cut_off_goes_on_with_what_is_new(
    stack: Stack, observer: Observer, seconds: float
) -> None:
    with stack.cut_off("rover-imu"):
        time.sleep(seconds)
        others: dict[str, Any] = observer.rates(2)
        assert others["/points"] == pytest.approx(10, rel=0.15)
    flows_again(observer, "/imu")
    seen = observer.look()
    assert abs(seen["/imu"][1] - seen["/clock"][1]) < 1e9


def test_physics_that_stands_still_for_three_seconds_goes_on(
    stack: Stack, observer: Observer
) -> None:
    name = stack.name("physics")
    docker("pause", name)
    time.sleep(3)
    docker("unpause", name)
    for topic in DECLARED_HZ:
        assert flows_again(observer, topic) < BACK_SECONDS, topic
