# SPDX-License-Identifier: Apache-2.0
"""/diagnostics of the real node, read by a subscriber of its own process."""

from typing import Any

from . import bodies
from .conftest import RELIABLE, FarEnd, Ros
from .processes import Process

DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
PARTS = ("delivered", "missing", "incomplete", "late", "dropped", "waiting")


def statuses(listener: Process) -> dict[str, Any]:
    """Return the newest array's statuses by name: level, hardware_id and values."""
    arrays = listener.messages("/diagnostics")
    return dict(arrays[-1][1]) if arrays else {}


def test_counters_are_published_and_add_up(ros: Ros) -> None:
    _, address = ros.bridge()
    far_end = FarEnd(address)
    listener = ros.listen((DIAGNOSTICS, "/diagnostics", RELIABLE))
    for number in range(200):
        if number % 10 == 0:
            far_end.skip(2, "/imu")
        far_end.send(2, "/imu", number + 1, bodies.imu(number + 1), "imu")
    far_end.refuse()

    def is_told() -> bool:
        values = statuses(listener).get("udp_bridge: /imu", [0, "", {}])[2]
        return bool(values.get("delivered") == "200")

    listener.wait_until(is_told, "the count of 200")
    far_end.close()
    _, hardware_id, values = statuses(listener)["udp_bridge: /imu"]
    assert hardware_id == f"udp_bridge {address[0]}:{address[1]}"
    assert {part: int(values[part]) for part in PARTS} == {
        "delivered": 200,
        "missing": 19,  # the first gap is before the first message
        "incomplete": 0,
        "late": 0,
        "dropped": 0,
        "waiting": 0,
    }
    assert int(values["sent"]) == 219
    assert float(values["age p50 (ms)"]) <= float(values["age p99 (ms)"])
    assert int(values["bytes"]) == 200 * len(bodies.imu(1))
    link = statuses(listener)["udp_bridge: link"][2]
    assert link["refused: short"] == "1"
    assert link["kernel drops"] == "0"
