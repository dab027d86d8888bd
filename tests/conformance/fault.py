# SPDX-License-Identifier: Apache-2.0
"""A fault in a recording, and the list of them all."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sensor_conformance.sources.source import Received

Alter = Callable[[list[Received]], list[Received] | None]


@dataclass(frozen=True)
class Fault:
    """A fault in the messages of a topic, and the clause that finds it."""

    name: str
    clause: str
    topic: str
    alter: Alter
    """Changes the messages, or returns others."""


FAULTS: list[Fault] = []


def fault(name: str, clause: str, topic: str) -> Callable[[Alter], Alter]:
    def add(alter: Alter) -> Alter:
        FAULTS.append(Fault(name, clause, topic, alter))
        return alter

    return add


def each(name: str, clause: str, topic: str) -> Callable[[Callable[[Any], None]], None]:
    """Add a fault that changes every message in the same way."""

    def add(change: Callable[[Any], None]) -> None:
        def alter(messages: list[Received]) -> None:
            for _, message in messages:
                change(message)

        FAULTS.append(Fault(name, clause, topic, alter))

    return add
