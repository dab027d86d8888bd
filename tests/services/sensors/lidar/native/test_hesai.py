# SPDX-License-Identifier: Apache-2.0
"""Clouds as a PandarXT-32's packets: what hydra4 decodes from them, and their instants."""

import struct
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.core.errors import UserError
from groundlink.messages.base import PointCloud
from services.sensors.lidar.native.hesai import HesaiXt32
from tests.services.sensors.lidar import rooms

from .test_vlp16 import BEAM, POLES, WAY, sheet, spec

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
RATES = [(5.0, 4000), (10.0, 2000), (20.0, 1000)]


def sent(fields: dict[str, Any], clouds: list[PointCloud]) -> list[bytes]:
    """Return the payloads that a fresh device makes of clouds."""
    device = HesaiXt32(spec(**fields))
    return [one.payload for cloud in clouds for one in device.datagrams(cloud, rooms.EPOCH_NANOS)]


def stamp_nanos(packet: bytes) -> int:
    year, *rest, micros = struct.unpack_from("<6BI", packet, 1065)
    second = datetime(1900 + year, *rest, tzinfo=UTC) - EPOCH  # type: ignore[arg-type]
    return (second + timedelta(microseconds=micros)) // timedelta(microseconds=1) * 1000


@pytest.mark.parametrize(("rate_hz", "firings"), RATES)
def test_others_decode_the_points_of_the_clouds(
    rate_hz: float, firings: int, tmp_path: Path
) -> None:
    """As close as the form can tell: the sheet's distances are multiples of 4 mm."""
    decoders = pytest.importorskip("hydra4.decoders")
    turn = {"rotation_rate_hz": rate_hz, "firings_per_revolution": firings}
    fields = sheet("xt32", **turn)
    (cloud,) = rooms.clouds(rooms.scenario(solids=POLES, **fields), WAY, round(400 / rate_hz) + 1)
    payloads = sent(fields, [cloud])
    assert len(payloads) == firings // 8
    file = tmp_path / "angles.csv"
    file.write_text(HesaiXt32(spec(**fields)).calibration, encoding="utf-8")
    decode = decoders.PandarXT32(file, 0.0, 300.0)

    ours = cloud.records()
    firing = np.rint((ours["time"] - 1.512e-6 * (31 - ours["ring"])) / 50e-6)
    for number in range(0, len(payloads), 29):
        packet = type("Packet", (), {"data": payloads[number]})
        theirs = np.array([point for block in decode(packet) for point in block.points])
        expected = ours[firing // 8 == number]
        assert len(theirs) == len(expected) > 100
        np.testing.assert_array_equal(31 - theirs[:, 4], expected["ring"])
        np.testing.assert_array_equal(theirs[:, 3], np.rint(expected["intensity"]))
        for axis, coordinate in enumerate("xyz"):
            assert np.abs(theirs[:, axis] - expected[coordinate]).max() < 1e-5
    # Of the last firing the first channel measures 6 us after the packet's stamp.
    first_nanos = [stamp_nanos(packet) - 344_000 - rooms.EPOCH_NANOS for packet in payloads]
    assert first_nanos == [400_000 * number for number in range(len(payloads))]
    assert {struct.unpack_from("<H", packet, 1063)[0] for packet in payloads} == {60 * rate_hz}


def test_two_returns_have_two_blocks() -> None:
    fields = sheet("xt32", returns="dual", block_deg=18.0, **BEAM)
    clouds = rooms.clouds(rooms.scenario(solids=POLES, **fields), WAY, 41)
    payloads = sent(fields, clouds)
    assert len(payloads) == 500
    numbers = [struct.unpack_from("<I", packet, 1076)[0] for packet in payloads]
    assert numbers == list(range(500))
    first_nanos = [stamp_nanos(packet) - 144_000 - rooms.EPOCH_NANOS for packet in payloads]
    assert first_nanos == [200_000 * number for number in numbers]
    unit = np.dtype([("distance", "<u2"), ("reflectivity", "u1"), ("", "u1")])
    block = np.dtype([("azimuth", "<u2"), ("units", unit, 32)])
    blocks = np.concatenate([np.frombuffer(packet, block, 8, 12) for packet in payloads])
    hundredths = np.repeat(np.arange(2000) * 18, 2)
    np.testing.assert_array_equal(blocks["azimuth"], hundredths)
    near, far = blocks["units"]["distance"].astype(int).reshape(2000, 2, 32).swapaxes(0, 1)
    assert np.all((near > 0) == (far > 0))
    assert np.all(near <= far)
    points = np.concatenate([cloud.records() for cloud in clouds])
    assert np.count_nonzero(near) + np.count_nonzero(far > near) == len(points)
    assert np.count_nonzero(far > near) > 100


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"elevations_deg": [0.0] * 16, "laser_times_us": []}, "are not 32"),
        ({"laser_times_us": [1.512 * i for i in range(32)]}, "from the highest down"),
        ({"rotation_rate_hz": 8.0, "firings_per_revolution": 2500}, "not 5, 10 or 20"),
        ({"firings_per_revolution": 1808}, "a firing takes 55.310 us, not 50"),
        ({"start_deg": 0.0}, "from 90 degrees on"),
        ({"vertical_offsets_m": [0.01] * 32}, "`vertical_offsets_m`"),
        ({"azimuth_resolution_deg": 0.01}, "`azimuth_resolution_deg`"),
        ({"max_range_m": 300.0}, "above 262.14"),
    ],
)
def test_specs_without_xt32_packets_are_refused(changed: dict[str, Any], reason: str) -> None:
    with pytest.raises(UserError, match="not a PandarXT-32") as refused:
        HesaiXt32(spec(**sheet("xt32") | changed))
    assert reason in str(refused.value)
    assert "xt32.yaml" in str(refused.value)
