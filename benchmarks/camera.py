# SPDX-License-Identifier: Apache-2.0
"""Rendering time compared with PyBullet's two renderers: `python -m benchmarks.camera`.

All renderers draw the same room through the same pinhole from the same positions and read back
color and depth. They take turns, each in its own process, because PyBullet's EGL fails beside
another OpenGL context. Groundlink draws textures and the shadows of two lamps and of a vehicle that
moves with every picture. PyBullet draws plain colors and a static scene without a segmentation
mask: TinyRenderer with its shadow, EGL without shadows, which it lacks. PyBullet has one sample per
pixel and jagged edges, as `groundlink_jagged` has; `groundlink` has the default of four samples.
`groundlink_lens` adds distortion, chromatic aberration, vignetting, depth of field, noise and a
JPEG. `groundlink_at_rest` stays at one place, with the scenario's own camera; all others show
another place with every picture. Figures are medians. `ratio` compares processor time over
all threads, which other load on the machine disturbs least; `wall_ratio` compares elapsed time.
"""

import argparse
import importlib.util
import multiprocessing
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pybullet
from msgspec.structs import replace

from groundlink.core.frames import Floats, matrix_from_quaternion, multiply, transform
from groundlink.loader import load
from groundlink.scenario import Scenario
from groundlink.scenario.cameras import Imager, Lens
from groundlink.scenario.schema import Vehicle
from groundlink.scene.build import solids
from groundlink.world.solids import Box, Cylinder, Solid, Sphere
from services.sensors.camera.spec import Camera
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rendering.cameras.messages import jpeg
from services.sensors.rendering.gl.context import open_context
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import Frame
from services.sensors.rendering.optics import lens
from services.sensors.rendering.optics.imager import Electronics
from services.sensors.runtime.world_replica import WorldReplica

from .claims import Claim, add_options, judge
from .lidar.driving import link_poses

LAB = Path(__file__).parents[1] / "scenarios" / "indoor_lab.yaml"
TICKS_A_PICTURE = 40
WARM_UP = 2
WAYS = (
    *(
        "groundlink",
        "groundlink_jagged",
        "groundlink_jpeg",
        "groundlink_lens",
        "groundlink_at_rest",
    ),
    *("tiny", "egl"),
)
GOALS = {
    ("groundlink_jagged", "tiny"): 6.0,
    ("groundlink_jagged", "egl"): 1.5,
    ("groundlink", "tiny"): 4.0,
    ("groundlink_lens", "tiny"): 2.5,
}
"""Lowest ratios that Groundlink claims."""

SIZES = ((640, 480), (1280, 720), (1920, 1080))
"""Of the table."""

NAMES = {
    "groundlink": "a picture",
    "groundlink_jagged": "a picture with one sample a pixel",
    "groundlink_lens": "a picture through a lens, as JPEG",
    "groundlink_at_rest": "a picture of a vehicle at rest, with noise, as JPEG",
    "tiny": "PyBullet's TinyRenderer",
    "egl": "PyBullet's EGL renderer",
}

LENS = Lens(
    distortion=(-0.2, 0.05, 0.001, -0.001),
    chromatic_aberration=0.002,
    vignetting=0.4,
    aperture_m=0.01,
)
GRAIN = Imager(full_well_electrons=10000.0, read_noise_electrons=5.0, black_level=0.01)


def clocks() -> Floats:
    """Return elapsed and processor time in milliseconds."""
    return 1e3 * np.array([time.perf_counter(), time.process_time()])


def place(scenario: Scenario, vehicle: Vehicle, camera: Camera, number: int) -> Floats:
    """Return world_from_optical of a picture by its number, shape (4, 4)."""
    base = link_poses(scenario, TICKS_A_PICTURE * number)[vehicle.name][0]
    base_from_optical = transform(camera.mount.xyz_m, camera.mount.quaternion(optical=True))
    world_from_optical: Floats = transform(base[:3], base[3:]) @ base_from_optical
    return world_from_optical


class Ours:
    """Groundlink's renderer on a path through the room."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, camera: Camera) -> None:
        self._scenario, self._vehicle, self._camera = scenario, vehicle, camera
        around = WorldReplica(scenario, vehicle, camera.mount)
        self._lens = lens.LensOptics(camera.lens, Pinhole.of(camera))
        self._renderer = Renderer(scenario.world, around, self._lens.drawn, samples=camera.samples)
        values = 3 * camera.width * camera.height
        self._electronics = Electronics(camera.imager, values, RandomStreams(1, "camera"))

    def _picture(self, number: int) -> Frame:
        poses = link_poses(self._scenario, TICKS_A_PICTURE * number)
        self._renderer.place(np.concatenate([*poses.values()]))
        return self._renderer.draw(place(self._scenario, self._vehicle, self._camera, number))

    def draw(self, number: int) -> None:
        """Move everything and draw."""
        self._picture(number)

    def draw_and_compress(self, number: int) -> None:
        """Move everything, draw with lens and sensor effects, and encode a JPEG."""
        color = self._lens.seen(self._picture(number)).color
        color = self._electronics.read(color, number)
        jpeg(0, "", color, gray=False, quality=self._camera.jpeg_quality)


class Rival:
    """PyBullet with the same solids and the vehicle at its spawn pose."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, camera: Camera, *, egl: bool) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        if egl:
            self._load_egl()  # objects loaded before the renderer are not drawn
        self._pinhole = Pinhole.of(camera)
        self._place: Callable[[int], Floats] = lambda n: place(scenario, vehicle, camera, n)
        materials = scenario.world.materials
        for solid in solids(scenario):
            self._add(solid, np.array([0, 0, 0, 0, 0, 0, 1.0]), materials[solid.material].color)
        base = link_poses(scenario, 0)[vehicle.name][0]
        for visual in vehicle.model.visuals:
            self._add(visual, base, materials[visual.material].color)

    def _load_egl(self) -> None:
        """Load the EGL renderer that is part of PyBullet."""
        found = importlib.util.find_spec("eglRenderer")
        assert found is not None
        assert found.origin is not None
        plugin = pybullet.loadPlugin(
            found.origin, "_eglRendererPlugin", physicsClientId=self._client
        )
        assert plugin >= 0

    def _add(self, solid: Solid, world_from_frame: Floats, color: tuple[float, ...]) -> None:
        client = {"physicsClientId": self._client}
        look = {"rgbaColor": [*np.sqrt(color).tolist(), 1.0], **client}
        match solid.shape:
            case Box(size_m=size):
                half = [length / 2 for length in size]
                shape = pybullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=half, **look)
            case Cylinder(radius_m=radius, length_m=length):
                shape = pybullet.createVisualShape(
                    pybullet.GEOM_CYLINDER, radius=radius, length=length, **look
                )
            case Sphere(radius_m=radius):
                shape = pybullet.createVisualShape(pybullet.GEOM_SPHERE, radius=radius, **look)
        place, turn = world_from_frame[:3], world_from_frame[3:]
        pybullet.createMultiBody(
            baseVisualShapeIndex=shape,
            basePosition=(place + matrix_from_quaternion(turn) @ solid.position_m).tolist(),
            baseOrientation=multiply(turn, solid.orientation).tolist(),
            **client,
        )

    def picture(self, number: int, renderer: int, *, shadow: int) -> None:
        """Draw a picture."""
        pinhole = self._pinhole
        # OpenGL's camera looks along -z with y up; its projection needs a far plane.
        world_from_camera = self._place(number) @ np.diag([1.0, -1.0, -1.0, 1.0])
        near, far = 0.02, 100.0
        projection = np.zeros((4, 4))
        projection[0, 0] = 2 * pinhole.fx / pinhole.width
        projection[1, 1] = 2 * pinhole.fy / pinhole.height
        projection[2, 2:] = -(far + near) / (far - near), -2 * far * near / (far - near)
        projection[3, 2] = -1.0
        pybullet.getCameraImage(
            pinhole.width,
            pinhole.height,
            np.linalg.inv(world_from_camera).T.ravel().tolist(),
            projection.T.ravel().tolist(),
            lightDirection=[0.2, 0.3, 3.0],
            shadow=shadow,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            renderer=renderer,
            physicsClientId=self._client,
        )


def painter(way: str, size: tuple[int, int]) -> Callable[[int], None]:
    """Return a function that draws a picture by its number, with one of the renderers."""
    scenario = load(LAB)
    vehicle, camera = scenario.sensor("rover/camera") or (None, None)
    assert vehicle is not None
    assert isinstance(camera, Camera)
    camera = replace(camera, width=size[0], height=size[1])
    if way == "groundlink_jagged":
        camera = replace(camera, samples=1)
    if way == "groundlink_lens":
        camera = replace(camera, lens=LENS, imager=GRAIN)
    if way.startswith("groundlink"):
        ours = Ours(scenario, vehicle, camera)
        if way == "groundlink_at_rest":
            return lambda _: ours.draw_and_compress(0)
        return ours.draw if way in ("groundlink", "groundlink_jagged") else ours.draw_and_compress
    rival = Rival(scenario, vehicle, camera, egl=way == "egl")
    if way == "tiny":
        return lambda number: rival.picture(number, pybullet.ER_TINY_RENDERER, shadow=1)
    return lambda number: rival.picture(number, pybullet.ER_BULLET_HARDWARE_OPENGL, shadow=0)


def paint(way: str, size: tuple[int, int], pipe: Connection) -> None:
    """Draw a picture for each number from a pipe; reply with the elapsed and the processor time."""
    picture = painter(way, size)
    while (number := pipe.recv()) is not None:
        started = clocks()
        picture(number)
        pipe.send(clocks() - started)


def measured(size: tuple[int, int], rounds: int) -> dict[str, Floats]:
    """Return the median elapsed and processor time of a picture by way, milliseconds."""
    context = multiprocessing.get_context("spawn")
    pipes: dict[str, Connection] = {}
    for way in WAYS:
        pipes[way], there = context.Pipe()
        context.Process(target=paint, args=(way, size, there), daemon=True).start()
        there.close()  # so that the end of the process is noticed
    spent: dict[str, list[Floats]] = {way: [] for way in WAYS}
    for number in range(rounds + WARM_UP):
        for way, pipe in pipes.items():
            pipe.send(number)
            spent[way].append(pipe.recv())
    for pipe in pipes.values():
        pipe.send(None)
    return {way: np.median(times[WARM_UP:], axis=0) for way, times in spent.items()}


def print_table(rounds: int) -> None:
    """Print the table of the documentation for this machine, with the name of its renderer."""
    opened = open_context()
    print(f"OpenGL: {opened.info['GL_RENDERER']}; elapsed (processor time) of a picture, ms\n")
    opened.release()
    medians = [measured(size, rounds) for size in SIZES]
    print("| | " + " | ".join(f"{width} x {height}" for width, height in SIZES) + " |")
    print("|---" * (1 + len(SIZES)) + "|")
    for way, name in NAMES.items():
        cells = [
            f"{wall_ms:.1f} ({cpu_ms:.1f})" for wall_ms, cpu_ms in (one[way] for one in medians)
        ]
        print(f"| {name} | " + " | ".join(cells) + " |")


def main() -> int:
    """Measure, print, and compare with --check."""
    parser = argparse.ArgumentParser(prog="benchmarks.camera", description=__doc__)
    add_options(parser)
    parser.add_argument("--size", default="1280x720", metavar="WxH")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--table", action="store_true", help="print a table of several sizes")
    options = parser.parse_args()
    if options.table:
        print_table(options.rounds)
        return 0
    width, height = (int(word) for word in options.size.split("x"))
    medians = measured((width, height), options.rounds)
    print(f"camera {options.size}, color and depth, {options.rounds} pictures each")
    for way, (wall_ms, cpu_ms) in medians.items():
        print(f"  {way:16} cpu_ms={cpu_ms:.1f} wall_ms={wall_ms:.1f}")
    claims = []
    for (way, rival), goal in GOALS.items():
        wall_ratio, ratio = medians[rival] / medians[way]
        print(f"  {way} against {rival}: ratio={ratio:.1f} wall_ratio={wall_ratio:.1f}")
        claims.append(Claim(f"{NAMES[rival]}'s time over that of {NAMES[way]}", ratio, goal))
    return judge(claims, options)


if __name__ == "__main__":
    sys.exit(main())
