# SPDX-License-Identifier: Apache-2.0
"""A snapshot shows what the camera's process publishes of that instant."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.messages.imagery import Image
from groundlink.scenario.cameras import Imager, Lens, Optics
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from services.sensors.camera.model import CameraModel
from services.sensors.camera.spec import Camera
from services.sensors.depth_camera.model import DepthCameraModel
from services.sensors.depth_camera.spec import ColorStream, DepthCamera
from services.sensors.rendering.gl.target import ALL_LAYERS, Frame
from services.sensors.rendering.look.labels import Labels
from services.sensors.rendering.portrait.snapshot import Snapshot, colors, write
from services.sensors.runtime.model import SensorModel, stream_and_message
from services.sensors.stereo_camera.model import StereoCameraModel
from services.sensors.stereo_camera.spec import StereoCamera
from tests.services.sensors.rendering import views
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import box, moving, yard

AT_NANOS = 100_000_000
"""The fourth picture of 30 Hz."""

BENT = Lens(distortion=(-0.2, 0.05), chromatic_aberration=0.004, vignetting=0.4)
FISHEYE = Lens(model="equidistant")
GRAIN = Imager(exposure_s=0.01, readout_s=0.01, poses=3, full_well_electrons=3000.0)
PLACE: dict[str, Any] = {
    **{"name": "camera", "frame": "eye", "width": 160, "height": 120, "rate_hz": 30.0},
    "mount": Mount((0.2, 0.0, 1.0)),
}
COLOR: dict[str, Any] = {**PLACE, "topic": "/camera/image_raw", "publish": "raw"}


def world() -> Scenario:
    made = yard(
        box("ground", (40, 40, 1), (0, 0, -1.5)),
        box("crate", (1, 1, 1), (5, 0.8, 0.5), "black"),
        box("wall", (0.5, 8, 8), (9, 0, 2)),
    )
    return replace(made, time=replace(made.time, mode="fast"))


def published(made: SensorModel, output: str) -> Any:
    """Return the pixels of the stream's picture at `AT_NANOS`, of a rover that drives."""
    for state in moving([(0.01 * tick, 0.0, 0.0) for tick in range(60)]):
        for name, message in map(stream_and_message, made.readings(state)):
            if name == output and isinstance(message, Image):
                if message.stamp_nanos == EPOCH_NANOS + AT_NANOS:
                    shape = (message.height, message.width, -1)
                    flat = np.frombuffer(message.data, np.uint8)
                    pixels = flat.reshape(shape).squeeze()
                    return pixels[..., ::-1] if message.encoding == "bgr8" else pixels
    raise AssertionError("no picture")


def taken(spec: Optics) -> tuple[Frame, Labels]:
    """Return what a snapshot of that instant shows."""
    made = world()
    snapshot = Snapshot(made, made.vehicles[0], spec, AT_NANOS)
    for state in moving([(0.01 * tick, 0.0, 0.0) for tick in range(60)]):
        assert list(snapshot.readings(state)) == []
    assert snapshot.frame is not None
    return snapshot.frame, snapshot.labels


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"lens": BENT},
        {"lens": FISHEYE, "vertical_fov_deg": 90.0},
        {"imager": GRAIN},
        {"lens": BENT, "imager": GRAIN, "encoding": "bgr8"},
        {"imager": GRAIN, "encoding": "mono8"},
        {"imager": GRAIN, "encoding": "bayer_rggb8"},
    ],
    ids=["ideal", "bent", "fisheye", "grain", "all", "gray", "bayer"],
)
def test_published_color(fields: dict[str, Any]) -> None:
    made, spec = world(), Camera(**COLOR, **fields)
    sent = published(CameraModel(made, made.vehicles[0], spec), "image")
    assert np.array_equal(taken(spec)[0].color, sent)


@pytest.mark.parametrize("encoding", ["rgb8", "mono8"])
def test_of_a_stereo_pair_it_is_the_left_eye(encoding: Any) -> None:
    made = world()
    spec = StereoCamera(**COLOR, right_topic="/right/image_raw", baseline_m=0.1, encoding=encoding)
    sent = published(StereoCameraModel(made, made.vehicles[0], spec), "")
    assert np.array_equal(taken(spec)[0].color, sent)


def test_of_a_depth_camera_it_is_true_depth_and_its_color() -> None:
    made = world()
    color: Any = {"topic": "/color/image_raw", "publish": "raw"}
    spec = DepthCamera(**PLACE, topic="/depth/image", color=ColorStream(**color), max_range_m=60.0)
    frame, _ = taken(spec)
    model = DepthCameraModel(made, made.vehicles[0], spec)
    assert np.array_equal(frame.color, published(model, "color_image"))
    model.restart()
    sent = published(model, "").reshape(120, 320).copy().view(np.uint16)
    near = frame.depth_m < 60
    assert np.array_equal(sent[near], np.rint(1000 * frame.depth_m[near]).astype(np.uint16))


def test_depth_and_labels_are_behind_the_lens() -> None:
    """The left edge of the crate's face is where a fisheye has it, in all three pictures.

    From the camera the edge is 3.9 m ahead, 1.3 m to the left and, half way up, 0.5 m down.
    """
    frame, labels = taken(Camera(**COLOR, lens=FISHEYE, vertical_fov_deg=90.0))
    assert frame.labels is not None
    side = np.hypot(1.3, 0.5)
    radius_px = 60 / np.radians(45) * np.arctan(side / 3.9)
    column, row = 79.5 - radius_px * 1.3 / side, 59.5 + radius_px * 0.5 / side
    inside, outside = (round(row), round(column + 1.5)), (round(row), round(column - 1.5))
    crate = labels.instances.index("crate")
    assert frame.labels[inside] == crate != frame.labels[outside]
    assert frame.depth_m[inside] == pytest.approx(3.9, abs=1e-3) != frame.depth_m[outside]
    # Textures have dark and light spots: the edge is what several rows have in common.
    rows = slice(round(row) - 3, round(row) + 4)
    assert frame.color[rows, inside[1]].mean() + 4 < frame.color[rows, outside[1]].mean()


def test_files_hold_the_picture(tmp_path: Path) -> None:
    made = views.renderer(views.laboratory(), layers=ALL_LAYERS)
    frame = made.draw(views.looking((3.0, -1.0, 1.0), yaw_deg=-60.0))  # through the door, too
    files = write(tmp_path / "new", "shot", frame, made.labels)
    assert [file.name for file in files] == [
        *("shot_colour.png", "shot_depth.png", "shot_labels.png", "shot_labels.json")
    ]
    color, depth, labels = (cv2.imread(str(f), cv2.IMREAD_UNCHANGED) for f in files[:3])
    assert color is not None
    assert np.array_equal(color[..., ::-1], frame.color)
    seen = np.isfinite(frame.depth_m)
    assert 0 < np.mean(~seen) < 0.5
    assert depth is not None
    assert depth.dtype == np.uint16
    assert (depth[~seen] == 0).all()
    assert np.abs(depth[seen] / 1000 - frame.depth_m[seen]).max() < 0.00051
    legend = json.loads(files[3].read_text(encoding="utf-8"))
    assert labels is not None
    assert frame.labels is not None
    for row, column in np.argwhere(seen)[::1500].tolist():
        blue, green, red = labels[row, column].tolist()
        number = frame.labels[row, column]
        thing = {"instance": made.labels.instances[number], "class": made.labels.classes[number]}
        assert legend[f"#{red:02x}{green:02x}{blue:02x}"] == thing
    assert (labels[~seen] == 0).all()
    assert len(legend) == len(np.unique(frame.labels[seen]))


def test_things_have_colors_of_their_own() -> None:
    assert len({tuple(color) for color in colors(150).tolist()}) == 150


def test_a_folder_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    made = views.renderer(views.laboratory(), layers=ALL_LAYERS)
    frame = made.draw(views.looking((0.0, 0.0, 1.0)))
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(UserError, match="file"):
        write(tmp_path / "file", "shot", frame, made.labels)
