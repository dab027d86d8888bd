# SPDX-License-Identifier: Apache-2.0
"""Packets decode to the firings that were put in."""

import struct

import numpy as np
import pytest

from groundlink.core.errors import UserError
from groundlink.fitting.packets import of_packets

from . import rooms


def velodyne(
    product: int, ranges: np.ndarray, lights: np.ndarray, *, dual: bool = False
) -> list[bytes]:
    """Return packets of firings, shape (firings, lasers); `ranges` in units of the device."""
    lasers = ranges.shape[1]
    rows = []
    for firing, (row, light) in enumerate(zip(ranges, lights, strict=True)):
        for part in range(max(1, lasers // 32)):
            of_part = slice(32 * part, min(32 * part + 32, lasers))
            cells = b"".join(map(_cell, row[of_part], light[of_part]))
            rows.append((firing, part, cells))
    if lasers == 16:
        rows = [(a[0], 0, a[2] + b[2]) for a, b in zip(rows[::2], rows[1::2], strict=True)]
    blocks = []
    for firing, part, cells in rows:
        azimuth = round(firing * 20) % 36000
        flag = (0xFFEE, 0xFFDD, 0xFFCC, 0xFFBB)[part]
        block = struct.pack(">H", flag) + struct.pack("<H", azimuth) + cells
        blocks += [_other(block), block] if dual else [block]
    packets = [b"".join(blocks[at : at + 12]) for at in range(0, len(blocks) - 11, 12)]
    mode = 0x39 if dual else 0x37
    return [packet + struct.pack("<IBB", 0, mode, product) for packet in packets]


def _cell(distance: int, light: int) -> bytes:
    return struct.pack("<HB", int(distance), int(light))


def _other(block: bytes) -> bytes:
    """Return the block of the last returns: farther ones."""
    cells = np.frombuffer(block[4:], np.uint8).reshape(-1, 3).copy()
    cells[:, 1] += 1
    return block[:4] + cells.tobytes()


def random(lasers: int, firings: int = 96) -> tuple[np.ndarray, np.ndarray]:
    source = np.random.default_rng(lasers)
    return source.integers(0, 9999, (firings, lasers)), source.integers(0, 255, (firings, lasers))


@pytest.mark.parametrize(
    ("product", "lasers", "unit_m", "dual"),
    [
        (0x22, 16, 0.002, False),
        (0x22, 16, 0.002, True),
        (0x28, 32, 0.004, False),
        (0x28, 32, 0.004, True),
        (0xA1, 128, 0.004, False),
    ],
)
def test_velodynes(product: int, lasers: int, unit_m: float, dual: bool) -> None:
    ranges, lights = random(lasers)
    firings = of_packets(velodyne(product, ranges, lights, dual=dual), "test")
    np.testing.assert_allclose(firings.range_m, ranges * unit_m)
    np.testing.assert_array_equal(firings.intensity, lights)
    assert firings.step_rad == pytest.approx(np.radians(0.2))


def test_missing_packets_leave_a_gap() -> None:
    ranges, lights = random(32)
    packets = velodyne(0x28, ranges, lights)
    firings = of_packets(packets[:2] + packets[4:], "test")
    assert len(firings.range_m) == 96 - 24 + 8
    assert not firings.range_m[24:32].any()
    np.testing.assert_allclose(firings.range_m[32:], ranges[48:] * 0.004)


HESAI = {
    "Pandar40P": (b"", 40, 10, b"\xff\xee", 3),
    "Pandar64": (b"\xee\xff\x40\x06\x00\x04\x00\x00", 64, 6, b"", 3),
    "XT32": (b"\xee\xff\x06\x01\x00\x00\x20\x08\x01\x04\x01\x00", 32, 8, b"", 4),
    "QT64": (b"\xee\xff\x03\x01\x00\x00\x40\x04\x01\x04\x01\x00", 64, 4, b"", 4),
}


@pytest.mark.parametrize("name", HESAI)
def test_hesais(name: str) -> None:
    header, lasers, blocks, sync, cell = HESAI[name]
    ranges, lights = random(lasers, 12 * blocks)
    packets = []
    for first in range(0, len(ranges), blocks):
        body = header
        for firing in range(first, first + blocks):
            body += sync + struct.pack("<H", firing * 20)
            for distance, light in zip(ranges[firing], lights[firing], strict=True):
                body += _cell(distance, light) + bytes(cell - 3)
        packets.append(body + bytes(22))
    firings = of_packets(packets, "test")
    np.testing.assert_allclose(firings.range_m, ranges * 0.004)
    np.testing.assert_array_equal(firings.intensity, lights)


@pytest.mark.parametrize("packets", [[], [b"none"], [bytes(1206)]])
def test_packets_of_no_known_device_are_refused(packets: list[bytes]) -> None:
    with pytest.raises(
        UserError, match=r"test: packets of .* are of no known device; expected a VLP"
    ):
        of_packets(packets, "test")


def test_a_room_in_packets_is_that_room() -> None:
    room = rooms.measured(0.005, 0.01)
    ranges = np.rint(room.range_m[:1800] / 0.002)
    firings = of_packets(velodyne(0x22, ranges, room.intensity[:1800]), "test")
    np.testing.assert_allclose(firings.range_m, ranges * 0.002)
    assert firings.step_rad == pytest.approx(room.step_rad)
