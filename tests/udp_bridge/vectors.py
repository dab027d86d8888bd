# SPDX-License-Identifier: Apache-2.0
"""The recorded vectors, as the tests of this folder use them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from udp_bridge.wire.capture import datagrams

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
IN_ORDER = (
    "camera-info",
    "clock-shortest-header",
    "cloud-255-parts",
    "cloud-in-order",
    "compressed-image",
    "encoders",
    "image",
    "imu",
    "joint-state",
    "laser-scan",
    "longest-names",
    "map",
    "nav-sat-fix",
    "odometry",
    "path",
    "pose",
    "range",
    "subscribe",
    "text",
    "transforms",
    "twist",
    "twist-stamped",
)
