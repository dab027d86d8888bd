# SPDX-License-Identifier: Apache-2.0
"""Runner of a sensor model: feed it states in order and publish its readings.

The runner restarts a model after every gap in ticks, does not repeat readings of a predecessor, and
reports missing readings. If no participant waits for the sensor and too many states are queued, the
runner drops all but the newest state.
"""

from collections.abc import Callable

import msgspec
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.messages.base import Ack, BadBusMessage, BusMessage, Ruts, State, measured_nanos
from groundlink.messages.missing_readings import Cause
from groundlink.world.ruts import NO_RUTS, TILE, digest_of, split

from .model import (
    LeftOut,
    RememberingModel,
    SensorModel,
    SkippingModel,
    StreamMessage,
    stream_and_message,
)
from .reading_ledger import NoReadingLedger, ReadingLedger


def _never(world: str) -> bool:
    """Accept no other world."""
    return False


class _Memory(msgspec.Struct, array_like=True):
    """Memory of a sensor for its successor."""

    ledger: bytes = b""
    model: bytes = b""


class SensorProcess:
    """Sensor model with its input of states and its output of readings.

    Parameters
    ----------
    expected_world_hash
        Hash of the world that the model was built for.
    renew
        Rebuilds the model for the world of another hash; returns False if that world is unknown.
    ledger
        Record of published and missing readings.
    reconnects
        Returns the number of reconnects of the bus session.
    ruts
        Returns the tiles of ruts with a digest, empty if they are unknown. None for a sensor that
        sees none.
    max_waiting_ticks
        Maximum number of queued states. Above it, the sensor leaves out readings to avoid delay.
        None disables this; the sensor then publishes every reading, however late.
    """

    def __init__(
        self,
        model: SensorModel,
        *,
        expected_world_hash: str,
        renew: Callable[[str], object] = _never,
        ack_ticks: int,
        publish: Callable[[BusMessage | StreamMessage], object],
        acknowledge: Callable[[Ack], object],
        ledger: ReadingLedger | NoReadingLedger | None = None,
        reconnects: Callable[[], int] = lambda: 0,
        max_waiting_ticks: int | None = None,
        ruts: Callable[[bytes], bytes] | None = None,
    ) -> None:
        self._model = model
        self._ledger = ledger or NoReadingLedger()
        self._reconnects, self._told_by = reconnects, reconnects()
        self._max_waiting_ticks = max_waiting_ticks
        self._lets_go = False
        self._missing_cause: Cause = "states lost"
        # Checked once, because a check takes 20 us, more than most sensors need for a state.
        self._remembering = model if isinstance(model, RememberingModel) else None
        self._skipping = (
            model if max_waiting_ticks is not None and isinstance(model, SkippingModel) else None
        )
        self._find_ruts, self._known_ruts = ruts, NO_RUTS
        self._expected_world_hash, self._renew = expected_world_hash, renew
        self.worlds = 1
        self._ack_ticks = ack_ticks
        self._publish = publish
        self._acknowledge = acknowledge
        self.acknowledged_tick = -1
        self.epoch_nanos = 0
        self._episode: int | None = None
        self._published_to = -1
        self.tick = -1
        self.readings = 0
        self.missed_ticks = 0
        self.refused = 0

    def resume(self, ack: Ack) -> None:
        """Continue after a predecessor without repeating its settled readings."""
        self._model.restart()
        self._episode = ack.episode
        self._published_to = ack.settled_tick
        # The model may need earlier states. Its memory applies to the settled tick.
        self.tick = max(ack.settled_tick, 0) - 1
        self._missing_cause = "restarted"
        self._remember(ack.memory)
        self.acknowledged_tick = ack.tick
        self._acknowledge(ack)

    def _remember(self, memory: bytes) -> None:
        known = msgspec.msgpack.decode(memory, type=_Memory) if memory else _Memory()
        self._ledger.remember(known.ledger)
        if self._remembering is not None:
            self._remembering.remember(known.model)

    def _is_let_go(self, waiting: int) -> bool:
        """Return whether to drop a state: all but the newest are, once too many are queued."""
        if self._max_waiting_ticks is None:
            return False
        self._lets_go = waiting > (0 if self._lets_go else self._max_waiting_ticks)
        if self._lets_go:
            self._missing_cause = "overloaded"
        return self._lets_go

    def take(self, state: State, waiting: int = 0) -> None:
        """Feed one state and publish the readings that it completes.

        `waiting` is the number of further states that have arrived.

        Raises
        ------
        UserError
            when physics simulates a world that differs from this replica.
        """
        if state.episode == self._episode and state.tick <= self.tick:
            return
        if self._is_let_go(waiting):
            return
        if state.world_hash != self._expected_world_hash:
            if not self._renew(state.world_hash):
                raise UserError(
                    f"world hash differs: physics has {state.world_hash[:12]}, this process has "
                    f"{self._expected_world_hash[:12]}; Fix: run the same version of Groundlink on "
                    "every host, and restart this sensor after changes of the scenario"
                )
            self._expected_world_hash = state.world_hash
            self.worlds += 1
            self._known_ruts = NO_RUTS
        if self._find_ruts is not None:
            state = self._with_ruts(state, self._find_ruts)
        self.epoch_nanos = state.epoch_nanos
        if state.episode != self._episode:
            self._episode, self._published_to, self.tick = state.episode, -1, -1
            self.acknowledged_tick = -1
            self._model.restart()
            self._remember(b"")
        elif self.tick >= 0 and state.tick != self.tick + 1:
            self.missed_ticks += state.tick - self.tick - 1
            self._published_to = -1
            self._model.restart()
            self._ledger.because(self._missing_cause)
        self._missing_cause = "states lost"
        self.tick = state.tick
        if self._skipping is not None:
            self._skipping.behind(waiting)
        settled_before = self._model.settled_tick()
        try:
            made = list(self._model.readings(state))
        except BadBusMessage:  # a valid state without the vehicle or link that the sensor measures
            self.refused += 1
            self._ledger.because("states lost")
            return
        for one in made:
            if settled_before < self._published_to:
                continue
            self._published_to = -1
            if isinstance(one, LeftOut):
                self._ledger.left_out(one)
                continue
            self._publish(one)
            self.readings += 1
            output, message = stream_and_message(one)
            self._ledger.published(output, measured_nanos(message) - state.epoch_nanos)
        if state.tick % self._ack_ticks == 0:
            self.report_progress()

    def _with_ruts(self, state: State, find: Callable[[bytes], bytes]) -> State:
        """Return a state whose ruts follow from those of the states before, or are all of them."""
        ruts, known = state.ruts, self._known_ruts
        self._known_ruts = ruts.digest if ruts else NO_RUTS
        if not ruts or ruts.digest == known or (ruts.tiles and ruts.before == known):
            return state
        tiles = find(ruts.digest)
        if len(tiles) % TILE.itemsize or digest_of(split(tiles)) != ruts.digest:
            self.refused += 1
            return state
        return replace(state, ruts=Ruts(ruts.digest, NO_RUTS, memoryview(tiles)))

    def report_progress(self) -> None:
        """Publish missing readings and acknowledge the last state with the successor's memory."""
        assert self._episode is not None, "no state was taken"
        settled = self._model.settled_tick()
        instant = self.epoch_nanos + self.tick * TICK_NANOS
        link = self._reconnects()
        again, self._told_by = link != self._told_by, link
        self._ledger.report(settled, stamp_nanos=instant, epoch_nanos=self.epoch_nanos, again=again)
        memory = b"" if self._remembering is None else self._remembering.memory()
        known = _Memory(self._ledger.memory(), memory)
        self.acknowledged_tick = self.tick
        self._acknowledge(Ack(self._episode, self.tick, settled, msgspec.msgpack.encode(known)))
