# SPDX-License-Identifier: Apache-2.0
"""A search finds a planted bug, also if it is killed; a campaign judges what ROS receives."""

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from groundlink.__main__ import main as groundlink
from groundlink.cli.run.cases import check_recording
from groundlink.cli.search.search import field_changes
from groundlink.loader import load
from groundlink.monitor.process_commands import free_endpoint
from groundlink.search.sampler import EvenSampler
from groundlink.search.space import space

from .rig import wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(500)]

SCENARIO = """
name: hall
world:
  name: hall
  room: {size_m: [20.0, 6.0, 3.0], floor_material: linoleum, wall_material: plaster}
vehicles:
  - name: rover
    model: rover
    placement: {x_m: -8.0, y_m: 0.0, yaw_deg: 0.0}
    sensors:
      - {kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link,
         ticks_per_revolution: 8192}
    route:
      {kind: waypoints, speed_mps: 0.6, points: [{x_m: 8.0, y_m: 0.0}]}
"""

ODOMETER = """
import sys
import numpy as np
import groundlink
with groundlink.open(sys.argv[1]) as run:
    ticks = run.array("/wheel_encoders")["ticks"]
steps = np.diff(ticks, axis=0)
lost = int((steps - steps.astype(np.int8)).sum())
print(f"{lost} ticks lost")
sys.exit(1 if lost else 0)
"""
"""A program with a bug: a byte holds the ticks of 20 ms up to 0.8 m/s."""


def processes_with(text: str) -> list[str]:
    """Return the command lines of processes that name a text."""
    found = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = file.read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if text in command:
            found.append(command)
    return found


def test_killed_search_finds_the_bug_without_losing_or_repeating_a_point(tmp_path: Path) -> None:
    scenario, program, out = (tmp_path / name for name in ("hall.yaml", "odometer.py", "out"))
    scenario.write_text(SCENARIO)
    program.write_text(ODOMETER)
    check = f"{sys.executable} {program}"
    words = ["search", str(scenario), "--out", str(out), "--check", check, "--duration", "1.5"]
    words += ["--vary", "seed=1..3", "--vary", "route.speed_mps=0.3,0.5,0.7,1.2"]
    words += ["--budget", "12", "--jobs", "2"]
    started = subprocess.Popen(
        [sys.executable, "-m", "groundlink", *words],
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    journal = out / "journal.jsonl"
    wait_for(
        lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 3, 120, "two points ran"
    )
    os.kill(started.pid, signal.SIGKILL)
    started.wait()
    wait_for(lambda: not processes_with(str(tmp_path)), 10, "all processes end with the search")
    before = journal.read_bytes()

    assert groundlink(words) == 1
    after = journal.read_bytes()
    assert after.startswith(before[: before.rindex(b"\n") + 1])
    rows = [json.loads(line) for line in after.splitlines()[1:]]
    points = [json.dumps(row["values"], sort_keys=True) for row in rows]
    assert len(points) == len(set(points))
    numbers = [row["number"] for row in rows if row["stage"] == "search"]
    assert sorted(numbers) == list(range(1, len(numbers) + 1))
    for row in rows:
        if row["stage"] in ("search", "shrink"):
            is_fast = row["values"].get("route.speed_mps", 0.6) == 1.2
            assert (row["outcome"]["verdict"] == "failed") == is_fast

    expected = load(scenario, changes=field_changes({"route.speed_mps": 1.2}))
    assert load(out / "minimal.yaml") == expected
    assert rows[-1]["values"] == {"again": {"route.speed_mps": 1.2}}
    assert rows[-1]["outcome"]["verdict"] == "failed"
    line, code = check_recording(check, out / "minimal.mcap")
    assert code == 1
    assert line == rows[-1]["outcome"]["text"]


LOSSY = "{seed: 5, to_ros: {loss: 0.2, delay_ms: 10}}"
EXPECT = """
gateway: {datagram: mtu}
expect:
  - {kind: rate, topic: /wheel_encoders, at_least_hz: 45}
  - {kind: age, topic: /wheel_encoders, at_most_ms: 15}
"""


def test_campaign_over_links_judges_what_ros_receives_and_repeats(tmp_path: Path) -> None:
    scenario = tmp_path / "hall.yaml"
    scenario.write_text(SCENARIO + EXPECT)
    words = ["campaign", str(scenario), "--duration", "2.5", "--fault", "none", "--fault", "delay"]
    words += ["--phases", "0.5", "--link", "none", "--link", LOSSY, "--jobs", "2"]
    tables = []
    for name in ("one", "two"):
        assert groundlink([*words, "--out", str(tmp_path / name)]) == 1
        tables.append((tmp_path / name / "points.csv").read_text())
    assert tables[0] == tables[1]
    journal = (tmp_path / "one" / "journal.jsonl").read_text().splitlines()[1:]
    rows = sorted(map(json.loads, journal), key=lambda row: (row["stage"], row["number"]))
    verdicts = [(r["outcome"]["verdict"], r["outcome"]["text"].split("; ")[-1]) for r in rows]
    assert verdicts[-1] == ("passed", "-"), "the scenario over a perfect link"
    assert verdicts[:-1] == [
        ("failed", "expected at least 45 Hz"),
        ("failed", "expected at most 15 ms"),
        ("failed", "expected at least 45 Hz"),
    ]


def evaluations(scenario: Path) -> list[str]:
    """Return the command lines of the processes that evaluate points of a scenario."""
    return [
        line for line in processes_with(str(scenario)) if "groundlink.cli.search.evaluation" in line
    ]


def listens(endpoint: str) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", int(endpoint.rpartition(":")[2]))) == 0


def search_process(*words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "groundlink", *words]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)


def test_workers_share_a_search_and_a_killed_one_loses_no_point(tmp_path: Path) -> None:
    scenario, out = tmp_path / "hall.yaml", tmp_path / "out"
    scenario.write_text(SCENARIO)
    vary, endpoint = "route.speed_mps=0.3..0.9", free_endpoint()
    search = search_process(
        *("search", str(scenario), "--out", str(out), "--duration", "1", "--vary", vary),
        *("--budget", "5", "--ahead", "3", "--jobs", "0", "--listen", endpoint),
    )
    wait_for(lambda: listens(endpoint), 60, "the search listens")
    workers = [search_process("worker", "--connect", endpoint) for _ in range(2)]
    journal = out / "journal.jsonl"
    try:
        wait_for(
            lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 2, 120, "a point ran"
        )
        wait_for(lambda: len(evaluations(scenario)) >= 2, 120, "both workers have a point")
        os.kill(workers[0].pid, signal.SIGKILL)
        assert search.wait(300) == 0
    finally:
        for process in (search, *workers):
            process.kill()
            process.wait()
    found = [json.loads(line) for line in journal.read_text().splitlines()[1:]]
    rows = sorted((row for row in found if row["stage"] == "search"), key=lambda r: r["number"])
    assert [row["number"] for row in rows] == [1, 2, 3, 4, 5]
    sampler = EvenSampler(space([vary]), seed=1)
    assert [row["values"] for row in rows] == [sampler.ask() for _ in rows]
    assert {row["outcome"]["verdict"] for row in rows} == {"passed"}
    wait_for(lambda: not processes_with(str(scenario)), 20, "all processes end with their worker")
