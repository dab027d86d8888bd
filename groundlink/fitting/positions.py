# SPDX-License-Identifier: Apache-2.0
"""Positions of a satellite receiver at rest out of recordings: NavSatFix, NMEA 0183, UBX.

A log of NMEA or UBX is searched for GGA sentences and NAV-PVT messages, whatever else it holds.
Messages of other types, such as nmea_msgs/Sentence, are searched for GGA sentences too.
"""

import math
import re
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import reduce
from operator import xor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.ros.types import nanos

from .messages import MESSAGES, UNREADABLE, BagMessage, found_file, one_topic
from .series import Series, of_samples

FIX = "sensor_msgs/msg/NavSatFix"
LOGS = (".nmea", ".log", ".txt", ".ubx")

GGA_SOLUTIONS = {1: "single_point", 2: "sbas", 4: "rtk_fix", 5: "rtk_float"}
"""Type of solution by the quality in GGA (NMEA 0183)."""

FIX_SOLUTIONS = {0: "single_point", 1: "sbas", 2: "rtk_fix"}
"""Type of solution by the status in NavSatFix, which does not tell RTK with fixed ambiguities from
floating ones."""

_GGA = re.compile(rb"\$(G[A-Z]GGA,[0-9A-Za-z.,+-]*)\*([0-9A-Fa-f]{2})")
_PVT = b"\xb5\x62\x01\x07" + struct.pack("<H", 92)
_DAY_S = 86400
_WEEK_S = 7 * _DAY_S

EQUATOR_M = 6378137.0
ECCENTRICITY_SQUARED = 6.69437999014e-3
"""WGS 84 (NGA.STND.0036)."""


class Fix(NamedTuple):
    """A position with its time."""

    time_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    solution: str
    """Type of solution, as in a scenario."""


class Positions(NamedTuple):
    """Positions of a receiver at rest."""

    series: Series
    """East, north and up in meters, from any origin."""

    solution: str
    """Type of solution of all of them."""

    left_out: int
    """Fixes of other types."""


def read_positions(path: Path, topic: str | None = None) -> Positions:
    """Return the positions of a recording, of the most frequent type of solution.

    Parameters
    ----------
    path : Path
        A bag or an MCAP file with sensor_msgs/NavSatFix or with messages that hold GGA sentences;
        or a log of NMEA or UBX.
    topic : str or None
        Needed where a bag has several such topics.

    Raises
    ------
    UserError
        when there are none, or too few, or nothing says which.
    """
    path = found_file(path)
    try:
        if path.suffix in MESSAGES:
            fixes = list(_of_messages(path, topic))
        elif path.suffix in LOGS:
            data = path.read_bytes()
            fixes = list(_of_ubx(data)) or list(_of_nmea(data))
        else:
            raise UserError(
                f"{path}: expected a .bag, .db3 or .mcap file, the folder of a bag, or a log: "
                f"{', '.join(LOGS)}"
            )
    except UNREADABLE as error:
        raise UserError(f"{path}: cannot be read: {error}") from None
    if not fixes:
        raise UserError(f"{path}: no fixes; expected NavSatFix, GGA sentences or NAV-PVT")
    solution, count = Counter(fix.solution for fix in fixes).most_common(1)[0]
    kept = np.array([fix[:4] for fix in fixes if fix.solution == solution])
    latitude, longitude = np.radians(kept[:, 1:3]).T
    # Radii of curvature along the meridian and across it, at the first position.
    root = math.sqrt(1 - ECCENTRICITY_SQUARED * math.sin(latitude[0]) ** 2)
    across = EQUATOR_M / root
    along = across * (1 - ECCENTRICITY_SQUARED) / root**2
    enu = np.stack(
        [
            (longitude - longitude[0]) * across * math.cos(latitude[0]),
            (latitude - latitude[0]) * along,
            kept[:, 3] - kept[0, 3],
        ],
        axis=1,
    )
    return Positions(of_samples(kept[:, 0], enu, str(path)), solution, len(fixes) - count)


def _of_messages(path: Path, topic: str | None) -> Iterator[Fix]:
    def is_wanted(message: BagMessage) -> bool:
        return message.ros_type == FIX or _GGA.search(message.data) is not None

    known = one_topic(path, is_wanted, topic, "NavSatFix or GGA sentences")
    if known[0].ros_type != FIX:
        yield from _of_nmea(b"".join(message.data for message in known))
        return
    begin = None
    for message in known:
        fix = message.content()
        stamp = nanos(fix.header.stamp)
        begin = stamp if begin is None else begin
        if fix.status.status in FIX_SOLUTIONS:
            solution = FIX_SOLUTIONS[fix.status.status]
            # The differences of integers are exact; stamps in seconds as floats are not.
            seconds = (stamp - begin) / NANOS
            yield Fix(seconds, fix.latitude, fix.longitude, fix.altitude, solution)


def _of_nmea(data: bytes) -> Iterator[Fix]:
    """Yield the fixes of the GGA sentences with a right checksum."""

    def found() -> Iterator[Fix]:
        for sentence, digits in _GGA.findall(data):
            fields = sentence.decode().split(",")
            if reduce(xor, sentence) != int(digits, 16) or len(fields) < 10:
                continue
            solution = GGA_SOLUTIONS.get(int(fields[6] or 0))
            if solution is None or not all(fields[i] for i in (1, 2, 4, 9)):
                continue
            clock = fields[1]
            yield Fix(
                int(clock[:2]) * 3600 + int(clock[2:4]) * 60 + float(clock[4:]),
                _degrees(fields[2], fields[3] == "S"),
                _degrees(fields[4], fields[5] == "W"),
                float(fields[9]),
                solution,
            )

    return _unwrapped(found(), _DAY_S)


def _degrees(text: str, is_negative: bool) -> float:
    """Return degrees out of degrees and minutes, (d)ddmm.mmmm."""
    dot = text.index(".")
    degrees = int(text[: dot - 2]) + float(text[dot - 2 :]) / 60
    return -degrees if is_negative else degrees


def _of_ubx(data: bytes) -> Iterator[Fix]:
    """Yield the fixes of NAV-PVT (u-blox F9 interface description, UBX-NAV-PVT)."""

    def found() -> Iterator[Fix]:
        at = data.find(_PVT)
        while 0 <= at <= len(data) - 100:
            body = data[at + 6 : at + 98]
            sums = 0, 0
            for byte in data[at + 2 : at + 98]:
                first = (sums[0] + byte) & 255
                sums = first, (sums[1] + first) & 255
            fix_type, flags = body[20], body[21]
            if sums == (data[at + 98], data[at + 99]) and flags & 1 and fix_type in (2, 3, 4):
                time_ms = struct.unpack_from("<I", body)[0]
                longitude, latitude, height = struct.unpack_from("<iii", body, 24)
                carrier = flags >> 6
                solution = ("sbas" if flags & 2 else "single_point", "rtk_float", "rtk_fix")
                yield Fix(
                    *(time_ms / 1e3, latitude * 1e-7, longitude * 1e-7, height / 1e3),
                    solution[carrier],
                )
            at = data.find(_PVT, at + 1)

    return _unwrapped(found(), _WEEK_S)


def _unwrapped(fixes: Iterable[Fix], period_s: float) -> Iterator[Fix]:
    """Yield fixes with times that go on where the receiver's begin anew."""
    last, turns = -math.inf, 0
    for fix in fixes:
        turns += fix.time_s < last - period_s / 2
        last = fix.time_s
        yield fix._replace(time_s=fix.time_s + turns * period_s)
