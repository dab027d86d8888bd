# SPDX-License-Identifier: Apache-2.0
"""System tests of sensor faults, by scenario and by command: visible in ROS and recorded."""

import itertools
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from groundlink.recording.reader import Recording
from groundlink.report.analysis.diagnostics import SensorFaultHistory
from groundlink.ros.diagnostics import from_faults
from groundlink.ros.types import STORE

from .rig import REPOSITORY, Observer, Rig, rig, wait_for

pytestmark = pytest.mark.system


def fault(it: Rig, *words: str, code: int = 0) -> str:
    """Return what `groundlink fault` prints."""
    done = subprocess.run(
        [sys.executable, "-m", "groundlink", "fault", *words, "--connect", it.endpoint],
        cwd=REPOSITORY,
        env=it.environment,
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stderr if code else done.stdout


def with_faults_of_the_wheels(it: Rig) -> None:
    text = it.scenario.read_text(encoding="utf-8")
    old = "{kind: encoders, "
    assert text.count(old) == 1
    new = old + "faults: [{kind: off, at_s: 1.0, for_s: 1.5}], "
    it.scenario.write_text(text.replace(old, new), encoding="utf-8")


def told(path: Path, sensor: str) -> SensorFaultHistory:
    failures = SensorFaultHistory(sensor)
    with Recording(path) as recording:
        for message in recording.read([f"/faults/{sensor}"]):
            array = STORE.deserialize_cdr(message.cdr, message.ros_type)
            seconds = (message.nanos - recording.run.epoch_nanos) / 1e9
            failures.add(seconds, from_faults(array))
    return failures


def times(path: Path, topic: str) -> list[float]:
    with Recording(path) as recording:
        epoch = recording.run.epoch_nanos
        return [(message.nanos - epoch) / 1e9 for message in recording.read([topic])]


def test_sensors_fail_and_recover_in_ros_and_in_a_recording(tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    with rig(tmp_path) as it:
        with_faults_of_the_wheels(it)
        observer = Observer(it)
        up = it.up("--record", str(out))
        wait_for(lambda: observer.count("/imu") > 400, 40, "the IMU is heard")
        wait_for(lambda: observer.count("/points") > 3, 40, "the LiDAR is heard")

        def last(topic: str) -> list[dict[str, Any]]:
            return observer.read()[topic][-20:]

        answer = fault(it, "rover/imu", "stuck", "--for", "1.5")
        assert "{kind: stuck, at_s: " in answer
        fault(it, "rover/lidar", "occluded_sector", "from_deg=-90", "to_deg=90")

        def was_stuck() -> bool:
            """Return whether what ended 1.5 s after it began did so in ROS."""
            readings = observer.read()["/imu"]
            runs = itertools.groupby(readings, lambda reading: reading["acceleration"])
            lengths = [len({reading["stamp"] for reading in run}) for _, run in runs]
            return 500 < max(lengths) <= 600 and lengths[-1] == 1

        wait_for(was_stuck, 30, "the IMU repeats itself for a while with new stamps")
        before = observer.read()["/points"][0]["width"]
        wait_for(lambda: last("/points")[-1]["width"] < 0.8 * before, 10, "half of it is covered")
        listed = fault(it, "--list")
        assert "occluded_sector" in listed
        assert "rover/encoders, from" in listed
        stamp = last("/imu")[-1]["stamp"]
        fault(it, "rover/imu", "time_jump", "offset_s=-100")
        wait_for(lambda: last("/imu")[-1]["stamp"] < stamp - 50 * 10**9, 10, "its clock jumps")
        assert "no fault" in fault(it, "rover/lidar", "clear")
        wait_for(lambda: last("/points")[-1]["width"] > 0.9 * before, 10, "it sees all again")

        assert "did you mean `rover/imu`?" in fault(it, "rover/imuu", "off", code=2)
        assert "does not look around" in fault(
            it, "rover/imu", "occluded_sector", "from_deg=0", "to_deg=9", code=2
        )
        top = [sys.executable, "-m", "groundlink", "top", "--once", "--connect", it.endpoint]
        done = subprocess.run(
            top, cwd=REPOSITORY, capture_output=True, text=True, timeout=30, check=False
        )
        [line] = [text for text in done.stdout.splitlines() if "rover/imu" in text]
        assert "alive, time_jump" in line
        up.terminate()
        up.wait(10)

    [stuck, jump] = told(out, "rover/imu").all
    assert stuck.fault.kind == "stuck"
    assert stuck.begin_seconds == pytest.approx(stuck.fault.at_s)
    assert stuck.end_seconds == pytest.approx(stuck.fault.at_s + 1.5)
    assert (jump.fault.kind, jump.end_seconds) == ("time_jump", None)
    [sector] = told(out, "rover/lidar").all
    assert sector.end_seconds is not None
    # By true time nothing is missing while the clock is off.
    imu = times(out, "/imu")
    assert max(b - a for a, b in itertools.pairwise(imu) if a > jump.begin_seconds) < 0.1
    [off] = [failure for failure in told(out, "rover/encoders").all if failure.fault.at_s == 1.0]
    assert off.end_seconds == 2.5
    assert not [t for t in times(out, "/wheel_encoders") if 1.0 <= t < 2.5]


FAST = "time: {mode: fast, epoch: zero, window_ticks: 200}\n"


def test_two_recorded_runs_with_faults_have_the_same_bytes(tmp_path: Path) -> None:
    bodies = []
    for number in range(2):
        folder = tmp_path / str(number)
        folder.mkdir()
        with rig(folder, time_section=FAST) as it:
            text = it.scenario.read_text(encoding="utf-8")
            noisy = "{kind: imu, faults: [{kind: noise_burst, at_s: 0.5, stddev: 0.5}, "
            noisy += "{kind: drop, share: 0.3, at_s: 1}, {kind: delay, delay_s: 0.2}], "
            assert text.count("{kind: imu, ") == 1
            it.scenario.write_text(text.replace("{kind: imu, ", noisy), encoding="utf-8")
            out = folder / "run.mcap"
            done = subprocess.run(
                [
                    *(sys.executable, "-m", "groundlink", "record", str(it.scenario)),
                    *("--out", str(out), "--duration", "2", "--listen", it.endpoint),
                ],
                cwd=REPOSITORY,
                capture_output=True,
                text=True,
                timeout=100,
                check=False,
            )
            assert done.returncode == 1, done.stdout + done.stderr  # a rate was not kept
        with Recording(out) as recording:
            messages = recording.read(["/imu", "/faults/rover/imu"])
            bodies.append(sorted((m.topic, m.nanos, bytes(m.cdr)) for m in messages))
    assert bodies[0] == bodies[1]
    imu = [nanos for topic, nanos, _ in bodies[0] if topic == "/imu"]
    assert len([n for n in imu if n < 10**9]) == 398
    assert 220 < len([n for n in imu if n >= 10**9]) < 340
