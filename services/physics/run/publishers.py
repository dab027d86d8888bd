# SPDX-License-Identifier: Apache-2.0
"""Where physics publishes, and where an episode that is only restored does not.

Rule: derived from the table of topics and a scenario's vehicles; what is declared stays declared.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import NamedTuple

from groundlink.bus.core_topics import CLOCK, STATE, BusTopic
from groundlink.bus.session import Bus
from groundlink.bus.topics import BODIES, GROUND_TRUTH, JOINTS, TRUE_WHEELS, VITALS
from groundlink.messages.base import Message, encode
from groundlink.scenario import Scenario

Publish = Callable[[Message], bytes]


class Publishers(NamedTuple):
    """Where physics publishes: for the run, and for each vehicle by name."""

    state: Publish
    clock: Publish
    bodies: Publish
    truth: dict[str, Publish]
    wheels: dict[str, Publish]
    joints: dict[str, Publish]
    vitals: dict[str, Publish]


def declare_publishers(
    bus: Bus, run: str, scenario: Scenario, known: Publishers | None = None
) -> Publishers:
    """Declare all that physics publishes, but what is declared already."""

    def each(row: BusTopic, there: dict[str, Publish]) -> dict[str, Publish]:
        names = (vehicle.name for vehicle in scenario.vehicles)
        return {
            name: there.get(name) or bus.publisher(row.key_in(run, vehicle=name), row.delivery)
            for name in names
        }

    if known is None:
        state, clock, bodies = (
            bus.publisher(row.key_in(run), row.delivery) for row in (STATE, CLOCK, BODIES)
        )
        known = Publishers(state, clock, bodies, {}, {}, {}, {})
    return known._replace(
        truth=each(GROUND_TRUTH, known.truth),
        wheels=each(TRUE_WHEELS, known.wheels),
        joints=each(JOINTS, known.joints),
        vitals=each(VITALS, known.vitals),
    )


def silent_publishers() -> Publishers:
    """Return outlets that publish nothing, and states that are encoded for the history alone."""

    def none(message: Message) -> bytes:
        return b""

    nowhere: defaultdict[str, Publish] = defaultdict(lambda: none)
    return Publishers(encode, none, none, nowhere, nowhere, nowhere, nowhere)
