# SPDX-License-Identifier: Apache-2.0
"""System tests of run control from ROS: pause, step and reset with lost datagrams."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.bus.core_topics import CLOCK
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Clock, PointCloud
from tests.ros.calling import Caller
from tests.ros.interfaces import simulation_interfaces

from .rig import Rig, rig, wait_for

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = [pytest.mark.system, pytest.mark.timeout(240)]  # it may compile the messages

SUCCEEDED, CANCELLED = 4, 5
STOPPED, PLAYING, PAUSED = range(3)
NO_WORLD = 4
UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, OPERATION_FAILED = range(5)
ALREADY_SO = NAME_TAKEN = NO_WORLD_LOADED = 101
NOT_THERE = 103
ROBOT, DYNAMIC_OBJECT = 1, 4
LOSSY = "link: {seed: 5, to_ros: {loss: 0.1}, from_ros: {loss: 0.1}}, "


@contextmanager
def running(
    folder: Path, *, gateway: str = "", interfaces: Path | None = None, sensor: str = "rover/imu"
) -> Iterator[tuple[Rig, Caller]]:
    """A run with one sensor, its gateway and the ROS node; yields the rig and a caller.

    With `interfaces` the caller calls the services of the standard, which are at `/`.
    """
    time_section = "time: {epoch: zero, clock_rate_hz: 400}\n"
    with rig(folder, time_section=time_section) as it:
        text = it.scenario.read_text(encoding="utf-8")
        it.scenario.write_text(text.replace("gateway: {", "gateway: {" + gateway), encoding="utf-8")
        if interfaces is not None:
            it.environment["PYTHONPATH"] = str(interfaces)
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        it.start(*physics, "--only", sensor, "--run", it.run, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        of_run = ("--run", it.run, "--connect", it.endpoint)
        it.start("-m", "services.gateway", *of_run, log="gateway.log")
        it.start("-m", "udp_bridge_ros2", "--bind", it.address(it.peer), log="node.log")
        caller = Caller(it.environment, "/udp_bridge" if interfaces is None else "")
        try:
            wait_for(lambda: caller.clock_nanos() > 0, 30, "the clock runs in ROS")
            yield it, caller
        finally:
            caller.close()


def test_the_standard_services(tmp_path: Path, pytestconfig: pytest.Config) -> None:
    interfaces = simulation_interfaces(pytestconfig.cache.mkdir("simulation_interfaces"))
    kinds = "simulation_interfaces/srv/"
    with running(tmp_path, interfaces=interfaces, sensor="rover/lidar") as (it, caller):

        def result(name: str, kind: str, /, **request: Any) -> tuple[int, str]:
            answer = caller.call(name, kinds + kind, **request)["result"]
            return answer["result"], answer["error_message"]

        def state() -> int:
            answer = caller.call("get_simulation_state", kinds + "GetSimulationState")
            assert answer["result"]["result"] == OK
            return int(answer["state"]["state"])

        def set_state(wanted: int) -> int:
            return result("set_simulation_state", "SetSimulationState", **{"state.state": wanted})[
                0
            ]

        def step(steps: int) -> tuple[int, str]:
            return result("step_simulation", "StepSimulation", steps=steps)

        def shows(nanos: int) -> None:
            wait_for(lambda: caller.clock_nanos() == nanos, 30, f"/clock shows {nanos}")

        def settled() -> int:
            """Return what the clock shows when all that was on its way has come."""
            wait_for(lambda: caller.clock_nanos() == caller.clock_nanos(), 10, "/clock stands")
            return caller.clock_nanos()

        features = caller.call("get_simulator_features", kinds + "GetSimulatorFeatures")
        assert features["features"]["features"] == [
            *(*range(15), 20, *range(22, 27), 31, 32, 33, *range(40, 46), 50)
        ]

        assert state() == PLAYING
        assert step(1)[0] == OPERATION_FAILED
        assert "pause it first" in step(1)[1]
        assert (set_state(PAUSED), state(), set_state(PAUSED)) == (OK, PAUSED, ALREADY_SO)
        paused_at = settled()

        for steps in (1, 400):
            assert step(steps) == (OK, "")
            paused_at += steps * TICK_NANOS
            shows(paused_at)
        assert step(0)[0] == OPERATION_FAILED

        kind = "simulation_interfaces/action/SimulateSteps"
        done = caller.act("simulate_steps", kind, steps=400)
        paused_at += 400 * TICK_NANOS
        assert (done["status"], done["result"]["result"]) == (SUCCEEDED, OK)
        shows(paused_at)
        completed = [told["completed_steps"] for told in done["feedback"]]
        assert completed
        assert completed == sorted({*completed})
        for told in done["feedback"]:
            assert told["completed_steps"] + told["remaining_steps"] == 400
        done = caller.act("simulate_steps", kind, steps=100_000, cancel=True)
        assert (done["status"], state()) == (CANCELLED, PAUSED)
        assert 0 <= settled() - paused_at < 100_000 * TICK_NANOS
        paused_at = settled()

        assert (set_state(PLAYING), state()) == (OK, PLAYING)
        wait_for(lambda: caller.clock_nanos() > paused_at, 30, "time goes on")
        assert (set_state(STOPPED), state()) == (OK, STOPPED)
        shows(0)
        assert step(1)[0] == OPERATION_FAILED
        assert (set_state(PAUSED), state()) == (OK, PAUSED)

        def names(**filters: Any) -> list[str]:
            filters = {f"filters.{name}": value for name, value in filters.items()}
            answer = caller.call("get_entities", kinds + "GetEntities", **filters)
            assert answer["result"]["result"] == OK, answer
            return list(answer["entities"])

        def about(name: str, kind: str, key: str, entity: str) -> Any:
            answer = caller.call(name, kinds + kind, entity=entity)
            assert answer["result"]["result"] == OK, answer
            return answer[key]

        def place_of(entity: str) -> list[float]:
            found = about("get_entity_state", "GetEntityState", "state", entity)
            assert found["header"]["frame_id"] == "world"
            return [found["pose"]["position"][axis] for axis in "xyz"]

        def spawn(x: float, y: float, **more: Any) -> tuple[int, str]:
            place = {"initial_pose.pose.position.x": x, "initial_pose.pose.position.y": y}
            answer = caller.call(
                "spawn_entity",
                kinds + "SpawnEntity",
                **{"entity_resource.uri": "crate"},
                **place,
                **more,
            )
            return answer["result"]["result"], answer["entity_name"]

        def place(entity: str, x: float, y: float, z: float) -> tuple[int, str]:
            position = {
                f"state.pose.position.{a}": v for a, v in zip("xyz", (x, y, z), strict=True)
            }
            return result(
                "set_entity_state", "SetEntityState", entity=entity, set_pose=True, **position
            )

        assert names(filter="rover.*") == ["rover"]
        assert spawn(-2.0, 0.5) == (OK, "crate")
        assert spawn(-2.0, -1.0, name="crate")[0] == NAME_TAKEN
        assert spawn(-2.0, -1.0, name="crate", allow_renaming=True) == (OK, "crate_2")
        assert names(filter="crate(_2)?") == ["crate", "crate_2"]
        assert place_of("crate")[:2] == [-2.0, 0.5]
        info = about("get_entity_info", "GetEntityInfo", "info", "crate")
        assert info["category"]["category"] == DYNAMIC_OBJECT
        described = {"info.category.category": ROBOT, "info.tags": ["red", "heavy"]}
        assert result("set_entity_info", "SetEntityInfo", entity="crate", **described)[0] == OK
        assert names(**{"tags.tags": ["red"]}) == ["crate"]
        assert about("get_entity_bounds", "GetEntityBounds", "bounds", "crate")["type"] == 1
        x, y, z = place_of("crate")
        assert place("crate", x - 0.3, y + 0.2, z)[0] == OK
        assert place_of("crate") == pytest.approx([x - 0.3, y + 0.2, z], abs=1e-6)
        states = caller.call("get_entities_states", kinds + "GetEntitiesStates")
        assert len(states["states"]) == len(states["entities"]) == len(names())
        assert result("delete_entity", "DeleteEntity", entity="crate_2") == (OK, "")
        assert result("delete_entity", "DeleteEntity", entity="crate_2")[0] == NOT_FOUND

        spawnables = caller.call("get_spawnables", kinds + "GetSpawnables")["spawnables"]
        assert {"crate", "rover"} <= {row["entity_resource"]["uri"] for row in spawnables}
        (pose,) = caller.call("get_named_poses", kinds + "GetNamedPoses")["poses"]
        assert pose["name"] == "rover_start"
        bounds = caller.call(
            "get_named_pose_bounds", kinds + "GetNamedPoseBounds", name="rover_start"
        )
        assert (bounds["result"]["result"], bounds["bounds"]["type"]) == (OK, 1)
        world = caller.call("get_current_world", kinds + "GetCurrentWorld")
        assert (world["result"]["result"], world["world"]["name"]) == (OK, "lab")
        worlds = caller.call("get_available_worlds", kinds + "GetAvailableWorlds")["worlds"]
        assert "indoor_lab" in [row["name"] for row in worlds]

        def reset(scope: int) -> int:
            return result("reset_simulation", "ResetSimulation", scope=scope)[0]

        start = place_of("rover")
        assert step(400) == (OK, "")
        assert place("rover", start[0] - 0.5, start[1], start[2])[0] == OK
        assert (reset(2), place_of("rover")) == (OK, pytest.approx(start))
        assert names(filter="crate") == ["crate"]
        assert (reset(4), names(filter="crate")) == (OK, [])
        shows(400 * TICK_NANOS)
        for scope, left in ((3, ["crate"]), (0, []), (255, []), (7, [])):
            if not names(filter="crate"):
                assert spawn(-2.0, 0.5) == (OK, "crate")
            assert step(8) == (OK, "")
            assert (reset(scope), state(), names(filter="crate")) == (OK, PAUSED, left)
            shows(0)
        assert reset(1) == UNSUPPORTED
        assert set_state(3) == UNSUPPORTED

        def load(world: str) -> tuple[int, str]:
            uri = {"world_resource.uri": world}
            answer = caller.call("load_world", kinds + "LoadWorld", **uri)
            return answer["result"]["result"], answer["world"]["name"]

        def farthest_m() -> float:
            """Return the largest range of a revolution of the present world."""
            while clouds.get(seconds=0.5):
                pass  # of the world before
            assert set_state(PLAYING) == OK
            for _ in range(2):
                arrived = clouds.get(seconds=30)
                assert arrived, "the scanner is silent"
            points = arrived[1].records()
            assert set_state(PAUSED) == OK
            return float(np.nanmax(np.hypot(points["x"], points["y"])))

        of_run = ("--run", it.run, "--connect", it.endpoint)
        lidar = ("-m", "services.sensors.lidar", "--name", "rover/lidar", *of_run)
        file = tmp_path / "run.mcap"
        with Bus(connect=it.endpoint) as bus:
            clouds: BusInbox[PointCloud] = BusInbox(depth=1000)
            key = SENSOR_TOPICS["lidar"].key_in(it.run, vehicle="rover", sensor="lidar")
            bus.subscribe(key, PointCloud, clouds)
            it.start(*lidar, log="lidar.log")
            recorder = it.start("-m", "services.recorder", "--out", str(file), *of_run, log="mcap")
            # A recording begins with the first clock, which a paused run does not send.
            assert set_state(PLAYING) == OK
            wait_for(file.exists, 60, "a recording is begun")
            assert set_state(PAUSED) == OK
            assert farthest_m() < 13.0, "the room has a length of 12 m"
            assert spawn(-2.0, 0.5) == (OK, "crate")
            assert load("/no/such/file.yaml")[0] == NOT_FOUND
            assert names(filter="crate") == ["crate"]
            assert (load("yard"), state()) == ((OK, "yard"), STOPPED)
            shows(0)
            assert names(filter="crate|room|rover") == ["rover"]
            assert place_of("rover")[:2] == pytest.approx([-8.0, -4.0])
            assert farthest_m() > 20.0, "the yard has a length of 60 m"
            recorder.send_signal(signal.SIGINT)
            assert recorder.wait(60) == 0
            assert result("unload_world", "UnloadWorld")[0] == OK
            assert (state(), names(), set_state(PLAYING)) == (NO_WORLD, [], NOT_THERE)
            assert result("unload_world", "UnloadWorld")[0] == NO_WORLD_LOADED
            assert result("get_current_world", "GetCurrentWorld")[0] == NO_WORLD_LOADED
            assert spawn(-2.0, 0.5)[0] == INCORRECT_STATE
            assert (load("indoor_lab"), state()) == ((OK, "lab"), STOPPED)
            assert place_of("rover") == pytest.approx(start)
            assert farthest_m() < 13.0
    words = (sys.executable, "-m", "groundlink", "verify", str(tmp_path / "run_2.mcap"))
    lines = it.scenario.read_text(encoding="utf-8").splitlines(keepends=True)
    only = "".join(line for line in lines if not re.match(r" +- {kind: (imu|encoders),", line))
    it.scenario.write_text(only, encoding="utf-8")
    words = (*words, str(it.scenario))
    verified = subprocess.run(words, capture_output=True, text=True, timeout=90, check=False)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert "/points" in verified.stdout


def test_plain_services_over_a_link_that_loses(tmp_path: Path) -> None:
    with running(tmp_path, gateway=LOSSY) as (it, caller), Bus(connect=it.endpoint) as bus:
        clocks: BusInbox[Clock] = BusInbox(depth=1_000_000)
        bus.subscribe(CLOCK.key_in(it.run), Clock, clocks)

        def tick(name: str, *, state: str = "paused") -> int:
            is_done, said = caller.trigger(name)
            assert is_done, said
            found = re.fullmatch(rf"{state} at tick (\d+)", said)
            assert found, said
            return int(found[1])

        refused, why = caller.trigger("step")
        assert (refused, why.startswith("the run is not paused but running at tick")) == (
            False,
            True,
        )
        at = tick("pause")
        for _ in range(10):
            assert tick("step") == at + 1
            at += 1
        for _ in range(10):
            assert tick("reset") == 0
        assert tick("step") == 1
        tick("resume", state="running")
        assert tick("state", state="running") >= 1
        tick("pause")
        episodes: set[int] = set()
        while arrived := clocks.get(seconds=0.5):
            episodes.add(arrived[1].episode)
        assert len(episodes) == 11, "each reset was done once"


def test_silent_process_is_named(tmp_path: Path) -> None:
    with running(tmp_path) as (it, caller):
        assert caller.trigger("resume")[0]
        physics, gateway, *_ = it.started
        physics.kill()
        physics.wait()
        is_done, said = caller.trigger("pause")
        assert (is_done, "physics does not answer" in said) == (False, True), said
        gateway.kill()
        gateway.wait()
        is_done, said = caller.trigger("pause")
        silent = f"the gateway at {it.address(it.bind)} was silent for 8 s"
        assert (is_done, said) == (False, silent)
