# SPDX-License-Identifier: Apache-2.0
"""Energy of a vehicle over time, and its contacts as events.

Contacts with the same object within half a second are one event. At most `MAX_EVENTS` events are
kept; further ones are counted.
"""

from dataclasses import dataclass, field

from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.ground_truth import Contact, Vitals

SAME_EVENT_SECONDS = 0.5
MAX_EVENTS = 500
MAX_POINTS = 20_000


@dataclass
class ContactEvent:
    """A contact of a vehicle with one object."""

    name: str
    begin_seconds: float
    """Sim time of the first message about it, exact to 0.1 s."""

    end_seconds: float
    force_n: float
    force_seconds: float
    """Sim time of the largest force."""

    ticks: int


@dataclass
class Energy:
    """Energy and contacts of one vehicle."""

    vehicle: str
    stride: int
    rows: list[tuple[float, float, float]] = field(default_factory=list)
    """Time (s of the run), work of the motors, work that they braked (J)."""

    events: list[ContactEvent] = field(default_factory=list)
    further_events: int = 0
    last: Vitals | None = None
    _seen: int = 0

    def add(self, seconds: float, vitals: Vitals) -> None:
        """Take the next vitals."""
        if self._seen % self.stride == 0:
            self.rows.append((seconds, vitals.motor_work_j, vitals.braked_j))
        self._seen += 1
        self.last = vitals
        for contact in vitals.contacts:
            self._touched(seconds, contact)

    def _touched(self, seconds: float, contact: Contact) -> None:
        at = contact.tick * TICK_SECONDS
        for event in reversed(self.events):
            if event.name == contact.name and seconds - event.end_seconds <= SAME_EVENT_SECONDS:
                event.end_seconds = seconds
                event.ticks += contact.ticks
                if contact.force_n > event.force_n:
                    event.force_n, event.force_seconds = contact.force_n, at
                return
        if len(self.events) == MAX_EVENTS:
            self.further_events += 1
            return
        self.events.append(
            ContactEvent(contact.name, seconds, seconds, contact.force_n, at, contact.ticks)
        )
