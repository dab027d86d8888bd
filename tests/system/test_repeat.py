# SPDX-License-Identifier: Apache-2.0
"""The processes of a repeated run follow a world that changes."""

import io
import subprocess
import sys
from pathlib import Path

import pytest
from msgspec.structs import replace

from groundlink.bus.core_topics import STATE
from groundlink.bus.pipe import read_piped
from groundlink.bus.queries import scenario_key
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.episode import journal
from groundlink.episode.control import Spawn
from groundlink.loader import load
from groundlink.loader.additions import SpawnPlace, addition
from groundlink.messages.base import EncodedState, PointCloud, State, decode
from groundlink.monitor.pipeline import RUN, pipeline, repeated_physics, repeated_sensors
from services.physics.run.episode import Episode
from services.physics.run.publishers import silent_publishers

pytestmark = pytest.mark.system

TICKS, CHANGED_TICK = 260, 100


@pytest.fixture
def saved(tmp_path: Path) -> tuple[Path, list[State]]:
    """A journal in which a crate is put before the rover, and its states."""
    scenario = load("indoor_lab")
    states: list[State] = []
    silent = silent_publishers()

    def publish(state: State | EncodedState) -> bytes:
        payload = encode(state)
        states.append(decode(payload, State))
        return payload

    encode, silent.state = silent.state, publish
    episode = Episode(scenario, "run", silent, required=(), wall_nanos=0, epoch_nanos=10**9)
    episode.begin(0, 0.0)
    while episode.tick < TICKS:
        if episode.tick == CHANGED_TICK:
            crate = addition("crate", at=SpawnPlace(-2.5, 0.0), name=None, taken=(), ground=None)
            episode.change(Spawn(crate[1]))
        episode.step()
    file = tmp_path / "run.journal"
    journal.write(file, journal.dumped(episode.journal()))
    episode.end()
    return file, states


def test_a_spawned_crate_is_seen(saved: tuple[Path, list[State]]) -> None:
    file, states = saved
    physics = repeated_physics(file, until_tick=TICKS)
    sensors = repeated_sensors(load("indoor_lab"), ["rover/lidar", "rover/encoders"], file)
    with pipeline([physics, *sensors]) as messages:
        found = list(messages)
    worlds = [each for each in found if each.key == scenario_key(RUN)]
    assert len(worlds) == 2
    repeated = [decode(p, State) for key, p in found if key == STATE.key_in(RUN)]
    assert repeated == [replace(state, run=RUN) for state in states]
    assert len({state.world_hash for state in repeated}) == 2
    key = SENSOR_TOPICS["lidar"].key_in(RUN, vehicle="rover", sensor="lidar")
    clouds = [decode(p, PointCloud).records() for k, p in found if k == key]
    near = [int((cloud["x"] < 2.2)[abs(cloud["y"]) < 0.2].sum()) for cloud in clouds]
    assert near[-1] > near[0] + 20


def test_what_follows_no_journal_says_so(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "services.physics.repeat", "--run", RUN]
    done = subprocess.run(
        [*command, "--follow", str(tmp_path / "none")], capture_output=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.decode().count("\n") == 1
    assert [*read_piped(io.BytesIO(done.stdout))] == []
