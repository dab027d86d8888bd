# SPDX-License-Identifier: Apache-2.0
"""The stereo pair: two pictures of one instant, from which depth comes back."""

from typing import Any

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.messages.base import BusMessage, State, packed
from groundlink.messages.imagery import Image
from groundlink.ros.message_sizes import body_bytes
from groundlink.ros.streams import outgoing
from groundlink.scenario.cameras import Imager, Lens
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from services.sensors.camera.model import CameraModel
from services.sensors.camera.spec import Camera
from services.sensors.rendering.cameras.eye import Eye
from services.sensors.runtime.model import stream_and_message
from services.sensors.stereo_camera.model import StereoCameraModel
from services.sensors.stereo_camera.spec import StereoCamera
from tests.services.sensors.rendering.views import laboratory
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import box, resting, yard

BASELINE_M = 0.12
MOUNT = Mount((0.2, 0.06, 1.0))


def spec(**fields: Any) -> StereoCamera:
    defaults: dict[str, Any] = {"width": 320, "height": 240, "mount": MOUNT}
    return StereoCamera(
        name="stereo",
        topic="/stereo/left/image_raw",
        right_topic="/stereo/right/image_raw",
        frame="stereo_optical_frame",
        baseline_m=BASELINE_M,
        **{**defaults, **fields},
    )


def world() -> Scenario:
    return yard(box("crate", (1, 1, 1), (4.5, 0.0, 1.0)), frame_prefix="one/")


def taken(run: list[State], made: Scenario, sensor: StereoCamera) -> dict[str, list[Any]]:
    model = StereoCameraModel(made, made.vehicles[0], sensor)
    streams: dict[str, list[BusMessage]] = {}
    for state in run:
        for output, message in map(stream_and_message, model.readings(state)):
            streams.setdefault(output, []).append(message)
    return streams


def pixels(message: BusMessage) -> Any:
    assert isinstance(message, Image)
    shape = (message.height, message.width, -1)
    return np.frombuffer(message.data, np.uint8).reshape(shape).squeeze()


def test_topics_are_those_of_stereo_image_proc() -> None:
    made = world()
    sides = ("/stereo/left", "/stereo/right")
    for publish, names in {
        "raw": ("image_raw",),
        "compressed": ("image_raw/compressed",),
        "both": ("image_raw", "image_raw/compressed"),
    }.items():
        rover = replace(made.vehicles[0], sensors=(spec(publish=publish),))
        sent = {stream.topic for stream in outgoing(replace(made, vehicles=(rover,)), "run")}
        wanted = {f"{side}/{name}" for side in sides for name in (*names, "camera_info")}
        assert {topic for topic in sent if topic.startswith("/stereo/")} == wanted


def test_eyes_are_synchronized_and_rectified() -> None:
    streams = taken(resting(41), world(), spec(publish="both"))
    assert streams.keys() == spec(publish="both").ros_topics().keys()
    for messages in streams.values():
        stamps = [EPOCH_NANOS + i * 1_000_000_000 // 30 for i in range(4)]
        assert [message.stamp_nanos for message in messages] == stamps
        assert {message.frame for message in messages} == {"one/stereo_optical_frame"}
    left, right = (streams[name][0] for name in ("camera_info", "right_camera_info"))
    k = np.frombuffer(left.intrinsic).reshape(3, 3)
    for info, baseline_m in ((left, 0.0), (right, BASELINE_M)):
        assert info.intrinsic == left.intrinsic
        assert np.array_equal(np.frombuffer(info.rectification).reshape(3, 3), np.eye(3))
        assert not np.frombuffer(info.distortion).any()
        tx = [[-k[0, 0] * baseline_m], [0.0], [0.0]]
        assert np.array_equal(np.frombuffer(info.projection).reshape(3, 4), np.hstack([k, tx]))


LENS = Lens(distortion=(-0.25, 0.06, 0.002, -0.001), vignetting=0.4, aperture_m=0.02, focus_m=2.0)
GRAIN = Imager(full_well_electrons=3000.0, read_noise_electrons=5.0)


@pytest.mark.parametrize("imager", [Imager(), GRAIN], ids=["quiet", "noisy"])
def test_the_left_eye_is_a_camera_with_the_same_lens_and_image_sensor(imager: Imager) -> None:
    """Bit for bit, with the same noise."""
    made, sensor = world(), spec(lens=LENS, imager=imager)
    streams = taken(resting(1), made, sensor)
    camera = Camera(
        **{"name": "stereo", "topic": "/stereo/image_raw", "frame": "eye", "publish": "raw"},
        **{"width": 320, "height": 240, "mount": MOUNT, "lens": LENS, "imager": imager},
    )
    alone = [
        message
        for state in resting(1)
        for output, message in map(
            stream_and_message, CameraModel(made, made.vehicles[0], camera).readings(state)
        )
        if output == "image"
    ]
    assert np.array_equal(pixels(streams[""][0]), pixels(alone[0]))


def test_each_eye_has_its_own_noise() -> None:
    made = world()
    clean, noisy = (
        taken(resting(1), made, spec(lens=LENS, imager=imager)) for imager in (Imager(), GRAIN)
    )
    noise = [
        pixels(noisy[name][0]).astype(float) - pixels(clean[name][0]) for name in ("", "right")
    ]
    for one in noise:
        assert 0.5 < one.std() < 10.0
    left, right = (one[60:200].ravel() for one in noise)
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.01


def test_camera_info_rectifies_pictures_of_a_lens_that_bends() -> None:
    """By D, K, R and P of CameraInfo, the crate's near edges come to where P puts them."""
    bent = Lens(distortion=(-0.25, 0.06, 0.002, -0.001))
    streams = taken(resting(1), world(), spec(encoding="mono8", lens=bent))
    for info, name in (("camera_info", ""), ("right_camera_info", "right")):
        told = streams[info][0]
        d, k = np.frombuffer(told.distortion), np.frombuffer(told.intrinsic).reshape(3, 3)
        r = np.frombuffer(told.rectification).reshape(3, 3)
        p = np.frombuffer(told.projection).reshape(3, 4)
        assert told.distortion_model == "plumb_bob"
        assert tuple(d) == bent.coefficients
        maps = cv2.initUndistortRectifyMap(k, d, r, p, (320, 240), cv2.CV_32FC1)
        row = cv2.remap(pixels(streams[name][0]), *maps, cv2.INTER_LINEAR)[120].astype(int)
        corners = np.array([[0.56, 0.0, 3.8, 1.0], [-0.44, 0.0, 3.8, 1.0]])
        u = sorted((p @ corner)[0] / (p @ corner)[2] for corner in corners)
        inside, outside = row[160], row[[20, 300]].mean()
        is_inside = np.flatnonzero(np.abs(row - inside) < np.abs(row - outside))
        assert [is_inside[0], is_inside[-1]] == pytest.approx([u[0] + 0.5, u[1] - 0.5], abs=0.8)


def test_projections_lead_to_both_pictures() -> None:
    """The crate's near edges are where P of each eye puts their points."""
    streams = taken(resting(1), world(), spec(encoding="mono8"))
    for info, name in (("camera_info", ""), ("right_camera_info", "right")):
        p = np.frombuffer(streams[info][0].projection).reshape(3, 4)
        row = pixels(streams[name][0])[120].astype(int)
        edges = np.flatnonzero(np.abs(np.diff(row)) > 20)
        corners = np.array([[0.56, 0.0, 3.8, 1.0], [-0.44, 0.0, 3.8, 1.0]])
        u = sorted((p @ corner)[0] / (p @ corner)[2] for corner in corners)
        assert [edges[0], edges[-1]] == pytest.approx([v - 0.5 for v in u], abs=0.51)


def test_disparity_gives_depth_back() -> None:
    """OpenCV's matching finds the depth of the laboratory as a stereo pair's noise allows."""
    made = laboratory()
    rover = made.vehicles[0]
    sensor = spec(width=640, height=480, encoding="mono8", mount=Mount((0.2, 0.06, 0.6)))
    state = resting(1, (-4.0, 0.0, 0.2))[0]
    links = np.repeat(state.vehicles["rover"].poses()[:1], 1 + len(rover.model.wheels), axis=0)
    vehicles = {"rover": replace(state.vehicles["rover"], link_poses=packed(links))}
    state = replace(state, vehicles=vehicles)
    eye = Eye(made, rover, sensor)
    eye.take(state)
    truth_m = eye.look(0).depth_m.copy()
    streams = taken([state], made, sensor)
    left, right = pixels(streams[""][0]), pixels(streams["right"][0])
    matcher = cv2.StereoSGBM.create(
        numDisparities=128,
        blockSize=5,
        P1=200,
        P2=800,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )
    found_px = matcher.compute(left, right).astype(np.float32) / 16
    scale = np.frombuffer(streams["camera_info"][0].intrinsic)[0] * BASELINE_M
    # The leftmost columns are not in the right picture.
    matched = (found_px > 0) & (scale / truth_m < 127) & np.isfinite(truth_m)
    assert matched.mean() > 0.7
    error_m = scale / found_px[matched] - truth_m[matched]
    one_pixel_m = truth_m[matched] ** 2 / scale
    error_px = error_m / one_pixel_m
    assert abs(np.median(error_px)) < 0.05
    assert np.median(np.abs(error_px)) < 0.15
    assert (np.abs(error_px) < 0.5).mean() > 0.93


def test_neither_eye_overwrites_the_other() -> None:
    made = world()
    streams = taken(resting(1), made, spec(encoding="rgb8"))
    left, right = pixels(streams[""][0]), pixels(streams["right"][0])
    eye = Eye(made, made.vehicles[0], spec())
    eye.take(resting(1)[0])
    assert np.array_equal(left, eye.look(0).color)
    assert not np.array_equal(left, right)


def test_gray_jpegs_show_the_same() -> None:
    streams = taken(resting(1), world(), spec(publish="both", encoding="mono8", jpeg_quality=95))
    for raw, compressed in (("", "compressed"), ("right", "right_compressed")):
        file = np.frombuffer(streams[compressed][0].data, np.uint8)
        decoded = cv2.imdecode(file, cv2.IMREAD_UNCHANGED)
        assert decoded is not None
        assert np.abs(decoded.astype(int) - pixels(streams[raw][0])).mean() < 2.0


def test_largest_message_matches_its_declaration() -> None:
    made = world()
    told = body_bytes(made.vehicles[0], spec())
    assert 0 <= told - len(taken(resting(1), made, spec())["right"][0].data) < 200


def test_eyes_need_namespaces_of_their_own() -> None:
    with pytest.raises(ValueError, match="share a namespace"):
        StereoCamera(
            name="stereo",
            topic="/stereo/left",
            right_topic="/stereo/right",
            frame="f",
            baseline_m=0.1,
        )
