# SPDX-License-Identifier: Apache-2.0
"""System tests of a sensor kind from another distribution, with all features of shipped kinds.

No module of Groundlink refers to that kind.
"""

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from groundlink.recording.reader import Recording
from groundlink.ros.types import STORE, nanos
from tests.ros_domains import next_domain
from tests.system.rig import REPOSITORY, free_port, wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

EXAMPLE = REPOSITORY / "examples" / "magnetometer_sensor"
TOPIC, ROS_TYPE = "/magnetic_field", "sensor_msgs/msg/MagneticField"
BIAS_T = 1e-5

SCENARIO = """\
name: compass
world: lab
time: {{mode: lockstep}}
vehicles:
  - name: rover
    model: rover
    sensors:
      - name: compass
        datasheet: hmc5883l
        topic: {topic}
        frame: compass
        faults: [{{kind: bias, at_s: 1.0, for_s: 1.0, value: [{bias:.1e}, 0.0, 0.0]}}]
      - {{name: encoders, kind: encoders, topic: /wheel_encoders, frame: base_link}}
gateway: {{bind: "127.0.0.1:{bind}", peer: "127.0.0.1:{peer}"}}
"""

OBSERVER = f"""
import json, sys, rclpy
from sensor_msgs.msg import MagneticField
rclpy.init()
node = rclpy.create_node("observer")
def take(message):
    print(json.dumps([message.header.frame_id, message.magnetic_field.z]), flush=True)
node.create_subscription(MagneticField, "{TOPIC}", take, 10)
print("ready", flush=True)
rclpy.spin(node)
"""


class Installed:
    """The example in a folder of its own, and commands that find it there."""

    def __init__(self, folder: Path) -> None:
        self.folder, packages = folder, folder / "packages"
        source = shutil.copytree(EXAMPLE, folder / "source")
        pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index")
        where = ("--no-build-isolation", "--target", str(packages), str(source))
        subprocess.run([*pip, *where], check=True, cwd=folder)
        domain = {"ROS_DOMAIN_ID": str(next_domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        self.without = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | domain
        self.environment = self.without | {"PYTHONPATH": str(packages)}
        ports = {"bind": free_port(), "peer": free_port()}
        self.scenario = folder / "compass.yaml"
        self.scenario.write_text(SCENARIO.format(topic=TOPIC, bias=BIAS_T, **ports))

    def groundlink(self, *words: object, environment: Mapping[str, str] | None = None) -> str:
        """Run a command in the folder and return its output."""
        done = self.tried(*words, environment=environment)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    def tried(
        self, *words: object, environment: Mapping[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        """Run a command in the folder and return how it ended."""
        return subprocess.run(
            [sys.executable, "-m", "groundlink", *map(str, words)],
            cwd=self.folder,
            env=dict(environment or self.environment),
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    return Installed(tmp_path_factory.mktemp("foreign"))


@pytest.fixture(scope="module")
def recording(installed: Installed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the recording of a run through ROS 2, in which an observer saw the field."""
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    folder = tmp_path_factory.mktemp("run")
    file, heard = folder / "run.mcap", folder / "heard.txt"
    with heard.open("w") as output:
        observer = subprocess.Popen(
            [sys.executable, "-c", OBSERVER], stdout=output, env=installed.environment
        )
    try:
        wait_for(lambda: "ready" in heard.read_text(), 30, "the observer is ready")
        endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
        done = installed.tried(
            *("up", installed.scenario, "--duration", 3, "--record", file, "--listen", endpoint)
        )
        # A busy machine may keep no rate, but everything is recorded and the field is heard.
        said = done.stdout + done.stderr
        assert done.returncode in (0, 1), said
        assert f"recorder: wrote {file}" in said
        wait_for(lambda: len(heard.read_text().splitlines()) > 1, 10, f"the field is heard: {said}")
    finally:
        observer.kill()
        observer.wait(10)
    frame, up_t = json.loads(heard.read_text().splitlines()[1])
    assert frame == "compass"
    assert up_t == pytest.approx(-45e-6, abs=5e-6)
    return file


def test_the_examples_own_tests_pass(installed: Installed) -> None:
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(EXAMPLE / "tests")],
        cwd=REPOSITORY,
        env=installed.environment,
        check=True,
    )


def test_it_is_checked_listed_and_in_the_schema(installed: Installed) -> None:
    checked = installed.groundlink("check", installed.scenario)
    assert f"rover/compass (magnetometer): {TOPIC}, 75 Hz" in checked
    assert "messages of up to 124 bytes in 1 datagram" in checked
    assert "fault {kind: bias" in checked
    assert "HMC5883L" in installed.groundlink("sensors")
    assert "Honeywell" in installed.groundlink("sensors", "show", "hmc5883l")
    schema = json.loads(installed.groundlink("schema", "scenario"))
    assert "Magnetometer" in schema["$defs"]
    containers = installed.groundlink("compose", installed.scenario)
    assert "command: [magnetometer_sensor, --name, rover/compass]" in containers


def test_a_mistake_is_one_line(installed: Installed) -> None:
    wrong = installed.folder / "wrong.yaml"
    wrong.write_text(installed.scenario.read_text().replace("kind: bias", "kind: occluded_sector"))
    done = installed.tried("check", wrong)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1


def test_its_fault_is_recorded(recording: Path) -> None:
    with Recording(recording) as opened:
        assert opened.types[TOPIC] == ROS_TYPE
        readings = [
            STORE.deserialize_cdr(bytes(found.cdr), ROS_TYPE) for found in opened.read([TOPIC])
        ]
        begin = opened.run.epoch_nanos
    seconds = np.array([(nanos(found.header.stamp) - begin) / 1e9 for found in readings])
    east_t = np.array([found.magnetic_field.x for found in readings])
    during_fault = (seconds >= 1.0) & (seconds < 2.0)
    assert east_t[during_fault].mean() - east_t[~during_fault].mean() == pytest.approx(
        BIAS_T, rel=0.1
    )


def test_it_is_verified_converted_drawn_and_reported(installed: Installed, recording: Path) -> None:
    assert "identical" in installed.groundlink("verify", recording, installed.scenario)
    installed.groundlink("convert", recording, "run.bag")
    with AnyReader([installed.folder / "run.bag"]) as bag:
        types = {found.topic: found.msgtype for found in bag.connections}
    assert types[TOPIC] == ROS_TYPE
    installed.groundlink("view", recording, "--save", "run.rrd")
    assert b"compass/field" in (installed.folder / "run.rrd").read_bytes()
    installed.groundlink("report", recording, "--out", "run.html")
    assert TOPIC in (installed.folder / "run.html").read_text()


def test_it_is_replayed(installed: Installed, recording: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    replay = subprocess.Popen(
        [
            *(sys.executable, "-m", "groundlink", "replay", str(recording), "--loop"),
            *("--no-ros", "--no-gateway", "--listen", endpoint),
        ],
        cwd=installed.folder,
        env=installed.environment,
    )
    try:
        recorder = ("-m", "services.recorder", "--out", "again.mcap", "--duration", "1")
        subprocess.run(
            [sys.executable, *recorder, "--connect", endpoint],
            cwd=installed.folder,
            env=installed.environment,
            check=True,
            timeout=60,
        )
    finally:
        replay.terminate()
        replay.wait(20)
    with Recording(installed.folder / "again.mcap") as again:
        assert again.topics[TOPIC].messages >= 50


def test_without_the_package_its_recording_is_read_and_the_package_named(
    installed: Installed, recording: Path
) -> None:
    bare = installed.without
    installed.groundlink("convert", recording, "bare.bag", environment=bare)
    installed.groundlink("report", recording, "--out", "bare.html", environment=bare)
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    done = installed.tried(
        *("replay", recording, "--factor", 100, "--no-ros", "--no-gateway", "--listen", endpoint),
        environment=bare,
    )
    assert "sensor `compass`: the kind `magnetometer` is not installed here" in done.stdout
    assert "pip install magnetometer-sensor" in done.stdout


def test_nothing_of_groundlink_knows_it() -> None:
    """Only its folder, its page and tests name the example's kind."""
    found = subprocess.run(
        [
            "git",
            "grep",
            "-il",
            "magnetometer",
            "--",
            "*.py",
            "*.toml",
            "*.yaml",
            ":!examples",
            ":!tests",
        ],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.split()
    assert found == []
