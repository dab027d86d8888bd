# SPDX-License-Identifier: Apache-2.0
"""Moving picture of recorded drives: the world with LiDAR points, and the camera's picture.

`python -m tools.pictures moving` starts it with the name of the file. The same
recordings, versions of Pillow and of the OpenGL driver give the same bytes.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from groundlink.core.frames import Floats
from groundlink.loader.partial_scenario import FileKind
from groundlink.scenario.cameras import Optics
from groundlink.scenario.rotating_lidar import RotatingLidar
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.portrait.picture import INDOORS
from services.sensors.rendering.portrait.scene import scene
from services.view.colors import RAINBOW

from .recorded import Pixels, RecordedDrive, record
from .viewpoints import ChaseEye, OverviewEye

WIDTH, HEIGHT = 640, 360
FPS = 10
QUALITY = 34
"""WebP's, of 100."""

DARK = 0.72
"""Brightness of the world, so that points stand out."""

NIGHT = (13, 17, 23)
"""Color around a room: red, green, blue."""

TRAIL = np.array((90, 215, 255), np.uint8)
"""Color of the vehicle's way."""

HIDDEN_M = 0.15
"""Points that are farther behind a surface of the picture than this are hidden by it."""

CORNER = 12
"""Space around insets, pixels."""


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A part of the picture: some seconds of a shipped scenario."""

    scenario: str
    from_s: float
    seconds: float
    viewpoint: OverviewEye | ChaseEye
    heights_m: tuple[float, float]
    """Heights above the vehicle's base of points that are blue and red."""

    revolutions: int
    """Newest revolutions of the LiDAR that are drawn."""

    hide_above_m: float = math.inf
    """Height above which points are left out: those of a ceiling."""

    trail_s: float = 0.0
    """Seconds before the shot from which the vehicle's way is drawn."""


SHOTS = (
    Shot(
        scenario="indoor_lab_tour",
        from_s=8.0,
        seconds=5.0,
        viewpoint=OverviewEye(azimuth_deg=196, elevation_deg=46),
        heights_m=(0.0, 2.4),
        revolutions=1,
        hide_above_m=2.8,
        trail_s=8.0,
    ),
    Shot(
        scenario="outdoor_paper",
        from_s=14.0,
        seconds=5.5,
        viewpoint=ChaseEye(behind_m=11.0, above_m=5.0, aside_deg=28.0, ahead_m=4.0),
        heights_m=(-2.5, 5.0),
        revolutions=3,
    ),
)


FOLDER = Path(__file__).resolve().parents[2] / "build" / "pictures"
"""Where recordings are kept."""


def moving_picture(out: Path, folder: Path, shots: Sequence[Shot] = SHOTS) -> None:
    """Write the moving picture; recordings are kept in a folder."""
    pictures = [Image.fromarray(frame) for shot in shots for frame in frames(shot, folder)]
    pictures[0].save(
        out,
        save_all=True,
        append_images=pictures[1:],
        duration=1000 // FPS,
        loop=0,
        quality=QUALITY,
        method=6,
    )


def frames(shot: Shot, folder: Path) -> Iterator[Pixels]:
    """Yield the frames of a shot, shape (HEIGHT, WIDTH, 3)."""
    drive = RecordedDrive(record(shot.scenario, shot.from_s + shot.seconds + 2.0, folder))
    shown = scene(FileKind.SCENARIO, drive.scenario, shot.viewpoint.towards_eye())
    pinhole, _ = shot.viewpoint.eye(drive, shown.corners, shot.from_s, (WIDTH, HEIGHT))
    renderer = Renderer(shown.world, shown, pinhole, layers=["color", "depth"], samples=16)
    if shown.world.room:
        renderer.exposure = INDOORS
    [lidar] = [s for s in drive.vehicle.sensors if isinstance(s, RotatingLidar)]
    cameras = [s for s in drive.vehicle.sensors if isinstance(s, Optics)]
    carried = ", ".join(sensor.name for sensor in drive.vehicle.sensors)
    for number in range(round(shot.seconds * FPS)):
        at_s = shot.from_s + number / FPS
        world_from_optical = shot.viewpoint.eye(drive, shown.corners, at_s, (WIDTH, HEIGHT))[1]
        renderer.place(drive.links(at_s))
        frame = renderer.draw(world_from_optical)
        picture = (frame.color * DARK).astype(np.uint8)
        if shown.world.room:
            picture[np.isinf(frame.depth_m)] = NIGHT
        points = drive.points(
            lidar.ros_topics()[""], at_s - shot.revolutions / lidar.rotation_rate_hz, at_s
        )
        points = points[points[:, 2] < shot.hide_above_m]
        base_z_m = drive.base_at(np.array([at_s]))[0, 2]
        way = drive.base_at(np.arange(shot.from_s - shot.trail_s, at_s, 0.01))
        for there, colors, size_px in (
            (way, np.broadcast_to(TRAIL, way.shape), 3),
            (points, RAINBOW_RGB[_shares(points[:, 2] - base_z_m, *shot.heights_m)], 2),
        ):
            draw_points(picture, frame.depth_m, there, colors, pinhole, world_from_optical, size_px)
        for camera in cameras:
            seen = drive.image(camera.ros_topics()[""], at_s, 1.5 / camera.rate_hz)
            if seen is not None:
                _inset(picture, seen)
        now = f"{at_s:.1f} s, {drive.speed_mps(at_s):.1f} m/s"
        yield _captioned(picture, shot.scenario, f"{now}: {carried}")


RAINBOW_RGB = np.stack([RAINBOW >> shift & 255 for shift in (24, 16, 8)], axis=-1).astype(np.uint8)


def _shares(values: Floats, low: float, high: float) -> NDArray[np.uint8]:
    share = (values - low) / (high - low)
    return (255 * np.clip(share, 0, 1)).astype(np.uint8)


def draw_points(
    picture: Pixels,
    depth_m: NDArray[np.float32],
    points: Floats,
    colors: Pixels,
    pinhole: Pinhole,
    world_from_optical: Floats,
    size_px: int,
) -> None:
    """Draw points into a picture, farthest first, without those behind its surfaces.

    Parameters
    ----------
    picture : shape (height, width, 3)
    depth_m : shape (height, width)
        Depth of the picture's surfaces, along z of the optical frame.
    points, colors : shape (N, 3)
        In the world; red, green, blue.
    """
    in_optical = (points - world_from_optical[:3, 3]) @ world_from_optical[:3, :3]
    ahead = in_optical[:, 2] > pinhole.near_m
    in_optical, colors = in_optical[ahead], colors[ahead]
    far_first = np.argsort(-in_optical[:, 2], kind="stable")
    in_optical, colors = in_optical[far_first], colors[far_first]
    z = in_optical[:, 2]
    x = np.rint(pinhole.fx * in_optical[:, 0] / z + pinhole.cx).astype(int)
    y = np.rint(pinhole.fy * in_optical[:, 1] / z + pinhole.cy).astype(int)
    height, width = depth_m.shape
    inside = (x >= 0) & (x < width - size_px) & (y >= 0) & (y < height - size_px)
    x, y, z, colors = x[inside], y[inside], z[inside], colors[inside]
    visible = z < depth_m[y, x] * 1.01 + HIDDEN_M
    x, y, colors = x[visible], y[visible], colors[visible]
    for row in range(size_px):
        for column in range(size_px):
            picture[y + row, x + column] = colors


def _inset(picture: Pixels, seen: Pixels) -> None:
    """Put a camera's picture into the lower right corner."""
    width = WIDTH // 4
    height = width * seen.shape[0] // seen.shape[1]
    small = cv2.resize(seen, (width, height), interpolation=cv2.INTER_AREA)
    bottom, right = HEIGHT - CORNER, WIDTH - CORNER
    picture[bottom - height - 2 : bottom + 2, right - width - 2 : right + 2] = 240
    picture[bottom - height : bottom, right - width : right] = small


def _captioned(picture: Pixels, title: str, line: str) -> Pixels:
    """Return a picture with two lines in its upper left corner."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image, "RGBA")
    draw.rounded_rectangle((8, 8, 306, 56), radius=6, fill=(15, 20, 28, 170))
    draw.text((18, 12), title, font=ImageFont.load_default(18), fill=(255, 255, 255))
    draw.text((18, 35), line, font=ImageFont.load_default(14), fill=(205, 215, 225))
    return np.asarray(image.convert("RGB"))


if __name__ == "__main__":
    moving_picture(Path(sys.argv[1]), FOLDER)
