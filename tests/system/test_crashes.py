# SPDX-License-Identifier: Apache-2.0
"""System tests of crashes: killed processes restart, and the other processes continue."""

import os
import signal
import time
from collections.abc import Iterator

import numpy as np
import pytest

from .rig import Observer, Rig, children_of, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.alone]

BACK_WITHIN_SECONDS = 3.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, Observer, int]]:
    with rig(tmp_path_factory.mktemp("run")) as it:
        observer = Observer(it)
        supervisor = it.up()
        for topic in ("/points", "/imu", "/wheel_encoders"):
            wait_for(lambda topic=topic: observer.count(topic) > 5, 60, f"{topic} arrives")
        yield it, observer, supervisor.pid


def gap_after(observer: Observer, topic: str, moment: float) -> float:
    """Return the longest silence of a topic since shortly before `moment`, in seconds."""
    seen = [m["seen"] for m in observer.read()[topic] if m["seen"] > moment - 0.5]
    return float(np.diff([*seen, time.monotonic()]).max())


@pytest.mark.parametrize(
    ("victim", "silenced"),
    [
        ("services.sensors.lidar", {"/points"}),
        ("services.sensors --name rover/imu", {"/imu", "/wheel_encoders"}),
        ("services.gateway", {"/points", "/imu", "/wheel_encoders", "/clock"}),
        ("udp_bridge_ros2", {"/points", "/imu", "/wheel_encoders", "/clock"}),
    ],
)
def test_a_killed_process_is_back(
    run: tuple[Rig, Observer, int], victim: str, silenced: set[str]
) -> None:
    _, observer, supervisor = run
    others = {"/points", "/imu", "/wheel_encoders", "/clock"} - silenced
    before = children_of(supervisor)
    pid = next(pid for pid, command in before.items() if victim in command)
    killed = time.monotonic()
    os.kill(pid, signal.SIGKILL)
    wait_for(lambda: pid not in children_of(supervisor), 2, "the process is gone")

    def all_flow() -> bool:
        observed = observer.read()
        return all(sum(m["seen"] > killed + 0.3 for m in observed[topic]) > 3 for topic in silenced)

    wait_for(all_flow, 10, f"topics flow again: {silenced}")
    for topic in silenced:
        assert gap_after(observer, topic, killed) < BACK_WITHIN_SECONDS, topic
    for topic in others:
        assert gap_after(observer, topic, killed) < 1.0, f"{topic} stopped too"
    after = children_of(supervisor)
    assert len(after) == len(before)
    assert set(before) - set(after) == {pid}, "only the killed process was replaced"


def test_ctrl_c_ends_all_of_it(run: tuple[Rig, Observer, int]) -> None:
    it, _, supervisor = run
    children = children_of(supervisor)
    assert len(children) == 5
    pressed = time.monotonic()
    os.kill(supervisor, signal.SIGINT)
    wait_for(lambda: "summary" in it.log("up.log"), 5, "a summary")
    wait_for(
        lambda: not any(os.path.exists(f"/proc/{pid}/exe") for pid in children), 5, "no orphan"
    )
    assert time.monotonic() - pressed < 4.0
    assert "killed after the timeout for a clean exit" not in it.log("up.log")
