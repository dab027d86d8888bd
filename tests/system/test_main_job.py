# SPDX-License-Identifier: Apache-2.0
"""System tests of the main use case: start a scenario, receive its data in ROS 2, and drive."""

import math
import os
import random
import signal
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
import zenoh

from groundlink.bus.core_topics import HEALTH, STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import TOPICS
from groundlink.core.clock import NANOS
from groundlink.loader import load
from groundlink.messages.base import Health, State
from services.sensors.encoders.spec import Encoders

from .rig import Observer, Rig, children_of, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.alone]

PICTURES, CAMERA_INFO = "/camera/image_raw/compressed", "/camera/camera_info"
SENSOR_PERIODS_NANOS = {"/points": 100_000_000, "/imu": 2_500_000, "/wheel_encoders": 20_000_000}
PICTURES_HZ = 30


@dataclass
class Running:
    """A run that all tests of this module look at."""

    rig: Rig
    supervisor: int
    """Its process id."""

    observer: Observer
    bus: Bus
    states: BusInbox[State]
    health: BusInbox[Health]

    def drain(self) -> list[State]:
        """Return the states that have arrived since the last look."""
        return [s[1] for s in iter(lambda: self.states.get(seconds=0), None)]

    def counters(self, process: str) -> dict[str, int]:
        """Return a process's next word about itself, whatever has come before."""
        while self.health.get(seconds=0):
            pass
        while True:
            arrived = self.health.get(seconds=5)
            assert arrived, f"{process} fell silent"
            if arrived[1].process == process:
                return arrived[1].counters


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with rig(tmp_path_factory.mktemp("run"), camera=True) as it:
        observer = Observer(it)
        supervisor = it.up().pid
        wait_for(lambda: observer.count(PICTURES) > 30, 60, "pictures arrive in ROS")
        wait_for(lambda: observer.count("/points") > 2, 60, "clouds arrive in ROS")
        wait_for(lambda: observer.count("/imu") > 100, 10, "IMU samples arrive in ROS")
        wait_for(lambda: observer.count("/wheel_encoders") > 10, 10, "encoders arrive in ROS")
        with Bus(connect=it.endpoint) as bus:
            states: BusInbox[State] = BusInbox(depth=20_000)
            health: BusInbox[Health] = BusInbox(depth=1000)
            bus.subscribe(STATE.key_in(it.run), State, states)
            bus.subscribe(HEALTH.key_in(it.run), Health, health)
            yield Running(it, supervisor, observer, bus, states, health)


def test_ten_seconds_arrive_complete(running: Running) -> None:
    """Every cloud, sample and count of 10 s is there, in order, none twice, none missing.

    Pictures are drawn beside them on the same cores. A camera that is behind is waited for; of
    those that then come at once the way to ROS may leave out some, and counts them.
    """
    observer = running.observer
    topics = (*SENSOR_PERIODS_NANOS, PICTURES, CAMERA_INFO)
    begin = {topic: observer.count(topic) for topic in topics}
    end_nanos = observer.messages["/clock"][-1]["stamp"] + 10 * NANOS
    wait_for(
        lambda: all(observer.read()[topic][-1]["stamp"] > end_nanos for topic in topics),
        45,
        "10 s of all of them",
    )
    missing = 0
    for topic in topics:
        stamps = np.array([m["stamp"] for m in observer.messages[topic][begin[topic] :]])
        if period := SENSOR_PERIODS_NANOS.get(topic):
            assert set(np.diff(stamps).tolist()) == {period}, topic
        else:
            slots = np.rint((stamps - stamps[0]) / NANOS * PICTURES_HZ)
            assert np.diff(slots).min() > 0, topic
            missing = max(missing, int(slots[-1]) + 1 - len(slots))
            rate_hz = (len(stamps) - 1) / (stamps[-1] - stamps[0]) * NANOS
            print(f"{topic}: {rate_hz:.2f} Hz of sim time")
    wait_for(
        lambda: running.counters("gateway")["wire_superseded"] >= missing, 10, "they are counted"
    )
    assert running.counters("rover/camera").get("gap_overloaded", 0) == 0


def test_a_picture_has_its_camera_info(running: Running) -> None:
    observed = running.observer.read()
    pictures, infos = (
        {m["stamp"]: m["frame"] for m in observed[topic]} for topic in (PICTURES, CAMERA_INFO)
    )
    both = pictures.keys() & infos.keys()
    assert len(both) > len(pictures) - 3  # the last may be on its way
    assert {pictures[stamp] for stamp in both} == {"camera_optical_frame"}
    assert {infos[stamp] for stamp in both} == {"camera_optical_frame"}


def test_a_camera_that_stood_still_takes_all_of_its_pictures(running: Running) -> None:
    """For two seconds it takes none; then it is waited for until it has taken them all."""
    children = children_of(running.supervisor)
    camera = next(pid for pid, command in children.items() if "sensors.camera" in command)
    observer = running.observer
    clouds = observer.count("/points")
    os.kill(camera, signal.SIGSTOP)
    try:
        # A window of 400 ticks holds ten of them; then time stands still.
        wait_for(lambda: observer.count("/points") >= clouds + 7, 30, "time goes on")
        stopped = time.monotonic()
        wait_for(lambda: time.monotonic() > stopped + 1.5, 10, "a while passes")
    finally:
        os.kill(camera, signal.SIGCONT)
    pictures = observer.count(PICTURES)
    wait_for(lambda: observer.count(PICTURES) >= pictures + 30, 30, "pictures go on")
    counters = running.counters("rover/camera")
    assert counters.get("gap_overloaded", 0) == counters["missed_ticks"] == 0
    stretched = running.counters("physics")
    assert stretched.get("stretched_ms rover/camera", 0) > 0


def test_clouds_are_what_a_vlp16_driver_publishes(running: Running) -> None:
    cloud = running.observer.read()["/points"][-1]
    assert cloud["frame"] == "lidar_link"
    assert cloud["fields"] == ["x", "y", "z", "intensity", "ring", "time"]
    assert cloud["point_step"] == 22
    assert cloud["dense"] is True
    assert cloud["data"] == 22 * cloud["width"]
    # In a closed room nearly each of the 57,600 rays returns; the own deck is nearer than the
    # least range for some.
    assert 0.8 * 57_600 < cloud["width"] <= 57_600


def test_a_resting_imu_feels_gravity(running: Running) -> None:
    samples = np.array([m["acceleration"] for m in running.observer.read()["/imu"][-400:]])
    assert samples.mean(axis=0) == pytest.approx([0, 0, 9.80665], abs=0.1)


def test_sensor_mounts_are_on_tf_static(running: Running) -> None:
    frames = running.observer.read()["/tf_static"][-1]["frames"]
    assert frames == dict.fromkeys(("lidar_link", "imu_link", "camera_optical_frame"), "base_link")


def test_clock_follows_the_data(running: Running) -> None:
    observed = running.observer.read()
    assert abs(observed["/clock"][-1]["stamp"] - observed["/imu"][-1]["stamp"]) < 1e9


def test_garbage_changes_nothing_and_is_counted(running: Running) -> None:
    it, generator = running.rig, random.Random(5)
    before, begin = running.counters("gateway"), running.observer.count("/imu")
    running.drain()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as hostile:
        for _ in range(300):
            size = generator.choice([0, 1, 17, 20, 60, 1400])
            hostile.sendto(generator.randbytes(size), it.bind)
            hostile.sendto(generator.randbytes(size), it.peer)
    garbage = [b"", b"\xc1", b"\x80", generator.randbytes(100)]
    names = {"vehicle": "rover", "sensor": "imu", "process": "rover/imu"}
    configuration = zenoh.Config.from_json5(
        f'{{mode: "client", connect: {{endpoints: ["{it.endpoint}"]}}}}'
    )
    with zenoh.open(configuration) as session:
        for topic in TOPICS:
            for payload in garbage:
                session.put(topic.key_in(it.run, **names), payload)
    wait_for(
        lambda: running.counters("gateway")["wire_refused"] >= before["wire_refused"] + 300,
        10,
        "malformed datagrams are counted",
    )
    wait_for(lambda: running.counters("physics")["refused"] >= 8, 10, "bad commands are counted")
    assert running.counters("gateway")["bus_refused"] >= 8
    # Its states come past the router, where no stranger can put any.
    assert running.counters("rover/imu")["refused"] == 0
    ticks = [state.tick for state in running.drain()]
    assert set(np.diff(ticks).tolist()) == {1}
    stamps = np.array([m["stamp"] for m in running.observer.read()["/imu"][begin:]])
    assert len(stamps) > 1
    assert set(np.diff(stamps).tolist()) == {2_500_000}


def test_a_twist_drives_the_rover(running: Running) -> None:
    """0.5 m/s asked for is 0.5 m/s of truth within 5 % after 2 s; the encoders agree with it."""
    it = running.rig
    running.drain()
    driver = it.start("-m", "tests.system.ros_driver", "0.5", "0", "6", log="driver.log")
    assert driver.wait(30) == 0, it.log("driver.log")
    states = running.drain()
    poses = np.array([s.vehicles["rover"].poses()[0] for s in states])
    seconds = np.array([s.sim_nanos for s in states]) * 1e-9
    speeds = np.hypot(*np.diff(poses[::80, :2], axis=0).T) / np.diff(seconds[::80])
    moving = np.flatnonzero(speeds > 0.05)
    start, end = seconds[::80][moving[0]] + 2.0, seconds[::80][moving[-1]] - 0.5
    steady = (seconds > start) & (seconds < end)
    assert seconds[steady][-1] - seconds[steady][0] > 2.0
    path = np.hypot(*np.diff(poses[steady, :2], axis=0).T).sum()
    truth = path / (seconds[steady][-1] - seconds[steady][0])
    assert truth == pytest.approx(0.5, rel=0.05)

    scenario = load(it.scenario)
    vehicle = scenario.vehicles[0]
    spec = next(s for s in vehicle.sensors if isinstance(s, Encoders))
    epoch = states[0].epoch_nanos
    ticks = {m["stamp"]: np.mean(m["ticks"]) for m in running.observer.read()["/wheel_encoders"]}
    turned = [
        count for stamp, count in sorted(ticks.items()) if start <= (stamp - epoch) * 1e-9 <= end
    ]
    circumference = 2 * math.pi * vehicle.model.wheels[0].radius_m
    by_encoders = (turned[-1] - turned[0]) / spec.ticks_per_revolution * circumference
    assert by_encoders / ((len(turned) - 1) / spec.rate_hz) == pytest.approx(truth, rel=0.03)


def test_without_commands_the_rover_stops(running: Running) -> None:
    def stands() -> bool:
        states = running.drain()
        return bool(states) and bool(
            np.abs(np.frombuffer(states[-1].vehicles["rover"].base_velocity)).max() < 0.01
        )

    wait_for(stands, 5, "the rover stands still after its last command")
