# SPDX-License-Identifier: Apache-2.0
"""A file for each episode of physics, and never one over another; with it the run's journal."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.episode.journal import Commanded, Journal, dumped, encode_entry, this_platform
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Ack, Clock, Command
from groundlink.recording.reader import Recording
from groundlink.scenario import Scenario
from groundlink.scene.loaded_world import with_world
from services.recorder.mcap_files import JOURNAL_NANOS, NO_ENTRIES, McapFiles
from services.recorder.recorder import Recorder

RUN = "lab"
CLOCK = f"groundlink/{RUN}/clock"
STILL = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def lab() -> Scenario:
    return load(str(SHIPPED / "indoor_lab.yaml"))


def test_what_exists_stays_and_the_next_goes_beside_it(
    lab: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = McapFiles(tmp_path / "run.mcap", lab, RUN, lambda query: b"")
    for epoch, name in enumerate(("run.mcap", "run_2.mcap", "run_3.mcap")):
        file = files.begin(epoch)
        file.commit({})
        file.close()
        assert files.path == tmp_path / name
        with Recording(files.path) as recording:
            assert recording.run.epoch_nanos == epoch
            assert recording.run.run == "lab"
            assert recording.journal is None
    said = capsys.readouterr().out.splitlines()
    assert [line.rpartition("/")[2] for line in said] == ["run_2.mcap", "run_3.mcap"]


class Physics:
    """Answers for the journal of an episode in which a command comes every ten ticks."""

    def __init__(self, scenario: Scenario, episode: int) -> None:
        self.scenario, self.episode, self.tick = scenario, episode, 0
        self.queries: list[str] = []

    def journal(self, left_out: int = 0) -> Journal:
        entries = [
            encode_entry(Commanded(tick, "rover", Command(tick * TICK_NANOS, STILL, STILL)))
            for tick in range(0, self.tick, 10)
        ]
        return Journal(
            made_on=this_platform(),
            run=RUN,
            episode=self.episode,
            epoch_nanos=5,
            scenario=self.scenario,
            tick=self.tick,
            digest="",
            entries=tuple(entries[left_out:]),
            left_out=left_out,
            acks={"rover/imu": Ack(self.episode, self.tick, self.tick)},
        )

    def ask(self, query: str) -> bytes:
        self.queries.append(query)
        episode, _, left_out = query.partition("/")
        return dumped(self.journal(int(left_out))) if int(episode) == self.episode else b""


def recorded(files: McapFiles, recorder: Recorder, physics: Physics, until_tick: int) -> None:
    """Record the clock of an episode, tended now and then."""
    while physics.tick < until_tick:
        physics.tick += 100
        stamp = 5 + physics.tick * TICK_NANOS
        recorder.take(CLOCK, Clock(stamp, 5, physics.tick, physics.episode))
        files.tend(recorder)


def test_the_journal_is_added_part_after_part(lab: Scenario, tmp_path: Path) -> None:
    physics = Physics(lab, episode=77)
    files = McapFiles(tmp_path / "run.mcap", lab, RUN, physics.ask)
    recorder = Recorder(lab, RUN, files.begin)
    recorded(files, recorder, physics, 5000)
    # So much a recorder that is killed leaves behind.
    with Recording(files.path) as recording:
        journal = recording.journal
        assert journal is not None
        assert recording.end_nanos is None
    ticks = JOURNAL_NANOS // TICK_NANOS
    assert journal.tick > 5000 - ticks
    files.finish(recorder)
    with Recording(files.path) as recording:
        journal = recording.journal
    assert journal == replace(physics.journal(), acks={}, episode=0)
    assert len(physics.queries) == pytest.approx(5000 / ticks + 1, abs=1)
    assert physics.queries[-1] == f"77/{len(journal.entries) - (5000 - 4900) // 10}"


def test_where_all_have_come_to_the_end_the_file_says_so(lab: Scenario, tmp_path: Path) -> None:
    sensors = lab.sensor_names()
    for absent, whole in (((), False), (sensors, True)):
        physics = Physics(lab, episode=77)
        files = McapFiles(tmp_path / f"{whole}.mcap", lab, RUN, physics.ask)
        recorder = Recorder(lab, RUN, files.begin, duration_nanos=NANOS, absent=absent)
        # Of physics itself only the clock comes.
        recorder._period_nanos = {
            key: period
            for key, period in recorder._period_nanos.items()
            if key == CLOCK or any(sensor in key for sensor in sensors)
        }
        recorded(files, recorder, physics, 1000)
        files.finish(recorder)
        with Recording(files.path) as recording:
            begin = 5 + 100 * TICK_NANOS
            assert recording.end_nanos == (begin + NANOS if whole else None)


def test_the_journal_of_another_episode_is_ignored(lab: Scenario, tmp_path: Path) -> None:
    physics = Physics(lab, episode=77)
    files = McapFiles(tmp_path / "run.mcap", lab, RUN, lambda query: dumped(physics.journal()))
    recorder = Recorder(lab, RUN, files.begin)
    recorder.take(CLOCK, Clock(5, 5, 0, 78))
    files.tend(recorder)
    files.finish(recorder)
    with Recording(files.path) as recording:
        assert recording.journal is None


def test_the_file_of_a_further_episode_has_its_world(lab: Scenario, tmp_path: Path) -> None:
    physics = Physics(with_world(lab, load("yard")), episode=77)
    asked = []

    def ask(query: str) -> bytes:
        asked.append(query)
        return dumped(replace(physics.journal(), left_out=NO_ENTRIES))

    files = McapFiles(tmp_path / "run.mcap", lab, RUN, ask)
    for epoch, world in enumerate(("lab", "yard")):
        file = files.begin(epoch)
        file.commit({})
        file.close()
        with Recording(files.path) as recording:
            assert recording.run.scenario.world.name == world
    assert recording.run.scenario == physics.scenario
    assert asked == [f"/{NO_ENTRIES}"]
