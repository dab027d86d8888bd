# SPDX-License-Identifier: Apache-2.0
"""System tests of user errors: one clear line on stderr, exit code 2, no traceback."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from groundlink.bus.core_topics import STATE
from groundlink.bus.queries import scenario_key
from groundlink.bus.session import Bus
from groundlink.loader import load
from groundlink.messages.base import State

from .rig import LAB, REPOSITORY, Rig, rig, wait_for

pytestmark = pytest.mark.system


def run(it: Rig, *command: str, seconds: float = 30) -> str:
    """Return the one line with which a command ends."""
    done = subprocess.run(
        [sys.executable, *command],
        cwd=REPOSITORY,
        env=it.environment,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert "Traceback" not in done.stdout
    return lines[0]


@pytest.fixture(scope="module", autouse=True)
def in_vain(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[Rig, subprocess.Popen[str]]]:
    """A sensor at a router without a run, which looks for one while the other tests go on."""
    with rig(tmp_path_factory.mktemp("in_vain")) as there, Bus(listen=there.endpoint):
        words = ("--name", "rover/imu", "--connect", there.endpoint)
        yield there, there.start("-m", "services.sensors.imu", *words, log="imu.log")


@pytest.fixture
def it(tmp_path: Path) -> Iterator[Rig]:
    with rig(tmp_path) as ready:
        yield ready


def test_scenarios_that_cannot_be_run(it: Rig) -> None:
    text = LAB.read_text(encoding="utf-8")
    check = ("-m", "groundlink", "check", str(it.scenario))
    up = ("-m", "groundlink", "up", str(it.scenario))
    physics = ("-m", "services.physics", str(it.scenario))
    for wrong, words, commands in [
        (text.replace("seed: 1", "sede: 1"), ["sede", "did you mean `seed`?", ":5:"], [check, up]),
        (text.replace("seed: 1", "seed: x"), ["seed", "int", ":5:"], [check, physics]),
        (text.replace("vehicles/rover.yaml", "rovr"), ["rovr", "did you mean `rover`?"], [up]),
        (text.replace("kind: encoders", "kind: encoder"), ["encoder", "`encoders`?"], [physics]),
    ]:
        assert wrong != text
        it.scenario.write_text(wrong, encoding="utf-8")
        for command in commands:
            line = run(it, *command)
            for word in [*words, str(it.scenario)]:
                assert word in line, line


def test_a_missing_file(it: Rig) -> None:
    assert "no such file" in run(it, "-m", "groundlink", "up", "nowhere.yaml")


def test_arguments_that_make_no_sense(it: Rig) -> None:
    up = ("-m", "groundlink", "up", str(it.scenario))
    assert "more than 0" in run(it, *up, "--duration", "-3")
    assert "no such folder" in run(it, *up, "--report", "/nowhere/at/all.json")
    assert "not an endpoint" in run(it, *up, "--listen", "localhost:1")


def test_endpoint_without_router(it: Rig) -> None:
    for module in ("services.sensors.imu", "services.gateway"):
        name = ("--name", "rover/imu") if "imu" in module else ()
        line = run(it, "-m", module, *name, "--connect", it.endpoint)
        assert it.endpoint in line
        assert "within 5 s" in line


def test_a_listening_port_in_use(it: Rig) -> None:
    with socket.create_server(("127.0.0.1", int(it.endpoint.rpartition(":")[2]))):
        for command in (
            ("-m", "groundlink", "up", str(it.scenario)),
            ("-m", "services.physics", str(it.scenario)),
        ):
            line = run(it, *command, "--listen", it.endpoint)
            assert f"{it.endpoint}: the address is in use" in line


class Counterfeit:
    """Serves a scenario as physics would, with a world of another hash."""

    def __init__(self, bus: Bus, run: str) -> None:
        scenario = msgspec.msgpack.encode(load(LAB))
        bus.serve(scenario_key(run), lambda _: [scenario])
        self._publish = bus.publisher(STATE.key_in(run), STATE.delivery)
        self._tick = 0

    def step(self) -> None:
        self._tick += 1
        self._publish(State("x", 0, 0, self._tick, self._tick * 2_500_000, "0" * 64, {}))


def test_sensors_that_the_run_does_not_have(it: Rig) -> None:
    with Bus(listen=it.endpoint) as bus:
        Counterfeit(bus, "one")
        join = ("--connect", it.endpoint)
        line = run(it, "-m", "services.sensors.imu", "--name", "rover/imo", *join)
        assert "no sensor `rover/imo`" in line
        assert "did you mean `rover/imu`?" in line
        line = run(it, "-m", "services.sensors.imu", "--name", "rover/lidar", *join)
        assert "python -m services.sensors.lidar" in line
        line = run(it, "-m", "services.gateway", "--bind", "nonsense", *join)
        assert "`nonsense`: not an address" in line
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(it.bind)
            line = run(it, "-m", "services.gateway", "--bind", it.address(it.bind), *join)
            assert "in use" in line
            assert line.count("bind to") == line.count("gateway: ") == 1
        Counterfeit(bus, "two")
        line = run(it, "-m", "services.sensors.imu", "--name", "rover/imu", *join)
        assert "--run" in line
        assert "one" in line
        assert "two" in line


def test_a_world_that_differs(it: Rig) -> None:
    with Bus(listen=it.endpoint) as bus:
        counterfeit = Counterfeit(bus, "one")
        sensor = it.start(
            *("-m", "services.sensors.imu", "--name", "rover/imu", "--connect", it.endpoint),
            log="imu.log",
        )

        def ended() -> bool:
            counterfeit.step()
            return sensor.poll() is not None

        wait_for(ended, 20, "the sensor refuses to start")
    assert sensor.returncode == 2
    assert it.log("imu.log").count("\n") == 1
    assert "world hash differs" in it.log("imu.log")
    assert "000000000000" in it.log("imu.log")


def test_the_ros_nodes_port_in_use(it: Rig) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(it.peer)
        line = run(it, "-m", "udp_bridge_ros2", "--bind", it.address(it.peer))
        assert "in use" in line.lower()


def test_no_run_at_the_endpoint(in_vain: tuple[Rig, subprocess.Popen[str]]) -> None:
    there, sensor = in_vain
    assert sensor.wait(30) == 2
    assert there.log("imu.log").count("\n") == 1
    assert "no run on the bus" in there.log("imu.log")
    assert "within 20 s" in there.log("imu.log")
