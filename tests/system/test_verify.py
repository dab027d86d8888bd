# SPDX-License-Identifier: Apache-2.0
"""System tests of `groundlink verify`: it reproduces recordings exactly and names differences."""

import math
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader

from groundlink.__main__ import main
from groundlink.bus.core_topics import CLOCK, COMMAND
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import faults_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import JOINT_COMMAND, JOINTS
from groundlink.core.clock import NANOS
from groundlink.episode.fault_messages import CLEAR
from groundlink.messages.base import Clock, Command, floats, packed
from groundlink.messages.navigation import JointState
from groundlink.recording.mcap_file import McapFile
from groundlink.scenario.faults import Bias, Stuck

from .determined import SCENARIO
from .rig import REPOSITORY, children_of, free_port, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

SECONDS = 4.0


def groundlink(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "groundlink", *words],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )


def write_scenario(folder: Path, change: Callable[[str], str] = str) -> Path:
    """Write the scenario with every kind of sensor, in which the rover drives."""
    file = folder / "every_sensor.yaml"
    file.write_text(change(SCENARIO.read_text(encoding="utf-8")), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a recording of a run in which the rover drives, and its scenario."""
    folder = tmp_path_factory.mktemp("recorded")
    scenario, out = write_scenario(folder), folder / "run.mcap"
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    done = groundlink(
        *("record", str(scenario), "--out", str(out), "--duration", str(SECONDS)),
        *("--listen", endpoint),
    )
    assert out.exists(), done.stdout + done.stderr
    return out, scenario


def copied(recording: Path, out: Path, topic: str, number: int, place: int) -> None:
    """Copy a recording with one bit changed: in a byte of one message of a topic."""
    with recording.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        file = McapFile(out, profile=reader.get_header().profile, library="test")
        for schema in summary.schemas.values():
            assert file.add_schema(schema.name, schema.encoding, schema.data) == schema.id
        for channel in summary.channels.values():
            file.add_channel(
                channel.topic, channel.schema_id, channel.message_encoding, channel.metadata
            )
        *others, last = reader.iter_metadata()
        for record in others:
            file.add_metadata(record.name, record.metadata)
        for attachment in reader.iter_attachments():
            file.add_attachment(
                attachment.name, attachment.media_type, attachment.log_time, attachment.data
            )
        count = 0
        for _, channel, message in reader.iter_messages():
            body = bytearray(message.data)
            count += channel.topic == topic
            if channel.topic == topic and count == number:
                body[place] ^= 1
            file.write(channel.id, message.log_time, message.sequence, bytes(body))
        file.commit(last.name, last.metadata)
        file.close()


def test_every_kind_of_sensor_comes_out_again(run: tuple[Path, Path]) -> None:
    done = groundlink("verify", *map(str, run))
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"identical: \d{4} messages of \d\d topics", done.stdout)
    for topic in ("/points", "/scan", "/imu", "/fix", "/sonar", "/camera/image_raw/compressed"):
        assert re.search(rf"(?m)^\W*{topic} ", done.stdout), done.stdout


def test_a_changed_byte_and_a_changed_scenario_are_named(
    run: tuple[Path, Path], tmp_path: Path
) -> None:
    changed = tmp_path / "changed.mcap"
    # In the fifth cloud, of which faults have taken nothing yet: a point's `ring`.
    copied(run[0], changed, "/points", 5, -1 - 22 * 10 + 16)
    noisier = write_scenario(
        tmp_path, lambda text: text.replace("missed_ticks: 0.01", "missed_ticks: 0.02")
    )
    done = groundlink("verify", str(changed), str(noisier))
    assert done.returncode == 1, done.stdout + done.stderr
    said = done.stdout.splitlines()
    assert said[0] == (
        "scenario differs: vehicles[0].sensors[5].missed_ticks (rover, worn): "
        "0.01 recorded, 0.02 repeated"
    )
    matches = [re.fullmatch(r"(first difference|and): (/\w+) (at .*)", line) for line in said]
    found = [match for match in matches if match]
    assert [match[1] for match in found] == ["first difference", "and", "and"]
    differing = {match[2]: match[3] for match in found}
    assert differing.keys() == {"/points", "/worn_encoders", "/odom"}
    assert re.search(
        r": ticks\[\d\] \(\w+\): -?\d+ recorded, -?\d+ repeated; \d of \d numbers differ$",
        differing["/worn_encoders"],
    )
    byte = re.fullmatch(
        r"at 0\.4\d* s \(stamp \d+\.\d{9}\), message 5 of \d+: "
        r"data: point (\d+), field ring: \d+ recorded, \d+ repeated; 1 of (\d+) points differ",
        differing["/points"],
    )
    assert byte, differing
    assert int(byte[1]) == int(byte[2]) - 10


def by_hand(text: str) -> str:
    """Return a scenario without its route."""
    return re.sub(r"(?m)^    route: .*\n", "", text)


def test_a_run_in_real_time_with_people_and_accidents_in_it(tmp_path: Path) -> None:
    """Commands and faults at any instant, sensors that come late or never, a recorder killed."""
    scenario, out = write_scenario(tmp_path, by_hand), tmp_path / "run.mcap"
    with rig(tmp_path) as it:
        joining = ("--connect", it.endpoint, "--run", it.run)
        physics = it.start(
            *("-m", "services.physics", str(scenario), "--listen", it.endpoint, "--run", it.run),
            log="physics.log",
        )
        wait_for(it.is_answered, 20, "physics listens")
        for sensor in ("imu", "encoders", "lidar", "scanner", "odometry", "gnss"):
            it.start(*("-m", "services.sensors", "--name", f"rover/{sensor}"), *joining, log=sensor)
        recorder = it.start(
            *("-m", "services.recorder", "--out", str(out)), *joining, log="recorder.log"
        )
        wait_for(out.exists, 20, "it records")
        draw = random.Random(1)
        requests = [(1.0, Stuck()), (2.0, Bias(value=0.5)), (3.0, CLEAR)]
        with Bus(connect=it.endpoint) as bus:
            command = bus.publisher(COMMAND.key_in(it.run, vehicle="rover"), COMMAND.delivery)
            clocks: BusInbox[Clock] = BusInbox(depth=1)
            bus.subscribe(CLOCK.key_in(it.run), Clock, clocks)
            # Behind the rover, however far it has come when the command has started.
            spawn = it.start(
                *("-m", "groundlink", "spawn", "box", "--at=-12,-4"), *joining, log="spawn.log"
            )
            begin, spawned = None, math.inf
            while arrived := clocks.get(seconds=20):
                now = arrived[1].stamp_nanos
                begin = begin or now
                seconds = (now - begin) / NANOS
                if spawn.poll() is not None:
                    spawned = min(spawned, seconds)
                if seconds > max(5.0, spawned + 3.0):
                    break
                stamp = now + draw.randrange(-NANOS // 10, NANOS // 10)
                linear, angular = (draw.uniform(0.0, 1.5), 0.0, 0.0), (0.0, 0.0, draw.gauss())
                command(Command(stamp, linear, angular))
                if requests and seconds > requests[0][0]:
                    request = requests.pop(0)[1]
                    said = (
                        request
                        if isinstance(request, str)
                        else msgspec.json.encode(request).decode()
                    )
                    assert bus.query(faults_key(it.run, "rover/imu"), said, seconds=5.0)
                time.sleep(draw.uniform(0.0, 0.2))
        assert (requests, spawn.returncode) == ([], 0), it.log("spawn.log")
        os.kill(recorder.pid, signal.SIGKILL)
        assert physics.poll() is None
    done = groundlink("verify", str(out), str(scenario))
    assert done.returncode == 0, done.stdout + done.stderr
    names = ("camera", "worn", "sonar", "radar", "depth", "stereo")
    absent = ", ".join(f"rover/{name}" for name in names)
    assert f"no messages recorded of {absent}:" in done.stdout
    assert (
        "faults of `rover/imu` were changed during the run and are repeated: stuck, bias"
        in done.stdout
    )
    assert "the recording was ended early: compared up to " in done.stdout
    assert re.search(r"identical: \d{4} messages of \d\d topics", done.stdout)


TANK = """\
name: turret
seed: 3
world: worlds/yard.yaml
vehicles:
  - name: tank
    model: vehicles/tank.yaml
    from_ros: {joints: /joint_commands}
    sensors:
      - {kind: lidar_2d, datasheet: sensors/rplidar_a2.yaml, name: scanner, topic: /scan,
         frame: scan_link, mount: {xyz_m: [0.22, 1.4, 1.4]}}
"""


def test_joints_that_were_commanded_on_the_bus_turn_again(tmp_path: Path) -> None:
    """The scanner beside the turret sees it turn."""
    scenario, out = tmp_path / "turret.yaml", tmp_path / "run.mcap"
    scenario.write_text(TANK, encoding="utf-8")
    with rig(tmp_path) as it:
        joining = ("--connect", it.endpoint, "--run", it.run)
        it.start(
            *("-m", "services.physics", str(scenario), "--listen", it.endpoint, "--run", it.run),
            log="physics.log",
        )
        wait_for(it.is_answered, 20, "physics listens")
        it.start("-m", "services.sensors", "--name", "tank/scanner", *joining, log="scanner")
        recorder = it.start(
            *("-m", "services.recorder", "--out", str(out)), *joining, log="recorder.log"
        )
        wait_for(out.exists, 20, "it records")
        with Bus(connect=it.endpoint) as bus:
            key = JOINT_COMMAND.key_in(it.run, vehicle="tank")
            command = bus.publisher(key, JOINT_COMMAND.delivery)
            truths: BusInbox[JointState] = BusInbox(depth=1)
            bus.subscribe(JOINTS.key_in(it.run, vehicle="tank"), JointState, truths)
            nothing, wanted, turned = packed(np.zeros(0)), [(0.3, 0.1), (-0.2, 0.0)], False
            while arrived := truths.get(seconds=20):
                now = arrived[1]
                at = floats(now.positions).tolist()
                if turned and at == [*wanted[0]]:
                    wanted.pop(0)
                    turned = False
                if not wanted:
                    break
                if not turned:
                    positions = packed(np.array(wanted[0]))
                    command(JointState(now.stamp_nanos, "", now.names, positions, *2 * (nothing,)))
                    turned = True
        recorder.send_signal(signal.SIGINT)
        recorder.wait(20)
    done = groundlink("verify", str(out), str(scenario))
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"identical: \d+ messages of \d+ topics", done.stdout)
    for topic in ("/ground_truth/joints", "/scan"):
        assert topic in done.stdout, done.stdout
    assert "an input of the run, applied again from the recording" in done.stdout


def test_ctrl_c_ends_all_of_it(run: tuple[Path, Path], tmp_path: Path) -> None:
    with rig(tmp_path) as it:
        verify = it.start("-m", "groundlink", "verify", *map(str, run), log="verify.log")
        children = wait_for(
            lambda: len(found := children_of(verify.pid)) > 7 and found, 40, "all are there"
        )
        verify.send_signal(signal.SIGINT)
        assert verify.wait(30) == 1
        said = it.log("verify.log")
    assert "ended early: nothing was compared" in said
    assert "Traceback" not in said
    assert not [pid for pid in children if Path(f"/proc/{pid}").exists()]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("{scenario}", "{scenario}"), "not a recording of a run"),
        (("{run}", "{folder}/nothing.yaml"), "no such file"),
        (("{folder}/cut.mcap", "{scenario}"), "not a recording of a run"),
        (("{folder}/nothing.mcap", "{scenario}"), "no such file"),
    ],
    ids=["no recording", "no scenario", "cut off", "nothing"],
)
def test_mistakes_are_one_line(
    run: tuple[Path, Path],
    tmp_path: Path,
    words: tuple[str, ...],
    why: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "cut.mcap").write_bytes(run[0].read_bytes()[:-1000])
    names = {"run": run[0], "scenario": run[1], "folder": tmp_path}
    assert main(["verify", *(word.format(**names) for word in words)]) == 2
    said = capsys.readouterr()
    assert why in said.err
    assert (said.out, said.err.count("\n")) == ("", 1)
