# SPDX-License-Identifier: Apache-2.0
"""Positions of a receiver at rest out of NMEA, UBX and messages, whatever else is in between."""

from pathlib import Path

import numpy as np
import pymap3d
import pytest
from mcap.writer import Writer
from pyubx2 import GET, UBXMessage

from groundlink.core.errors import UserError
from groundlink.fitting.positions import FIX, read_positions
from groundlink.ros.types import STORE, header
from services.sensors.runtime import nmea
from tests.services.sensors.allan import Floats

PLACE = 50.061, 19.937, 219.0
COUNT = 200


def enu() -> Floats:
    return np.cumsum(np.random.default_rng(1).normal(size=(COUNT, 3)), axis=0)


def geodetic() -> list[tuple[float, float, float]]:
    return [pymap3d.enu2geodetic(*row, *PLACE) for row in enu()]


def sentences(begin_s: int = 86_340, quality: int = 1) -> list[bytes]:
    """Return GGA sentences at 1 Hz, past midnight."""
    return [
        nmea.gga(
            nmea.Epoch(
                (begin_s + number) * 1_000_000_000, quality, "A", 7, *place,
                satellites=9, horizontal_dilution=1.0,
            )
        )
        for number, place in enumerate(geodetic())
    ]  # fmt: skip


def ubx() -> bytes:
    """Return NAV-PVT over the end of a week."""
    return b"".join(
        UBXMessage(
            "NAV", "NAV-PVT", GET, iTOW=(604_740_000 + 1000 * number) % 604_800_000,
            fixType=3, gnssFixOk=1, carrSoln=2, lat=place[0], lon=place[1],
            height=round(1000 * place[2]),
        ).serialize()
        for number, place in enumerate(geodetic())
    )  # fmt: skip


def fixes(path: Path, topics: tuple[str, ...] = ("/fix",), lost: int = 0) -> Path:
    types = STORE.types
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(FIX, "ros2msg", b"")
        for topic in topics:
            channel = writer.register_channel(topic, "cdr", schema)
            for number, place in enumerate(geodetic()):
                status = -1 if number < lost else 1
                message = types[FIX](
                    header=header(1_700_000_000_000_000_000 + number * 1_000_000_000, "gnss"),
                    status=types["sensor_msgs/msg/NavSatStatus"](status=status, service=1),
                    latitude=place[0], longitude=place[1], altitude=place[2],
                    position_covariance=np.zeros(9), position_covariance_type=0,
                )  # fmt: skip
                data = bytes(STORE.serialize_cdr(message, FIX))
                writer.add_message(channel, log_time=number, data=data, publish_time=number)
        writer.finish()
    return path


def text_messages(path: Path) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("nmea_msgs/msg/Sentence", "ros2msg", b"")
        channel = writer.register_channel("/nmea", "cdr", schema)
        for sentence in sentences():
            data = b"\0\1\0\0" + bytes(16) + sentence + b"\0"
            writer.add_message(channel, log_time=1, data=data, publish_time=1)
        writer.finish()
    return path


def test_every_form_has_the_same_positions(tmp_path: Path) -> None:
    log, binary = tmp_path / "run.nmea", tmp_path / "run.ubx"
    noise = b"$GNGGA,123\xff\xb5b\x01\x07\\\0short$GPRMC,,*11\r\n"
    log.write_bytes(noise + noise.join(sentences()))
    binary.write_bytes(noise + sentences()[0] + ubx() + b"\xb5b\x01\x07\\\0")
    expected = {
        log: "single_point",
        binary: "rtk_fix",
        fixes(tmp_path / "run.mcap"): "sbas",
        text_messages(tmp_path / "text.mcap"): "single_point",
    }
    true = enu() - enu()[0]
    for path, solution in expected.items():
        found = read_positions(path)
        assert (found.solution, found.left_out, found.series.period_s) == (solution, 0, 1.0)
        (segment,) = found.series.segments
        np.testing.assert_allclose(segment, true, atol=0.02)


def test_the_most_frequent_type_of_solution_is_taken(tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    fixed, floating = sentences(quality=4), sentences(quality=5)
    bad = fixed[150].replace(b"*", b"1*")
    log.write_bytes(b"".join([*floating[:30], *fixed[30:150], bad, *fixed[151:]]))
    found = read_positions(log)
    assert (found.solution, found.left_out, found.series.readings) == ("rtk_fix", 30, 169)
    assert read_positions(fixes(tmp_path / "lost.mcap", lost=20)).series.readings == COUNT - 20


def test_what_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    two = fixes(tmp_path / "two.mcap", ("/a", "/b"))
    assert read_positions(two, "/b").series.readings == COUNT
    (tmp_path / "none.log").write_text("nothing here")
    (tmp_path / "few.log").write_bytes(b"".join(sentences()[:50]))
    expected = {
        two: "2 topics of NavSatFix or GGA sentences: /a, /b; expected one",
        tmp_path / "none.log": "no fixes; expected NavSatFix, GGA sentences or NAV-PVT",
        tmp_path / "few.log": "50 readings; expected at least 100",
        tmp_path / "missing.ubx": "no such file",
        Path(__file__): "expected a .bag, .db3 or .mcap file, .* or a log",
    }
    for path, message in expected.items():
        with pytest.raises(UserError, match=message):
            read_positions(path)
