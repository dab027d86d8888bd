# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from groundlink.messages.imagery import CameraInfo
from services.sensors.camera.model import CameraModel
from services.sensors.camera.spec import Camera
from services.sensors.runtime.model import stream_and_message
from tests.services.sensors.sheets import from_sheet
from tests.services.sensors.yards import box, resting, yard

SHEETS = {"camera_vga_mono": ("plumb_bob", 415.7), "camera_fisheye": ("equidistant", 305.6)}
"""Model of the lens, and what its angle makes of the focal length, worked out by hand."""


@pytest.mark.parametrize("name", SHEETS)
def test_every_sheet_fits_and_its_camera_says_so(name: str) -> None:
    spec = from_sheet(Camera, name)
    assert spec.datasheet
    made = yard(box("crate", (1, 1, 1), (5, 0.8, 0.5)))
    streams = dict(
        map(stream_and_message, CameraModel(made, made.vehicles[0], spec).readings(resting(1)[0]))
    )
    assert streams.keys() == {"", "camera_info"}
    info = streams["camera_info"]
    assert isinstance(info, CameraInfo)
    model, focal_px = SHEETS[name]
    assert (info.width, info.height, info.distortion_model) == (640, 480, model)
    k = np.frombuffer(info.intrinsic).reshape(3, 3)
    assert (k[0, 0], k[1, 1]) == pytest.approx((focal_px, focal_px), abs=0.06)
