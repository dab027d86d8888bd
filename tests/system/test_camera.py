# SPDX-License-Identifier: Apache-2.0
"""System tests of the default scenario's camera: a fast run has all pictures, with equal bytes."""

import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundlink.messages.imagery import CameraInfo, CompressedImage
from groundlink.recording.reader import Recording
from groundlink.ros.cdr import from_cdr
from groundlink.ros.codec import Moment
from tests.services.sensors.rendering.opengl import _opengl as _opengl

from .rig import LAB, Observer, free_port, rig, wait_for

pytestmark = pytest.mark.system

PICTURES, INFO = "/camera/image_raw/compressed", "/camera/camera_info"
SECONDS = 2


def recorded(file: Path) -> tuple[list[CompressedImage], list[CameraInfo], int]:
    """Return what a camera published in a fast run, and the stamp of sim time zero."""
    listen = f"tcp/127.0.0.1:{free_port()}"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "groundlink", "record", str(LAB), "--out", str(file)),
            *("--duration", str(SECONDS), "--listen", listen),
        ],
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    pictures, infos = [], []
    with Recording(file) as recording:
        epoch_nanos = recording.run.epoch_nanos
        for message in recording.read([PICTURES, INFO]):
            moment = Moment(message.nanos, epoch_nanos)
            if message.topic == PICTURES:
                pictures.append(from_cdr(message.cdr, CompressedImage, moment))
            else:
                infos.append(from_cdr(message.cdr, CameraInfo, moment))
    return pictures, infos, epoch_nanos


def test_without_opengl_the_default_scenario_goes_on_without_its_camera(tmp_path: Path) -> None:
    with rig(tmp_path, camera=True) as it:
        it.environment["__EGL_VENDOR_LIBRARY_DIRS"] = str(tmp_path)  # no driver is there
        observer = Observer(it)
        up = it.up()
        wait_for(lambda: observer.count("/points") > 50, 60, "clouds arrive in ROS")
        up.send_signal(signal.SIGINT)
        assert up.wait(30) == 1
        assert observer.count(PICTURES) == 0
        log = " ".join(it.log("up.log").split())
        assert log.count("install Debian's libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri") == 1
        assert log.count("rover/camera: skipped; the run continues without it") == 1
        assert f"failed: {PICTURES}: declared 30 Hz, measured none" in log


@pytest.mark.nightly
def test_a_fast_run_has_every_picture_twice_alike(tmp_path: Path) -> None:
    pictures, infos, epoch_nanos = recorded(tmp_path / "one.mcap")
    wanted = [i * 1_000_000_000 // 30 for i in range(30 * SECONDS)]
    assert [picture.stamp_nanos - epoch_nanos for picture in pictures][: len(wanted)] == wanted
    assert [info.stamp_nanos for info in infos] == [picture.stamp_nanos for picture in pictures]
    assert {info.frame for info in infos} == {"camera_optical_frame"}
    for picture in pictures[::20]:
        assert picture.format == "rgb8; jpeg compressed bgr8"
        decoded = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
        assert decoded is not None
        assert decoded.shape == (480, 640, 3)
        assert decoded.std() > 20
    again, _, _ = recorded(tmp_path / "two.mcap")
    assert [bytes(picture.data) for picture in pictures] == [bytes(p.data) for p in again]
