# SPDX-License-Identifier: Apache-2.0
"""What physics publishes: on the bus, or nowhere for an episode that is being restored."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from groundlink.bus.core_topics import BATCH_TICKS, CLOCK, STATE, STATE_BATCH
from groundlink.bus.session import Bus
from groundlink.bus.topics import BODIES, GROUND_TRUTH, JOINTS, TRUE_MAP, TRUE_WHEELS, VITALS
from groundlink.messages.base import BusMessage, EncodedState, State, StateBatch, encode
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Time

Publish = Callable[[BusMessage], bytes]


@dataclass
class Publishers:
    """A publisher for each message of the run, and for each message of a vehicle by name."""

    state: Callable[[State | EncodedState], bytes]
    clock: Publish
    bodies: Publish
    true_map: Publish
    truth: dict[str, Publish]
    wheels: dict[str, Publish]
    joints: dict[str, Publish]
    vitals: dict[str, Publish]


class BusPublishers(Publishers):
    """Publishers on the bus."""

    def __init__(self, bus: Bus, run: str, scenario: Scenario) -> None:
        self._bus, self._run = bus, run
        # Where physics waits, nothing may overtake what it has published before.
        is_local = scenario.time.mode == "realtime"
        state, clock, bodies, true_map, batch = (
            bus.publisher(topic.key_in(run), topic.delivery, local=topic.local and is_local)
            for topic in (STATE, CLOCK, BODIES, TRUE_MAP, STATE_BATCH)
        )
        if not is_local:
            bus.hold()

        def publish_batch(message: BusMessage) -> bytes:
            payload = batch(message)
            bus.flush()
            return payload

        self.states = StatePublisher(state, publish_batch, scenario.time)
        super().__init__(self.states, clock, bodies, true_map, {}, {}, {}, {})
        self.declare(scenario)

    def declare(self, scenario: Scenario) -> None:
        """Declare the publishers of a scenario's vehicles that are not declared yet."""
        for topic, known in (
            (GROUND_TRUTH, self.truth),
            (TRUE_WHEELS, self.wheels),
            (JOINTS, self.joints),
            (VITALS, self.vitals),
        ):
            for vehicle in scenario.vehicles:
                if vehicle.name not in known:
                    key = topic.key_in(self._run, vehicle=vehicle.name)
                    known[vehicle.name] = self._bus.publisher(key, topic.delivery)


class StatePublisher:
    """Publishes each state at once, and all states in batches.

    A batch ends early where a process may wait for an acknowledgement of its last state: at the
    first state of an episode, and at every `ack_ticks`-th. Without a wall clock no process needs
    states earlier than that, and larger batches wake receivers less often.
    """

    def __init__(
        self, state: Callable[[State | EncodedState], bytes], batch: Publish, time: Time
    ) -> None:
        self._state, self._batch, self._ack_ticks = state, batch, time.ack_ticks
        self._batch_ticks = time.ack_ticks if time.mode == "fast" else BATCH_TICKS
        self._encoded: list[msgspec.Raw] = []
        self._episode: int | None = None

    def __call__(self, state: State | EncodedState) -> bytes:
        """Publish a state; return its bytes."""
        payload = self._state(state)
        self._encoded.append(msgspec.Raw(payload))
        is_first, self._episode = state.episode != self._episode, state.episode
        if is_first or not (state.tick % self._batch_ticks and state.tick % self._ack_ticks):
            self.flush()
        return payload

    def flush(self) -> None:
        """Publish the states that wait for their batch, if any."""
        if self._encoded:
            # The encoder writes them as the states that they are.
            self._batch(StateBatch(tuple(self._encoded)))  # type: ignore[arg-type]
            self._encoded.clear()


def silent_publishers() -> Publishers:
    """Return publishers that publish nothing; states are still encoded, for the history."""

    def none(message: BusMessage) -> bytes:
        return b""

    each: defaultdict[str, Publish] = defaultdict(lambda: none)
    return Publishers(encode, none, none, none, each, each, each, each)
