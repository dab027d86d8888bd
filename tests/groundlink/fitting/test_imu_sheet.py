# SPDX-License-Identifier: Apache-2.0
"""Recordings of Groundlink's own IMU at rest fit back to the figures of its data sheet."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as BagWriter

from groundlink.__main__ import main
from groundlink.core.errors import UserError
from groundlink.fitting import imu_sheet
from groundlink.fitting.imu_sheet import FIELDS, IMU, fit, fitted_fields, read_readings
from groundlink.fitting.series import Series
from groundlink.loader.datasheets import CheckedDatasheet, load_datasheet
from groundlink.recording.ros1 import NOETIC, to_ros1
from groundlink.ros.types import STORE, header
from services.sensors.imu.spec import InertialUnit
from tests.services.sensors.imu.test_datasheets import SHEETS
from tests.services.sensors.sheets import from_sheet
from tools.at_rest import imu_at_rest

MADE = [sheet.stem for sheet in SHEETS if sheet.stem != "imu_ideal" and "_fitted" not in sheet.stem]


def wrong(sheet: str) -> CheckedDatasheet:
    """Return a sheet with wrong levels."""
    base = load_datasheet(sheet)
    figures = dict(base.figures)
    for triad in imu_sheet.TRIADS:
        figures[triad] = figures[triad] | {
            "noise_density": 5 * figures[triad]["noise_density"],
            "bias_instability": 20 * figures[triad]["bias_instability"],
            "turn_on_bias": 1.0,
            "resolution": 1.0,
        }
    return base._replace(figures=figures)


@pytest.mark.parametrize(
    "sheet",
    [pytest.param(s, marks=[] if s == "imu_mti1" else [pytest.mark.nightly]) for s in MADE],
)
def test_half_an_hour_fits_back_to_the_sheet(sheet: str) -> None:
    """Within three times the stated error, and within 20 % in every band."""
    spec = from_sheet(InertialUnit, sheet)
    found = fit(imu_at_rest(spec, 1800), wrong(sheet))
    for name, triad in found.items():
        noise = getattr(spec, name)
        fields = fitted_fields(name, triad)
        assert {"noise_density", "bias_instability"} <= fields.keys()
        for of, error in triad.curve.errors.items():
            field = FIELDS[of][0]
            apart = np.log(fields[field] / getattr(noise, field))
            assert abs(apart) < 3 * error, (name, field, fields[field])
        assert triad.curve.errors["white"] < 0.02
        assert fields.get("resolution", 0) == pytest.approx(noise.resolution, rel=1e-3)
        assert np.abs(triad.curve.differences).max() < 0.2
    # Three numbers' root mean square: within 0.15 and 2.2 sigma but for 1 %.
    ratio = fitted_fields("gyroscope", found["gyroscope"])["turn_on_bias"]
    assert 0.15 < ratio / spec.gyroscope.turn_on_bias < 2.2


def test_a_minute_keeps_the_bias_of_the_base(tmp_path: Path) -> None:
    spec = from_sheet(InertialUnit, "imu_mti1", rate_hz=100)
    sheet = imu_sheet.fitted_sheet(imu_at_rest(spec, 60), load_datasheet("imu_mti1"))
    assert sheet.figures["accelerometer"]["noise_density"] == pytest.approx(1.18e-3, rel=0.03)
    assert sheet.figures["accelerometer"]["bias_instability"] == 2.94e-4
    assert sheet.figures["accelerometer"]["saturation"] == 156.9
    assert sheet.comments == ["Length: 60 s at rest, 5998 readings at 100 Hz, 1 segment(s)."]
    assert sheet.notes["accelerometer"][-1] == (
        "The base's, as the recording does not show them: bias_instability, bias_time_constant_s, "
        "random_walk, bandwidth_hz."
    )


@pytest.fixture(scope="module")
def readings() -> Series:
    spec = from_sheet(InertialUnit, "imu_adis16448", rate_hz=100)
    return imu_at_rest(spec, 20)


def messages(readings: Series) -> list[tuple[int, bytes]]:
    """Return stamps and sensor_msgs/Imu as CDR."""
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    turn = STORE.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    unknown = np.zeros(9)
    found = []
    for number, row in enumerate(readings.segments[0].tolist()):
        stamp = 1_700_000_000_000_000_000 + number * 10_000_000
        message = STORE.types[IMU](
            header=header(stamp, "imu"),
            orientation=turn, orientation_covariance=unknown,
            angular_velocity=vector(*row[3:]), angular_velocity_covariance=unknown,
            linear_acceleration=vector(*row[:3]), linear_acceleration_covariance=unknown,
        )  # fmt: skip
        found.append((stamp, bytes(STORE.serialize_cdr(message, IMU))))
    return found


def mcap(path: Path, readings: Series, topics: tuple[str, ...] = ("/imu",)) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(IMU, "ros2msg", b"")
        for topic in topics:
            channel = writer.register_channel(topic, "cdr", schema)
            for stamp, cdr in messages(readings):
                writer.add_message(channel, log_time=stamp, data=cdr, publish_time=stamp)
        writer.finish()
    return path


def ros1_bag(path: Path, readings: Series) -> Path:
    with BagWriter(path) as bag:
        text, digest = NOETIC.generate_msgdef(IMU, ros_version=1)
        connection = bag.add_connection("/imu", IMU, msgdef=text, md5sum=digest)
        for stamp, cdr in messages(readings):
            bag.write(connection, stamp, to_ros1(IMU, cdr))
    return path


def table(path: Path, readings: Series, time: str = "t") -> Path:
    names = [f"{field}.{axis}" for field, _ in imu_sheet.TRIADS.values() for axis in "xyz"]
    rows = [f"note,{time}," + ",".join(names)]
    for number, row in enumerate(readings.segments[0].tolist()):
        at = number * 10_000_000 if time == "stamp" else number * 0.01
        rows.append(f'"a, b",{at},' + ",".join(map(repr, row)))
    path.write_text("\n".join(rows) + "\n")
    return path


def test_every_form_of_recording_has_the_same_readings(tmp_path: Path, readings: Series) -> None:
    paths = [
        mcap(tmp_path / "imu.mcap", readings),
        ros1_bag(tmp_path / "imu.bag", readings),
        table(tmp_path / "imu.csv", readings),
        table(tmp_path / "stamps.csv", readings, "stamp"),
    ]
    for path in paths:
        read = read_readings(path)
        np.testing.assert_array_equal(read.segments[0], readings.segments[0])
        assert read.period_s == pytest.approx(0.01, rel=1e-6)


def test_what_cannot_be_read_is_one_line(tmp_path: Path, readings: Series) -> None:
    two = mcap(tmp_path / "two.mcap", readings, ("/a", "/b"))
    assert read_readings(two, "/b").readings == readings.readings
    poor, words = tmp_path / "poor.csv", tmp_path / "words.csv"
    poor.write_text("t,linear_acceleration.x\n1,2\n")
    words.write_text(table(tmp_path / "imu.csv", readings).read_text() + '"",one' + ",1" * 6)
    (tmp_path / "text.bag").write_text("text")
    expected = {
        two: "2 topics of sensor_msgs/Imu: /a, /b; expected one",
        poor: r"poor.csv:1: no column linear_acceleration.y, .*; expected",
        words: "not numbers",
        tmp_path / "text.bag": "cannot be read",
        tmp_path / "none.bag": "no such file",
        Path(__file__): "expected a .bag, .db3, .mcap or .csv file",
    }
    for path, message in expected.items():
        with pytest.raises(UserError, match=message):
            read_readings(path)


def test_the_command_fits_an_imu(
    tmp_path: Path, readings: Series, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, out = mcap(tmp_path / "imu.mcap", readings), tmp_path / "imu_mine.yaml"
    arguments = ["fit", str(recording), "--topic", "/imu", "--sheet", "imu_ideal"]
    assert main([*arguments, "--out", str(out), "--source", "a table"]) == 0
    printed = capsys.readouterr().out
    assert "Allan deviation of the gyroscope, rad/s, by averaging time:" in printed
    assert f"wrote {out}" in printed
    sensor: Any = load_datasheet(str(out)).sensor()
    noise = sensor.gyroscope
    assert noise.noise_density == pytest.approx(3.39e-4, rel=0.05)
    assert noise.resolution == pytest.approx(6.98e-4, rel=1e-3)
    text = out.read_text()
    assert "# Recording: a table\n# Length: 20 s at rest, " in text
    assert "\n# Fitted: noise_density +-" in text
    out.unlink()
    assert main([*arguments, "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["gyroscope"]["figures"]["noise_density"] == noise.noise_density
    assert found["gyroscope"]["bands"][0]["seconds"] == pytest.approx(0.01)
