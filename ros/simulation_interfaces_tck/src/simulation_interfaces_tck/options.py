# SPDX-License-Identifier: Apache-2.0
"""Options of the kit, for its command and for pytest alike."""

from collections.abc import Callable
from typing import Any


def add_options(add: Callable[..., Any]) -> None:
    """Add the options by argparse's `add_argument` or pytest's `addoption`."""
    add("--namespace", default="/", help="namespace of the simulator's services (default: /)")
    add(
        "--spawnable",
        metavar="URI",
        default="",
        help="resource to spawn (default: the first that GetSpawnables lists)",
    )
    add(
        "--definition",
        metavar="FILE",
        default="",
        help="file that defines an entity in a format of the simulator's own: spawned as a "
        "resource string, and broken (default: a box in URDF, SDF or MJCF)",
    )
    add(
        "--world",
        metavar="FILE",
        default="",
        help="file of a world that the simulator can load, on its machine and on this one; loaded "
        "by its URI and as a resource string, and broken (default: the current world's)",
    )
    add(
        "--origin",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        default=(0.0, 0.0, 0.0),
        help="where to spawn, in meters in the world frame; entities are spawned from there along "
        "the x axis, at most six (default: 0 0 0)",
    )
    add(
        "--spacing",
        type=float,
        metavar="M",
        default=2.0,
        help="distance between spawned entities in meters (default: 2)",
    )
    add(
        "--tolerance",
        type=float,
        metavar="M",
        default=0.05,
        help="how far a position read may be from the one set, along x and y, in meters; the same "
        "number in radians for headings and in m/s for speeds (default: 0.05)",
    )
    add(
        "--call-timeout",
        type=float,
        metavar="SECONDS",
        default=30.0,
        help="how long a service may take to respond (default: 30)",
    )
    add(
        "--find-timeout",
        type=float,
        metavar="SECONDS",
        default=10.0,
        help="how long to wait for the simulator's services to appear (default: 10)",
    )
    add("--junit", metavar="FILE", default=None, help="write the results as JUnit XML")
