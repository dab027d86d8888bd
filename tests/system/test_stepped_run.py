# SPDX-License-Identifier: Apache-2.0
"""System tests of runs that a program steps, with real processes."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

import groundlink
from groundlink.bus.queries import world_query_key
from groundlink.core.clock import TICK_RATE_HZ
from groundlink.core.errors import RunFailed, UserError
from groundlink.episode.journal import dumped, loaded
from groundlink.episode.world_queries import EntitiesQuery, UnloadWorldQuery
from groundlink.messages.base import Ack, Imu, PointCloud
from groundlink.scenario.faults import Bias, OccludedSector, Off, Stuck
from groundlink.sim.stepped_run import SteppedRun

from .rig import REPOSITORY, rig

pytestmark = pytest.mark.system

CLOUD_NANOS = 100_000_000


@pytest.fixture(scope="module")
def sim(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SteppedRun]:
    with (
        rig(tmp_path_factory.mktemp("sim")) as files,
        groundlink.run(files.scenario) as started,
    ):
        yield started


def drive(sim: SteppedRun) -> list[Any]:
    """Return what half a second of driving gives."""
    sim.step(0.1)
    sim.command("rover", 0.8, 0.4)
    sim.step(0.4)
    return [sim.latest(stream) for stream in sim.streams]


def test_step_returns_with_the_readings_up_to_its_end(sim: SteppedRun) -> None:
    sim.reset()
    assert sim.time_s == 0.0
    sim.step(0.25)
    assert sim.time_s == 0.25
    imu, cloud = sim.latest("rover/imu"), sim.latest("rover/lidar")
    assert isinstance(imu, Imu)
    assert isinstance(cloud, PointCloud)
    now = sim.latest("rover/ground_truth").stamp_nanos
    assert now - imu.stamp_nanos <= 1e9 / sim.scenario.sensor("rover/imu")[1].rate_hz  # type: ignore[index, attr-defined]
    assert CLOUD_NANOS <= now - cloud.stamp_nanos < 2 * CLOUD_NANOS
    sim.step()
    assert sim.time_s == pytest.approx(0.25 + sim.step_s)


def test_command_acts_in_the_next_tick_and_a_reset_takes_it_back(sim: SteppedRun) -> None:
    sim.reset()
    still = sim.latest("rover/ground_truth")
    first = drive(sim)
    moved = sim.latest("rover/ground_truth")
    assert moved.position_m[0] - still.position_m[0] != 0
    assert moved.linear_mps[0] > 0.3
    sim.reset()
    assert sim.latest("rover/lidar") is None
    assert drive(sim) == first


def test_physics_waits_for_each_of_several_commands(
    sim: SteppedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    sim.reset()
    sent: list[Ack] = []
    acknowledge = sim._acknowledge
    monkeypatch.setattr(sim, "_acknowledge", lambda ack: (sent.append(ack), acknowledge(ack))[1])
    sim.command("rover", 0.8, 0.4)
    sim.command("rover", 0.0, 0.0)
    sim.step()
    sim.command("rover", 0.8, 0.4)
    sim.step()
    tick = round(sim.step_s * TICK_RATE_HZ)
    assert [(ack.commanded, ack.commands) for ack in sent] == [
        ({"rover": 0}, {"rover": 2}),
        ({"rover": tick}, {}),
    ]


def test_sensors_in_one_process_give_the_same(sim: SteppedRun, tmp_path: Path) -> None:
    sim.reset()
    expected = drive(sim)
    with rig(tmp_path) as files, groundlink.run(files.scenario, sensors_together=True) as other:
        assert drive(other) == expected


def test_other_commands_join_the_run(sim: SteppedRun) -> None:
    sim.reset()
    where = ("--run", sim.name, "--connect", sim.endpoint)
    words = ("-m", "groundlink", "fault", "rover/imu", "stuck", *where)
    subprocess.run([sys.executable, *words], check=True, capture_output=True, timeout=60)
    sim.step(0.1)
    before = sim.latest("rover/imu").linear_acceleration_mps2
    sim.command("rover", 1.0, 0.0)
    sim.step(0.1)
    assert sim.latest("rover/imu").linear_acceleration_mps2 == before


def test_faults_begin_and_end_between_two_steps(sim: SteppedRun) -> None:
    sim.reset()
    sim.step(0.1)
    imu = sim.latest("rover/imu")
    (stuck,) = sim.fault("rover/imu", Stuck(for_s=5.0))
    assert isinstance(stuck, Stuck)
    assert stuck.begin_tick == round(sim.time_s * TICK_RATE_HZ) + 1
    assert len(sim.fault("rover/imu", Bias(value=1.0))) == 2
    sim.fault("rover/lidar", Off())
    sim.step(0.1)
    cloud = sim.latest("rover/lidar")  # its revolution began before the fault
    biased = np.array(sim.latest("rover/imu").linear_acceleration_mps2)
    np.testing.assert_allclose(biased - imu.linear_acceleration_mps2, 1.0, atol=0.15)
    sim.command("rover", 1.0, 0.0)
    sim.step(0.1)
    assert sim.latest("rover/lidar") == cloud
    assert sim.latest("rover/imu").linear_acceleration_mps2 == tuple(biased)
    for sensor in ("rover/imu", "rover/lidar"):
        sim.clear_faults(sensor)
    sim.step(0.2)
    assert sim.latest("rover/imu").linear_acceleration_mps2 != tuple(biased)
    assert sim.latest("rover/lidar") != cloud
    with pytest.raises(UserError, match="has no sensor `rover/imo`; did you mean `rover/imu`"):
        sim.fault("rover/imo", Off())
    with pytest.raises(UserError, match="rover/imu: `kind`: nothing can cover a sector"):
        sim.fault("rover/imu", OccludedSector(from_deg=0.0, to_deg=9.0))


def test_a_spawned_vehicle_drives_until_it_is_removed(sim: SteppedRun) -> None:
    sim.reset()
    before = dict(sim.streams)
    assert sim.spawn("rover", x_m=0.0, y_m=-1.0, yaw_deg=90.0, name="second") == "second"
    assert sim.spawn("box", x_m=-3.0, y_m=0.0) == "box"
    with pytest.raises(UserError, match="`crate` would be inside `box`"):
        sim.spawn("crate", x_m=-3.0, y_m=0.0)
    (box,) = sim.ask(EntitiesQuery("box"))["entities"]
    assert box["position_m"] == pytest.approx([-3.0, 0.0, 0.25])
    with pytest.raises(UserError, match="no entity `bax`"):
        sim.ask(EntitiesQuery("bax"))
    with pytest.raises(UserError, match="takes no UnloadWorldQuery"):
        sim.ask(UnloadWorldQuery())
    assert sim.latest("second/ground_truth") is None
    sim.step(0.1)
    sim.command("second", 0.5, 0.0)
    sim.step(0.4)
    (x_m, y_m, _), speed = (
        getattr(sim.latest("second/ground_truth"), name) for name in ("position_m", "linear_mps")
    )
    assert (x_m, y_m) == pytest.approx((0.0, -0.85), abs=0.06)
    assert speed[0] == pytest.approx(0.5, abs=0.05)
    for name in ("second", "box"):
        sim.remove(name)
    sim.step(0.1)
    assert sim.streams == before
    with pytest.raises(UserError, match="no vehicle `second`; expected one of rover"):
        sim.command("second", 0.0, 0.0)


ONE_OF_TWO = """
  - name: {0}
    model: rover
    placement: {{x_m: -4.6, y_m: {1}}}
    sensors:
      - {{kind: imu, datasheet: imu_mti1, name: imu, topic: /{0}/imu, frame: imu, mount: imu}}
    namespace: /{0}
    frame_prefix: {0}/
    command_topic: /{0}/cmd_vel
"""


def test_a_saved_state_is_restored_and_recorded(tmp_path: Path) -> None:
    scenario, saved = tmp_path / "two.yaml", tmp_path / "half_way.run"
    vehicles = [ONE_OF_TWO.format(name, y_m) for name, y_m in (("one", 0.0), ("two", -1.5))]
    scenario.write_text("name: two\nworld: lab\nvehicles:\n" + "".join(vehicles), "utf-8")

    def drive_on(sim: SteppedRun) -> list[Any]:
        sim.command("two", 0.8, 0.4)
        sim.step(0.4)
        return [sim.latest(stream) for stream in sim.streams]

    recording = tmp_path / "run.mcap"
    with groundlink.run(scenario, sensors_together=True, record=recording) as sim:
        sim.command("two", 0.5, 0.0)
        sim.step(0.5)
        sim.save(saved)
        expected = drive_on(sim)
        sim.restore(saved)
        assert sim.time_s == 0.5
        assert sim.latest("two/imu") is None
        assert drive_on(sim) == expected
        sim.remove("two")
        sim.step(0.1)
        assert set(sim.streams) == {"one/imu", "one/ground_truth", "one/vitals"}
    imu = expected[[*sim.streams].index("one/imu")]
    with groundlink.open(recording) as run:
        recorded = run.array("/one/imu")
        assert recorded["stamp"][-1] == imu.stamp_nanos
        assert recorded["linear_acceleration"][-1].tolist() == list(imu.linear_acceleration_mps2)
        assert len(recorded) == round(0.9 * 400) - 1
    with groundlink.open(tmp_path / "run_2.mcap") as run:
        last_s = run.poses("/one/ground_truth/odom").seconds[-1] - run.start_nanos / 1e9
        assert last_s == pytest.approx(1.0, abs=0.02)

    between = tmp_path / "between.run"
    journal = loaded(saved.read_bytes(), "saved")
    between.write_bytes(dumped(replace(journal, tick=journal.tick + 1)))
    with pytest.raises(UserError, match=r"run\.mcap: file exists"):
        groundlink.run(saved, record=recording)
    with groundlink.run(saved, sensors_together=True) as again:
        assert again.time_s == 0.5
        assert drive_on(again) == expected
        with pytest.warns(UserWarning, match="differs from the saved one"):
            again.restore(between)
        assert again.time_s == 0.5025
        again.step()
        assert again.time_s == 0.51
        with pytest.raises(UserError, match="not a saved run"):
            again.restore(scenario)


def printed_by_guide(name: str, folder: Path, number: int = 0) -> list[str]:
    """Return the lines that a program of a guide prints."""
    guides = REPOSITORY / "docs" / "how-to"
    pages = [(guides / file).read_text(encoding="utf-8") for file in ("python-run.md", name)]
    (scenario,) = re.findall(r"```yaml\n(.*?)```", pages[0], re.DOTALL)
    program = re.findall(r"```python\n(.*?)```", pages[1], re.DOTALL)[number]
    (folder / "small.yaml").write_text(scenario, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
        timeout=100,
    )
    return done.stdout.splitlines()


def test_the_programs_of_the_guide(tmp_path: Path) -> None:
    first, streams = printed_by_guide("python-run.md", tmp_path)
    (x_m,) = re.findall(r"^2\.0 s, x (-\d\.\d\d) m$", first)
    assert float(x_m) == pytest.approx(-3.75, abs=0.15)
    assert "'rover/scanner'" in streams
    lines = printed_by_guide("python-run.md", tmp_path, 1)
    found = [re.match(r"(\w+): nearest (.*) m, turning with (.*) rad/s$", line) for line in lines]
    names, nearest_m, turning = zip(*(one.groups() for one in found if one), strict=True)
    assert names == ("free", "barrel", "stuck")
    assert nearest_m[0] == nearest_m[2]
    assert 0.2 < float(nearest_m[1]) < float(nearest_m[0])
    assert turning[0] == turning[1] != turning[2]
    assert (tmp_path / "three_3.mcap").exists()


def test_the_policy_of_the_guide_reaches_its_goal(tmp_path: Path) -> None:
    (line,) = printed_by_guide("gymnasium.md", tmp_path)
    (returned,) = re.findall(r"^return (\d+\.\d\d), 1081 rays$", line)
    assert float(returned) > 11


def test_mistakes_name_what_is_expected(sim: SteppedRun) -> None:
    with pytest.raises(UserError, match=r"0\.013 s is no multiple of 0\.01 s"):
        sim.step(0.013)
    with pytest.raises(UserError, match="no vehicle `car`; expected one of rover"):
        sim.command("car", 0.0, 0.0)
    with pytest.raises(UserError, match=r"no stream `rover/radar`; expected one of .*rover/lidar"):
        sim.latest("rover/radar")
    with pytest.raises(UserError, match="nowhere"):
        groundlink.run("nowhere.yaml")


def test_run_that_cannot_go_on_says_why_and_leaves_no_process(tmp_path: Path) -> None:
    with rig(tmp_path) as files:
        text = files.scenario.read_text(encoding="utf-8")
        files.scenario.write_text(text.replace("name: imu,", "name: imu, bogus: 1,"), "utf-8")
        with pytest.raises(UserError, match="bogus"):
            groundlink.run(files.scenario)
    with rig(tmp_path) as files, groundlink.run(files.scenario) as run:
        processes = run.processes
        assert {"physics", "rover/imu+encoders", "rover/lidar"} <= set(processes)
        files.scenario.unlink()
        subprocess.run(["kill", "-KILL", str(processes["physics"])], check=True)
        with pytest.raises(RunFailed, match="physics ended the run"):
            run.step(0.1)
    for pid in processes.values():
        assert not Path(f"/proc/{pid}").exists()


def ask(sim: SteppedRun, query: str, **fields: object) -> dict[str, Any]:
    content = msgspec.json.encode({"query": query, **fields})
    replies = sim._bus.query(world_query_key(sim.name), seconds=10, content=content)
    answer: dict[str, Any] = msgspec.json.decode(next(iter(replies.values())))
    assert "error" not in answer, answer
    return answer


def test_what_a_tool_changes_is_restored_with_all_readings(sim: SteppedRun, tmp_path: Path) -> None:
    sim.reset()
    sim.step(0.2)
    ask(sim, "spawn", uri="person", name="tom", position_m=[-2.0, 1.0, 0.0])
    sim.step(0.1)
    placed = ask(
        sim,
        "place",
        name="rover",
        position_m=[-3.0, 0.5, 0.3],
        orientation=[0.0, 0.0, 1.0, 0.0],
        linear_mps=[-0.5, 0.0, 0.0],
    )
    assert placed["tick"] == round(0.3 * TICK_RATE_HZ) + 1
    ask(sim, "place", name="tom", position_m=[-2.0, -1.0, 0.0])
    sim.step(0.3)
    imu, cloud = sim.latest("rover/imu"), sim.latest("rover/lidar")
    assert np.isfinite([*imu.linear_acceleration_mps2, *imu.angular_velocity_radps]).all()
    assert np.isfinite(cloud.records()["x"]).all()
    sim.save(saved := tmp_path / "placed.run")
    sim.step(0.3)
    first = [sim.latest(stream) for stream in sim.streams]
    sim.restore(saved)
    sim.step(0.3)
    assert [sim.latest(stream) for stream in sim.streams] == first
    began = {entity["name"] for entity in ask(sim, "entities")["entities"]} - {"tom"}
    assert ask(sim, "reset", scopes=["time", "state", "spawned"])["tick"] == 0
    assert {entity["name"] for entity in ask(sim, "entities")["entities"]} == began
