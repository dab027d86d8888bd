# SPDX-License-Identifier: Apache-2.0
"""Assets over the bus: the process that serves a scenario serves its assets; others fetch them.

An asset travels in parts of 1 MiB, one query each, the last part shorter, so a large asset does not
block other answers. An asset is stored under the digest of its received content. If that is not the
requested digest, joining the run fails.
"""

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

MAX_PARTS = 4096
"""Limit of 4 GiB against a server that never ends."""

ANSWER_SECONDS = 10.0


def needed(described: msgspec.Struct) -> list[str]:
    """Return the digests of all assets that a resolved scenario, or part of one, names."""
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
    """Serve the assets of a scenario, and no others, from the local store.

    `scenario` is called for each query because the scenario of a run may change.
    """

    def part(parameters: str) -> list[bytes]:
        digest, _, number = parameters.partition("/")
        if digest not in needed(scenario()) or not number.isdecimal():
            return []
        start = int(number) * PART_BYTES
        try:
            with (assets.folder() / digest).open("rb") as file:
                file.seek(start)
                return [file.read(PART_BYTES)]
        except OSError:
            return []

    bus.serve(asset_key(run), part)


def fetch(bus: Bus, run: str, scenario: Scenario) -> None:
    """Fetch the assets of a scenario that the local store lacks.

    Raises
    ------
    UserError
        if an asset is not served, or its content does not match its digest.
    """
    for digest in assets.missing(needed(scenario)):
        content = b"".join(_parts(bus, run, digest))
        if (arrived := assets.put(content)) != digest:
            raise UserError(
                f"run `{run}`: asset {digest[:12]}: content has digest {arrived[:12]}. Fix: delete "
                "the asset store on the host that serves the run, and start the run again"
            )


def _parts(bus: Bus, run: str, digest: str) -> Iterator[bytes]:
    for number in range(MAX_PARTS):
        replies = bus.query(asset_key(run), f"{digest}/{number}", seconds=ANSWER_SECONDS)
        if not replies:
            raise UserError(
                f"run `{run}`: asset {digest[:12]}: not served. Fix: check the asset store on the "
                "host that serves the run"
            )
        part = next(iter(replies.values()))
        yield part
        if len(part) < PART_BYTES:
            return
    raise UserError(f"run `{run}`: asset {digest[:12]}: larger than the limit of 4 GiB")
