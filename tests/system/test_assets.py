# SPDX-License-Identifier: Apache-2.0
"""System tests of world assets: a sensor host without files receives terrain and meshes."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.base import PointCloud
from groundlink.world import assets
from groundlink.world.assets import VARIABLE
from tests.groundlink.importing.files import glb, write

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

SCENARIO = """
name: hills
time: {mode: fast, window_ticks: 400}
world:
  name: hills
  materials: {grass: {}, brick: {}}
  terrain:
    {kind: hills, size_m: [200, 200], cell_m: 0.5, height_m: 3, longest_m: 60, material: grass}
  solids:
    - name: house
      shape: {kind: mesh, file: house.glb}
      material: brick
      position_m: [0, 6, 1]
      on_ground: true
vehicles:
  - name: rover
    model: rover
    sensors: [{name: lidar, datasheet: vlp16, mount: mast, topic: /points, frame: lidar}]
"""


@pytest.fixture
def it(tmp_path: Path) -> Iterator[Rig]:
    with rig(tmp_path) as ready:
        write(tmp_path, "house.glb", glb())
        ready.scenario.write_text(SCENARIO)
        yield ready


def test_a_sensor_without_files_gets_them_from_physics(
    it: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs, ours = tmp_path / "theirs", tmp_path / "ours"
    it.environment[VARIABLE] = str(theirs)
    run = ("--run", it.run)
    it.start(*("-m", "services.physics", str(it.scenario)), *run, "--listen", it.endpoint, log="p")
    wait_for(it.is_answered, 30, "physics listens")
    it.environment[VARIABLE] = str(ours)
    with Bus(connect=it.endpoint) as bus:
        clouds: BusInbox[PointCloud] = BusInbox(depth=10)
        key = SENSOR_TOPICS["lidar"].key_in(it.run, vehicle="rover", sensor="lidar")
        bus.subscribe(key, PointCloud, clouds)
        it.start(
            *("-m", "services.sensors.lidar", "--name", "rover/lidar", "--connect", it.endpoint),
            *run,
            log="lidar",
        )
        wait_for(lambda: len(clouds) > 1, 60, f"clouds; {it.log('p')} {it.log('lidar')}")
    kept = {file.name for file in ours.iterdir()}
    assert kept == {file.name for file in theirs.iterdir()}
    monkeypatch.setenv(VARIABLE, str(ours))
    assert len(kept) == 2
    assert assets.missing(kept) == []
