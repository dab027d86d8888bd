# SPDX-License-Identifier: Apache-2.0
"""A run behind credentials: all of it works, and whoever tries to take part without them fails."""

from __future__ import annotations

import os
import shutil
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest
import zenoh

from groundlink.bus import Bus
from groundlink.certificates import Authority
from groundlink.credentials import AUTHORITY, CERTIFICATE, KEY
from groundlink.inbox import Inbox
from groundlink.messages import Command, State, encode
from groundlink.questions import (
    asset_key,
    control_key,
    faults_key,
    history_key,
    journal_key,
    link_key,
    scenario_key,
)
from groundlink.recording import Recording
from groundlink.scenario import load
from groundlink.topics import (
    ACK,
    CLOCK,
    COMMAND,
    FAULTS,
    GAPS,
    GROUND_TRUTH,
    HEALTH,
    IMU,
    POINTS,
    STATE,
    VITALS,
    WHEEL_COMMAND,
    process_names,
)

from .rig import LAB, Observer, Rig, rig, wait_for, without_camera
from .secured import Secured

pytestmark = pytest.mark.system

RUN = "secured"


class Running(NamedTuple):
    """A run of the default scenario, with a driver, that all tests of this module look at."""

    secured: Secured
    observer: Observer
    recording: Path


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("secured")
    with rig(folder) as it:
        _let_it_drive(it)
        secured = Secured(it)
        _start(secured, "router", "services.router", "--listen", it.endpoint)
        wait_for(it.is_answered, 20, "the router listens")
        _start(secured, "physics", "services.physics", str(it.scenario), "--run", RUN)
        for name, module in process_names(load(str(it.scenario))).items():
            if "/" in name:
                _start(secured, name, module, "--name", name)
        recording = folder / "run.mcap"
        _start(secured, "recorder", "services.recorder", "--out", str(recording))
        _start(secured, "gateway", "services.gateway", "--key-file", secured.key_file)
        it.start(
            *("-m", "udp_bridge_ros2", "--bind", it.address(it.peer)),
            *("--key-file", secured.key_file),
            log="node.log",
        )
        observer = Observer(it)
        for topic in ("/points", "/imu", "/wheel_encoders", "/clock"):
            wait_for(lambda topic=topic: observer.count(topic) > 20, 60, f"{topic} is in ROS")
        yield Running(secured, observer, recording)


def _start(secured: Secured, name: str, *command: str) -> None:
    secured.start(name, *command)


def _let_it_drive(it: Rig) -> None:
    """Give the rig's rover a route, and its gateway an emulated link."""
    text = it.scenario.read_text(encoding="utf-8")
    text = text.replace("gateway: {", "gateway: {link: {}, ")
    it.scenario.write_text(text, encoding="utf-8")
