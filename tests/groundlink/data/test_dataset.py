# SPDX-License-Identifier: Apache-2.0
"""Arrays of a recording, compared with what an independent reader of MCAP files decodes."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import groundlink
from groundlink.core.errors import RequirementError, UserError
from groundlink.core.frames import matrix_from_quaternion
from groundlink.data.dataset import Dataset
from groundlink.data.ros_arrays import content, table
from groundlink.ros.types import TYPES, header

FILE = Path(__file__).parents[2] / "compatibility" / "every_kind.mcap"


@pytest.fixture(scope="module")
def run() -> Iterator[Dataset]:
    with groundlink.open(FILE) as opened:
        yield opened


def decoded(topic: str) -> list[Any]:
    """Return the messages of a topic, by the decoder of the MCAP project."""
    with FILE.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages([topic])]


def stamp_of(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec * 10**9 + stamp.nanosec)


def topic_of(run: Dataset, ros_type: str) -> str:
    return next(name for name, facts in run.topics.items() if facts.type == ros_type)


def test_readings_are_one_record_each(run: Dataset) -> None:
    topic = topic_of(run, "sensor_msgs/msg/Imu")
    table, expected = run.array(topic), decoded(topic)
    assert len(table) == len(expected) > 50
    assert table["stamp"].tolist() == [stamp_of(message) for message in expected]
    acceleration = [
        (m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z)
        for m in expected
    ]
    assert table["linear_acceleration"].tolist() == [list(row) for row in acceleration]
    assert table["orientation_covariance"].shape == (len(expected), 9)


def test_nested_fields_have_dotted_names_and_constants_are_left_out(run: Dataset) -> None:
    topic = topic_of(run, "sensor_msgs/msg/NavSatFix")
    table, expected = run.array(topic), decoded(topic)
    assert table["status.status"].tolist() == [message.status.status for message in expected]
    assert not [name for name in table.dtype.names or () if name.isupper() or "STATUS" in name]


def test_clouds_and_images_are_one_array_each(run: Dataset) -> None:
    clouds = topic_of(run, "sensor_msgs/msg/PointCloud2")
    for (stamp, points), expected in zip(run.contents(clouds), decoded(clouds), strict=True):
        assert stamp == stamp_of(expected)
        assert points.shape == (expected.width,)
        assert points.dtype.names == tuple(field.name for field in expected.fields)
        assert points.tobytes() == bytes(expected.data)
    images = topic_of(run, "sensor_msgs/msg/Image")
    for (_, pixels), expected in zip(run.contents(images), decoded(images), strict=True):
        assert pixels.shape[:2] == (expected.height, expected.width)
        assert pixels.tobytes() == bytes(expected.data)
    pictures = topic_of(run, "sensor_msgs/msg/CompressedImage")
    _, pixels = next(run.contents(pictures))
    assert pixels.ndim == 3
    assert pixels.std() > 1


def test_a_slice_has_the_messages_of_its_span(run: Dataset) -> None:
    topic = topic_of(run, "sensor_msgs/msg/Imu")
    whole = run.array(topic)["stamp"]
    part = run.array(topic, start_s=0.2, end_s=0.4)["stamp"]
    since = whole - run.start_nanos
    assert part.tolist() == whole[(since >= 200_000_000) & (since < 400_000_000)].tolist()
    assert 0 < len(part) < len(whole)


def test_truth_of_a_frame_is_that_of_the_base_moved_by_the_mount(run: Dataset) -> None:
    vehicle = run.scenario.vehicles[0]
    lidar = next(sensor for sensor in vehicle.sensors if sensor.kind == "lidar")
    base, seen = run.truth(), run.truth(vehicle.name, lidar.frame)
    odometry = decoded(run.scenario.ground_truth_topic(vehicle))
    first = odometry[0].pose.pose.position
    assert base.positions_m[0].tolist() == [first.x, first.y, first.z]
    offset = matrix_from_quaternion(base.orientations) @ np.array(lidar.mount.xyz_m)
    np.testing.assert_allclose(seen.positions_m, base.positions_m + offset, atol=1e-12)
    between = (base.seconds[3] + base.seconds[4]) / 2
    middle = (base.positions_m[3] + base.positions_m[4]) / 2
    np.testing.assert_allclose(base.at(np.array([between])).positions_m[0], middle, atol=1e-6)


def test_poses_are_one_array(run: Dataset) -> None:
    topic = topic_of(run, "nav_msgs/msg/Odometry")
    assert run.poses(topic).rows.shape == (len(decoded(topic)), 8)


def test_topics_of_a_span_come_in_one_pass_in_order_of_time(run: Dataset) -> None:
    topics = ["/imu", "/points"]
    found = [(topic, nanos) for topic, nanos, _ in run.interleaved(topics, end_s=0.3)]
    each = [(t, nanos) for t in topics for nanos, _ in run.messages(t, end_s=0.3)]
    assert sorted(found) == sorted(each)
    times = [nanos for _, nanos in found]
    assert times == sorted(times)


def test_frames_and_the_sensor_of_a_topic(run: Dataset) -> None:
    assert run.frames["rover"][0] == "base_link"
    assert run.sensor_frame("/points/truth") == ("rover", "lidar_link")
    assert run.sensor_frame("/odom") is None
    assert run.mount("rover", "base_link") == (0, 0, 0, 0, 0, 0, 1)


def test_records_with_lists_of_other_lengths_are_refused() -> None:
    rows = [{"a": np.ones(4)}, {"a": np.ones(1)}]
    with pytest.raises(ValueError, match="same shape"):
        table(rows)


def test_a_cloud_may_have_any_byte_order_and_lists_in_its_fields() -> None:
    fields = [
        TYPES["sensor_msgs/msg/PointField"](name=name, offset=offset, datatype=7, count=count)
        for name, offset, count in (("x", 0, 1), ("normal", 8, 3))
    ]
    data = np.arange(10, dtype=">f4").view(np.uint8)
    cloud = TYPES["sensor_msgs/msg/PointCloud2"](
        header(0, "lidar"), 1, 2, fields, True, 20, 40, data, True
    )
    points = content(cloud)
    assert points is not None
    assert points["x"].tolist() == [0, 5]
    assert points["normal"].tolist() == [[2, 3, 4], [7, 8, 9]]


def test_mistakes_are_named_with_what_is_there(run: Dataset) -> None:
    with pytest.raises(UserError, match=r"no topic `/imo`; expected one of .*/imu"):
        run.array("/imo")
    with pytest.raises(UserError, match=r"an array in each message. Fix: use `contents`"):
        run.array(topic_of(run, "sensor_msgs/msg/PointCloud2"))
    with pytest.raises(UserError, match=r"expected point clouds or images. Fix: use `array`"):
        next(run.contents(topic_of(run, "sensor_msgs/msg/Imu")))
    with pytest.raises(UserError, match="expected poses: "):
        run.poses(topic_of(run, "sensor_msgs/msg/Imu"))
    with pytest.raises(UserError, match="no vehicle `car`; the run has "):
        run.truth("car")
    with pytest.raises(UserError, match=r"no frame `x`; expected one of .*base_link"):
        run.truth(frame="x")
    with pytest.raises(UserError, match="no messages in this span"):
        run.array(topic_of(run, "sensor_msgs/msg/Imu"), start_s=1e6)
    with pytest.raises(UserError, match="no such file"):
        groundlink.open("nowhere.mcap")


def test_data_frames_have_a_column_for_each_component(
    run: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = run.dataframe(topic_of(run, "sensor_msgs/msg/Imu"))
    assert isinstance(frame, pandas.DataFrame)
    assert {"stamp", "orientation.w", "linear_acceleration.z"} <= set(frame.columns)
    wheels = decoded("/wheel_encoders")
    ticks = run.dataframe("/wheel_encoders")[[f"ticks.{name}" for name in wheels[0].name]]
    assert ticks.to_numpy().tolist() == [list(message.ticks) for message in wheels]
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(RequirementError, match="Fix: pip install pandas"):
        run.dataframe(topic_of(run, "sensor_msgs/msg/Imu"))
