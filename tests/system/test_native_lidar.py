# SPDX-License-Identifier: Apache-2.0
"""System tests of VLP-16 packets from a real run, checked with independent decoders.

A LiDAR without its own packet format causes one error line.
"""

import random
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.base import PointCloud

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

DATA_PORT, POSITION_PORT = 2368, 8308
HOUR_MICROS = 3_600_000_000
PACKETS = 400
"""More than five revolutions."""


@pytest.fixture
def host() -> str:
    """An address of this machine, so that the device's ports are free there."""
    return "127." + ".".join(str(random.randrange(1, 255)) for _ in range(3))


@pytest.fixture
def it(tmp_path: Path) -> Iterator[Rig]:
    with rig(tmp_path) as it:
        yield it


def receiver(host: str, port: int) -> socket.socket:
    made = socket.socket(type=socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
    made.bind((host, port))
    made.settimeout(60)
    return made


def drain(receiving: socket.socket) -> None:
    """Throw away the datagrams that wait in a socket."""
    timeout = receiving.gettimeout()
    receiving.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            receiving.recv(2000)
    receiving.settimeout(timeout)


def next_cloud(inbox: BusInbox[PointCloud]) -> PointCloud:
    """Return the next cloud on the bus."""
    arrived = inbox.get(seconds=60.0)
    assert arrived, "no cloud came"
    return arrived[1]


def since(micros: int, nanos: int) -> float:
    """Return microseconds from an instant to another, of which the hours do not count."""
    return (nanos / 1000 - micros + HOUR_MICROS / 2) % HOUR_MICROS - HOUR_MICROS / 2


def decoded(packets: list[bytes]) -> np.ndarray:
    """Return points as others decode them, `time` in microseconds of the hour."""
    decoder = pytest.importorskip("velodyne_decoder")
    config = decoder.Config(model=decoder.Model.VLP16)
    clouds = []
    for packet in packets:
        found = decoder.ScanDecoder(config).decode(
            [decoder.VelodynePacket(0.0, packet)], as_pcl_structs=True
        )[1]
        found = found.astype([(name, "f8") for name in found.dtype.names])
        found["time"] = found["time"] * 1e6 + struct.unpack_from("<I", packet, 1200)[0]
        clouds.append(found)
    return np.concatenate(clouds)


def test_others_decode_the_points_that_are_on_the_bus(it: Rig, host: str) -> None:
    text = it.scenario.read_text(encoding="utf-8")
    sheet = "datasheet: sensors/vlp16_paper.yaml, block_deg: 0,"
    assert sheet in text
    own = f"datasheet: sensors/vlp16.yaml, block_deg: 15, native: {host}:{DATA_PORT},"
    it.scenario.write_text(text.replace(sheet, own), encoding="utf-8")
    with receiver(host, DATA_PORT) as data, receiver(host, POSITION_PORT) as positions:
        it.up("--no-ros")
        wait_for(it.is_answered, 30, "the run's router listens")
        with Bus(connect=it.endpoint) as bus:
            inbox: BusInbox[PointCloud] = BusInbox(depth=10_000)
            bus.subscribe(
                SENSOR_TOPICS["lidar"].key_in(it.run, vehicle="rover", sensor="lidar"),
                PointCloud,
                inbox,
            )
            clouds = [next_cloud(inbox)]
            # What is in the sockets was measured before the first cloud on the bus.
            drain(data)
            drain(positions)
            packets = [data.recv(2000) for _ in range(PACKETS)]
            end = struct.unpack_from("<I", packets[-1], 1200)[0]
            while since(end, clouds[-1].stamp_nanos) < 0:
                clouds.append(next_cloud(inbox))
            told = [positions.recv(2000) for _ in range(PACKETS // 14 - 1)]
    stamps = [struct.unpack_from("<I", packet, 1200)[0] for packet in packets]
    assert {len(packet) for packet in packets} == {1206}
    steps = np.diff(stamps) % HOUR_MICROS
    assert np.abs(steps - 24 * 55.31).max() < 1, "none is lost, and each in its turn"

    found = decoded(packets)
    found["time"] = (found["time"] - stamps[0]) % HOUR_MICROS
    whole = []
    for cloud in clouds:
        begin = since(stamps[0], cloud.stamp_nanos)
        points = cloud.records()
        if begin < -1 or begin + points["time"][-1] * 1e6 > since(stamps[0], stamps[-1] * 1000):
            continue  # The packets begin or end within it.
        times = begin + points["time"] * 1e6
        theirs = found[(found["time"] > times[0] - 2) & (found["time"] < times[-1] + 2)]
        np.testing.assert_allclose(theirs["time"], times, rtol=0, atol=1)
        np.testing.assert_array_equal(theirs["ring"], points["ring"])
        # 0.01 degrees are 2 mm here, and the decoder's lasers have no vertical offsets.
        for axis, limit_m in (("x", 0.003), ("y", 0.003), ("z", 0.0113)):
            np.testing.assert_allclose(theirs[axis], points[axis], rtol=0, atol=limit_m)
        whole.append(cloud)
    assert len(whole) > 100

    for packet in told:
        assert len(packet) == 512
        micros, pps = struct.unpack_from("<IB", packet, 198)
        assert -1e6 < since(stamps[0], micros * 1000) < 1e6
        assert pps == 2
        assert packet[206:213] == b"$GPRMC,"


def test_a_lidar_without_packets_of_its_own_is_answered_in_one_line(it: Rig) -> None:
    physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
    it.start(*physics, log="physics.log")
    wait_for(it.is_answered, 20, "physics listens")
    sensor = ("-m", "services.sensors.lidar", "--name", "rover/lidar", "--connect", it.endpoint)
    process = it.start(*sensor, "--native", "127.0.0.1:2368", log="lidar.log")
    assert process.wait(30) == 2
    assert it.log("lidar.log").count("\n") == 1
    assert "a firing takes 27.778 us, not 55.296" in it.log("lidar.log")
