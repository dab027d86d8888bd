# SPDX-License-Identifier: Apache-2.0
"""Assets over the bus: whoever serves a scenario serves what it names, others fetch what they lack.

Rule: an asset travels in parts of 1 MiB, each a query of its own, the last one shorter; so nobody
waits for another's large answer. What arrives is kept only under the digest of what arrived, and if
that is not what was asked for the run is not joined.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import msgspec

from groundlink.bus.queries import asset_key
from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.scenario import Scenario
from groundlink.world import assets
from groundlink.world.solids import Mesh
from groundlink.world.terrain import Terrain

PART_BYTES = 2**20

MOST_PARTS = 4096
"""Four gigabytes: whoever goes on and on is not believed."""

ANSWER_SECONDS = 10.0


def needed(described: msgspec.Struct) -> list[str]:
    """Return the digests of all assets that a resolved scenario, or a part of one, names."""
    return list(dict.fromkeys(_digests(described)))


def _digests(value: Any) -> Iterator[str]:
    match value:
        case Mesh(asset=digest):
            yield digest
        case Terrain(heights=heights, surface=surface):
            yield heights
            if surface is not None:
                yield surface
        case msgspec.Struct():
            for field in value.__struct_fields__:
                yield from _digests(getattr(value, field))
        case tuple() | list():
            for item in value:
                yield from _digests(item)
        case dict():
            for item in value.values():
                yield from _digests(item)


def serve(bus: Bus, run: str, scenario: Callable[[], Scenario]) -> None:
    """Give a scenario's assets, and no others, to those who ask, as far as the store has them.

    `scenario` is asked each time: a run's may change.
    """

    def part(asked: str) -> list[bytes]:
        digest, _, number = asked.partition("/")
        if digest not in needed(scenario()) or not number.isdecimal():
            return []
        start = int(number) * PART_BYTES
        try:
            with (assets.store() / digest).open("rb") as file:
                file.seek(start)
                return [file.read(PART_BYTES)]
        except OSError:
            return []

    bus.serve(asset_key(run), part)


def fetch(bus: Bus, run: str, scenario: Scenario) -> None:
    """Get what the store lacks of a scenario's assets.

    Raises
    ------
    UserError
        when it is not to be had, or something else came.
    """
    for digest in assets.missing(needed(scenario)):
        content = b"".join(_parts(bus, run, digest))
        if (arrived := assets.keep(content)) != digest:
            raise UserError(
                f"run `{run}` sent {arrived[:12]} for the world's data {digest[:12]}; the store of "
                "who serves the run is damaged: delete it and start the run again"
            )


def _parts(bus: Bus, run: str, digest: str) -> Iterator[bytes]:
    for number in range(MOST_PARTS):
        replies = bus.ask(asset_key(run), f"{digest}/{number}", seconds=ANSWER_SECONDS)
        if not replies:
            raise UserError(
                f"run `{run}` has a world with data {digest[:12]}, which nobody there serves; "
                "is the store of who serves the run whole?"
            )
        part = next(iter(replies.values()))
        yield part
        if len(part) < PART_BYTES:
            return
    raise UserError(f"run `{run}` sends the world's data {digest[:12]} without an end")
