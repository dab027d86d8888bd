# SPDX-License-Identifier: Apache-2.0
"""System tests of recordings: readable by other tools, complete, correct and crash-safe."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader

from groundlink.bus.core_topics import CLOCK
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.core.frames import matrix_from_quaternion, nlerp
from groundlink.loader import load
from groundlink.messages.base import Clock, PointCloud
from groundlink.messages.navigation import Odometry, Transforms
from groundlink.recording.reader import Recording
from groundlink.ros.cdr import from_cdr
from groundlink.ros.codec import Moment
from groundlink.scene.build import solids, world_hash
from groundlink.world.solids import Box, Cylinder, Solid
from services.sensors.lidar.spec import Lidar

from .rig import REPOSITORY, Rig, children_of, free_port, rig, wait_for

pytestmark = pytest.mark.system

TOUR = REPOSITORY / "scenarios" / "indoor_lab_tour.yaml"

SECONDS = float(os.environ.get("GROUNDLINK_RECORDING_SECONDS", "6"))
"""Of sim time; longer is as true, and takes longer."""

REALTIME = "time: {mode: realtime}\n"


def groundlink(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "groundlink", *words],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of a run in which the rover drives."""
    out = tmp_path_factory.mktemp("recorded") / "run.mcap"
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    done = groundlink(
        *("record", str(TOUR), "--out", str(out), "--duration", str(SECONDS)),
        *("--listen", endpoint),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_mcap_opens_it_with_ros_2_definitions(run: Path) -> None:
    with run.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        assert {index.compression for index in summary.chunk_indexes} == {"zstd"}
        decoded = sum(1 for _ in reader.iter_decoded_messages())
        assert summary.statistics is not None
        assert decoded == summary.statistics.message_count


def test_rosbags_opens_it_with_the_definitions_that_are_in_it(run: Path) -> None:
    with AnyReader([run]) as reader:
        read = 0
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            read += 1
        assert read == reader.message_count
        policies = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}  # type: ignore[union-attr]
        assert policies["/tf_static"].durability.name == "TRANSIENT_LOCAL"


def test_every_declared_topic_has_its_rate_and_times_increase(run: Path) -> None:
    times: dict[str, list[int]] = defaultdict(list)
    with Recording(run) as recording:
        for message in recording.read():
            times[message.topic].append(message.nanos)
        begin, topics = recording.run.epoch_nanos, recording.topics
    declared = {name: topic.declared_hz for name, topic in topics.items() if topic.declared_hz}
    assert {"/clock", "/points", "/imu", "/wheel_encoders", "/ground_truth/odom"} <= set(declared)
    for name, rate_hz in declared.items():
        nanos = np.array(times[name])
        assert (len(nanos) - 1) * 1e9 / (nanos[-1] - nanos[0]) == pytest.approx(rate_hz, rel=0.01)
        # Nothing is missing at either end. The IMU differentiates, so its first two are not there.
        assert nanos[0] == begin + (5_000_000 if name == "/imu" else 0), name
        end = begin + round(SECONDS * 1e9)
        assert end - int(nanos[-1]) == pytest.approx(1e9 / rate_hz, abs=1), name
    for name, nanos in times.items():
        assert np.all(np.diff(nanos) > 0), name
        assert topics[name].messages == len(nanos)


def test_a_second_recording_is_the_same_file(run: Path, tmp_path: Path) -> None:
    """Byte for byte; the messages are compared first, as they say where files differ."""
    again = tmp_path / "run.mcap"
    done = groundlink(
        *("record", str(TOUR), "--out", str(again), "--duration", str(SECONDS)),
        *("--listen", f"tcp/127.0.0.1:{free_port()}"),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    one, other = content(run), content(again)
    assert one[0].keys() == other[0].keys()
    for topic, messages in one[0].items():
        assert messages == other[0][topic], topic
    assert one[1] == other[1]
    assert run.read_bytes() == again.read_bytes()


def content(path: Path) -> tuple[dict[str, list[tuple[int, bytes]]], dict[str, str]]:
    """Return log times and bodies by topic, and what is said of the run."""
    messages: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    with path.open("rb") as stream:
        reader = make_reader(stream)
        for _, channel, message in reader.iter_messages():
            messages[channel.topic].append((message.log_time, message.data))
        [facts] = [m.metadata for m in reader.iter_metadata() if m.name == "groundlink.run"]
    return messages, facts


def test_the_run_is_in_the_metadata(run: Path) -> None:
    with Recording(run) as recording:
        facts = recording.run
    scenario = load(str(TOUR))
    assert facts.scenario.world == scenario.world
    assert facts.scenario.vehicles == scenario.vehicles
    assert facts.scenario.time.mode == "fast"
    assert facts.world_hash == world_hash(scenario)
    assert facts.versions.keys() >= {"groundlink", "python", "mcap", "rosbags"}


def test_frames_form_one_tree(run: Path) -> None:
    parents: dict[str, set[str]] = defaultdict(set)
    with Recording(run) as recording:
        for message in recording.read(["/tf", "/tf_static", "/ground_truth/tf"]):
            for one in from_cdr(message.cdr, Transforms, Moment(0, 0)).transforms:
                parents[one.child].add(one.parent)
    assert all(len(of) == 1 for of in parents.values()), "a frame with two parents"
    parent_of = {child: next(iter(of)) for child, of in parents.items()}
    roots = set(parent_of.values()) - set(parent_of)
    assert roots == {"world"}
    assert set(parent_of) == {"base_link", "lidar_link", "imu_link"}
    for frame in parent_of:
        chain = [frame]
        while chain[-1] in parent_of:
            chain.append(parent_of[chain[-1]])
            assert len(chain) <= len(parent_of) + 1, "a circle"


@dataclass
class Poses:
    """world_from_base over time, from the ground truth."""

    nanos: NDArray[np.int64]
    positions: NDArray[np.float64]
    quaternions: NDArray[np.float64]

    def in_world(
        self, points_in_base: NDArray[np.float64], nanos: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return points, each measured at an instant of its own, between the poses around it."""
        after = np.searchsorted(self.nanos, nanos).clip(1, len(self.nanos) - 1)
        span = self.nanos[after] - self.nanos[after - 1]
        share = (nanos - self.nanos[after - 1]) / span
        first, second = self.positions[after - 1], self.positions[after]
        position = first + share[:, None] * (second - first)
        turned = nlerp(self.quaternions[after - 1], self.quaternions[after], share)
        return np.einsum("nij,nj->ni", matrix_from_quaternion(turned), points_in_base) + position


def distance_m(solid: Solid, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far points are from a solid's surface, inside or outside of it."""
    local = (points - solid.position_m) @ matrix_from_quaternion(np.array(solid.orientation))
    match solid.shape:
        case Box():
            beyond = np.abs(local) - np.array(solid.shape.size_m) / 2
        case Cylinder():
            radial = np.hypot(local[:, 0], local[:, 1]) - solid.shape.radius_m
            beyond = np.stack([radial, np.abs(local[:, 2]) - solid.shape.length_m / 2], axis=-1)
        case _:
            return np.abs(np.linalg.norm(local, axis=1) - solid.shape.radius_m)
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    return np.abs(outside + np.minimum(beyond.max(axis=1), 0))


def test_clouds_fit_the_walls_where_the_rover_truly_was(run: Path) -> None:
    """Each revolution lies on the world's surfaces within three times the noise of its ranges."""
    with Recording(run) as recording:
        scenario = recording.run.scenario
        truths, clouds, statics = [], [], {}
        for message in recording.read(["/ground_truth/odom", "/points", "/tf_static"]):
            moment = Moment(message.nanos, recording.run.epoch_nanos)
            if message.topic == "/points":
                clouds.append(from_cdr(message.cdr, PointCloud, moment))
            elif message.topic == "/tf_static":
                for one in from_cdr(message.cdr, Transforms, moment).transforms:
                    statics[one.child] = one
            else:
                truths.append(from_cdr(message.cdr, Odometry, moment))
    poses = Poses(
        np.array([truth.stamp_nanos for truth in truths]),
        np.array([truth.position_m for truth in truths]),
        np.array([truth.orientation for truth in truths]),
    )
    assert np.linalg.norm(poses.positions[-1] - poses.positions[0]) > 1.0, "the rover stands"
    found = scenario.sensor("rover/lidar")
    assert found is not None
    assert isinstance(found[1], Lidar)
    three_sigma = 3 * found[1].range_stddev_m
    world = solids(scenario)
    mount = statics["lidar_link"]
    generator = np.random.default_rng(1)
    for cloud in clouds[:-1]:  # behind the last there is no truth any more
        records = cloud.records()
        records = records[generator.choice(len(records), 600, replace=False)]
        local = np.stack([records[axis] for axis in "xyz"], axis=-1).astype(np.float64)
        in_base = local @ matrix_from_quaternion(np.array(mount.rotation)).T + mount.translation_m
        instants = cloud.stamp_nanos + np.round(records["time"] * 1e9).astype(np.int64)
        points = poses.in_world(in_base, instants)
        off = np.min([distance_m(solid, points) for solid in world], axis=0)
        off = off[np.linalg.norm(in_base, axis=1) > 0.8]  # of the rover's own parts
        assert len(off) > 500
        # Of a normal distribution 99.73 % are within; of 600 rays three outside are no surprise.
        assert np.mean(off < three_sigma) > 0.985
        assert np.sqrt(np.mean(off**2)) < found[1].range_stddev_m


def test_a_bag_for_ros_1(run: Path, tmp_path: Path) -> None:
    bag = tmp_path / "run.bag"
    done = groundlink("convert", str(run), str(bag))
    assert done.returncode == 0, done.stdout + done.stderr
    with AnyReader([run]) as of_ros2, AnyReader([bag]) as of_ros1:
        counts = {name: topic.msgcount for name, topic in of_ros2.topics.items()}
        assert {name: topic.msgcount for name, topic in of_ros1.topics.items()} == counts
        for connection, _, raw in of_ros1.messages():
            of_ros1.deserialize(raw, connection.msgtype)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("record", str(TOUR), "--out", "{run}"), "file exists"),
        (("record", str(TOUR), "--out", "/nowhere/run.mcap"), "no such folder"),
        (("record", str(TOUR), "--out", "{new}", "--duration", "0"), "more than 0"),
        (("up", str(TOUR), "--record", "{run}"), "file exists"),
        (("convert", "{run}", "{new}"), "ends in .bag"),
        (("convert", "{new}", "{new}.bag"), "no such file"),
        (("replay", str(TOUR)), "not a recording of a run"),
    ],
    ids=["existing", "no folder", "no time", "existing too", "no bag", "nothing", "no recording"],
)
def test_mistakes_are_one_line(run: Path, tmp_path: Path, words: tuple[str, ...], why: str) -> None:
    new = tmp_path / "new.mcap"
    done = groundlink(*(word.format(run=run, new=new) for word in words))
    assert done.returncode == 2
    assert why in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.fixture
def driving(tmp_path: Path) -> Iterator[Rig]:
    """Physics and the sensors in real time, without anybody else."""
    with rig(tmp_path, time_section=REALTIME) as it:
        physics = ("-m", "services.physics", str(it.scenario), "--run", it.run)
        it.start(*physics, "--listen", it.endpoint, log="physics.log")
        for name in ("lidar", "imu", "encoders"):
            wait_for(lambda: it.is_answered(), 20, "physics listens")
            sensor = ("-m", f"services.sensors.{name}", "--name", f"rover/{name}")
            it.start(*sensor, "--connect", it.endpoint, log=f"{name}.log")
        yield it


def test_a_killed_recorder_loses_less_than_a_second(driving: Rig) -> None:
    """What came up to a second before is in the file, which every tool opens."""
    with Bus(connect=driving.endpoint) as bus:
        clocks: BusInbox[Clock] = BusInbox(depth=10_000)
        bus.subscribe(CLOCK.key_in(driving.run), Clock, clocks)
        for attempt, extra_seconds in enumerate((0.0, 0.15, 0.35)):
            out = driving.folder / f"run{attempt}.mcap"
            recorder = driving.start(
                *("-m", "services.recorder", "--out", str(out), "--connect", driving.endpoint),
                log=f"recorder{attempt}.log",
            )
            wait_for(lambda out=out: out.exists() and out.stat().st_size > 3e6, 20, "it records")
            time.sleep(extra_seconds)
            while clocks.get(seconds=0):
                pass
            newest = clocks.get(seconds=5)
            assert newest
            time.sleep(1.0)
            os.kill(recorder.pid, signal.SIGKILL)
            recorder.wait()
            with Recording(out) as recording:
                times = defaultdict(list)
                for message in recording.read():
                    times[message.topic].append(message.nanos)
            assert times["/clock"][-1] >= newest[1].stamp_nanos
            assert times["/imu"][-1] >= newest[1].stamp_nanos - 50_000_000
            assert times["/points"][-1] >= newest[1].stamp_nanos - 300_000_000
            with AnyReader([out]) as reader:
                assert sum(1 for _ in reader.messages()) == sum(map(len, times.values()))


def test_a_new_episode_is_a_new_file(tmp_path: Path) -> None:
    with rig(tmp_path) as it:
        out, second = tmp_path / "run.mcap", tmp_path / "run_2.mcap"
        up = it.up("--no-ros", "--record", str(out))
        wait_for(lambda: out.exists() and out.stat().st_size > 3e6, 30, "it records")
        (physics,) = (p for p, command in children_of(up.pid).items() if ".physics" in command)
        os.kill(physics, signal.SIGKILL)
        wait_for(lambda: second.exists() and second.stat().st_size > 3e6, 30, "it records again")
        up.send_signal(signal.SIGINT)
        up.wait(20)
        with Recording(out) as before, Recording(second) as after:
            assert before.run.epoch_nanos < after.run.epoch_nanos
            assert before.last_nanos < after.first_nanos
            assert after.first_nanos == after.run.epoch_nanos
            assert before.run.scenario == after.run.scenario


def test_a_full_disk_ends_the_recording_and_not_the_run(tmp_path: Path) -> None:
    """A limit for the size of the recorder's files stands in for the disk."""
    with rig(tmp_path) as it:
        out, report = tmp_path / "run.mcap", tmp_path / "report.json"
        up = it.up("--no-ros", "--record", str(out), "--report", str(report))
        wait_for(lambda: out.exists() and out.stat().st_size > 1e6, 30, "it records")
        before = children_of(up.pid)
        (recorder,) = (p for p, command in before.items() if ".recorder" in command)
        size = out.stat().st_size + 1_000_000
        resource.prlimit(recorder, resource.RLIMIT_FSIZE, (size, size))
        wait_for(
            lambda: "skipped; the run continues without it" in it.log("up.log"),
            30,
            "it is left out",
        )
        with Bus(connect=it.endpoint) as bus:
            clocks: BusInbox[Clock] = BusInbox(depth=10_000)
            bus.subscribe(CLOCK.key_in(it.run), Clock, clocks)
            assert all(clocks.get(seconds=20) for _ in range(200)), "the run goes on"
            assert children_of(up.pid).keys() == before.keys() - {recorder}
        up.send_signal(signal.SIGINT)
        assert up.wait(20) == 1, "the recording is not what was asked for"
        said = it.log("up.log")
        assert said.count("cannot write") == 1
        assert f"recorder: cannot write {out}: file too large" in said
        assert f"{out}: incomplete; see the error line of the recorder" in said
        assert "Traceback" not in said
        told = json.loads(report.read_text(encoding="utf-8"))
        assert told["processes"]["recorder"]["last_exit"] == "skipped"
        with Recording(out) as recording:
            assert recording.topics["/points"].messages > 0
            assert sum(1 for _ in recording.read()) > 0


def cpu_seconds(pid: int) -> float:
    stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


def test_a_recorder_takes_less_than_the_sensors(driving: Rig) -> None:
    """Processor time in the same seconds."""
    out = driving.folder / "run.mcap"
    recorder = driving.start(
        *("-m", "services.recorder", "--out", str(out), "--connect", driving.endpoint),
        log="recorder.log",
    )
    wait_for(lambda: out.exists() and out.stat().st_size > 3e6, 20, "it records")
    sensors = [each for each in driving.started if "services.sensors." in str(each.args)]
    assert len(sensors) > 1
    begin = {process.pid: cpu_seconds(process.pid) for process in (recorder, *sensors)}
    time.sleep(3.0)
    took = {pid: cpu_seconds(pid) - before for pid, before in begin.items()}
    assert took[recorder.pid] < sum(took[process.pid] for process in sensors)
