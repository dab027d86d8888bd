# SPDX-License-Identifier: Apache-2.0
"""System tests of run control from ROS: pause, step and reset with lost datagrams."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from groundlink.bus.core_topics import CLOCK
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Clock
from tests.ros.calling import Caller
from tests.ros.interfaces import simulation_interfaces

from .rig import Rig, rig, wait_for

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = pytest.mark.system

SUCCEEDED, CANCELLED = 4, 5
STOPPED, PLAYING, PAUSED = range(3)
OK, OPERATION_FAILED, UNSUPPORTED, ALREADY_SO = 1, 4, 0, 101
LOSSY = "link: {seed: 5, to_ros: {loss: 0.1}, from_ros: {loss: 0.1}}, "


@contextmanager
def running(
    folder: Path, *, gateway: str = "", interfaces: Path | None = None
) -> Iterator[tuple[Rig, Caller]]:
    """A run with an IMU, its gateway and the ROS node; yields the rig and a caller."""
    time_section = "time: {epoch: zero, clock_rate_hz: 400}\n"
    with rig(folder, time_section=time_section) as it:
        text = it.scenario.read_text(encoding="utf-8")
        it.scenario.write_text(text.replace("gateway: {", "gateway: {" + gateway), encoding="utf-8")
        if interfaces is not None:
            it.environment["PYTHONPATH"] = str(interfaces)
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        it.start(*physics, "--only", "rover/imu", "--run", it.run, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        of_run = ("--run", it.run, "--connect", it.endpoint)
        it.start("-m", "services.gateway", *of_run, log="gateway.log")
        it.start("-m", "udp_bridge_ros2", "--bind", it.address(it.peer), log="node.log")
        caller = Caller(it.environment)
        try:
            wait_for(lambda: caller.clock_nanos() > 0, 30, "the clock runs in ROS")
            yield it, caller
        finally:
            caller.close()


def test_the_standard_services(tmp_path: Path, pytestconfig: pytest.Config) -> None:
    interfaces = simulation_interfaces(pytestconfig.cache.mkdir("simulation_interfaces"))
    kinds = "simulation_interfaces/srv/"
    with running(tmp_path, interfaces=interfaces) as (_, caller):

        def result(name: str, kind: str, **request: Any) -> tuple[int, str]:
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
            wait_for(lambda: caller.clock_nanos() == nanos, 10, f"/clock shows {nanos}")

        def settled() -> int:
            """Return what the clock shows when all that was on its way has come."""
            wait_for(lambda: caller.clock_nanos() == caller.clock_nanos(), 10, "/clock stands")
            return caller.clock_nanos()

        features = caller.call("get_simulator_features", kinds + "GetSimulatorFeatures")
        assert features["features"]["features"] == [20, 21, 22, 24, 25, 26, 31, 32, 33]

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
        assert done["feedback"]
        for told in done["feedback"]:
            assert told["completed_steps"] + told["remaining_steps"] == 400
        done = caller.act("simulate_steps", kind, steps=100_000, cancel=True)
        assert (done["status"], state()) == (CANCELLED, PAUSED)
        assert 0 <= settled() - paused_at < 100_000 * TICK_NANOS
        paused_at = settled()

        assert (set_state(PLAYING), state()) == (OK, PLAYING)
        wait_for(lambda: caller.clock_nanos() > paused_at, 10, "time goes on")
        assert (set_state(STOPPED), state()) == (OK, STOPPED)
        shows(0)
        assert (set_state(PAUSED), state()) == (OK, PAUSED)
        assert step(8) == (OK, "")
        for scope in (0, 3, 255):
            assert result("reset_simulation", "ResetSimulation", scope=scope) == (OK, "")
            assert state() == PAUSED
            shows(0)
        for scope in (1, 2, 4):
            assert result("reset_simulation", "ResetSimulation", scope=scope)[0] == UNSUPPORTED
        assert set_state(3) == UNSUPPORTED


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
