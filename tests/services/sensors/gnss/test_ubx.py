# SPDX-License-Identifier: Apache-2.0
"""UBX: known bytes and times, and what pyubx2 reads of a receiver's fixes."""

from datetime import UTC, datetime
from typing import Any, get_args

import numpy as np
import pytest
from msgspec.structs import replace

from services.sensors.gnss import ubx
from services.sensors.gnss.model import GnssModel
from services.sensors.gnss.native import FORMATS, native_device
from services.sensors.gnss.reception import Path
from services.sensors.gnss.spec import Gnss, Multipath
from services.sensors.runtime.model import ModelDevice
from services.sensors.runtime.nmea import Epoch
from tests.services.sensors.gnss.test_fix_state import LADDER
from tests.services.sensors.gnss.test_model import UP, fixes, receiver
from tests.services.sensors.sheets import from_sheet
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import box, resting, yard


def nanos(*date: int) -> int:
    return int(datetime(*date, tzinfo=UTC).timestamp()) * 10**9  # type: ignore[misc, arg-type]


MOTION = ubx.Motion(-0.5, (0.003, 0.004, 0.0102), 0.042)
WEST = Epoch(
    *(
        nanos(2024, 3, 9, 12, 0, 1) + 200_000_000,
        4,
        "R",
        7,
        -33.8523456789,
        -151.2107654321,
        58.1234,
    ),
    **{"geoid_m": 22.5, "east_mps": -3.0, "north_mps": 4.0, "satellites": 14},
)


def read(message: bytes) -> Any:
    """Return a message as pyubx2 reads it, with its checksum and length validated."""
    pyubx2 = pytest.importorskip("pyubx2")
    parsed = pyubx2.UBXReader.parse(message, validate=pyubx2.VALCKSUM)
    assert parsed.serialize() == message
    return parsed


def test_frames_are_those_of_the_document() -> None:
    assert ubx.frame(ubx.PVT, b"") == bytes.fromhex("b562010700000819")
    message = ubx.nav_dop(WEST, None)
    time = (561_619_200).to_bytes(4, "little")
    assert message[:-2] == bytes.fromhex("b56201041200") + time + bytes.fromhex("0f27" * 7)
    assert read(message).gDOP == 99.99


@pytest.mark.parametrize(
    ("stamp_nanos", "itow_ms"),
    [
        # A Saturday is the seventh day of the GPS week, which begins 18 s before Sunday in UTC.
        (nanos(2024, 3, 9, 12, 0, 1) + 200_000_000, ((6 * 24 + 12) * 3600 + 19) * 1000 + 200),
        (nanos(2024, 3, 9, 23, 59, 41) + 999_499_999, 604_799_999),
        (nanos(2024, 3, 9, 23, 59, 41) + 999_500_000, 0),
        (nanos(2024, 3, 9, 23, 59, 42), 0),
        (nanos(2024, 3, 10, 0, 0, 0), 18_000),
        (0, ((4 * 24) * 3600 + 18) * 1000),  # 1970-01-01 was a Thursday.
    ],
)
def test_time_of_week(stamp_nanos: int, itow_ms: int) -> None:
    assert ubx.itow_ms(stamp_nanos) == itow_ms


def test_pyubx2_reads_position_velocity_and_time() -> None:
    model = receiver()
    (fix,) = fixes(model, resting(1))
    solved = model.details(fix).solved
    assert solved is not None
    geometry = solved.geometry
    pvt = read(ubx.nav_pvt(WEST, geometry, MOTION))
    assert (pvt.identity, pvt.length, pvt.iTOW) == ("NAV-PVT", 92, 561_619_200)
    assert (pvt.year, pvt.month, pvt.day, pvt.hour, pvt.min, pvt.second, pvt.nano) == (
        *(2024, 3, 9, 12, 0, 1),
        200_000_000,
    )
    assert (pvt.validDate, pvt.validTime, pvt.fullyResolved, pvt.validMag) == (1, 1, 1, 0)
    assert (pvt.fixType, pvt.gnssFixOk, pvt.diffSoln, pvt.carrSoln) == (3, 1, 1, 2)
    assert (pvt.numSV, pvt.lat, pvt.lon) == (14, -33.8523457, -151.2107654)
    assert (pvt.height, pvt.hMSL, pvt.hAcc, pvt.vAcc) == (58_123, 35_623, 5, 10)
    assert (pvt.velN, pvt.velE, pvt.velD, pvt.gSpeed) == (4000, -3000, 500, 5000)
    assert pvt.headMot == pytest.approx(360 - 36.8699, abs=1e-4)
    assert (pvt.sAcc, pvt.headAcc) == (42, pytest.approx(0.48127))
    assert (pvt.invalidLlh, pvt.lastCorrectionAge) == (0, 1)
    dop = read(ubx.nav_dop(WEST, geometry))
    assert (dop.identity, dop.iTOW) == ("NAV-DOP", pvt.iTOW)
    assert dop.pDOP == pvt.pDOP == pytest.approx(np.hypot(dop.hDOP, dop.vDOP), abs=0.011)
    assert dop.gDOP == pytest.approx(np.hypot(dop.pDOP, dop.tDOP), abs=0.011)
    assert dop.hDOP == pytest.approx(np.hypot(dop.nDOP, dop.eDOP), abs=0.011)
    assert dop.eDOP == pytest.approx(geometry.dilution_enu[0], abs=0.005)
    fine = read(ubx.nav_hpposllh(WEST, MOTION))
    assert (fine.identity, fine.iTOW, fine.invalidLlh) == ("NAV-HPPOSLLH", pvt.iTOW, 0)
    # pyubx2 adds the parts of high precision.
    assert fine.lat == pytest.approx(-33.852345679, abs=1e-10)
    assert fine.lon == pytest.approx(-151.210765432, abs=1e-10)
    assert (fine.height, fine.hMSL) == (pytest.approx(58_123.4), pytest.approx(35_623.4))
    assert (fine.hAcc, fine.vAcc) == (pytest.approx(5.0), pytest.approx(10.2))


def test_every_format_has_a_device() -> None:
    assert set(get_args(Gnss.__annotations__["native_format"])) == FORMATS.keys()


def test_messages_follow_solution_satellites_and_faults() -> None:
    """Beside a wall, from no fix to fixed ambiguities; then fixes that a fault changed."""
    made = yard(box("wall", (60, 0.2, 30), (0, 5.1, 14)))
    spec = from_sheet(
        *(Gnss, "gnss_zed_f9p"),
        **{"mount": UP, "startup_s": 0.0, "rate_hz": 1.0, "latency_jitter_s": 0.0},
        **{"solutions": LADDER, "multipath": Multipath(amplitude=0.4)},
    )
    model = GnssModel(made, made.vehicles[0], spec)
    device = native_device(model, spec)
    seen = []
    for fix in fixes(model, resting(400 * 8, velocities=(0.0, 1.0, 0.25, 0.0, 0.0, 0.0))):
        datagrams = [datagram.payload for datagram in device.datagrams(fix, EPOCH_NANOS)]
        dop, pvt, fine, sat = map(read, datagrams)
        assert dop.iTOW == pvt.iTOW == fine.iTOW == sat.iTOW == ubx.itow_ms(fix.stamp_nanos)
        seen.append((fix.status, pvt.fixType, pvt.gnssFixOk, pvt.diffSoln, pvt.carrSoln))
        details = model.details(fix)
        above = details.signals.towards[2] > 0
        assert sat.numSvs == np.count_nonzero(above)
        ids = [(sat_field(sat, "gnssId", i), sat_field(sat, "svId", i)) for i in range(sat.numSvs)]
        assert len(set(ids)) == len(ids)
        assert {gnss for gnss, _ in ids} == {0, 2, 3, 6}
        used = [sat_field(sat, "svUsed", i) for i in range(sat.numSvs)]
        assert sum(used) == pvt.numSV == details.epoch.satellites
        strengths = np.array([sat_field(sat, "cno", i) for i in range(sat.numSvs)])
        received = details.signals.path[above] != Path.NONE
        assert ((strengths > 0) == received).all()
        assert 25 < strengths[received].min() < strengths.max() < 55
        east, north, up = details.signals.towards[:, above]
        azimuth = np.degrees(np.arctan2(east, north))
        for i in range(sat.numSvs):
            turn = sat_field(sat, "azim", i) - azimuth[i]
            assert abs((turn + 180) % 360 - 180) <= 0.5
            assert abs(sat_field(sat, "elev", i) - np.degrees(np.arcsin(up[i]))) <= 0.5
        residuals = [sat_field(sat, "prRes", i) for i in range(sat.numSvs)]
        assert any(residuals)
        if fix.status < 0:
            assert (pvt.numSV, pvt.invalidLlh, fine.invalidLlh) == (0, 1, 1)
            assert (pvt.hAcc, dop.gDOP) == (2**32 - 1, 99.99)
        else:
            assert fine.lat == pytest.approx(fix.latitude_deg, abs=1e-9)
            assert pvt.lon == pytest.approx(fix.longitude_deg, abs=1e-7)
            assert pvt.height == pytest.approx(fix.altitude_m * 1e3, abs=1)
            assert (pvt.velN, pvt.velD) == (
                pytest.approx(1000, abs=300),
                pytest.approx(-250, abs=300),
            )
    assert seen == [
        (-1, 0, 0, 0, 0),
        *((0, 3, 1, 0, 0),) * 2,
        (1, 3, 1, 1, 0),
        *((2, 3, 1, 1, 1),) * 2,
        *((2, 3, 1, 1, 2),) * 2,
    ]
    moved = replace(fix, latitude_deg=fix.latitude_deg + 0.5)
    _, pvt, _, _ = (read(datagram.payload) for datagram in device.datagrams(moved, 0))
    assert pvt.lat == pytest.approx(fix.latitude_deg + 0.5, abs=1e-7)
    _, pvt, _, sat = (
        read(each.payload) for each in device.datagrams(replace(fix, status=-1), EPOCH_NANOS)
    )
    assert (pvt.fixType, pvt.gnssFixOk, pvt.numSV) == (0, 0, 0)
    assert not any(sat_field(sat, "svUsed", i) for i in range(sat.numSvs))


def sat_field(sat: Any, name: str, index: int) -> Any:
    """Return a field of the satellite with this index in NAV-SAT."""
    return getattr(sat, f"{name}_{index + 1:02d}")


@pytest.mark.parametrize("native_format", FORMATS)
def test_devices_follow_the_model_of_a_changed_world(native_format: str) -> None:
    spec = from_sheet(
        *(Gnss, "gnss_zed_f9p"),
        **{"native_format": native_format, "startup_s": 0.0, "solutions": LADDER[:1]},
        mount=UP,
    )
    one, other = (GnssModel(yard(), yard().vehicles[0], spec) for _ in range(2))
    device = native_device(one, spec)
    assert isinstance(device, ModelDevice)
    *_, fix = fixes(one, resting(800))
    whole = device.datagrams(fix, EPOCH_NANOS)
    device.follow(other)
    # A fix of the model before, such as one that a fault delayed: no details are known.
    assert device.datagrams(fix, EPOCH_NANOS) != whole
    fixes(other, resting(800))
    assert device.datagrams(fix, EPOCH_NANOS) == whole
