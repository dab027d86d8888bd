# SPDX-License-Identifier: Apache-2.0
"""System tests of replay: a recording sends ROS the same message bodies as the original run."""

import itertools
import json
import re
import signal
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from groundlink.bus.core_topics import CLOCK
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.messages.base import Clock, Imu
from groundlink.recording.reader import Recording
from services.view.rerun_destinations import program

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

Sent = dict[str, list[tuple[int, str]]]
"""By topic: stamp and sha256 of each body, in order of arrival."""

RUN_TOPICS = ("/clock", "/points", "/imu", "/wheel_encoders")


class Listener:
    """`udp-bridge listen --json` in the place of the ROS side."""

    def __init__(self, it: Rig, name: str) -> None:
        self._it = it
        self._log = f"{name}.jsonl"
        self.process = it.start(
            *("-m", "udp_bridge", "listen", "--bind", it.address(it.peer), "--json", "--report"),
            log=self._log,
        )
        wait_for(lambda: "listening" in it.log(self._log), 10, "the receiver listens")

    def end(self) -> Sent:
        """Return what has arrived, when nothing more comes."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(10)
        sent: Sent = defaultdict(list)
        for line in self._it.log(self._log).splitlines():
            row: dict[str, Any] = json.loads(line) if line.startswith("{") else {}
            if row.get("topic") in (*RUN_TOPICS, "/tf_static"):
                stamp = row["time_sec"] * 10**9 + row["time_nsec"]
                sent[row["topic"]].append((stamp, row["body_sha256"]))
        return sent


def end(process: subprocess.Popen[str]) -> int:
    process.send_signal(signal.SIGINT)
    return process.wait(20)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, Path, Sent]]:
    """Return a rig, the recording of a run through a gateway, and what was sent in that run.

    In fast mode, where the gateway is waited for: nothing is lost however busy the machine is.
    """
    with rig(tmp_path_factory.mktemp("replay"), time_section="time: {mode: fast}\n") as it:
        out = it.folder / "run.mcap"
        listener = Listener(it, "live")
        up = it.up("--no-ros", "--record", str(out))
        wait_for(lambda: out.exists() and out.stat().st_size > 3e7, 60, "some seconds are recorded")
        wait_for(lambda: '"/tf_static"' in it.log("live.jsonl"), 10, "what is static is sent, too")
        end(up)  # it may say that a rate was not kept: the gateway came late
        yield it, out, listener.end()


def replay(it: Rig, out: Path, *more: str, log: str) -> subprocess.Popen[str]:
    return it.start(
        *("-m", "groundlink", "replay", str(out), "--no-ros", "--listen", it.endpoint, *more),
        log=log,
    )


def test_bodies_are_those_of_the_run(recorded: tuple[Rig, Path, Sent]) -> None:
    it, out, live = recorded
    listener = Listener(it, "again")
    process = replay(it, out, log="replay.log")
    assert process.wait(60) == 0, it.log("replay.log")
    again = listener.end()
    with Recording(out) as recording:
        messages = {topic: recording.topics[topic].messages for topic in RUN_TOPICS}
    for topic in RUN_TOPICS:
        then, now = dict(live[topic]), dict(again[topic])
        for sent in (live[topic], again[topic]):
            stamps = [stamp for stamp, _ in sent]
            assert stamps == sorted(set(stamps)), topic
        # A busy receiver's socket may lose datagrams, and the gateway came late to the live run.
        both = [stamp for stamp in then if stamp in now]
        assert len(both) > 0.8 * min(len(then), messages[topic]), topic
        assert len(now) > 0.9 * messages[topic], topic
        assert [then[stamp] for stamp in both] == [now[stamp] for stamp in both], topic
    assert set(live["/tf_static"]) == set(again["/tf_static"])


def test_a_factor_and_a_start(recorded: tuple[Rig, Path, Sent]) -> None:
    """Twice as fast from 1 s on: the same readings in half of the time, none before."""
    it, out, _ = recorded
    with Bus(listen=it.endpoint) as bus:
        clocks: BusInbox[Clock] = BusInbox(depth=10_000)
        bus.subscribe(CLOCK.key_in(it.run), Clock, clocks)
        playing = it.start(
            *("-m", "services.replay", str(out), "--connect", it.endpoint),
            *("--factor", "2", "--from", "1"),
            log="factor.log",
        )
        arrived = [clocks.get(seconds=20)]
        begin = time.monotonic()
        for _ in range(100):
            arrived.append(clocks.get(seconds=5))
        seconds = time.monotonic() - begin
        assert end(playing) == 0
    with Recording(out) as recording:
        start = recording.first_nanos
    stamps = [message[1].stamp_nanos for message in arrived if message]
    assert stamps[0] == start + 10**9
    assert [b - a for a, b in itertools.pairwise(stamps)] == [10_000_000] * 100
    assert seconds > 0.4, "1 s of the run at twice its pace"


def test_a_loop_goes_through_the_gateway_again_and_again(
    recorded: tuple[Rig, Path, Sent],
) -> None:
    """A round is longer than 2 s: what is older by less is stale to a receiver (see PROTOCOL)."""
    it, out, _ = recorded
    with Recording(out) as recording:
        # In a fast run streams end at different times, up to a second apart.
        ends = [recording.topics[topic].last_nanos for topic in RUN_TOPICS]
        seconds = (min(ends) - recording.first_nanos) / 1e9
    listener = Listener(it, "loop")
    process = replay(it, out, "--loop", "--from", f"{seconds - 2.2:.2f}", log="loop.log")
    # Of the slowest stream a round has 2.2 s, of the IMU up to a second more.
    wait_for(lambda: it.log("loop.jsonl").count('"/imu"') > 2 * 1300, 40, "it comes again")
    assert end(process) == 0
    sent = listener.end()
    for topic in ("/imu", "/clock", "/points"):
        stamps = [stamp for stamp, _ in sent[topic]]
        one_round = stamps[: stamps.index(stamps[0], 1)]
        assert one_round == sorted(one_round)
        assert stamps == (one_round * 9)[: len(stamps)], topic


def test_a_recording_of_a_replay_is_the_recording(recorded: tuple[Rig, Path, Sent]) -> None:
    """On the bus, too, a replay is the run: all that physics and the sensors said, and when."""
    it, out, _ = recorded
    copy = it.folder / "copy.mcap"
    truths = [f"/ground_truth/{name}" for name in ("odom", "wheels", "bodies", "tf")]
    topics = [*RUN_TOPICS, *truths, "/tf_static", "/joint_states", "/robot_description", "/vitals"]
    with Bus(listen=it.endpoint):
        join = ("--connect", it.endpoint)
        replaying = it.start(
            *("-m", "services.replay", str(out), *join, "--factor", "3", "--wait-for", "recorder"),
            log="copied.log",
        )
        recorder = it.start("-m", "services.recorder", "--out", str(copy), *join, log="copy.log")
        assert replaying.wait(40) == 0
        with Recording(out) as original:
            # The bus keeps no order between streams: a cloud may come behind the last clock.
            whole = {topic: original.topics[topic].messages for topic in topics}
            wait_for(lambda: whole.items() <= counts_of(copy).items(), 10, "all is written")
            assert end(recorder) == 0
            with Recording(copy) as copied:
                for topic in topics:
                    assert list(copied.read([topic])) == list(original.read([topic])), topic
                assert copied.run.epoch_nanos == original.run.epoch_nanos


def counts_of(path: Path) -> dict[str, int]:
    """Return how many messages of each topic a file has that may still be written."""
    with Recording(path) as recording:
        return {topic: facts.messages for topic, facts in recording.topics.items()}


def test_a_run_is_not_replayed_into_itself(recorded: tuple[Rig, Path, Sent]) -> None:
    it, out, _ = recorded
    with Bus(listen=it.endpoint) as bus:
        first = ("-m", "services.replay", str(out), "--connect", it.endpoint, "--loop")
        playing = it.start(*first, log="first.log")
        samples: BusInbox[Imu] = BusInbox(depth=10)
        bus.subscribe(
            SENSOR_TOPICS["imu"].key_in(it.run, vehicle="rover", sensor="imu"), Imu, samples
        )
        wait_for(lambda: samples.get(seconds=1), 20, "it plays")
        second = it.start(*first, log="second.log")
        assert second.wait(20) == 2
        assert "is already on the bus" in it.log("second.log")
        assert end(playing) == 0


def test_a_viewer_shows_a_replay(recorded: tuple[Rig, Path, Sent]) -> None:
    """There are no states in it: vehicles and clouds are placed by the ground truth."""
    it, out, _ = recorded
    shown = it.folder / "shown.rrd"
    with Bus(listen=it.endpoint):
        join = ("--connect", it.endpoint)
        viewer = it.start("-m", "services.view", "--save", str(shown), *join, log="view.log")
        replaying = it.start(
            *("-m", "services.replay", str(out), *join, "--loop", "--factor", "2"), log="viewed.log"
        )
        # Each pass is a file of its own, and the viewer may join late in the first.
        third = it.folder / "shown-3.rrd"
        wait_for(third.exists, 60, "a whole pass is drawn")
        assert end(viewer) == 0
        end(replaying)
    held = subprocess.run(
        [program(), "rrd", "print", str(it.folder / "shown-2.rrd")],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    for entity, drawn in (
        ("tf/base_link", "Transform3D"),
        ("rover/lidar", "Points3D"),
        ("rover/speed/true", "Scalars"),
    ):
        assert re.search(rf"- /{entity}\b.*{drawn}", held), entity
