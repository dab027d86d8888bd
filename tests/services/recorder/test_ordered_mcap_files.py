# SPDX-License-Identifier: Apache-2.0
"""Equal runs give equal files, whenever their messages arrive and the journal is asked for."""

import random
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from msgspec import UNSET
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.episode.checkpoint import Checkpoint
from groundlink.episode.journal import Commanded, Journal, dumped, encode_entry, this_platform
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Ack, Clock, Command, Imu
from groundlink.recording.reader import Recording
from groundlink.scenario import Scenario
from services.recorder.ordered_mcap_files import SLICE_NANOS, OrderedMcapFiles
from services.recorder.recorder import Participant, Recorder

RUN = "lab"
EPOCH = 10**18
EPISODE = 7
CLOCK = f"groundlink/{RUN}/clock"
IMU = f"groundlink/{RUN}/rover/imu"
COMMAND = f"groundlink/{RUN}/rover/command"
STILL = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
END_TICKS = 1000
PERIOD_TICKS = 200
"""Of checkpoints."""

IMU_ALONE = {"rover/imu": Participant("rover")}

Step = Callable[[Recorder], object]


@pytest.fixture(scope="module")
def lab() -> Scenario:
    """Return the default scenario with its IMU alone: of others nothing comes."""
    scenario = load(str(SHIPPED / "indoor_lab.yaml"))
    (rover,) = scenario.vehicles
    imu = tuple(sensor for sensor in rover.sensors if sensor.name == "imu")
    return replace(scenario, vehicles=(replace(rover, sensors=imu),))


class Physics:
    """Answers for the journal of an episode that is some ticks ahead of what is recorded."""

    def __init__(self, scenario: Scenario, ahead: random.Random) -> None:
        self._scenario, self._ahead = scenario, ahead
        self._entries: list[bytes] = []
        self.tick = 0

    def ask(self, question: str) -> bytes:
        left_out, *known = map(int, question.split("/")[1:])
        while 8 * len(self._entries) < self.tick + 8:
            stamp = 8 * len(self._entries)
            taken_in = max(0, stamp - self._ahead.randrange(16))
            command = Command(stamp * TICK_NANOS, STILL, STILL)
            self._entries.append(encode_entry(Commanded(taken_in, "rover", command)))
        return dumped(
            Journal(
                made_on=this_platform(),
                run=RUN,
                episode=EPISODE,
                epoch_nanos=EPOCH,
                scenario=self._scenario,
                tick=self.tick,
                digest=str(self.tick),
                entries=tuple(self._entries[left_out:]),
                left_out=left_out,
                acks={"rover/imu": Ack(EPISODE, self.tick, self.tick)},
                checkpoints=tuple(self._checkpoints()[known[0] :]) if known else UNSET,
            )
        )

    def _checkpoints(self) -> list[Checkpoint]:
        """Return the complete checkpoints: at times the newest ones are not, for a moment."""
        last = self.tick - self._ahead.choice((0, PERIOD_TICKS))
        acks = {name: Ack(EPISODE, 7, 7) for name in self._ahead.sample(["a", "b", "c"], 3)}
        return [
            Checkpoint(tick=tick, memory=b"%d" % tick, acks=acks)
            for tick in range(PERIOD_TICKS, last + 1, PERIOD_TICKS)
        ]


def clock(tick: int) -> Step:
    stamp = EPOCH + tick * TICK_NANOS
    return lambda recorder: recorder.take(CLOCK, Clock(stamp, EPOCH, tick, EPISODE))


def imu(tick: int) -> Step:
    stamp = EPOCH + tick * TICK_NANOS
    sample = Imu(stamp, "imu_link", UPRIGHT, STILL, STILL, 0, 0, 0)
    return lambda recorder: recorder.take(IMU, sample)


def command(tick: int) -> Step:
    stamp = EPOCH + tick * TICK_NANOS
    return lambda recorder: recorder.take(COMMAND, Command(stamp, STILL, STILL))


def acknowledged(tick: int) -> Step:
    return lambda recorder: recorder.acknowledged("rover/imu", Ack(EPISODE, tick, tick))


def arriving(seed: int) -> Iterable[tuple[int, Step]]:
    """Yield a run's messages with physics' tick: each stream in order, streams mixed at random."""
    chance = random.Random(seed)
    streams = [
        [(tick, clock(tick)) for tick in range(0, 1400, 4)],
        [
            (tick, step(tick))
            for tick in range(1400)
            for step in (imu, *([acknowledged] if tick % 50 == 0 else []))
        ],
        [(tick, command(tick)) for tick in range(8, 1400, 8)],
    ]
    yield streams[0].pop(0)
    while any(streams):
        # No stream is further ahead than physics' window.
        least = min(stream[0][0] for stream in streams if stream)
        near = [stream for stream in streams if stream and stream[0][0] <= least + 100]
        yield chance.choice(near).pop(0)


def recorded(scenario: Scenario, path: Path, seed: int) -> bytes:
    """Return the file of a run whose messages arrive in an order of its own."""
    chance = random.Random(seed + 1)
    physics = Physics(scenario, chance)
    files = OrderedMcapFiles(path, scenario, RUN, physics.ask)
    recorder = Recorder(
        *(scenario, RUN, files.begin),
        duration_nanos=END_TICKS * TICK_NANOS,
        acknowledging=IMU_ALONE,
    )
    recorder._period_nanos = {CLOCK: 4 * TICK_NANOS, IMU: TICK_NANOS}  # nothing else comes
    for tick, step in arriving(seed):
        if recorder.is_complete:
            break
        step(recorder)
        physics.tick = max(physics.tick, tick + chance.randrange(100))
        if chance.random() < 0.02:
            files.tend(recorder)
    assert recorder.is_whole
    files.finish(recorder)
    return path.read_bytes()


def test_the_order_of_arrival_changes_no_byte(lab: Scenario, tmp_path: Path) -> None:
    first = recorded(lab, tmp_path / "1.mcap", 1)
    for seed in (2, 3, 4):
        assert recorded(lab, tmp_path / f"{seed}.mcap", seed) == first
    with (tmp_path / "1.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [
            (message.log_time, channel.id)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
        summary = reader.get_summary()
    assert found == sorted(found)
    assert summary is not None
    assert len(summary.chunk_indexes) == END_TICKS * TICK_NANOS // SLICE_NANOS
    with Recording(tmp_path / "1.mcap") as recording:
        journal = recording.journal
        assert recording.end_nanos == EPOCH + END_TICKS * TICK_NANOS
        assert recording.topics["/imu"].messages == END_TICKS
        assert "/diagnostics" not in recording.topics
    assert journal is not None
    assert (journal.tick, journal.digest) == (END_TICKS, "")
    assert [entry.tick for entry in journal.read()] == [*range(0, END_TICKS, 8)]


def test_checkpoints_are_in_the_file_whenever_physics_completes_them(
    lab: Scenario, tmp_path: Path
) -> None:
    lab = replace(lab, time=replace(lab.time, checkpoint_s=PERIOD_TICKS / 400))
    first = recorded(lab, tmp_path / "1.mcap", 1)
    for seed in (2, 3):
        assert recorded(lab, tmp_path / f"{seed}.mcap", seed) == first
    with Recording(tmp_path / "1.mcap") as recording:
        found = [(attached.nanos, attached.load()) for attached in recording.checkpoints]
    ticks = range(PERIOD_TICKS, END_TICKS + 1, PERIOD_TICKS)
    assert [nanos for nanos, _ in found] == [EPOCH + tick * TICK_NANOS for tick in ticks]
    assert [checkpoint.tick for _, checkpoint in found] == [*ticks]
    assert {ack.episode for _, checkpoint in found for ack in checkpoint.acks.values()} == {0}


def test_what_a_sensor_may_still_send_is_waited_for(lab: Scenario, tmp_path: Path) -> None:
    """A slice is in the file, for a recorder that is killed, when all have acknowledged beyond."""
    files = OrderedMcapFiles(tmp_path / "run.mcap", lab, RUN, lambda question: b"")
    recorder = Recorder(lab, RUN, files.begin, acknowledging=IMU_ALONE)
    recorder._period_nanos = {CLOCK: 4 * TICK_NANOS, IMU: TICK_NANOS}
    ticks = SLICE_NANOS // TICK_NANOS

    def messages() -> int:
        files.tend(recorder)
        with Recording(files.path) as recording:
            return recording.topics["/imu"].messages

    for tick in range(ticks + 4):
        clock(tick)(recorder)
        imu(tick)(recorder)
    acknowledged(ticks - 1)(recorder)
    assert messages() == 0
    acknowledged(ticks)(recorder)
    assert messages() == ticks
    files.finish(recorder)
    with Recording(files.path) as recording:
        assert recording.topics["/imu"].messages == ticks + 4
        assert recording.end_nanos is None


def test_who_never_acknowledges_is_not_waited_for_forever(lab: Scenario, tmp_path: Path) -> None:
    files = OrderedMcapFiles(tmp_path / "run.mcap", lab, RUN, lambda question: b"")
    recorder = Recorder(lab, RUN, files.begin, acknowledging=IMU_ALONE)
    for tick in (0, 4, 6 * NANOS // TICK_NANOS):
        clock(tick)(recorder)
        imu(tick)(recorder)
    files.tend(recorder)
    with Recording(files.path) as recording:
        assert recording.topics["/imu"].messages == 2
