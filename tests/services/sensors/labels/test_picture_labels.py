# SPDX-License-Identifier: Apache-2.0
"""Labels of cameras: each pixel has its class and object, and boxes are those of known places."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.frames import quaternion_from_rpy
from groundlink.messages.base import BusMessage, encode, floats
from groundlink.messages.ground_truth import Detections2D, Detections3D, LabelTable
from groundlink.messages.imagery import Image
from groundlink.scenario.cameras import Imager, Lens
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from groundlink.world.actors import EntityDescription
from groundlink.world.solids import Solid
from services.sensors.camera.model import CameraModel
from services.sensors.camera.spec import Camera
from services.sensors.depth_camera.model import DepthCameraModel
from services.sensors.depth_camera.spec import DepthCamera
from services.sensors.runtime.model import LeftOut, stream_and_message
from services.sensors.stereo_camera.model import StereoCameraModel
from services.sensors.stereo_camera.spec import StereoCamera
from tests.services.sensors.rendering.hilly import hilly
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import box, moving, resting, yard

MOUNT = Mount((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
FOCAL = 100.0
FORMS = ("segmentation", "boxes_2d", "boxes_3d")
CRATE = box("crate", (1, 1, 1), (5.5, 0.8, 1.0))


def spec(kind: Any = Camera, **fields: Any) -> Any:
    place = {"name": "it", "topic": "/it/image", "frame": "optical", "mount": MOUNT}
    view = {"width": 160, "height": 120, "intrinsics": (FOCAL, FOCAL, 79.5, 59.5)}
    return kind(**{**place, **view, "labels": FORMS, "publish": "raw", **fields})


def world(*solids: Solid, **described: EntityDescription) -> Scenario:
    made = yard(box("ground", (80, 80, 1), (0, 0, -1.5)), *solids, frame_prefix="one/")
    return replace(made, world=replace(made.world, entities=described))


def seen(model: Any, at_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """Return the messages of the first picture, by stream."""
    messages: dict[str, BusMessage] = {}
    for state in resting(24, at_m):
        for made in model.readings(state):
            assert not isinstance(made, LeftOut)
            stream, message = stream_and_message(made)
            messages.setdefault(stream, message)
    return messages


def camera(made: Scenario, **fields: Any) -> CameraModel:
    return CameraModel(made, made.vehicles[0], spec(**fields))


def pixels(message: Image) -> Any:
    dtype = {"mono8": "u1", "mono16": "<u2"}[message.encoding]
    return np.frombuffer(message.data, dtype).reshape(message.height, message.width)


def number_of(name: str, table: LabelTable) -> int:
    numbers = np.frombuffer(table.numbers, np.uint16).tolist()
    return dict(zip(table.names, numbers, strict=True))[name]


def box_of(name: str, found: Detections2D | Detections3D) -> list[float]:
    rows = found.boxes_px if isinstance(found, Detections2D) else found.boxes
    row: list[float] = floats(rows).reshape(len(found.names), -1)[found.names.index(name)].tolist()
    return row


def share_of(name: str, found: Detections2D | Detections3D) -> float:
    return float(floats(found.visible)[found.names.index(name)])


def test_a_box_at_a_known_place_has_known_boxes() -> None:
    found = seen(camera(world(CRATE)))
    # The near face is 5 m ahead, from 0.3 to 1.3 m to the left, and centered in height.
    x, y, width, height = box_of("crate", found["boxes_2d"])
    left, right = 79.5 - FOCAL * 1.3 / 5, 79.5 - FOCAL * 0.3 / 6
    assert (x, width) == pytest.approx(((left + right) / 2, right - left), abs=1)
    assert (y, height) == pytest.approx((59.5, FOCAL * 1.0 / 5), abs=1)
    box = box_of("crate", found["boxes_3d"])
    assert box[:3] == pytest.approx((-0.8, 0.0, 5.5), abs=1e-12)  # right, down, ahead
    assert np.abs(box[3:7]) == pytest.approx((0.5,) * 4, abs=1e-12)  # as the mount in optical axes
    assert box[7:] == [1.0, 1.0, 1.0]
    assert found["boxes_2d"].names == found["boxes_3d"].names == ("crate",)  # not the ground
    assert share_of("crate", found["boxes_2d"]) == 1.0


def test_all_labels_have_the_stamp_and_the_frame_of_the_picture() -> None:
    found = seen(camera(world(CRATE)))
    assert {m.stamp_nanos for m in found.values()} == {EPOCH_NANOS}
    assert {m.frame for m in found.values()} == {"one/optical"}
    of_labels = {"label_info", "semantic", "instances", "instance_info", "boxes_2d", "boxes_3d"}
    assert set(found) == {"image", "camera_info", *of_labels}


@pytest.mark.parametrize("form", FORMS)
def test_only_what_the_scenario_asks_for_is_made(form: str) -> None:
    asked = spec(labels=(form,))
    made = world(CRATE)
    found = seen(CameraModel(made, made.vehicles[0], asked))
    assert found.keys() == asked.ros_topics().keys()


def test_pixels_have_classes_and_objects_with_names() -> None:
    found = seen(camera(world(CRATE, crate=EntityDescription(tags=("pallet", "wood")))))
    classes, objects = pixels(found["semantic"]), pixels(found["instances"])
    kinds, names = found["label_info"], found["instance_info"]
    assert {"crate", "ground"} == set(names.names)
    assert classes[59, 60] == number_of("pallet", kinds) >= 32  # the first tag
    assert classes[110, 20] == number_of("ground", kinds) == 21
    assert classes[5, 20] == objects[5, 20] == 0  # the sky
    on_crate = objects == number_of("crate", names)
    assert (classes[on_crate] == number_of("pallet", kinds)).all()
    assert np.frombuffer(found["boxes_2d"].classes, np.uint16).tolist() == [classes[59, 60]]


def test_classes_have_the_same_numbers_in_every_world() -> None:
    tables = [seen(camera(made))["label_info"] for made in (world(), world(CRATE))]
    own = [dict(zip(t.names, np.frombuffer(t.numbers, np.uint16), strict=True)) for t in tables]
    assert own[0].items() <= own[1].items() | {("rover", own[0].get("rover"))}
    assert own[1]["person"] == own[0]["person"] == 20


def test_the_visible_share_is_that_of_pixels() -> None:
    # A wall hides what is left of the crate's middle.
    wall = box("wall", (0.1, 4.0, 4.0), (3.0, 2.0 + 0.48, 1.0))
    whole, hidden = seen(camera(world(CRATE))), seen(camera(world(CRATE, wall)))
    shown = [
        (pixels(found["instances"]) == number_of("crate", found["instance_info"])).sum()
        for found in (whole, hidden)
    ]
    assert 0.2 < shown[1] / shown[0] < 0.8
    for form in ("boxes_2d", "boxes_3d"):
        assert share_of("crate", hidden[form]) == shown[1] / shown[0]
    # The box is around what is visible.
    assert box_of("crate", hidden["boxes_2d"])[2] < box_of("crate", whole["boxes_2d"])[2]
    assert box_of("crate", hidden["boxes_3d"]) == box_of("crate", whole["boxes_3d"])


def test_what_is_hidden_or_out_of_view_has_no_box() -> None:
    behind = box("behind", (1, 1, 1), (-5.5, 0.0, 1.0))
    covered = box("covered", (0.2, 0.2, 0.2), (9.0, 1.0, 1.0))
    found = seen(camera(world(CRATE, behind, covered)))
    assert found["boxes_2d"].names == found["boxes_3d"].names == ("crate",)


def test_a_turned_vehicle_sees_the_box_where_it_is() -> None:
    turned = quaternion_from_rpy(0.0, 0.0, np.pi / 2)
    made = world(box("crate", (1.0, 2.0, 3.0), (0.3, 7.0, 2.0)))
    model = camera(made)
    found: dict[str, Any] = {}
    (state,) = moving(np.array([(0.0, 1.0, 0.5)]), turned)
    for made_now in model.readings(state):
        assert not isinstance(made_now, LeftOut)
        found |= [stream_and_message(made_now)]
    row = box_of("crate", found["boxes_3d"])
    assert row[:3] == pytest.approx((0.3, -0.5, 6.0), abs=1e-12)
    assert row[7:] == [1.0, 2.0, 3.0]


def test_labels_end_where_depth_jumps() -> None:
    made = world(CRATE)
    depth = spec(DepthCamera, encoding="32FC1", max_range_m=100.0)
    found = seen(DepthCameraModel(made, made.vehicles[0], depth))
    depth_m = np.frombuffer(found[""].data, np.float32).reshape(120, 160)
    crate = pixels(found["instances"]) == number_of("crate", found["instance_info"])
    assert crate.any()
    assert (depth_m[crate] < 6.01).all()
    assert (depth_m[pixels(found["semantic"]) == 0] == np.inf).all()
    # Of the neighbors of its upper rim, those above are sky and those below are the crate.
    rim = np.flatnonzero(crate[:, 60])[0]
    assert depth_m[rim - 1, 60] > 20
    assert depth_m[rim, 60] == pytest.approx(5.0, abs=1e-3)


def test_the_left_picture_of_a_pair_is_labeled() -> None:
    made = world(CRATE)
    pair = spec(StereoCamera, right_topic="/right/image", baseline_m=0.5)
    labeled = seen(StereoCameraModel(made, made.vehicles[0], pair))
    plain = seen(StereoCameraModel(made, made.vehicles[0], replace(pair, labels=())))
    assert {"right", ""} < set(plain) < set(labeled)
    assert {stream: labeled[stream] for stream in plain} == plain
    left = seen(camera(made))
    for stream in ("semantic", "instances", "boxes_2d", "boxes_3d"):
        assert encode(labeled[stream]) == encode(left[stream])


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"encoding": "mono8"},
        {"lens": Lens(distortion=(-0.2, 0.02)), "encoding": "bgr8"},
        {"imager": Imager(exposure_s=0.01, poses=3, full_well_electrons=9000.0)},
    ],
)
def test_labels_change_no_picture_and_are_the_same_again(fields: dict[str, Any]) -> None:
    made = world(CRATE)
    plain = seen(camera(made, labels=(), **fields))
    labeled, again = (seen(camera(made, **fields)) for _ in range(2))
    assert {stream: labeled[stream] for stream in plain} == plain
    assert labeled == again


def test_labels_are_behind_the_lens() -> None:
    made = world(box("crate", (1, 1, 1), (5.5, 3.0, 1.0)))
    k1, k2 = -0.2, 0.02
    straight, bent = seen(camera(made)), seen(camera(made, lens=Lens(distortion=(k1, k2))))
    x, _, width, _ = box_of("crate", straight["boxes_2d"])
    left = 0.5 + x - width / 2 - 79.5  # of the leftmost pixel's center
    squared = (left / FOCAL) ** 2
    x, _, width, _ = box_of("crate", bent["boxes_2d"])
    moved = left * (1 + k1 * squared + k2 * squared**2)
    assert abs(moved - left) > 5
    assert 0.5 + x - width / 2 - 79.5 == pytest.approx(moved, abs=1.5)
    numbers = [np.unique(pixels(found["semantic"])).tolist() for found in (straight, bent)]
    assert numbers[0] == numbers[1]


def test_each_material_of_the_terrain_is_a_class() -> None:
    surface = np.zeros((40, 40), np.uint8)
    surface[20:] = 1
    made = hilly(np.full((41, 41), -1.0), surface=surface)
    found = seen(camera(made))
    classes, kinds = pixels(found["semantic"]), found["label_info"]
    assert (classes[80:, :79] == number_of("sand", kinds)).all()
    assert (classes[80:, 81:] == number_of("grass", kinds)).all()
    assert found["instance_info"].names == ("terrain",)
    assert found["boxes_2d"].names == found["boxes_3d"].names == ()
