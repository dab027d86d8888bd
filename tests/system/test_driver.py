# SPDX-License-Identifier: Apache-2.0
"""System tests of the autopilot: identical bytes in fast mode, and arrival at the route's end."""

import hashlib
import os
import signal
import time
from pathlib import Path

import pytest
from msgspec.structs import replace

from groundlink.bus.core_topics import COMMAND, STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import Command, State, encode

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

TICKS = 6000

SCENARIO = """\
name: driven
seed: 1
world: worlds/lab.yaml
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    placement: {x_m: -2.0}
    sensors:
      - {kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link}
    route: {kind: square, side_m: 0.6, speed_mps: 0.8}
time: {mode: fast, epoch: zero}
"""


def driven(it: Rig, *, disturbed: bool) -> tuple[str, list[Command]]:
    """Return the hash of all states of a run up to `TICKS`, and the driver's commands."""
    it.scenario.write_text(SCENARIO, encoding="utf-8")
    it.start("-m", "services.physics", str(it.scenario), "--listen", it.endpoint, log="physics.log")
    wait_for(it.is_answered, 20, "physics listens")
    states: BusInbox[State] = BusInbox(depth=2 * TICKS)
    commands: BusInbox[Command] = BusInbox(depth=TICKS)
    with Bus(connect=it.endpoint) as bus:
        bus.subscribe(STATE.key_in("driven"), State, states)
        bus.subscribe(COMMAND.key_in("driven", vehicle="rover"), Command, commands)
        processes = ["driver", "encoders"] if disturbed else ["encoders", "driver"]
        pids = {}
        for name in processes:
            module = "services.driver" if name == "driver" else f"services.sensors.{name}"
            join = ("--name", f"rover/{name}", "--connect", it.endpoint)
            pids[name] = it.start("-m", module, *join, log=f"{name}.log").pid
        digest, ticks = hashlib.sha256(), []
        while not ticks or ticks[-1] < TICKS:
            arrived = states.get(seconds=60)
            assert arrived, it.log("physics.log") + it.log("driver.log")
            if arrived[1].tick == 0:
                continue  # was published before this test listened, or not
            ticks.append(arrived[1].tick)
            digest.update(encode(replace(arrived[1], episode=0)))
            if disturbed and arrived[1].tick == 1001:
                os.kill(pids["driver"], signal.SIGSTOP)
                time.sleep(0.3)
                os.kill(pids["driver"], signal.SIGCONT)
        assert ticks == list(range(1, TICKS + 1))
    sent = []
    while len(commands) and (command := commands.get(seconds=0)):
        sent.append(command[1])
    return digest.hexdigest(), sent


def test_a_killed_driver_is_waited_for_and_its_successor_drives_on(tmp_path: Path) -> None:
    with rig(tmp_path) as it:
        # At a pace at which the first does not come to the end before it is killed.
        paced = SCENARIO.replace("mode: fast", "mode: lockstep, factor: 3")
        it.scenario.write_text(paced, encoding="utf-8")
        physics = ("-m", "services.physics", str(it.scenario), "--listen", it.endpoint)
        it.start(*physics, log="physics.log")
        wait_for(it.is_answered, 20, "physics listens")
        states: BusInbox[State] = BusInbox(depth=2 * TICKS)
        driver = ("-m", "services.driver", "--name", "rover/driver", "--connect", it.endpoint)
        sensor = ("-m", "services.sensors.encoders", "--name", "rover/encoders")
        with Bus(connect=it.endpoint) as bus:
            bus.subscribe(STATE.key_in("driven"), State, states)
            first = it.start(*driver, log="first.log")
            it.start(*sensor, "--connect", it.endpoint, log="encoders.log")

            def reached(tick: int) -> bool:
                while arrived := states.get(seconds=0):
                    if arrived[1].tick >= tick:
                        return True
                return False

            wait_for(lambda: reached(1000), 30, "the run goes on")
            first.kill()
            first.wait()
            while states.get(seconds=0.5):
                pass  # what physics may still step, and then no more
            it.start(*driver, log="second.log")
            wait_for(lambda: reached(TICKS), 30, "the run goes on again")
            wait_for(lambda: "the route is driven" in it.log("second.log"), 30, "it is driven")


def test_two_fast_runs_give_the_same_states_and_the_route_ends(tmp_path: Path) -> None:
    """Whoever starts first, and although the driver stands still for a while in one of them."""
    (tmp_path / "again").mkdir()
    with rig(tmp_path) as it, rig(tmp_path / "again") as other:
        digest, sent = driven(it, disturbed=False)
        assert driven(other, disturbed=True)[0] == digest
        assert sent[-1].linear_mps == sent[-1].angular_radps == (0.0, 0.0, 0.0)
        assert 200 < len(sent) < TICKS / 8
        said = "rover/driver: the route is driven; stopped at"
        assert it.log("driver.log").count(said) == 1
