# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1, ROS 2 and MCAP give the same readings as the messages that were written."""

import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from sensor_conformance.checking import check_source
from sensor_conformance.readings.motion import ImuReadings
from sensor_conformance.readings.packets import (
    HesaiPackets,
    LivoxPackets,
    OusterPackets,
    VelodynePackets,
)
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.sources.bag import BagSource
from sensor_conformance.sources.live import LiveSource
from sensor_conformance.sources.memory import MemorySource
from sensor_conformance.sources.pcap import HESAI, LIVOX, PcapSource
from sensor_conformance.sources.source import Received, SourceTopic, UnreadableSource

from .clean import imu
from .clean_packets import hesai, livox, ouster, velodyne

KIND = "sensor_msgs/msg/Imu"


def typed(store: Any, kind: str, value: Any) -> Any:
    """Return a message of the type store with the numbers of a namespace."""
    fields = {}
    for name, description in store.fielddefs[kind][1]:
        given = getattr(value, name, None)
        if given is None:
            given = 0  # `seq` of ROS 1
        node, detail = description
        fields[name] = typed(store, detail, given) if node.name == "NAME" else given
    return store.types[kind](**fields)


def ros_1(path: Path) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path / "run.bag") as writer:
        connection = writer.add_connection("/imu", KIND, typestore=store)
        for at, message in imu()[:100]:
            raw = store.serialize_ros1(typed(store, KIND, message), KIND)
            writer.write(connection, at, raw)
    return path / "run.bag"


def ros_2(path: Path, plugin: StoragePlugin) -> Path:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer2(path / "run", version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/imu", KIND, typestore=store)
        for at, message in imu()[:100]:
            writer.write(connection, at, store.serialize_cdr(typed(store, KIND, message), KIND))
    return path / "run"


def mcap_file(path: Path) -> Path:
    return next(ros_2(path, StoragePlugin.MCAP).glob("*.mcap"))


@pytest.fixture(
    params=[ros_1, lambda path: ros_2(path, StoragePlugin.SQLITE3), mcap_file],
    ids=["ROS 1", "ROS 2 folder", "MCAP file"],
)
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    write: Callable[[Path], Path] = request.param
    return write(tmp_path)


def test_bag_holds_what_was_written(bag: Path) -> None:
    with BagSource(bag) as source:
        (read,) = CheckedRecording.read(source).of(ImuReadings)
    expected = imu()[:100]
    assert read.name == "/imu"
    assert read.received.tolist() == [at for at, _ in expected]
    assert read.frame == "imu_link"
    assert read.gyro[:, 2].tolist() == [one.angular_velocity.z for _, one in expected]
    assert np.array_equal(read.covariances["orientation"][0], 1e-4 * np.eye(3))


def test_duration_ends_reading(tmp_path: Path) -> None:
    with BagSource(mcap_file(tmp_path), duration=0.5) as source:
        (read,) = CheckedRecording.read(source).topics
    assert 45 <= len(read.received) <= 55


@pytest.mark.parametrize("name", ["missing.bag", "broken.bag", "broken.mcap", "broken.db3"])
def test_no_bag_is_one_error(tmp_path: Path, name: str) -> None:
    if name.startswith("broken"):
        (tmp_path / name).write_bytes(b"no bag" * 100)
    with pytest.raises(UnreadableSource, match=name), BagSource(tmp_path / name):
        pass


def test_live_topics_need_rclpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rclpy", None)
    with pytest.raises(UnreadableSource, match="source ROS 2"):
        LiveSource(0.1)


def test_topic_that_can_not_be_read_is_named() -> None:
    def fail(topic: str) -> Any:
        raise UnreadableSource("broken bytes")

    topics = [SimpleNamespace(name="/imu", type=KIND)]
    source: Any = SimpleNamespace(name="run", topics=lambda: topics, messages=fail)
    recording = CheckedRecording.read(source)
    assert recording.topics == []
    assert recording.unread == {"/imu": "broken bytes"}


def udp(data: bytes, port: int, sender: int = 1) -> bytes:
    """Return an IP packet; its checksums are not read."""
    length = struct.pack(">HHHH", 2000, port, 8 + len(data), 0)
    address = bytes([10, 0, 0, sender, 10, 0, 0, 9])
    head = struct.pack(">BBHHHBBH", 0x45, 0, 28 + len(data), 7, 0, 64, 17, 0)
    return head + address + length + data


def parts(packet: bytes, size: int) -> list[bytes]:
    """Return the fragments of an IP packet."""
    header, body = packet[:20], packet[20:]
    found = []
    for start in range(0, len(body), size):
        part = body[start : start + size]
        flags = start // 8 | (0x2000 if start + size < len(body) else 0)
        head = header[:2] + struct.pack(">HHH", 20 + len(part), 7, flags) + header[8:]
        found.append(head + part)
    return found


def pcap(path: Path, packets: list[bytes], order: str = "<", link: int = 1) -> Path:
    header = struct.pack(order + "IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, link)
    skip = b"\0" * {1: 14, 101: 0, 113: 16}[link]
    records = [
        struct.pack(order + "IIII", 100, index, len(skip + one), len(skip + one)) + skip + one
        for index, one in enumerate(packets)
    ]
    path.write_bytes(header + b"".join(records))
    return path


@pytest.mark.parametrize(("order", "link"), [("<", 1), (">", 1), ("<", 101), ("<", 113)])
def test_capture_has_the_packets_of_devices(tmp_path: Path, order: str, link: int) -> None:
    packets = [bytes(one.data) for _, one in velodyne()[:20]]
    others = [bytes(one.data) for _, one in ouster()[:5]]
    ip = [udp(one, 2368) for one in packets] + [udp(b"hello", 9)]
    ip += [part for one in others for part in parts(udp(one, 7502), 1480)]
    source = PcapSource(pcap(tmp_path / "run.pcap", ip, order, link))
    recording = CheckedRecording.read(source)
    (head,) = recording.of(VelodynePackets)
    assert head.name == "10.0.0.1/2368/velodyne/packet"
    assert [row.tobytes() for row in head.rows] == packets
    assert head.received[1] - head.received[0] == 1000
    (lidar,) = recording.of(OusterPackets)
    assert [row.tobytes() for row in lidar.rows] == others
    assert lidar.measurements.tolist() == list(range(80))


def test_capture_has_packets_of_hesai_and_livox(tmp_path: Path) -> None:
    made = {
        port: [bytes(one.data) for _, one in all_of[:5]]
        for port, all_of in ((2368, hesai()), (56301, livox()))
    }
    ip = [udp(one, port) for port, packets in made.items() for one in packets]
    imu_data = struct.pack("<BHxxHxxxBx", 0, 60, 1, 0).ljust(60, b"\0")
    recording = CheckedRecording.read(
        PcapSource(pcap(tmp_path / "run.pcap", [*ip, udp(imu_data, 56401)]))
    )
    (head,) = recording.of(HesaiPackets)
    (solid,) = recording.of(LivoxPackets)
    assert [row.tobytes() for row in head.rows] == made[2368]
    assert head.times[1] - head.times[0] == 5_000_000
    assert head.numbers is not None
    assert head.numbers.tolist() == [70_000 + index for index in range(5)]
    assert [row.tobytes() for row in solid.rows] == made[56301]
    assert [one.type for one in recording.topics].count("udp/datagram") == 1


def test_message_of_a_driver_is_longer_than_its_packet() -> None:
    """A PandarPacket has 1500 bytes, and says how many of them arrived."""
    packet = np.pad(hesai()[0].message.data, (0, 420))
    inner = SimpleNamespace(data=packet, size=1080, stamp=SimpleNamespace(sec=7, nanosec=5))
    scan = Received(9, SimpleNamespace(packets=[inner]))
    topic = SourceTopic("/pandar_packets", "pandar_msgs/msg/PandarScan")
    (head,) = CheckedRecording.read(MemorySource({topic: [scan]})).of(HesaiPackets)
    assert head.is_known
    assert head.arrivals.tolist() == [7_000_000_005]


@pytest.mark.parametrize("size", [0, 5, 11, 1080])
def test_bytes_that_are_no_packets_are_a_finding(size: int) -> None:
    junk = np.random.default_rng(size).integers(0, 256, (20, size), np.uint8)
    messages = [Received(index, SimpleNamespace(data=row)) for index, row in enumerate(junk)]
    for kind in ("hesai", "livox"):
        topic = SourceTopic("/packets", {"hesai": HESAI, "livox": LIVOX}[kind])
        report = check_source(MemorySource({topic: messages}))
        assert f"{kind}.structure" in {one.clause.id for one in report.findings}


def test_senders_on_one_port_are_topics_of_their_own(tmp_path: Path) -> None:
    packet = bytes(velodyne()[0].message.data)
    file = pcap(tmp_path / "run.pcap", [udp(packet, 2368, sender) for sender in (1, 2, 2)])
    counts = {one.name: len(one.received) for one in CheckedRecording.read(PcapSource(file)).topics}
    assert counts == {"10.0.0.1/2368/velodyne/packet": 1, "10.0.0.2/2368/velodyne/packet": 2}


def test_packet_of_another_length_is_one_of_its_stream(tmp_path: Path) -> None:
    packets = [bytes(one.data) for _, one in velodyne()[:5]]
    file = pcap(tmp_path / "run.pcap", [udp(one, 2368) for one in [*packets, packets[0][:900]]])
    (head,) = CheckedRecording.read(PcapSource(file)).of(VelodynePackets)
    assert head.wrong_lengths == [900]


def test_column_formats_with_a_header(tmp_path: Path) -> None:
    """As RNG19_RFL8_SIG16_NIR16 of 32 rows: header and footer of 32 bytes, status of 2."""
    packet = bytearray(32 + 16 * (12 + 32 * 12) + 32)
    struct.pack_into("<HH", packet, 0, 1, 77)
    for index in range(16):
        struct.pack_into("<QHH", packet, 32 + index * 396, index * 1000, index, 1)
    file = pcap(tmp_path / "run.pcap", [udp(bytes(packet), 7502)])
    (lidar,) = CheckedRecording.read(PcapSource(file)).of(OusterPackets)
    assert not lidar.is_legacy
    assert lidar.frame_numbers.tolist() == [77] * 16
    assert lidar.times.tolist() == [index * 1000 for index in range(16)]
    assert lidar.is_valid.all()


def test_no_capture_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "broken.pcap").write_bytes(b"no capture" * 5)
    for name in ("broken.pcap", "missing.pcap"):
        with pytest.raises(UnreadableSource, match=name):
            PcapSource(tmp_path / name)
