# SPDX-License-Identifier: Apache-2.0
"""System tests of camera pictures in a real ROS 2: received pictures equal the sent ones."""

import hashlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.imagery import CompressedImage
from tests.services.sensors.rendering.opengl import _opengl as _opengl

from .rig import Observer, rig, wait_for

pytestmark = pytest.mark.system

SCENARIO = """
name: pictures
seed: 1
world: worlds/lab.yaml
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    placement: {{x_m: -4.6, y_m: 0.0, yaw_deg: 0.0}}
    sensors:
      - {{kind: camera, name: camera, topic: /camera/image_raw, frame: camera_optical_frame,
         mount: camera, width: 160, height: 120, rate_hz: 5.0}}
      - {{kind: depth_camera, name: depth, topic: /depth/image_rect_raw, frame: depth_optical_frame,
         mount: camera, width: 160, height: 120, rate_hz: 5.0, publish: both,
         points_topic: /depth/points, baseline_m: 0.05, disparity_stddev_px: 0.08}}
      - {{kind: stereo_camera, name: stereo, topic: /stereo/left/image_raw,
         right_topic: /stereo/right/image_raw, frame: stereo_optical_frame, mount: camera,
         width: 160, height: 120, rate_hz: 5.0, baseline_m: 0.12}}
gateway: {{bind: {bind}, peer: {peer}}}
"""

TOGETHER = {
    "/camera/camera_info": ("/camera/image_raw/compressed",),
    "/depth/camera_info": (
        "/depth/image_rect_raw",
        "/depth/image_rect_raw/compressedDepth",
        "/depth/points",
    ),
    "/stereo/left/camera_info": (
        "/stereo/left/image_raw",
        "/stereo/right/image_raw",
        "/stereo/right/camera_info",
    ),
}
"""CameraInfo, and what belongs to it."""

WANTED = 8


def sha256(data: Any) -> str:
    return hashlib.sha256(data).hexdigest()


def test_received_images_equal_sent_ones(tmp_path: Path) -> None:
    with rig(tmp_path) as it:
        scenario = SCENARIO.format(bind=it.address(it.bind), peer=it.address(it.peer))
        it.scenario.write_text(scenario, encoding="utf-8")
        observer = Observer(it, "tests.system.ros_pictures")
        it.up()
        wait_for(it.is_answered, 30, "the bus opens")
        sent: dict[int, CompressedImage] = {}
        with Bus(connect=it.endpoint) as bus:
            pictures: BusInbox[CompressedImage] = BusInbox(depth=1000)
            key = SENSOR_TOPICS["camera"].key_in(it.run, vehicle="rover", sensor="camera")
            bus.subscribe(key, CompressedImage, pictures)

            def all_there() -> bool:
                for _, picture in iter(lambda: pictures.get(seconds=0), None):
                    sent[picture.stamp_nanos] = picture
                topics = [*TOGETHER, *(t for others in TOGETHER.values() for t in others)]
                return all(observer.count(topic) >= WANTED for topic in topics)

            wait_for(all_there, 90, "pictures of every kind arrive in ROS")
        arrived = observer.read()

    compared = 0
    for message in arrived["/camera/image_raw/compressed"]:
        if message["stamp"] in sent:
            picture = sent[message["stamp"]]
            pixels = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_UNCHANGED)
            assert pixels is not None
            assert pixels.shape == (120, 160, 3)
            assert message["data"] == sha256(picture.data)
            assert message["decoded"] == sha256(pixels.tobytes())
            assert message["format"] == picture.format
            compared += 1
    assert compared >= WANTED / 2

    # The PNG of compressedDepth holds the pixels of the depth image with its stamp.
    depths = {m["stamp"]: m["data"] for m in arrived["/depth/image_rect_raw"]}
    files = {m["stamp"]: m for m in arrived["/depth/image_rect_raw/compressedDepth"]}
    both = depths.keys() & files.keys()
    assert len(both) >= WANTED / 2
    for stamp in both:
        assert files[stamp]["decoded"] == depths[stamp]
        assert files[stamp]["format"] == "16UC1; compressedDepth png"

    # All that belongs together has the same stamps, but for the last on its way.
    for info, others in TOGETHER.items():
        stamps = [m["stamp"] for m in arrived[info]]
        assert sorted(set(stamps)) == stamps
        for topic in others:
            shared = {m["stamp"] for m in arrived[topic]} & set(stamps)
            assert len(shared) >= WANTED - 2, topic
            assert {m["frame"] for m in arrived[topic]} == {m["frame"] for m in arrived[info]}
    left, right = (arrived[f"/stereo/{side}/camera_info"][0]["p"] for side in ("left", "right"))
    assert right[3] == pytest.approx(-right[0] * 0.12)
    assert left == [*right[:3], 0.0, *right[4:]]


def test_without_opengl_depth_is_measured_by_rays(tmp_path: Path) -> None:
    with rig(tmp_path) as it:
        scenario = SCENARIO.format(bind=it.address(it.bind), peer=it.address(it.peer))
        before, _, rest = scenario.partition("      - {kind: camera")
        depth = rest[
            rest.index("      - {kind: depth_camera") : rest.index("      - {kind: stereo")
        ]
        gateway = rest[rest.index("gateway:") :]
        it.scenario.write_text(before + depth + gateway, encoding="utf-8")
        it.environment["__EGL_VENDOR_LIBRARY_DIRS"] = str(tmp_path)  # no driver is there
        observer = Observer(it, "tests.system.ros_pictures")
        it.up()
        wait_for(lambda: observer.count("/depth/points") > 2, 60, "depth arrives in ROS")
        assert observer.count("/depth/image_rect_raw") > 1
        assert it.log("up.log").count("measures depth by rays") == 1
