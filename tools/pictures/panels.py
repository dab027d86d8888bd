# SPDX-License-Identifier: Apache-2.0
"""Pictures of several panels: what cameras see of shipped scenarios, drawn in this process.

`python -m tools.pictures` starts it with the name of a sheet.
"""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from groundlink.core.clock import TICK_NANOS
from groundlink.core.frames import Floats, multiply
from groundlink.loader import load
from groundlink.loader.partial_scenario import FileKind, load_partial
from groundlink.messages.base import State, VehicleState, packed
from groundlink.messages.imagery import CompressedImage
from groundlink.messages.imagery import Image as ImageMessage
from groundlink.scenario.cameras import Imager, Lens
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from groundlink.scene.build import world_hash
from services.sensors.camera.spec import Camera
from services.sensors.depth_camera.model import DepthCameraModel
from services.sensors.depth_camera.spec import DepthCamera
from services.sensors.rendering.cameras.camera_eye import CameraEye
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import ALL_LAYERS
from services.sensors.rendering.portrait.picture import direction, portrait
from services.sensors.rendering.portrait.scene import scene
from services.sensors.rendering.portrait.snapshot import colors
from services.sensors.runtime.model import StreamMessage

from .viewpoints import looking, pinhole

Pixels = NDArray[np.uint8]

GAP, TITLE = 4, 24
"""Pixels between panels, and of a panel's title."""


IDEAL_LENS, IDEAL_IMAGER = Lens(), Imager()


@dataclass(frozen=True, kw_only=True)
class PanelView:
    """A camera beside the first vehicle of a scenario at rest."""

    scenario: str
    xyz_m: tuple[float, float, float]
    """Position in the vehicle's base frame."""

    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    size: tuple[int, int] = (300, 225)
    vertical_fov_deg: float = 60.0
    lens: Lens = IDEAL_LENS
    imager: Imager = IDEAL_IMAGER
    turn_dps: float = 0.0
    """Speed at which the vehicle turns, with the camera; degrees per second."""

    def camera(self) -> Camera:
        """Return the specification of the camera."""
        width, height = self.size
        return Camera(
            name="panel",
            topic="/panel",
            frame="panel",
            mount=Mount(self.xyz_m, self.rpy_deg),
            width=width,
            height=height,
            vertical_fov_deg=self.vertical_fov_deg,
            samples=16,
            lens=self.lens,
            imager=self.imager,
        )


def states(scenario: Scenario, ticks: int, turn_dps: float = 0.0) -> list[State]:
    """Return states of a run whose vehicles rest at their starts, the first one turning."""
    shown = scene(FileKind.SCENARIO, scenario, direction(0.0, 90.0))
    links = [len(vehicle.model.link_names()) for vehicle in scenario.vehicles]
    *vehicles, actors = np.split(shown.poses, np.cumsum(links))
    found = []
    for tick in range(ticks):
        yaw = math.radians(turn_dps) * tick * TICK_NANOS * 1e-9
        turned = [_turned(vehicles[0], yaw), *vehicles[1:]]
        state = {
            vehicle.name: VehicleState(
                packed(poses),
                packed(np.zeros(6)),
                packed(np.zeros(len(vehicle.model.wheels))),
                packed(np.zeros(len(vehicle.model.wheels))),
            )
            for vehicle, poses in zip(scenario.vehicles, turned, strict=True)
        }
        found.append(
            State(
                *("panel", 1, 0, tick, tick * TICK_NANOS, world_hash(scenario)),
                *(state, packed(actors)),
            )
        )
    return found


def _turned(poses: Floats, yaw: float) -> Floats:
    """Return the poses of a vehicle's links after a turn about the base's z."""
    found = poses.copy()
    cosine, sine = math.cos(yaw), math.sin(yaw)
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    found[:, :3] = (poses[:, :3] - poses[0, :3]) @ rotation.T + poses[0, :3]
    half = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    found[:, 3:] = multiply(half, poses[:, 3:])
    return found


def color(view: PanelView) -> Pixels:
    """Return the picture of a view."""
    return _layers(view)[0]


def _layers(view: PanelView) -> tuple[Pixels, NDArray[np.float32], Pixels]:
    """Return color, depth in meters, and labels as colors."""
    scenario = load(view.scenario)
    camera = CameraEye(scenario, scenario.vehicles[0], view.camera(), layers=ALL_LAYERS)
    for state in states(scenario, 2 + camera.span_nanos // TICK_NANOS + 1, view.turn_dps):
        camera.eye.take(state)
    frame = camera.taken(0, 0)
    assert frame.labels is not None
    palette = np.vstack([colors(len(camera.eye.renderer.labels.instances)), [[0, 0, 0]]])
    return frame.color.copy(), frame.depth_m.copy(), palette.astype(np.uint8)[frame.labels]


def depth(depth_m: NDArray[np.float32], near_m: float, far_m: float) -> Pixels:
    """Return depth as colors: near is red, far is blue, beyond is white, none is black."""
    share = 1 - np.clip((depth_m - near_m) / (far_m - near_m), 0, 1)
    drawn = cv2.applyColorMap((255 * (0.05 + 0.9 * share)).astype(np.uint8), cv2.COLORMAP_TURBO)
    drawn[depth_m > far_m] = 255
    drawn[~(depth_m > 0)] = 0
    return np.asarray(drawn[..., ::-1], np.uint8)


def magnified(picture: Pixels, left: float, top: float, share: float) -> Pixels:
    """Return a part of a picture, its pixels enlarged to the picture's size."""
    height, width = picture.shape[:2]
    x, y = int(left * width), int(top * height)
    part = picture[y : y + int(share * height), x : x + int(share * width)]
    return np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)


def sheet(panels: Sequence[tuple[str, Pixels]], columns: int) -> Image.Image:
    """Return panels in rows, each below its title; without titles, none has space for one."""
    height, width = panels[0][1].shape[:2]
    title = TITLE if any(name for name, _ in panels) else 0
    rows = -(-len(panels) // columns)
    size = (columns * (width + GAP) - GAP, rows * (height + title + GAP) - GAP)
    page = Image.new("RGB", size, "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(14)
    for number, (name, picture) in enumerate(panels):
        row, column = divmod(number, columns)
        x, y = column * (width + GAP), row * (height + title + GAP)
        draw.text((x + 4, y + 4), name, font=font, fill="black")
        page.paste(Image.fromarray(picture), (x, y + title))
    return page


LAB = PanelView(scenario="indoor_lab", xyz_m=(-0.6, -1.0, 0.55), rpy_deg=(0.0, 6.0, 18.0))
HAMLET = PanelView(scenario="outdoor_paper", xyz_m=(-17.0, 2.5, 1.6), rpy_deg=(0.0, -2.0, 2.0))
BARREL = Lens(distortion=(-0.25, 0.06))
NOISY = Imager(
    exposure_s=0.01 / 16, gain=16.0, full_well_electrons=10_000.0, read_noise_electrons=5.0
)
"""An exposure of 10 ms is as bright as an ideal picture."""

LANDSCAPE = (478, 318)
"""Size of the pictures of terrain."""


def fisheye(view: PanelView) -> Pixels:
    """Return what a fisheye of 150 degrees sees from there."""
    return color(replace(view, lens=Lens(model="equidistant"), vertical_fov_deg=112.0))


def camera() -> Image.Image:
    """Draw color, depth and labels of the laboratory, and the yard."""
    big: dict[str, Any] = {"size": (440, 330)}
    indoors = replace(LAB, xyz_m=(-1.1, -1.9, 1.5), rpy_deg=(0.0, 22.0, 48.0), **big)
    yard = PanelView(scenario="yard", xyz_m=(-3.4, 2.6, 1.8), rpy_deg=(0.0, 14.0, -38.0), **big)
    seen, depth_m, labels = _layers(indoors)
    return sheet([("", seen), ("", depth(depth_m, 0.8, 12.0)), ("", labels), ("", color(yard))], 2)


def effects() -> Image.Image:
    """Draw nine pictures of the laboratory, each with one effect."""
    fringed = replace(LAB, lens=Lens(chromatic_aberration=0.01))
    moving = Imager(exposure_s=0.01, poses=24)
    rolling = Imager(exposure_s=0.001, gain=10.0, readout_s=0.032, poses=48)
    return sheet(
        [
            ("ideal", color(LAB)),
            ("barrel, k1 -0.25, k2 0.06", color(replace(LAB, lens=BARREL))),
            ("fisheye", fisheye(LAB)),
            ("chromatic aberration 0.01, a part", magnified(color(fringed), 0.68, 0.3, 0.32)),
            ("vignetting 0.6", color(replace(LAB, lens=Lens(vignetting=0.6)))),
            (
                "aperture 40 mm, focus at 1 m",
                color(replace(LAB, lens=Lens(aperture_m=0.04, focus_m=1.0))),
            ),
            (
                "gain 16: noise, a part",
                magnified(color(replace(LAB, imager=NOISY)), 0.05, 0.55, 0.35),
            ),
            (
                "exposed 10 ms, turning at 300 deg/s",
                color(replace(LAB, imager=moving, turn_dps=300)),
            ),
            (
                "read out in 32 ms, turning at 400 deg/s",
                color(replace(LAB, imager=rolling, turn_dps=400)),
            ),
        ],
        3,
    )


def rural() -> Image.Image:
    """Draw a hamlet: color, depth, labels, and six effects."""
    seen, depth_m, labels = _layers(HAMLET)
    fringed = replace(HAMLET, lens=Lens(chromatic_aberration=0.006))
    return sheet(
        [
            ("color", seen),
            ("depth: red is 2 m, blue 60 m, white beyond", depth(depth_m, 2.0, 60.0)),
            ("labels", labels),
            ("barrel, k1 -0.25, k2 0.06", color(replace(HAMLET, lens=BARREL))),
            ("fisheye", fisheye(HAMLET)),
            ("vignetting 0.6", color(replace(HAMLET, lens=Lens(vignetting=0.6)))),
            ("chromatic aberration 0.006, a part", magnified(color(fringed), 0.0, 0.1, 0.4)),
            (
                "aperture 100 mm, focus at 30 m",
                color(replace(HAMLET, lens=Lens(aperture_m=0.1, focus_m=30.0))),
            ),
            (
                "gain 16: noise, a part",
                magnified(color(replace(HAMLET, imager=NOISY)), 0.4, 0.3, 0.35),
            ),
        ],
        3,
    )


def depth_camera() -> Image.Image:
    """Draw the laboratory in color, and as a D435i measures its depth."""
    scenario = load("indoor_depth")
    vehicle = scenario.vehicles[0]
    [spec] = [sensor for sensor in vehicle.sensors if isinstance(sensor, DepthCamera)]
    model = DepthCameraModel(scenario, vehicle, spec)
    [resting] = states(scenario, 1)
    readings = list(model.readings(resting))
    [measured] = [each for each in readings if isinstance(each, ImageMessage)]
    [jpeg] = [
        each.message
        for each in readings
        if isinstance(each, StreamMessage) and isinstance(each.message, CompressedImage)
    ]
    millimeters = np.frombuffer(measured.data, np.uint16).reshape(measured.height, measured.width)
    seen = cv2.imdecode(np.frombuffer(jpeg.data, np.uint8), cv2.IMREAD_COLOR)
    assert seen is not None
    drawn = depth((millimeters * 1e-3).astype(np.float32), 0.5, spec.max_range_m)
    return sheet([("", _half(np.asarray(seen[..., ::-1], np.uint8))), ("", drawn[::2, ::2])], 2)


def _half(picture: Pixels) -> Pixels:
    """Return a picture of half the size, each pixel the mean of four."""
    height, width = picture.shape[:2]
    small = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def within(world: str, eye: tuple[float, float, float], azimuth_deg: float) -> Pixels:
    """Return what is seen of a world from a place, in a direction clockwise from north."""
    _, scenario = load_partial(world)
    shown = scene(FileKind.WORLD, scenario, direction(0.0, 90.0))
    camera = pinhole(50.0, *LANDSCAPE)
    renderer = Renderer(scenario.world, shown, camera, layers=["color"], samples=16)
    renderer.place(shown.poses)
    there = np.array(eye)
    return renderer.draw(looking(there, there + direction(azimuth_deg, -3.0))).color.copy()


def terrain() -> Image.Image:
    """Draw a tank in a hamlet, its pond, and hills of 15 km from two sides."""
    size: dict[str, Any] = {"size": LANDSCAPE}
    tank = replace(HAMLET, xyz_m=(-9.0, 7.0, 1.2), rpy_deg=(0.0, 2.0, -38.0), **size)
    pond = replace(HAMLET, xyz_m=(-4.0, 36.0, 3.0), rpy_deg=(0.0, 4.0, 125.0), **size)
    near = within("valley", (0.0, 0.0, 450.0), 40.0)
    above = portrait(*load_partial("valley"), (200.0, 38.0), LANDSCAPE)
    return sheet([("", color(tank)), ("", color(pond)), ("", near), ("", above)], 2)


def meadow() -> Image.Image:
    """Draw a rover between tall grass, its view in color and depth, and a pond."""
    size: dict[str, Any] = {"scenario": "meadow", "size": (440, 330)}
    behind = PanelView(xyz_m=(-3.0, 1.2, 1.3), rpy_deg=(0.0, 10.0, -12.0), **size)
    pond = PanelView(xyz_m=(22.0, 4.0, 2.5), rpy_deg=(0.0, 12.0, -40.0), **size)
    seen, depth_m, _ = _layers(PanelView(xyz_m=(0.44, 0.0, 0.3), **size))
    panels = color(behind), seen, depth(depth_m, 0.5, 20.0), color(pond)
    return sheet([("", panel) for panel in panels], 2)


SHEETS: dict[str, Callable[[], Image.Image]] = {
    "camera": camera,
    "camera_effects": effects,
    "camera_rural": rural,
    "depth": depth_camera,
    "meadow": meadow,
    "terrain": terrain,
}
"""Sheets by the name of their file."""


def main(arguments: Sequence[str]) -> None:
    """Write a sheet."""
    parser = argparse.ArgumentParser(prog="python -m tools.pictures.panels")
    parser.add_argument("sheet", choices=SHEETS)
    parser.add_argument("out", type=Path)
    options = parser.parse_args(arguments)
    SHEETS[options.sheet]().save(options.out)


if __name__ == "__main__":
    main(sys.argv[1:])
