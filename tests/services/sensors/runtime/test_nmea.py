# SPDX-License-Identifier: Apache-2.0
"""NMEA 0183: known sentences, rounding, and what pynmea2 reads."""

import re
from datetime import UTC, datetime
from functools import reduce

import numpy as np
import pytest

from services.sensors.runtime import nmea
from services.sensors.runtime.nmea import Epoch

NOON_NANOS = int(datetime(2024, 3, 9, 12, 0, 1, tzinfo=UTC).timestamp()) * 10**9 + 200_000_000

FIX = Epoch(
    *(NOON_NANOS, 4, "R", 7, 52.25, -20.9, 141.5, 31.0),
    east_mps=3.0,
    north_mps=-4.0,
    satellites=9,
    horizontal_dilution=0.876,
)


def test_sentences_are_these() -> None:
    assert [line.decode() for line in nmea.sentences(FIX)] == [
        "$GPGGA,120001.20,5215.0000000,N,02054.0000000,W,4,09,0.88,110.500,M,31.000,M,,*45\r\n",
        "$GPRMC,120001.20,A,5215.0000000,N,02054.0000000,W,9.719,143.13,090324,,,R*61\r\n",
        "$GPVTG,143.13,T,,M,9.719,N,18.000,K,R*15\r\n",
    ]


def test_the_checksum_is_that_of_the_common_example() -> None:
    fields = "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,".split(",")
    assert nmea.sentence(*fields).endswith(b"*47\r\n")


@pytest.mark.parametrize(
    ("latitude_deg", "decimals", "expected"),
    [
        (59.99999999999, 5, ("6000.00000", "N")),
        (-0.5, 5, ("0030.00000", "S")),
        (0.0, 2, ("0000.00", "N")),
        (7.1, 7, ("0706.0000000", "N")),
        (89 + 59.999994 / 60, 5, ("8959.99999", "N")),
        (89 + 59.999996 / 60, 5, ("9000.00000", "N")),
    ],
)
def test_minutes_never_reach_sixty(
    latitude_deg: float, decimals: int, expected: tuple[str, str]
) -> None:
    line = nmea.gga(FIX._replace(latitude_deg=latitude_deg, minute_decimals=decimals)).decode()
    assert tuple(line.split(",")[2:4]) == expected


@pytest.mark.parametrize(
    ("east", "north", "course"),
    [
        *((0.0, 1.0, "0.00"), (1.0, 0.0, "90.00"), (-1.0, 0.0, "270.00")),
        *((-1e-9, 1.0, "0.00"), (0.0, 0.01, "")),
    ],
)
def test_course_is_clockwise_from_north_and_none_at_rest(
    east: float, north: float, course: str
) -> None:
    moving = FIX._replace(east_mps=east, north_mps=north)
    assert nmea.vtg(moving).decode().split(",")[1] == course
    assert nmea.rmc(moving).decode().split(",")[8] == course


def test_hundredths_of_a_second_carry_into_the_next_day() -> None:
    late = datetime(2023, 12, 31, 23, 59, 59, tzinfo=UTC)
    at = FIX._replace(stamp_nanos=int(late.timestamp()) * 10**9 + 999_000_000)
    assert nmea.rmc(at).decode().split(",")[1] == "000000.00"
    assert nmea.rmc(at).decode().split(",")[9] == "010124"


def epochs() -> list[Epoch]:
    draws = np.random.default_rng(5).random((300, 6)).tolist()
    kinds = [(1, "A", 5), (2, "D", 5), (5, "F", 7), (4, "R", 7), (0, "N", 5)]
    return [
        Epoch(
            *(NOON_NANOS + i * 50_000_000, *kinds[i % 5], 180 * a - 90, 360 * b - 180, 3000 * c),
            *(31.0, 20 * d - 10, 20 * e - 10, int(4 + 12 * f), 0.5 + 3 * f),
        )
        for i, (a, b, c, d, e, f) in enumerate(draws)
    ]


def test_checksums_hold() -> None:
    for epoch in epochs():
        for line in nmea.sentences(epoch):
            found = re.fullmatch(rb"\$(.*)\*([0-9A-F]{2})\r\n", line)
            assert found
            assert reduce(lambda a, b: a ^ b, found[1]) == int(found[2], 16)


def test_pynmea2_reads_the_same() -> None:
    pynmea2 = pytest.importorskip("pynmea2")
    for epoch in epochs():
        gga, rmc, vtg = (pynmea2.parse(line.decode(), check=True) for line in nmea.sentences(epoch))
        assert (gga.gps_qual, rmc.mode_indicator, vtg.faa_mode) == (
            *(epoch.quality, epoch.mode, epoch.mode),
        )
        assert rmc.datetime.timestamp() == pytest.approx(epoch.stamp_nanos / 1e9, abs=0.006)
        assert gga.timestamp == rmc.timestamp
        assert rmc.status == ("A" if epoch.fixed else "V")
        assert gga.is_valid == rmc.is_valid == epoch.fixed
        if not epoch.fixed:
            assert (gga.lat, gga.altitude, rmc.lon, vtg.spd_over_grnd_kts) == ("", None, "", None)
            continue
        for parsed in (gga, rmc):
            unit = 10**-epoch.minute_decimals / 60
            assert parsed.latitude == pytest.approx(epoch.latitude_deg, abs=unit)
            assert parsed.longitude == pytest.approx(epoch.longitude_deg, abs=unit)
        assert gga.altitude == pytest.approx(epoch.altitude_m - 31.0, abs=6e-4)
        assert float(gga.geo_sep) == 31.0
        assert int(gga.num_sats) == epoch.satellites
        assert float(gga.horizontal_dil) == pytest.approx(epoch.horizontal_dilution, abs=0.006)
        speed = float(np.hypot(epoch.east_mps, epoch.north_mps))
        assert float(vtg.spd_over_grnd_kmph) == pytest.approx(3.6 * speed, abs=6e-4)
        assert float(rmc.spd_over_grnd) == pytest.approx(speed * 3600 / 1852, abs=6e-4)
        course = np.degrees(np.arctan2(epoch.east_mps, epoch.north_mps)) % 360
        assert float(rmc.true_course) == pytest.approx(float(course), abs=0.006)
        assert vtg.true_track == pytest.approx(float(rmc.true_course))
