# SPDX-License-Identifier: Apache-2.0
"""System test of counters and odometry: a crash changes no byte of a fast run."""

import os
import signal
from pathlib import Path

import pytest

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.base import BusMessage, WheelEncoders, encode
from groundlink.messages.navigation import Odometry

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

SCENARIO = """\
name: wheels
seed: 4
world: worlds/lab.yaml
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    placement: {x_m: -2.0, y_m: 0.0}
    route: {kind: circle, radius_m: 0.8, speed_mps: 0.5}
    sensors:
      - kind: encoders
        name: encoders
        topic: /wheels
        frame: base_link
        missed_ticks: 0.01
        resets_s: [1.0, 2.5]
      - {kind: wheel_odometry, name: odometry, encoders: encoders, topic: /odom, frame: odom}
time: {mode: fast, epoch: zero, window_ticks: 200}
"""

STREAMS = {
    "encoders": (SENSOR_TOPICS["encoders"], WheelEncoders),
    "odometry": (SENSOR_TOPICS["wheel_odometry"], Odometry),
}
MODULES = {"encoders": "encoders", "odometry": "wheel_odometry"}
CRASH_NANOS, UNTIL_NANOS = 1_500_000_000, 4_000_000_000


def start(it: Rig, name: str) -> int:
    command = ("-m", f"services.sensors.{MODULES[name]}", "--name", f"rover/{name}")
    return it.start(*command, "--connect", it.endpoint, log=f"{name}.log").pid


def played(folder: Path, *, crash: bool) -> dict[str, dict[int, bytes]]:
    """Return what was sent of each stream, by stamp."""
    with rig(folder) as it:
        it.scenario.write_text(SCENARIO, encoding="utf-8")
        it.start(
            *("-m", "services.physics", str(it.scenario), "--listen", it.endpoint),
            log="physics.log",
        )
        wait_for(it.is_answered, 20, "physics listens")
        with Bus(connect=it.endpoint) as bus:
            inboxes: dict[str, BusInbox[BusMessage]] = {}
            for name, (topic, message) in STREAMS.items():
                inbox: BusInbox[BusMessage] = BusInbox(depth=100_000)
                key = topic.key_in("wheels", vehicle="rover", sensor=name)
                bus.subscribe(key, message, inbox)
                inboxes[name] = inbox
            pids = {name: start(it, name) for name in STREAMS}
            it.start(
                *("-m", "services.driver", "--name", "rover/driver", "--connect", it.endpoint),
                log="driver.log",
            )
            sent: dict[str, dict[int, bytes]] = {name: {} for name in STREAMS}
            for name, inbox in inboxes.items():
                while UNTIL_NANOS not in sent[name]:
                    arrived = inbox.get(seconds=60)
                    assert arrived, f"{name} fell silent"
                    stamp: int = arrived[1].stamp_nanos  # type: ignore[attr-defined]
                    # A successor repeats what its predecessor had not acknowledged: the same.
                    assert sent[name].setdefault(stamp, encode(arrived[1])) == encode(arrived[1])
                    if crash and stamp >= CRASH_NANOS:
                        for victim, pid in pids.items():
                            os.kill(pid, signal.SIGKILL)
                            start(it, victim)
                        crash = False
    return {
        name: {stamp: body for stamp, body in bodies.items() if stamp <= UNTIL_NANOS}
        for name, bodies in sent.items()
    }


def test_a_crash_changes_no_byte_of_counters_and_odometry(tmp_path: Path) -> None:
    (tmp_path / "whole").mkdir()
    (tmp_path / "crashed").mkdir()
    whole = played(tmp_path / "whole", crash=False)
    assert [len(bodies) for bodies in whole.values()] == [201, 201]
    assert played(tmp_path / "crashed", crash=True) == whole
