# SPDX-License-Identifier: Apache-2.0
"""Recordings of every kind give the firings that they hold, or one line of error."""

import sqlite3
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from groundlink.core.errors import UserError
from groundlink.fitting.recordings import CLOUD, read_firings
from groundlink.ros.types import STORE

from . import rooms
from .test_packets import velodyne


@pytest.fixture(scope="module")
def packets() -> list[bytes]:
    room = rooms.measured(0.005, 0.01)
    return velodyne(0x22, np.rint(room.range_m[:480] / 0.002), room.intensity[:480])


def scan(packets: list[bytes]) -> bytes:
    """Return a velodyne_msgs/VelodyneScan as CDR."""
    head = struct.pack("<4xIII", 1, 2, 6) + b"front\0" + bytes(2) + struct.pack("<I", len(packets))
    return head + b"".join(bytes(8) + packet + bytes(2) for packet in packets)


def bag(path: Path, topics: dict[str, tuple[str, bytes]]) -> Path:
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE topics(id INTEGER, name TEXT, type TEXT)")
        file.execute("CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER, data BLOB)")
        for number, (name, (ros_type, cdr)) in enumerate(topics.items()):
            file.execute("INSERT INTO topics VALUES(?, ?, ?)", (number, name, ros_type))
            file.execute("INSERT INTO messages VALUES(?, ?, ?)", (number, number, cdr))
    return path


def cloud(*, without: str = "") -> bytes:
    """Return the first turn of a room as sensor_msgs/PointCloud2."""
    room = rooms.measured(0.005, 0.01, lost=0.05)
    firing, ring = np.nonzero(room.range_m[:1800])
    range_m, azimuth = room.range_m[firing, ring], firing * rooms.STEP_RAD
    points = np.zeros(
        len(range_m), [(n, "<f4") for n in ("x", "y", "z", "intensity")] + [("ring", "<u2")]
    )
    elevation = np.radians(np.linspace(-15, 15, 16))[ring]
    points["x"] = range_m * np.cos(elevation) * np.cos(azimuth)
    points["y"] = range_m * np.cos(elevation) * np.sin(azimuth)
    points["z"] = range_m * np.sin(elevation)
    points["intensity"], points["ring"] = room.intensity[firing, ring], ring
    kinds = {"<f4": 7, "<u2": 4}
    fields: list[Any] = [
        STORE.types["sensor_msgs/msg/PointField"](
            name=name, offset=points.dtype.fields[name][1],  # type: ignore[index]
            datatype=kinds[points.dtype[name].str], count=1,
        )
        for name in points.dtype.names or () if name != without
    ]  # fmt: skip
    header = STORE.types["std_msgs/msg/Header"](
        stamp=STORE.types["builtin_interfaces/msg/Time"](sec=1, nanosec=0), frame_id="lidar"
    )
    message = STORE.types[CLOUD](
        header=header, height=1, width=len(points), fields=fields, is_bigendian=False,
        point_step=points.itemsize, row_step=points.nbytes,
        data=points.view(np.uint8), is_dense=True,
    )  # fmt: skip
    return bytes(STORE.serialize_cdr(message, CLOUD))


def mcap(path: Path, cdr: bytes) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(CLOUD, "ros2msg", b"")
        channel = writer.register_channel("/points", "cdr", schema)
        writer.add_message(channel, log_time=1, data=cdr, publish_time=1)
        writer.finish()
    return path


def test_a_bag_of_packets(tmp_path: Path, packets: list[bytes]) -> None:
    topics = {"/packets": ("velodyne_msgs/msg/VelodyneScan", scan(packets))}
    bag(tmp_path / "run.db3", topics | {"/other": ("std_msgs/msg/String", b"")})
    for path in (tmp_path / "run.db3", tmp_path):
        firings = read_firings(path)
        np.testing.assert_allclose(
            firings.range_m[:480], rooms.measured(0.005, 0.01).range_m[:480], atol=1.1e-3
        )


def test_a_capture_of_packets(tmp_path: Path, packets: list[bytes]) -> None:
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    for packet in [*packets, b"position"]:
        head = bytes(12) + b"\x08\x00\x45" + bytes(8) + b"\x11" + bytes(10) + bytes(8)
        frame = head + packet
        data += struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame
    (tmp_path / "run.pcap").write_bytes(data)
    assert read_firings(tmp_path / "run.pcap").range_m.shape == (480, 16)


def test_clouds(tmp_path: Path) -> None:
    """Firings whose return was lost keep their place."""
    room = rooms.measured(0.005, 0.01, lost=0.05)
    for path in (
        mcap(tmp_path / "run.mcap", cloud()),
        bag(tmp_path / "c.db3", {"/c": (CLOUD, cloud())}),
    ):
        firings = read_firings(path)
        assert firings.step_rad == pytest.approx(room.step_rad, rel=1e-3)
        for ring in range(16):
            seen = np.flatnonzero(room.range_m[:1800, ring])
            own = firings.range_m[: seen[-1] - seen[0] + 1, ring]
            np.testing.assert_allclose(own, room.range_m[seen[0] : seen[-1] + 1, ring], atol=1e-5)


def test_what_cannot_be_read_is_one_line(tmp_path: Path, packets: list[bytes]) -> None:
    two = {name: ("velodyne_msgs/msg/VelodyneScan", scan(packets)) for name in ("/a", "/b")}
    several = bag(tmp_path / "two.db3", two)
    assert len(read_firings(several, "/b").range_m)
    poor = mcap(tmp_path / "poor.mcap", cloud(without="ring"))
    (tmp_path / "text.mcap").write_text("text")
    (tmp_path / "text.pcap").write_text("text, not packets")
    (tmp_path / "empty").mkdir()
    expected = {
        several: "2 topics of clouds or packets: /a, /b; expected one",
        poor: "clouds have the fields x, y, z, intensity; expected also ring",
        tmp_path / "text.mcap": "cannot be read",
        tmp_path / "text.pcap": "not a pcap file",
        tmp_path / "empty": "a folder without",
        tmp_path / "none.db3": "no such file",
        Path(__file__): "expected a .db3, .mcap, .pcap or .osf",
    }
    for path, message in expected.items():
        with pytest.raises(UserError, match=message):
            read_firings(path)
