# SPDX-License-Identifier: Apache-2.0
"""The recorded vectors, as the tests of this folder use them."""

import json
from pathlib import Path
from typing import Any, NamedTuple

from udp_bridge.wire.capture import datagrams
from udp_bridge.wire.header import Refused
from udp_bridge.wire.typed import pack_typed, parse_typed

FOLDER = Path(__file__).parents[1] / "vectors"


class Vector(NamedTuple):
    """Datagrams and what they mean."""

    name: str
    datagrams: list[bytes]
    meaning: dict[str, Any]


def load(name: str) -> Vector:
    with open(FOLDER / f"{name}.bin", "rb") as file:
        return Vector(
            name, list(datagrams(file)), json.loads((FOLDER / f"{name}.json").read_text())
        )


NAMES = sorted(path.stem for path in FOLDER.glob("*.bin"))
VECTORS = [load(name) for name in NAMES]
TYPED_BODIES = [
    pack_typed(name, b"cdr") for name in ("a/msg/B", "a_1/msg/Bc", "sensor_msgs/msg/MagneticField")
] + [
    *(b"", b"\0", b"\x07a/msg/", b"\x08a/msg/Bc", b"\x07a/srv/B", b"\x07A/msg/B", b"\x07a/msg/b"),
    *(
        b"\x07a/msg/\xff",
        b"\x06a/msg/\0",
        b"\x06/msg/B\0",
        b"\x07a/msg/\0",
        b"\x07a-b/msg",
        b"\xff" * 300,
    ),
]
"""Bodies of Typed messages, valid and not."""
OUT_OF_ORDER = (
    "cloud-duplicated",
    "cloud-one-part-lost",
    "cloud-shuffled",
    "malformed",
    "parts-disagree",
    "two-interleaved",
)
IN_ORDER = tuple(name for name in NAMES if name not in OUT_OF_ORDER)
"""Vectors of one message whose parts come as they were sent."""


def typed_as(body: bytes) -> str:
    """Return what the library reads in a Typed body: type and offset, or why it is refused."""
    try:
        return "{} {}".format(*parse_typed(body))
    except Refused as refused:
        return refused.reason
