# SPDX-License-Identifier: Apache-2.0
"""What is missing in a bag, or has other bytes, is counted."""

from pathlib import Path

from experiments.recording.deliveries import (
    TopicDelivery,
    compare_delivery,
    read_deliveries,
    write_deliveries,
)
from groundlink.core.clock import NANOS
from groundlink.loader import load
from groundlink.messages.base import Clock
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.cdr import to_cdr

SCENARIO = """
name: deliveries
world: worlds/lab.yaml
time: {clock_rate_hz: 50.0}
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    sensors:
      - {kind: imu, name: imu, topic: /imu, frame: imu_link, mount: imu, rate_hz: 100.0}
"""


def write(file: Path, bodies: dict[int, bytes]) -> Path:
    """A recording of two seconds of clock, and of the IMU what is given by time."""
    bag = RosFile(file)
    clock = bag.topic("/clock", "rosgraph_msgs/msg/Clock")
    imu = bag.topic("/imu", "sensor_msgs/msg/Imu")
    for nanos in range(0, 2 * NANOS + 1, NANOS // 50):
        clock.write(nanos, to_cdr(Clock(nanos, 0, nanos // 2_500_000, 0)))
    for nanos, body in bodies.items():
        imu.write(nanos, memoryview(body))
    bag.commit({})
    bag.close()
    return file


def test_all_lost_and_changed_messages_are_found(tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_text(SCENARIO, encoding="utf-8")
    scenario = load(tmp_path / "scenario.yaml")
    sent = {nanos: b"%010d" % nanos for nanos in range(0, 2 * NANOS, NANOS // 100)}
    late = {nanos for nanos in sent if nanos >= 2 * NANOS - NANOS // 4}
    arrived = {nanos: body for nanos, body in sent.items() if nanos not in late}
    bus = write(tmp_path / "bus.mcap", sent)
    arrived = {nanos: body + b"\0\0" for nanos, body in arrived.items()}  # as DDS fills up
    deliveries = {
        a.topic: a for a in compare_delivery(bus, write(tmp_path / "a.mcap", arrived), scenario)
    }
    assert deliveries["/imu"] == TopicDelivery("/imu", sent=150, arrived=150, other=0)
    assert deliveries["/clock"].lost == 0

    del arrived[NANOS // 2]
    arrived[NANOS] = b"something other"
    deliveries = {
        a.topic: a for a in compare_delivery(bus, write(tmp_path / "b.mcap", arrived), scenario)
    }
    assert deliveries["/imu"] == TopicDelivery("/imu", sent=150, arrived=148, other=1)
    assert deliveries["/imu"].lost == 2


def test_deliveries_are_read_as_they_were_written(tmp_path: Path) -> None:
    deliveries = [TopicDelivery("/imu", 10, 9, 1), TopicDelivery("/scan", 4, 4, 0)]
    write_deliveries(tmp_path / "deliveries.csv", deliveries)
    assert read_deliveries(tmp_path / "deliveries.csv") == deliveries
