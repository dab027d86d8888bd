# SPDX-License-Identifier: Apache-2.0
"""A recorded drive with other sensors is what a whole run with them gives."""

import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import pytest

from groundlink.loader.scenario_files import SHIPPED
from groundlink.monitor.process_commands import free_endpoint
from groundlink.recording.reader import Recording
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC
from tests.services.view.foxglove_client import joined

from .rig import REPOSITORY, free_port

pytestmark = pytest.mark.system

CHANGES = ("--set", "scanner.dropout=0.2", "--set", "encoders.rate_hz=40.0")
"""Wheel odometry and `/tf` follow from the encoders."""

SCENARIOS = sorted(file.stem for file in SHIPPED.glob("*.yaml"))


def groundlink(*words: str | Path) -> str:
    command = [sys.executable, "-m", "groundlink", *map(str, words)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return " ".join(done.stdout.split())


def record(scenario: str, out: Path, *words: str, duration: float = 1.0) -> None:
    length = ("--duration", str(duration), "--listen", free_endpoint())
    groundlink("record", scenario, "--out", out, *length, *words)


def messages(recording: Recording) -> dict[str, list[tuple[int, bytes]]]:
    found = defaultdict(list)
    for message in recording.read():
        found[message.topic].append((message.nanos, message.cdr))
    found.pop(DIAGNOSTICS_TOPIC, None)
    return found


def check_same(resimulated: Path, whole: Path) -> None:
    """Check that a resimulated file has what a whole run has."""
    with Recording(resimulated) as found, Recording(whole) as wanted:
        assert messages(found) == messages(wanted)
        assert found.types == wanted.types
        assert found.topics == wanted.topics
        assert found.run.scenario == wanted.run.scenario
        assert found.end_nanos == wanted.end_nanos
        assert found.journal == wanted.journal


def test_only_what_differs_is_simulated_and_equals_a_whole_run(tmp_path: Path) -> None:
    run, copy, again, whole = (tmp_path / f"{n}.mcap" for n in ("run", "copy", "again", "whole"))
    record("indoor_2d", run)
    assert "nothing differs" in groundlink("resim", run, "--out", copy)
    assert copy.read_bytes() == run.read_bytes()
    said = groundlink("resim", run, *CHANGES, "--out", again)
    assert "(rover/scanner, rover/encoders, rover/odometry)" in said
    record("indoor_2d", whole, *CHANGES)
    check_same(again, whole)
    with Recording(run) as before, Recording(again) as after:
        assert messages(before) != messages(after)


def test_a_sensor_is_removed_and_another_one_added(tmp_path: Path) -> None:
    run, again = tmp_path / "run.mcap", tmp_path / "again.mcap"
    record("indoor_2d", run)
    file = tmp_path / "second.yaml"
    file.write_text(
        "{kind: range, datasheet: hc_sr04, name: ahead, topic: /ahead, frame: ahead_link}"
    )
    words = ("--remove", "rover/scanner", "--add", f"rover={file}")
    assert "(rover/ahead)" in groundlink("resim", run, *words, "--out", again)
    with Recording(run) as before, Recording(again) as after:
        old, new = messages(before), messages(after)
        assert len(new["/ahead"]) > 5
        assert new.keys() ^ old.keys() == {"/scan", "/ahead"}
        changed = {topic for topic in old.keys() & new.keys() if old[topic] != new[topic]}
        assert changed == {"/tf_static", "/robot_description"}


@pytest.mark.nightly
@pytest.mark.timeout(900)
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_all_sensors_of_a_shipped_scenario_give_what_they_give_in_a_whole_run(
    scenario: str, tmp_path: Path
) -> None:
    run, copy, again, whole = (tmp_path / f"{n}.mcap" for n in ("run", "copy", "again", "whole"))
    rain = ("--set", "world.weather={rain_mm_per_h: 8.0}")
    seconds = 2.2  # two messages of each topic: bodies have one a second
    record(scenario, run, duration=seconds)
    groundlink("resim", run, "--out", copy)
    assert copy.read_bytes() == run.read_bytes()
    groundlink("resim", run, *rain, "--out", again)
    record(scenario, whole, *rain, duration=seconds)
    check_same(again, whole)


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_another_lidar_in_the_default_scenario(tmp_path: Path) -> None:
    run, again, whole = (tmp_path / f"{name}.mcap" for name in ("run", "again", "whole"))
    change = ("--set", "rover/lidar.datasheet=sensors/os1_64.yaml")
    record("indoor_lab", run, duration=2.0)
    assert "(rover/lidar)" in groundlink("resim", run, *change, "--out", again)
    record("indoor_lab", whole, "--set", "lidar.datasheet=sensors/os1_64.yaml", duration=2.0)
    check_same(again, whole)
    with Recording(run) as before, Recording(again) as after:
        old, new = messages(before), messages(after)
        assert {topic for topic in old if old[topic] != new[topic]} == {"/points"}


def test_a_recording_is_viewed_with_a_further_sensor(tmp_path: Path) -> None:
    run, shown, sensor = (tmp_path / name for name in ("run.mcap", "shown.rrd", "roof.yaml"))
    sensor.write_text(
        "{kind: lidar_2d, name: roof, datasheet: lms111, topic: /roof, frame: roof_link}",
        encoding="utf-8",
    )
    groundlink("record", "indoor_2d", "--duration", "0.5", "--out", run)
    for options, is_drawn in (((), False), (("--add", f"rover={sensor}"), True)):
        said = groundlink("view", run, *options, "--save", shown)
        assert (b"/rover/roof" in shown.read_bytes()) == is_drawn
        assert ("view: simulated rover/roof: 100 %" in said) == is_drawn
        shown.unlink()


def test_foxglove_gets_a_further_sensor_when_it_subscribes(tmp_path: Path) -> None:
    run, sensor, port = tmp_path / "run.mcap", tmp_path / "roof.yaml", free_port(socket.SOCK_STREAM)
    sensor.write_text(
        "{kind: lidar_2d, name: roof, datasheet: lms111, topic: /roof, frame: roof_link}",
        encoding="utf-8",
    )
    record("indoor_2d", run)
    words = ["view", str(run), "--add", f"rover={sensor}", "--foxglove", "--port", str(port)]
    viewer = subprocess.Popen(
        [sys.executable, "-m", "groundlink", *words], stdout=subprocess.PIPE, text=True
    )
    assert viewer.stdout is not None
    try:
        assert "open ws://" in viewer.stdout.readline()
        with joined(port) as client:
            client.subscribe("/roof")
            assert "simulated rover/roof: " in viewer.stdout.readline()
            client.control(play=True)
            begun = time.monotonic()
            while not client.got:
                assert time.monotonic() < begun + 60
                client.read(at_most=0.5)
            scan = client.decoded("/roof")
        assert len(scan.ranges) > 500
    finally:
        viewer.send_signal(signal.SIGINT)
        assert viewer.wait(30) in (0, 130)
        viewer.stdout.close()
