# SPDX-License-Identifier: Apache-2.0
"""Labels of LiDARs: each point has the class and the object that it is on."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.messages.base import BusMessage, floats
from groundlink.messages.ground_truth import LabelTable
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.faults import Bias, OccludedSector, TimeJump
from groundlink.scenario.schema import Scenario
from services.sensors.faults.fault_wrapper import FaultWrapper
from services.sensors.lidar import KIND
from services.sensors.lidar.model import LidarModel
from services.sensors.lidar.spec import Lidar
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.runtime.model import LeftOut, SensorModel, stream_and_message
from tests.services.sensors.rendering.hilly import hilly
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import box, resting, yard

MOUNT = Mount((0.0, 0.0, 1.0), (0.0, 0.0, 90.0))
CRATE = box("crate_7", (1, 2, 3), (5.5, 0.5, 1.0))
SPEC: dict[str, Any] = {
    **{"name": "it", "topic": "/it/points", "frame": "lidar", "mount": MOUNT},
    **{"elevations_deg": (-20.0, -1.0, 0.0, 5.0), "firings_per_revolution": 360},
    "labels": ("points", "boxes_3d"),
}


def seen(made: Scenario, model: SensorModel | None = None, **fields: Any) -> dict[str, Any]:
    """Return the messages of the first revolution, by stream."""
    model = model or LidarModel(made, made.vehicles[0], Lidar(**SPEC | fields))
    messages: dict[str, BusMessage] = {}
    for state in resting(42):
        for one in model.readings(state):
            assert not isinstance(one, LeftOut)
            stream, message = stream_and_message(one)
            messages.setdefault(stream, message)
    return messages


def numbers(table: LabelTable) -> dict[str, int]:
    of_each = np.frombuffer(table.numbers, np.uint16).tolist()
    return dict(zip(table.names, of_each, strict=True))


def test_points_have_the_object_that_they_are_on() -> None:
    found = seen(yard(box("ground", (60, 60, 1), (0, 0, -1.5)), CRATE))
    cloud, labeled = found[""].records(), found["labeled_points"].records()
    for field in cloud.dtype.names:
        assert (labeled[field] == cloud[field]).all()
    kinds, names = numbers(found["label_info"]), numbers(found["instance_info"])
    assert set(names) == {"crate_7", "ground"}
    assert kinds["ground"] == 21
    # The sensor looks to the left: the crate is at its right.
    on_crate = labeled["y"] < -4.9
    on_crate &= np.abs(labeled["x"] - 0.5) < 1.01
    on_crate &= labeled["z"] > -1.9
    assert on_crate.sum() > 20
    assert (labeled["instance"] == np.where(on_crate, names["crate_7"], names["ground"])).all()
    assert (labeled["label"] == np.where(on_crate, kinds["crate"], kinds["ground"])).all()
    assert {m.stamp_nanos for m in found.values()} == {EPOCH_NANOS}


def test_a_box_is_around_the_object_in_the_frame_of_the_sensor() -> None:
    found = seen(yard(CRATE))["boxes_3d"]
    assert found.names == ("crate_7",)
    (row,) = floats(found.boxes).reshape(-1, 10).tolist()
    assert row[:3] == pytest.approx((0.5, -5.5, 0.0), abs=1e-12)
    assert row[3:7] == pytest.approx((0, 0, -(0.5**0.5), 0.5**0.5), abs=1e-12)
    assert row[7:] == [1.0, 2.0, 3.0]


def test_each_material_of_the_terrain_is_a_class() -> None:
    surface = np.zeros((40, 40), np.uint8)
    surface[:, 20:] = 1
    made = hilly(np.full((41, 41), -1.0), surface=surface)
    found = seen(made, mount=Mount((0.0, 0.0, 1.0)))
    points, kinds = found["labeled_points"].records(), numbers(found["label_info"])
    assert set(numbers(found["instance_info"])) == {"terrain"}
    assert (points["label"] == np.where(points["x"] > 0, kinds["sand"], kinds["grass"])).all()
    assert found["boxes_3d"].names == ()


def test_blocks_have_the_labels_of_the_whole_revolution() -> None:
    made = yard(box("ground", (60, 60, 1), (0, 0, -1.5)), CRATE)
    whole = seen(made)["labeled_points"].records()
    model = LidarModel(made, made.vehicles[0], Lidar(**SPEC | {"block_deg": 90.0}))
    blocks = []
    for state in resting(41):
        for one in model.readings(state):
            assert not isinstance(one, LeftOut)
            stream, message = stream_and_message(one)
            if stream == "labeled_points":
                blocks.append(message.records())  # type: ignore[attr-defined]
    joined = np.concatenate(blocks)
    for field in ("x", "y", "z", "label", "instance"):
        assert (joined[field] == whole[field]).all()


def test_faults_of_the_clock_act_on_labels_and_those_of_the_measurement_do_not() -> None:
    made = yard(CRATE)
    faults = (TimeJump(offset_s=1.0), Bias(value=0.5), OccludedSector(from_deg=0.0, to_deg=90.0))
    spec = Lidar(**SPEC, faults=faults)
    inner = LidarModel(made, made.vehicles[0], spec)
    streams = RandomStreams(1, "rover/it")
    faulty = FaultWrapper(inner, faults=faults, messages=KIND.streams, streams=streams)
    found, plain = seen(made, faulty), seen(made)
    assert {m.stamp_nanos for m in found.values()} == {EPOCH_NANOS + 10**9}
    for stream in ("labeled_points", "boxes_3d"):
        stamp = {"stamp_nanos": EPOCH_NANOS, "clock_error_nanos": 0}
        assert replace(found[stream], **stamp) == plain[stream]
    assert found[""].points != plain[""].points


def test_labels_change_no_cloud() -> None:
    made = yard(CRATE)
    assert seen(made)[""] == seen(made, labels=())[""]
