# SPDX-License-Identifier: Apache-2.0
"""What `groundlink check` says of sizes is what the bridge does and what sensors send."""

import argparse
from typing import Any, Literal

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.cli.files.check import check
from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import packed
from groundlink.messages.ground_truth import LABELED_POINT, TRUE_POINT, LabeledPoints, TruePoints
from groundlink.messages.imagery import Image
from groundlink.ros.cdr import to_cdr
from groundlink.ros.message_sizes import NeverFits, body_bytes, cut, fitting_block_deg
from groundlink.scenario.ros_side import GatewaySettings
from services.sensors.depth_camera.spec import ColorStream, DepthCamera
from services.sensors.lidar.spec import Lidar
from udp_bridge.wire.fragments import TooLarge, plan
from udp_bridge.wire.message import Message

LAB = SHIPPED / "indoor_lab.yaml"
SCENARIO = load(LAB)
ROVER = SCENARIO.vehicles[0]
LIDAR = ROVER.sensors[0]
assert isinstance(LIDAR, Lidar)

GATEWAYS = [
    GatewaySettings(),
    GatewaySettings(signed_peer=True),
    GatewaySettings(datagram="mtu"),
    GatewaySettings(datagram="mtu", signed_peer=True),
    GatewaySettings(datagram=256),
    GatewaySettings(datagram=9000),
    GatewaySettings(datagram=65507),
]


@pytest.mark.parametrize("gateway", GATEWAYS, ids=str)
@pytest.mark.parametrize("block_deg", [0.0, 15.0, 2.4])
@pytest.mark.parametrize("sensor", ROVER.sensors, ids=lambda sensor: sensor.name)
def test_the_cut_is_the_bridges_own(
    gateway: GatewaySettings, block_deg: float, sensor: Any
) -> None:
    if isinstance(sensor, Lidar):
        sensor = replace(sensor, block_deg=block_deg)
    found = cut(ROVER, sensor, gateway)
    message = Message(1, sensor.topic, sensor.frame, 0, 0, bytes(found.body_bytes))
    planned = plan(message, gateway.datagram, signed_peer=gateway.signed_peer)
    assert (found.part_bytes, found.parts) == (planned.part_size, planned.parts_max)


@pytest.mark.parametrize("gateway", GATEWAYS, ids=str)
@pytest.mark.parametrize("block_deg", [0.0, 15.0])
@pytest.mark.parametrize(
    ("stream", "topic", "kind", "record"),
    [
        ("truth", "/points/truth", TruePoints, TRUE_POINT),
        ("labeled_points", "/points/labels/points", LabeledPoints, LABELED_POINT),
    ],
)
def test_points_beside_a_cloud_are_cut_like_any_message(
    gateway: GatewaySettings, block_deg: float, stream: str, topic: str, kind: Any, record: Any
) -> None:
    lidar = replace(LIDAR, block_deg=block_deg, truth=True, labels=("points",))
    found = cut(ROVER, lidar, gateway, stream)
    points = 57_600 // lidar.blocks_per_revolution
    cloud = kind(0, "lidar_link", packed(np.empty(points, record)))
    message = Message(1, topic, "lidar_link", 0, 0, bytes(to_cdr(cloud)))
    planned = plan(message, gateway.datagram, signed_peer=gateway.signed_peer)
    assert found.body_bytes == len(message.body)
    assert (found.part_bytes, found.parts) == (planned.part_size, planned.parts_max)


@pytest.mark.parametrize(("publish", "bytes_a_pixel"), [("raw", 3), (None, 2)])
def test_the_largest_picture_of_a_depth_camera_counts(
    publish: Literal["raw"] | None, bytes_a_pixel: int
) -> None:
    color = ColorStream(topic="/color", publish=publish) if publish else None
    camera = DepthCamera(name="eye", topic="/depth", frame="eye", color=color)
    pixels = camera.width * camera.height
    depth = Image(0, "eye", 0, 0, "16UC1", 0, memoryview(b""))
    of_fields = len(to_cdr(depth))
    assert cut(ROVER, camera, GatewaySettings()).body_bytes == of_fields + bytes_a_pixel * pixels


def test_two_returns_and_a_part_of_the_view_count() -> None:
    def size(**fields: Any) -> int:
        return cut(ROVER, replace(LIDAR, **fields), GatewaySettings()).body_bytes

    whole, rays = size(), 16 * LIDAR.firings_per_revolution
    assert size(returns="dual") == whole + 22 * rays
    assert size(field_of_view_deg=90.0) == whole - 22 * (rays - 16 * 901)


def test_what_fits_nowhere_is_refused_by_both() -> None:
    lasers = {"elevations_deg": tuple(range(-16, 16)), "laser_times_us": ()}
    huge = replace(LIDAR, firings_per_revolution=36000, **lasers)
    with pytest.raises(NeverFits, match=r"more than 255 datagrams hold, 166\d{5} bytes"):
        cut(ROVER, huge, GatewaySettings())
    with pytest.raises(TooLarge):
        plan(Message(1, "/points", "", 0, 0, bytes(body_bytes(ROVER, huge))))


def test_the_block_that_is_offered_fits_and_the_next_larger_does_not() -> None:
    gateway = GatewaySettings(datagram="mtu")
    assert fitting_block_deg(ROVER, LIDAR, gateway) == 90.0
    assert cut(ROVER, replace(LIDAR, block_deg=90.0), gateway).fits
    assert not cut(ROVER, replace(LIDAR, block_deg=120.0), gateway).fits


def said(capsys: pytest.CaptureFixture[str], tmp_path: Any, more: str = "", lidar: str = "") -> str:
    """Return what is said about the laboratory with more fields, its LiDAR with others."""
    file = tmp_path / "lab.yaml"
    text = LAB.read_text(encoding="utf-8").replace("vlp16_paper.yaml,", f"vlp16_paper.yaml,{lidar}")
    file.write_text(text + more, encoding="utf-8")
    assert check(argparse.Namespace(scenario=str(file), json=False, urdf=None)) == 0
    return capsys.readouterr().out


def test_check_warns_of_a_revolution_in_ethernet_frames(
    capsys: pytest.CaptureFixture[str], tmp_path: Any
) -> None:
    text = said(capsys, tmp_path, "gateway: {datagram: mtu}\n")
    assert "exceeds 255 datagrams of `mtu`" in text
    assert "Fix: `block_deg: 90` for rover/lidar" in text
    assert text.count("exceeds") == 1


def test_check_is_content_with_the_default(
    capsys: pytest.CaptureFixture[str], tmp_path: Any
) -> None:
    text = said(capsys, tmp_path)
    assert "exceeds" not in text
    assert "up to 1267393 bytes in 20 datagrams" in text
    assert "/ground_truth/odom, 50 Hz, sent to subscribers" in text


def test_check_lists_ground_truth(capsys: pytest.CaptureFixture[str], tmp_path: Any) -> None:
    told = said(capsys, tmp_path, lidar=" truth: true,")
    assert "/points, /points/truth, 10 Hz" in told
    assert "ground truth:\n           messages of up to 1497817 bytes" in told
    for topic in ("/ground_truth/wheels, 50 Hz", "/ground_truth/bodies, 10 Hz"):
        assert f"{topic}, sent to subscribers" in told


def test_check_sizes_labeled_clouds(capsys: pytest.CaptureFixture[str], tmp_path: Any) -> None:
    told = said(capsys, tmp_path, lidar=" labels: [points],")
    assert "labeled points:\n           messages of up to 1497845 bytes in 23 datagrams" in told


def test_check_refuses_what_fits_nowhere(capsys: pytest.CaptureFixture[str], tmp_path: Any) -> None:
    lidar = (
        f" firings_per_revolution: 36000, laser_times_us: [], elevations_deg: {[*range(-32, 32)]},"
    )
    with pytest.raises(UserError, match=r"rover/lidar: a message of 506\d+ bytes is more than 255"):
        said(capsys, tmp_path, lidar=lidar)
