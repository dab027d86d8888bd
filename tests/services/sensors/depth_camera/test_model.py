# SPDX-License-Identifier: Apache-2.0
"""The depth camera: what it sends, when, and that all of a picture belongs together."""

from typing import Any

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.messages.base import BadBusMessage, BusMessage, PointCloud, State
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image
from groundlink.ros.message_sizes import body_bytes
from groundlink.ros.streams import outgoing
from services.sensors.depth_camera.eyes import RayEye
from services.sensors.depth_camera.model import DepthCameraModel
from services.sensors.depth_camera.spec import ColorStream
from services.sensors.rendering.cameras.eye import Eye
from services.sensors.rendering.cameras.messages import jpeg
from services.sensors.runtime.model import LeftOut, stream_and_message
from tests.services.sensors.rendering.opengl import _opengl as _opengl
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import moving, resting

from .specs import spec, world

ALL: dict[str, Any] = {
    "publish": "both",
    "points_topic": "/camera/depth/points",
    "color": ColorStream(topic="/camera/color/image_raw", publish="both"),
}
NOISY: dict[str, Any] = {"baseline_m": 0.05, "disparity_stddev_px": 0.01, "edge_holes_px": 2}


def camera(*, by_rays: bool = False, **fields: Any) -> DepthCameraModel:
    made, sensor = world(), spec(**fields)
    eye = RayEye(made, made.vehicles[0], sensor) if by_rays else None
    return DepthCameraModel(made, made.vehicles[0], sensor, eye=eye)


def taken(model: DepthCameraModel, run: list[State]) -> dict[str, list[Any]]:
    """Return the messages of each stream."""
    streams: dict[str, list[BusMessage]] = {}
    for state in run:
        for made in model.readings(state):
            assert not isinstance(made, LeftOut)
            output, message = stream_and_message(made)
            streams.setdefault(output, []).append(message)
        assert model.settled_tick() == state.tick
    return streams


def depth(message: BusMessage) -> NDArray[Any]:
    assert isinstance(message, Image)
    dtype = {"16UC1": np.uint16, "32FC1": np.float32}[message.encoding]
    return np.frombuffer(message.data, dtype).reshape(message.height, message.width)


def test_every_stream_has_the_stamps_of_the_rate() -> None:
    streams = taken(camera(**ALL), resting(41))
    assert streams.keys() == spec(**ALL).ros_topics().keys()
    thirtieths = [EPOCH_NANOS + i * 1_000_000_000 // 30 for i in range(4)]
    for messages in streams.values():
        assert [message.stamp_nanos for message in messages] == thirtieths
        assert {message.frame for message in messages} == {"one/camera_optical_frame"}
    assert streams["color_info"] == streams["camera_info"]
    info = streams["camera_info"][0]
    assert isinstance(info, CameraInfo)
    k = np.frombuffer(info.intrinsic).reshape(3, 3)
    assert k[0, 0] == k[1, 1] == pytest.approx(60 / np.tan(np.radians(30)))
    assert np.array_equal(np.frombuffer(info.projection).reshape(3, 4)[:, :3], k)


@pytest.mark.parametrize(
    ("fields", "topics"),
    [
        ({}, {"/camera/depth/image_rect_raw"}),
        ({"publish": "compressed"}, {"/camera/depth/image_rect_raw/compressedDepth"}),
        (
            ALL,
            {
                "/camera/depth/image_rect_raw",
                "/camera/depth/image_rect_raw/compressedDepth",
                "/camera/depth/points",
                "/camera/color/camera_info",
                "/camera/color/image_raw",
                "/camera/color/image_raw/compressed",
            },
        ),
    ],
)
def test_only_requested_outputs(fields: dict[str, Any], topics: set[str]) -> None:
    made = world()
    rover = replace(made.vehicles[0], sensors=(spec(**fields),))
    sent = {stream.topic for stream in outgoing(replace(made, vehicles=(rover,)), "run")}
    own = {topic for topic in sent if topic.startswith("/camera/")}
    assert own == {"/camera/depth/camera_info"} | topics
    streams = taken(camera(**fields), resting(1))
    assert streams.keys() == spec(**fields).ros_topics().keys()


def test_all_of_a_picture_is_of_the_same_pixels() -> None:
    streams = taken(camera(**ALL, **NOISY), resting(1))
    (image,), (file,), (cloud,) = streams[""], streams["compressed"], streams["points"]
    assert isinstance(file, CompressedImage)
    assert isinstance(cloud, PointCloud)
    millimeters = depth(image)
    stored = cv2.imdecode(np.frombuffer(file.data[12:], np.uint8), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    assert np.array_equal(stored, millimeters)
    z = cloud.records()["z"]
    assert np.array_equal(np.rint(z * 1000).astype(int), millimeters[millimeters > 0])
    assert 3200 < np.median(millimeters[62:68, 55:60]) < 3400
    assert 7700 < np.median(millimeters[62:68, 90:100]) < 7900
    made = world()
    eye = Eye(made, made.vehicles[0], spec())
    eye.take(resting(1)[0])
    color = eye.look(0).color
    assert streams["color_image"][0].data == color.tobytes()
    assert streams["color"][0] == jpeg(
        EPOCH_NANOS, "one/camera_optical_frame", color, gray=False, quality=80
    )


def test_rays_give_the_same_images() -> None:
    sensor = {**NOISY, "encoding": "32FC1"}
    drawn, cast = (taken(camera(by_rays=b, **sensor), resting(1)) for b in (False, True))
    assert drawn.keys() == cast.keys()
    a, b = depth(drawn[""][0]), depth(cast[""][0])
    both = np.isfinite(a) & np.isfinite(b)
    assert both.mean() > 0.4
    # Only at edges do they differ, and there are holes.
    assert np.quantile(np.abs(a[both] - b[both]), 0.99) < 1e-3
    assert (np.isnan(a) == np.isnan(b)).mean() > 0.99


def test_after_a_restart_come_the_same_pictures() -> None:
    run = list(moving([(0.01 * tick, 0.0, 0.0) for tick in range(60)]))
    model = camera(**NOISY)
    whole = taken(model, run)[""]
    assert not np.array_equal(depth(whole[-1]), depth(whole[-2]))
    model.restart()
    for later in (model, camera(**NOISY)):
        assert taken(later, run[25:])[""] == whole[2:]


def test_noise_is_new_in_every_picture() -> None:
    first, second = taken(camera(**NOISY), resting(15))[""]
    assert not np.array_equal(depth(first), depth(second))
    calm = taken(camera(), resting(15))[""]
    assert np.array_equal(depth(calm[0]), depth(calm[1]))


def test_a_state_without_its_vehicle_is_refused_and_forgotten() -> None:
    for by_rays in (False, True):
        model = camera(by_rays=by_rays)
        run = resting(20)
        model.readings(run[0])
        with pytest.raises(BadBusMessage, match="link poses"):
            model.readings(replace(run[1], vehicles={}))
        assert model.settled_tick() == -1
        assert len(taken(model, run[2:])[""]) == 1


@pytest.mark.parametrize(
    ("fields", "output"),
    [
        ({}, ""),
        ({"encoding": "32FC1"}, ""),
        ({"points_topic": "/points", "points_every": 4}, ""),
        ({"points_topic": "/points", "max_range_m": 50.0}, "points"),
        (
            {"publish": "compressed", "color": ColorStream(topic="/c/image", publish="raw")},
            "color_image",
        ),
    ],
)
def test_largest_message_is_within_its_declaration(fields: dict[str, Any], output: str) -> None:
    made = world()
    told = body_bytes(made.vehicles[0], spec(**fields))
    streams = taken(camera(**fields), resting(1))

    def size(message: Any) -> int:
        return len(message.points if isinstance(message, PointCloud) else message.data)

    largest = max(
        (name for name in streams if name.rpartition("_")[2] != "info"),
        key=lambda name: size(streams[name][0]),
    )
    assert largest == output
    assert told * 0.4 < size(streams[largest][0]) <= told
