# SPDX-License-Identifier: Apache-2.0
"""System tests of the viewer: the picture is not blank, and the run is not affected."""

import os
import re
import signal
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.bus.core_topics import COMMAND, HEALTH, STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import RELAYED, SENSOR_TOPICS
from groundlink.bus.zenoh_config import ROUTER_WAIT_SECONDS
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import (
    BusMessage,
    Command,
    Health,
    Imu,
    M,
    PointCloud,
    Relayed,
    State,
)
from services.view.rerun_destinations import program
from tests.services.view.foxglove_client import joined

from .rerun_eyes import Eyes, eyes, need_vulkan, share_of
from .rig import Rig, children_of, free_port, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.timeout(240)]

TRUTH = (90, 220, 255)
"""Color of the true trajectory, as services/view/rerun_view.py draws it."""


OF_THE_STACK = "from_ros: {pose: /pose, map: /map}"


class TimedInbox(BusInbox[BusMessage]):
    """Keeps messages, and when each arrived."""

    def __init__(self, *, depth: int) -> None:
        super().__init__(depth=depth)
        self.arrivals_seconds: deque[float] = deque(maxlen=depth)

    def put(self, key: str, payload: bytes, message_type: type[M]) -> None:
        self.arrivals_seconds.append(time.monotonic())
        super().put(key, payload, message_type)


@dataclass
class Running:
    """A run whose rover drives in a circle, and a witness of what is on its bus."""

    rig: Rig
    bus: Bus
    boxes: dict[str, TimedInbox] = field(default_factory=dict)
    health: BusInbox[Health] = field(default_factory=lambda: BusInbox(depth=1000))

    def drain(self) -> dict[str, list[int]]:
        """Return the stamps of each stream that have come since the last look."""
        return {
            name: [m[1].stamp_nanos for m in iter(lambda b=box: b.get(seconds=0), None)]
            for name, box in self.boxes.items()
        }

    def counters(self, process: str) -> dict[str, int]:
        """Return a process's next word about itself."""
        while True:
            arrived = self.health.get(seconds=10)
            assert arrived, f"{process} fell silent"
            if arrived[1].process.startswith(process):
                return arrived[1].counters

    def pass_clouds(self, count: int) -> None:
        """Wait until so many more clouds have come, ten a second, without holding them up long."""
        begin = len(self.boxes["lidar"])
        wait_for(
            lambda: len(self.boxes["lidar"]) >= begin + count,
            0.15 * count + 1.0,
            f"{count} clouds more",
        )

    def view(self, *arguments: str, log: str) -> subprocess.Popen[str]:
        """Start a viewer of this run."""
        join = ("--connect", self.rig.endpoint, "--run", self.rig.run)
        return self.rig.start("-m", "groundlink", "view", *join, *arguments, log=log)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with rig(tmp_path_factory.mktemp("view")) as it:
        text = it.scenario.read_text(encoding="utf-8")
        assert OF_THE_STACK in text
        more = OF_THE_STACK.replace("}", ", topics: {/plan: nav_msgs/Path}}")
        it.scenario.write_text(text.replace(OF_THE_STACK, more), encoding="utf-8")
        it.up()
        wait_for(lambda: _listens(it), 20, "the router listens")
        with Bus(connect=it.endpoint) as bus:
            run = Running(it, bus)
            names = {"vehicle": "rover"}
            for name, row, box_of in (
                ("state", STATE, State),
                ("lidar", SENSOR_TOPICS["lidar"], PointCloud),
                ("imu", SENSOR_TOPICS["imu"], Imu),
            ):
                box = TimedInbox(depth=40_000 if name != "lidar" else 800)
                run.boxes[name] = box
                bus.subscribe(row.key_in(it.run, sensor=name, **names), box_of, box)
            bus.subscribe(HEALTH.key_in(it.run), Health, run.health)
            drive = bus.publisher(COMMAND.key_in(it.run, **names), COMMAND.delivery)
            stop = threading.Event()

            def circle() -> None:
                while not stop.wait(0.05):
                    drive(Command(time.time_ns(), (0.35, 0.0, 0.0), (0.0, 0.0, 0.6)))

            driver = threading.Thread(target=circle)
            driver.start()
            try:
                wait_for(lambda: len(run.boxes["lidar"]) > 5, 40, "clouds come")
                yield run
            finally:
                stop.set()
                driver.join()


def _listens(it: Rig) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", int(it.endpoint.rpartition(":")[2]))) == 0


@pytest.mark.nightly  # Each day a picture of a file is looked at.
def test_the_picture_of_a_live_run_is_not_blank(running: Running, tmp_path: Path) -> None:
    """Live, by the way of the web viewer's server; the colors that must be there are there."""
    need_vulkan()
    port = free_port(socket.SOCK_STREAM)
    viewer = running.view("--web", "--port", str(port), log="web.log")
    wait_for(lambda: "open http://127.0.0.1" in running.rig.log("web.log"), 30, "it serves")
    (address,) = re.findall(r"\?url=(\S+)", running.rig.log("web.log"))
    with eyes(unquote(address), tmp_path) as seen:
        began = wait_for(seen.newest_seconds, 60, "the recording arrives")
        wait_for(lambda: seen.newest_seconds() > began + 8, 60, "eight seconds more arrive")
        world = _world(seen)
        text, speed = seen.picture("Run"), seen.picture("Speed, m/s")
        assert seen.reports() == []
    assert len(np.unique(world.reshape(-1, 3), axis=0)) > 1000
    _, counts = np.unique(world.reshape(-1, 3), axis=0, return_counts=True)
    assert counts.max() < 0.6 * counts.sum(), "one color is most of the picture"
    assert share_of(world, TRUTH, 12) > 2e-4, "the trajectory is drawn"
    assert _cloud_share(world) > 2e-3, "the cloud is drawn"
    assert (text.max(axis=-1) > 200).mean() > 2e-3, "the text is there"
    assert share_of(speed, TRUTH, 25) > 1e-4, "the speed is plotted"
    _ends_at_once(viewer)


def _world(seen: Eyes) -> NDArray[np.uint8]:
    """Return the 3D view once something bright enough fills a third of it."""

    def lit() -> list[NDArray[np.uint8]]:
        picture = seen.picture("World")
        return [picture] if (picture.max(axis=-1) > 60).mean() > 0.3 else []

    picture: NDArray[np.uint8] = wait_for(lit, 60, "the world is drawn")[0]
    return picture


def _cloud_share(world: NDArray[np.uint8]) -> float:
    """Return the share of pixels in the colors of walls as a LiDAR sees them."""
    return share_of(world, (240, 200, 60), 30) + share_of(world, (100, 215, 110), 40)


def _ends_at_once(viewer: subprocess.Popen[str]) -> None:
    """Ctrl-C ends a viewer, and nothing of it is left."""
    children = children_of(viewer.pid)
    viewer.send_signal(signal.SIGINT)
    assert viewer.wait(30) == 0
    wait_for(lambda: all(map(_is_gone, children)), 10, "what it started has ended")


def _is_gone(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return True
    return stat.rpartition(")")[2].split()[0] == "Z"  # ended, and nobody has asked how


@pytest.mark.alone
def test_a_viewer_that_falls_behind_or_goes_changes_no_rate(running: Running) -> None:
    """Two viewers, whose servers are stopped. Then one of them is stopped itself, as by Ctrl-Z, for
    5 s, and killed; the other, which waits for its server, ends by Ctrl-C all the same.
    """
    running.drain()
    for box in running.boxes.values():
        box.arrivals_seconds.clear()
    viewers = []
    for log in ("stopped.log", "waiting.log"):
        port = free_port(socket.SOCK_STREAM)
        viewers.append(running.view("--web", "--port", str(port), log=log))
        wait_for(lambda log=log: "open http" in running.rig.log(log), 30, "it serves")
    stopped, waiting = viewers
    running.pass_clouds(10)
    servers = [pid for viewer in viewers for pid in children_of(viewer.pid)]
    assert len(servers) == 2
    for server in servers:
        os.kill(server, signal.SIGSTOP)
    running.pass_clouds(50)
    stopped.send_signal(signal.SIGSTOP)
    running.pass_clouds(50)
    stopped.kill()
    running.pass_clouds(10)
    _ends_at_once(waiting)
    wait_for(lambda: all(map(_is_gone, servers)), 5, "the servers end with their viewers")
    stamps = running.drain()
    for name, period in (("state", TICK_NANOS), ("lidar", 10**8), ("imu", TICK_NANOS)):
        assert set(np.diff(stamps[name]).tolist()) == {period}, name
        silences = np.diff(running.boxes[name].arrivals_seconds)
        assert silences.max() < ROUTER_WAIT_SECONDS / 2, f"the router waited for a viewer: {name}"
    for sensor in ("rover/lidar", "rover/imu", "rover/encoders"):
        assert running.counters(sensor)["missed_ticks"] == 0


@contextmanager
def slam(running: Running) -> Iterator[None]:
    """Have a stack tell of poses, plans and once of a map, which a viewer has to be there for."""
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    process = running.rig.start("-m", "tests.system.ros_slam", log="slam.log")
    try:
        yield
    finally:
        process.terminate()
        process.wait(10)


def test_foxglove_gets_robot_and_stack_topics(running: Running) -> None:
    port = free_port(socket.SOCK_STREAM)
    viewer = running.view("--foxglove", "--port", str(port), log="foxglove.log")
    wait_for(lambda: "open ws://" in running.rig.log("foxglove.log"), 30, "it serves")
    with joined(port) as client, slam(running):
        client.subscribe(*client.channels)
        wanted = {"/clock", "/points", "/imu", "/wheel_encoders", "/tf_static", "/scene"}
        wanted |= {
            "/ground_truth/tf",
            "/joint_states",
            "/robot_description",
            "/pose",
            "/map",
            "/plan",
        }
        begun = time.monotonic()
        while not wanted <= {topic for topic, _, _ in client.got}:
            assert time.monotonic() < begun + 40, wanted - {topic for topic, _, _ in client.got}
            client.read(at_most=0.5)
        assert client.decoded("/points").width > 40_000
        frames = {
            t.child_frame_id: t.header.frame_id
            for topic in ("/ground_truth/tf", "/tf_static")
            for t in client.decoded(topic).transforms
        }
        assert frames == {"base_link": "world", "lidar_link": "base_link", "imu_link": "base_link"}
        assert client.times
        told = {topic: client.decoded(topic) for topic in ("/pose", "/map", "/plan")}
    assert {message.header.frame_id for message in told.values()} == {"map"}
    assert np.unique(told["/map"].data).tolist() == [0, 100]
    assert len(told["/map"].data) == told["/map"].info.width * told["/map"].info.height > 0
    assert [row.pose.position.x for row in told["/plan"].poses] == [0.0, 2.0]
    _ends_at_once(viewer)


def test_a_file_holds_what_was_seen(running: Running, tmp_path: Path) -> None:
    """Also what the vehicle's stack told: the vehicle in its map."""
    need_vulkan()
    file = tmp_path / "run.rrd"
    viewer = running.view("--save", str(file), log="save.log")
    wait_for(lambda: "view: writing" in running.rig.log("save.log"), 30, "it takes")
    plans: BusInbox[Relayed] = BusInbox(depth=100)
    running.bus.subscribe(RELAYED.key_in(running.rig.run), Relayed, plans)
    with slam(running):
        wait_for(lambda: len(plans) > 20, 40, "the stack tells of its plans")
        wait_for(lambda: file.exists() and file.stat().st_size > 30_000_000, 90, "it is written")
    _ends_at_once(viewer)
    held = subprocess.run(
        [program(), "rrd", "print", str(file)], check=True, capture_output=True, text=True
    ).stdout
    for entity, drawn in (
        ("map", "GridMap"),
        ("pose", "LineStrips3D"),
        ("topics/plan", "LineStrips3D"),
    ):
        assert re.search(rf"/rover/from_ros/{entity}\b.*{drawn}", held), entity
    with eyes(str(file), tmp_path) as seen:
        wait_for(lambda: seen.newest_seconds() > 0 and not seen.state().loading, 60, "it opens")
        wait_for(lambda: _cloud_share(_world(seen)) > 2e-3, 60, "the cloud is drawn")
