# SPDX-License-Identifier: Apache-2.0
"""What `top` knows: states, rates, restarts, all from words and comings and goings."""

import json
from typing import Any

import pytest

from groundlink.messages.base import Health, StreamReport
from groundlink.messages.stalls import Stalls
from groundlink.monitor.overview import SILENT_SECONDS, Overview

STREAM = StreamReport("/imu", "Imu", 400.0, 399.0, 0.004, 10, 2, missing=2, sent=12)


def health(process: str, tick: int, readings: int = 0, *, pid: int = 1, **more: Any) -> Health:
    return Health(process, pid, tick, {"readings": readings, **more}, host="lab-pc")


@pytest.fixture
def run() -> Overview:
    overview = Overview("lab", {"physics": None, "rover/imu": 400.0, "gateway": None})
    for name in ("physics", "rover/imu"):
        overview.presence_changed(name, True)
    for second in range(5):
        overview.update(health("physics", 200 * second), float(second))
        overview.update(health("rover/imu", 200 * second, 190 * second), second + 0.1)
    return overview


def row(overview: Overview, name: str, now: float = 4.5) -> dict[str, Any]:
    [found] = [row for row in overview.snapshot(now)["processes"] if row["name"] == name]
    return found


def test_a_process_has_its_place_and_its_rate(run: Overview) -> None:
    imu = row(run, "rover/imu")
    assert (imu["state"], imu["host"], imu["pid"], imu["tick"]) == ("alive", "lab-pc", 1, 800)
    assert imu["declared_hz"] == 400.0
    assert imu["measured_hz"] == pytest.approx(380.0)
    assert imu["heard_seconds_ago"] == pytest.approx(0.4)


def test_real_time_factor_is_of_the_latest_health(run: Overview) -> None:
    assert run.snapshot(4.5)["real_time_factor"] == pytest.approx(0.5)
    for second in range(5, 20):
        run.update(health("physics", 800 + 400 * (second - 4)), float(second))
    assert run.snapshot(20.0)["real_time_factor"] == pytest.approx(1.0)


def test_absent_process_is_missing_and_departed_one_gone(run: Overview) -> None:
    assert row(run, "gateway")["state"] == "missing"
    run.presence_changed("rover/imu", False)
    assert row(run, "rover/imu")["state"] == "gone"
    run.presence_changed("rover/imu", True)
    assert row(run, "rover/imu")["state"] == "alive"


def test_in_a_replay_only_its_own_processes_can_be_missing() -> None:
    overview = Overview("lab", dict.fromkeys(("physics", "rover/imu", "rover/driver", "gateway")))
    overview.presence_changed("replay", True)
    overview.presence_changed("rover/imu", True)  # started beside it
    overview.presence_changed("rover/imu", False)
    states = {row["name"]: row["state"] for row in overview.snapshot(1.0)["processes"]}
    assert states == {"replay": "there", "rover/imu": "gone", "gateway": "missing"}
    overview.presence_changed("replay", False)
    states = {row["name"]: row["state"] for row in overview.snapshot(1.0)["processes"]}
    assert states["physics"] == states["rover/driver"] == "missing"


def test_process_without_health_is_silent(run: Overview) -> None:
    assert row(run, "physics", 4.0 + 1.1 * SILENT_SECONDS)["state"] == "silent"
    run.presence_changed("viewer", True)
    assert row(run, "viewer")["state"] == "there"


def test_restart_is_counted_and_resets_its_rate(run: Overview) -> None:
    run.update(health("rover/imu", 1000, 10, pid=2), 5.0)
    imu = row(run, "rover/imu", 5.0)
    assert (imu["restarts"], imu["measured_hz"]) == (1, None)
    run.update(health("rover/imu", 1400, 410, pid=2), 6.0)
    assert row(run, "rover/imu", 6.0)["measured_hz"] == pytest.approx(400.0)


def test_a_new_episode_resets_the_rates(run: Overview) -> None:
    run.update(health("rover/imu", 0, 0), 5.0)
    assert row(run, "rover/imu", 5.0)["measured_hz"] is None


def test_streams_and_the_link_are_the_gateways(run: Overview) -> None:
    counters = {"commands": 3, "wire_stalls": 7, "link_to_ros_lost": 2}
    run.update(Health("gateway", 1, 5, counters, (STREAM,)), 5.0)
    now = run.snapshot(5.0)
    assert now["link"]["counters"] == {"wire_stalls": 7, "link_to_ros_lost": 2}
    assert row(run, "gateway")["counters"] == {"commands": 3}
    [stream] = now["streams"]
    assert stream["topic"] == "/imu"
    assert stream["missing"] == 2
    assert stream["keeps_rate"] is True
    json.dumps(now)


def test_once_is_when_everybody_spoke_twice(run: Overview) -> None:
    assert run.has_rates
    run.presence_changed("gateway", True)
    assert not run.has_rates
    assert not Overview("lab", {"physics": None}).has_rates


def test_stalled_process_is_named(run: Overview) -> None:
    assert run.snapshot(0.0)["stalls"]["stretched_seconds"] == {}
    told = Stalls(("rover/imu",), {"rover/imu": 6.0}, {"rover/imu": 5.0}, 0.4)
    run.update(Health("physics", 1, 400, told.counters()), 1.0)
    assert run.snapshot(1.0)["stalls"] == {
        "silent_now": ("rover/imu",),
        "silent_seconds": {"rover/imu": 6.0},
        "stretched_seconds": {"rover/imu": 5.0},
        "behind_seconds": 0.4,
    }
