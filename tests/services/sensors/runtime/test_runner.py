# SPDX-License-Identifier: Apache-2.0
"""The process around a model, with a stand-in model and without a bus."""

from collections.abc import Iterable, Mapping, Sequence

import msgspec
import numpy as np
import pytest
from msgspec import UNSET, UnsetType

from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ
from groundlink.core.errors import UserError
from groundlink.messages.base import Ack, BusMessage, Clock, Ruts, State
from groundlink.messages.missing_readings import MissingReadings
from groundlink.messages.reading_schedule import Events
from groundlink.world.ruts import NO_RUTS, TILE, digest_of, split
from services.sensors.runtime.model import Made
from services.sensors.runtime.reading_ledger import ReadingLedger
from services.sensors.runtime.runner import SensorProcess

HASH = "ab" * 32
PERIOD = 40
ACK_TICKS = 50


class EveryFortyTicks:
    """Measures over 40 ticks; like a LiDAR it settles a tick when its revolution is out."""

    def __init__(self) -> None:
        self.restart()
        self.restarts = 0

    def restart(self) -> None:
        self.restarts = getattr(self, "restarts", 0) + 1
        self._settled = -1
        self._expected: int | None = None

    def readings(self, state: State) -> Iterable[Made]:
        assert self._expected in (None, state.tick), "a model never sees a gap"
        self._expected = state.tick + 1
        if state.tick % PERIOD == 0:
            if self._settled >= 0:
                stamp = state.epoch_nanos + (state.tick - PERIOD) * TICK_NANOS
                yield Clock(stamp, state.epoch_nanos, state.tick, state.episode)
            self._settled = state.tick

    def settled_tick(self) -> int:
        return self._settled


class Counts(EveryFortyTicks):
    """Remembers how many states it has seen since physics began."""

    def __init__(self) -> None:
        super().__init__()
        self.seen = 0

    def readings(self, state: State) -> Iterable[Made]:
        self.seen += 1
        return super().readings(state)

    def memory(self) -> bytes:
        return str(self.seen).encode()

    def remember(self, memory: bytes) -> None:
        self.seen = int(memory or b"0")


class Bench:
    def __init__(
        self,
        model: EveryFortyTicks | None = None,
        worlds: Sequence[str] = (),
        max_waiting_ticks: int | None = None,
        ruts: Mapping[bytes, bytes] | None = None,
    ) -> None:
        self.model = model or EveryFortyTicks()
        self.asked: list[str] = []
        self.worlds = worlds
        self.published: list[BusMessage] = []
        self.acks: list[Ack] = []
        self.told: list[MissingReadings] = []
        self.reconnects = 0
        self.ledger = ReadingLedger(
            "rover/it", Events(TICK_RATE_HZ / PERIOD), [""], self.told.append
        )
        self.sensor = SensorProcess(
            self.model,
            expected_world_hash=HASH,
            renew=self._renew,
            ack_ticks=ACK_TICKS,
            publish=self.published.append,
            acknowledge=self.acks.append,
            ledger=self.ledger,
            reconnects=lambda: self.reconnects,
            max_waiting_ticks=max_waiting_ticks,
            ruts=None if ruts is None else self._find,
        )
        self.ruts, self.asked_ruts = ruts or {}, list[bytes]()

    def _renew(self, world: str) -> bool:
        self.asked.append(world)
        return world in self.worlds

    def _find(self, digest: bytes) -> bytes:
        self.asked_ruts.append(digest)
        return self.ruts.get(digest, b"")

    def take(self, ticks: Iterable[int], epoch: int = 0, waiting: int = 0) -> None:
        for tick in ticks:
            state = State("run", epoch, epoch, tick, tick * TICK_NANOS, HASH, {})
            self.sensor.take(state, waiting)

    def stamps(self) -> list[int]:
        """Return those of what was published, in ticks."""
        return [
            (m.stamp_nanos - m.epoch_nanos) // TICK_NANOS
            for m in self.published
            if isinstance(m, Clock)
        ]

    def gaps(self) -> list[tuple[str, int, int, int]]:
        """Return what was told to be missing: why, from and to which tick, how many."""
        return [
            (gap.cause, gap.first_nanos // TICK_NANOS, gap.last_nanos // TICK_NANOS, gap.readings)
            for told in self.told
            for gap in told.gaps
        ]

    def memories(self) -> list[bytes]:
        """Return what the model remembered at each word of its process."""
        return [msgspec.msgpack.decode(ack.memory)[1] for ack in self.acks]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_states_go_in_and_readings_come_out(bench: Bench) -> None:
    bench.take(range(200))
    assert bench.stamps() == [0, 40, 80, 120]
    assert (bench.sensor.readings, bench.sensor.missed_ticks) == (4, 0)
    assert bench.told == []


def test_a_gap_is_counted_and_restarts_the_model(bench: Bench) -> None:
    bench.take([*range(100), *range(110, 250)])
    assert bench.sensor.missed_ticks == 10
    assert bench.stamps() == [0, 40, 120, 160, 200]
    assert bench.gaps() == [("states lost", 80, 80, 1)]
    assert bench.ledger.missing == {"states lost": 1}


def test_repeated_states_are_passed_over(bench: Bench) -> None:
    bench.take([0, 1, 1, 0, *range(2, 81)])
    assert bench.stamps() == [0, 40]
    assert bench.sensor.missed_ticks == 0


def test_a_new_episode_begins_without_missing_readings(bench: Bench) -> None:
    bench.take(range(100), epoch=1)
    bench.take(range(100), epoch=2)
    assert bench.stamps() == [0, 40, 0, 40]
    assert bench.sensor.missed_ticks == 0
    assert bench.told == []


def test_a_successor_repeats_nothing_that_was_settled(bench: Bench) -> None:
    bench.sensor.resume(Ack(0, 130, 120))
    bench.take(range(300))
    assert bench.stamps() == [120, 160, 200, 240]


def test_without_predecessor_memory_everything_is_published(bench: Bench) -> None:
    bench.sensor.resume(Ack(0, -1, -1))
    bench.take(range(100))
    assert bench.stamps() == [0, 40]


def test_a_gap_after_resuming_withholds_nothing(bench: Bench) -> None:
    bench.sensor.resume(Ack(0, 50, 40))
    bench.take([*range(130), *range(150, 250)])
    assert bench.stamps() == [40, 80, 160, 200]


def test_readings_before_a_late_join_are_missing_as_not_there(bench: Bench) -> None:
    bench.take(range(110, 201))
    assert bench.stamps() == [120, 160]
    assert bench.gaps() == [("not there", 0, 80, 3)]


def test_unrecoverable_readings_after_a_restart_are_missing(
    bench: Bench,
) -> None:
    bench.take(range(101))
    after = Bench()
    after.sensor.resume(bench.acks[-1])
    after.take(range(300, 401))
    assert bench.stamps() + after.stamps() == [0, 40, 320, 360]
    assert after.gaps() == [("restarted", 80, 280, 6)]


def test_overload_drops_states_and_marks_readings_missing() -> None:
    bench = Bench(max_waiting_ticks=100)
    bench.take(range(90), waiting=100)
    bench.take(range(90, 190), waiting=101)
    # Not before it is abreast: else it would be behind again at once.
    bench.take(range(190, 240), waiting=1)
    bench.take(range(240, 401))
    assert bench.stamps() == [0, 40, 240, 280, 320, 360]
    assert bench.gaps() == [("overloaded", 80, 200, 4)]
    waiting = Bench()
    waiting.take(range(401), waiting=1000)
    assert waiting.told == []


def test_lost_states_after_dropped_states_have_their_own_cause() -> None:
    bench = Bench(max_waiting_ticks=100)
    bench.take([*range(90), 100])
    bench.take(range(101, 150), waiting=101)
    bench.take([*range(150, 300), *range(350, 500)])
    assert bench.gaps() == [("overloaded", 80, 120, 2), ("states lost", 280, 320, 2)]


def test_gaps_are_repeated_after_a_lost_session(bench: Bench) -> None:
    lost, later = ("states lost", 80, 80, 1), ("states lost", 240, 240, 1)
    bench.take([*range(100), *range(110, 230)])
    assert bench.gaps() == [lost]
    bench.reconnects += 1
    bench.take([*range(230, 245), *range(246, 330)])
    assert bench.gaps() == [lost, lost, later]
    assert bench.told[1].stamp_nanos > bench.told[0].stamp_nanos, "a recorder takes no older one"
    assert bench.ledger.missing == {"states lost": 2}
    bench.take(range(330, 13_000))
    bench.reconnects += 1
    bench.take(range(13_000, 13_200))
    assert bench.gaps() == [lost, lost, later], "it has come by now, or never will"


def test_a_new_episode_receives_nothing_of_the_one_before(bench: Bench) -> None:
    bench.take([*range(100), *range(110, 200)])
    bench.reconnects += 1
    bench.take(range(200), epoch=9)
    assert len(bench.told) == 1


def test_acknowledgement_carries_the_settled_tick(bench: Bench) -> None:
    bench.take(range(101))
    told = [(ack.episode, ack.tick, ack.settled_tick) for ack in bench.acks]
    assert told == [(0, 0, 0), (0, ACK_TICKS, 40), (0, 2 * ACK_TICKS, 80)]


def test_another_world_is_refused(bench: Bench) -> None:
    with pytest.raises(UserError, match="world hash differs: physics has cdcdcdcdcdcd"):
        bench.sensor.take(State("run", 0, 0, 0, 0, "cd" * 32, {}))


def test_changed_world_is_requested_once() -> None:
    other = "cd" * 32
    bench = Bench(worlds=[other])
    bench.take(range(50))
    for tick in range(50, 140):
        bench.sensor.take(State("run", 0, 0, tick, tick * 2_500_000, other, {}))
    assert bench.asked == [other]
    assert (bench.sensor.worlds, bench.sensor.missed_ticks) == (2, 0)
    assert bench.stamps() == [0, 40, 80]
    with pytest.raises(UserError, match="physics has efefefefefef, this process has cdcdcdcdcdcd"):
        bench.sensor.take(State("run", 0, 0, 140, 0, "ef" * 32, {}))


def test_model_memory_is_sent_with_acknowledgements() -> None:
    bench = Bench(Counts())
    bench.take(range(101))
    assert bench.memories() == [b"1", b"51", b"101"]


def test_successor_gets_its_predecessors_memory() -> None:
    before, model = Bench(Counts()), Counts()
    before.take(range(51))
    bench = Bench(model)
    bench.sensor.resume(before.acks[-1])
    bench.take(range(30, 60))
    assert model.seen == 51 + 20  # From the settled tick on: earlier states are for others.
    assert bench.acks[:1] == before.acks[-1:]  # And tells it on, should it end at once.


def test_memory_survives_a_gap_but_not_a_new_episode() -> None:
    model = Counts()
    bench = Bench(model)
    bench.take([*range(100), *range(110, 120)], epoch=1)
    assert model.seen == 110
    bench.take(range(10), epoch=2)
    assert model.seen == 10


class Skips(EveryFortyTicks):
    """Notes how far behind it is told to be."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[int] = []

    def behind(self, waiting: int) -> None:
        self.told.append(waiting)


def test_skipping_model_gets_its_delay() -> None:
    model = Skips()
    bench = Bench(model, max_waiting_ticks=100)
    for tick, waiting in enumerate((0, 3, 41)):
        bench.take([tick], waiting=waiting)
    assert model.told == [0, 3, 41]


def test_one_that_is_waited_for_is_not() -> None:
    model = Skips()
    Bench(model).take(range(3), waiting=41)
    assert model.told == []


class SeesRuts(EveryFortyTicks):
    """Notes the ruts of states."""

    def __init__(self) -> None:
        super().__init__()
        self.ruts: list[Ruts | UnsetType] = []

    def readings(self, state: State) -> Iterable[Made]:
        self.ruts.append(state.ruts)
        return super().readings(state)


def tile(key: int) -> bytes:
    record = np.zeros(1, TILE)
    record["key"] = key
    return record.tobytes()


ONE, BOTH = tile(1), tile(1) + tile(2)
DIGESTS = {content: digest_of(split(content)) for content in (ONE, BOTH)}
KNOWN = {digest: content for content, digest in DIGESTS.items()}
FIRST = Ruts(DIGESTS[ONE], NO_RUTS, memoryview(ONE))
SECOND = Ruts(DIGESTS[BOTH], DIGESTS[ONE], memoryview(tile(2)))
ALL = Ruts(DIGESTS[BOTH], NO_RUTS, memoryview(BOTH))
SAME = Ruts(DIGESTS[BOTH])


@pytest.mark.parametrize(
    ("sent", "asked", "seen"),
    [
        # All changes arrive: nothing is asked.
        ([(0, UNSET), (1, FIRST), (2, SECOND), (3, SAME)], 0, [UNSET, FIRST, SECOND, SAME]),
        # A sensor that starts late asks once.
        ([(7, SAME), (8, SAME)], 1, [ALL, SAME]),
        # It may start with a change of what it does not know.
        ([(7, SECOND)], 1, [ALL]),
        # The state with a change is lost.
        ([(0, UNSET), (1, FIRST), (3, SAME), (4, SAME)], 1, [UNSET, FIRST, ALL, SAME]),
        # The ground is levelled.
        ([(0, FIRST), (1, UNSET), (2, FIRST)], 0, [FIRST, UNSET, FIRST]),
    ],
)
def test_ruts_that_were_missed_are_asked_for_by_their_digest(
    sent: Sequence[tuple[int, Ruts | UnsetType]], asked: int, seen: Sequence[Ruts | UnsetType]
) -> None:
    bench = Bench(model := SeesRuts(), ruts=KNOWN)
    for tick, ruts in sent:
        state = State("run", 0, 0, tick, tick * TICK_NANOS, HASH, {}, ruts=ruts)
        bench.sensor.take(state)
    assert len(bench.asked_ruts) == asked
    assert model.ruts == list(seen)
    assert bench.sensor.refused == 0


@pytest.mark.parametrize("answer", [b"", ONE, b"?"])
def test_ruts_with_another_digest_are_refused(answer: bytes) -> None:
    bench = Bench(model := SeesRuts(), ruts={DIGESTS[BOTH]: answer})
    for tick in (5, 6):
        bench.sensor.take(State("run", 0, 0, tick, tick * TICK_NANOS, HASH, {}, ruts=SAME))
    assert model.ruts == [SAME, SAME]
    assert (bench.sensor.refused, len(bench.asked_ruts)) == (1, 1)


def test_a_model_of_another_world_gets_all_ruts() -> None:
    other = "cd" * 32
    bench = Bench(model := SeesRuts(), worlds=[other], ruts=KNOWN)
    bench.sensor.take(State("run", 0, 0, 0, 0, HASH, {}, ruts=ALL))
    bench.sensor.take(State("run", 0, 0, 1, TICK_NANOS, other, {}, ruts=SAME))
    assert model.ruts == [ALL, ALL]


def test_a_sensor_that_sees_no_world_asks_for_no_ruts() -> None:
    bench = Bench(model := SeesRuts())
    bench.sensor.take(State("run", 0, 0, 0, 0, HASH, {}, ruts=SAME))
    assert model.ruts == [SAME]
    assert bench.asked_ruts == []
