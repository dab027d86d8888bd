# SPDX-License-Identifier: Apache-2.0
"""What each effect of a lens does to a picture, and that without it there is none."""

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import Floats
from groundlink.scenario import cameras
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.target import Frame
from services.sensors.rendering.optics.distortion import EDGE, MODELS
from services.sensors.rendering.optics.lens import MOST_PIXELS, Focus, LensOptics

PINHOLE = Pinhole(320, 240, 250.0, 245.0, 165.3, 117.8)
BARREL = (-0.25, 0.06, 0.001, -0.002, -0.003)
FISHEYE = (-0.02, 0.004, -0.03, 0.2)
LENSES: dict[str, dict[str, Any]] = {
    "barrel": {"distortion": BARREL},
    "pincushion": {"distortion": (0.25, 0.05)},
    "decentered": {"distortion": (0.0, 0.0, 0.01, -0.008)},
    "fisheye": {"model": "equidistant", "distortion": FISHEYE},
}


def lens(**fields: Any) -> LensOptics:
    return LensOptics(cameras.Lens(**fields), PINHOLE)


def through(made: LensOptics, color: NDArray[np.uint8], depth_m: float = 2.0) -> Frame:
    shape = color.shape[:2]
    labels = np.arange(color[..., 0].size, dtype=np.int32).reshape(shape)
    return made.seen(Frame(color, np.full(shape, depth_m, np.float32), labels))


def gray(made: LensOptics, value: int = 200) -> NDArray[np.uint8]:
    return np.full((made.drawn.height, made.drawn.width, 3), value, np.uint8)


def spotted(made: LensOptics, points: Floats) -> NDArray[np.uint8]:
    """Return a drawing with round spots where rays through `points` at z of 1 are."""
    rays = made.drawn.rays()[..., :2]
    focal = np.array([made.drawn.fx, made.drawn.fy])
    light = np.zeros(rays.shape[:2])
    for point in points:
        squared = (((rays - point) * focal) ** 2).sum(axis=-1)
        light += 250 * np.exp(-squared / (2 * 2.0**2))
    return np.repeat(np.rint(light).astype(np.uint8)[..., None], 3, axis=-1)


def spot(channel: NDArray[np.uint8], near: Floats) -> Floats:
    """Return the middle of the light within 9 pixels of a place: column, row."""
    rows, columns = np.mgrid[: channel.shape[0], : channel.shape[1]]
    light = channel * (np.hypot(columns - near[0], rows - near[1]) < 9)
    return np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()


def in_picture(points: Floats, **fields: Any) -> Floats:
    """Return where OpenCV has points at z of 1 in the picture, shape (N, 2)."""
    spec = cameras.Lens(**fields)
    solid = np.column_stack([points, np.ones(len(points))])[:, None]
    project = cv2.projectPoints if spec.model == "plumb_bob" else cv2.fisheye.projectPoints
    zero = np.zeros(3)
    found = project(solid, zero, zero, PINHOLE.matrix(), np.array(spec.coefficients))[0]
    return np.asarray(found, np.float64).reshape(-1, 2)


GRID = np.array([(x, y) for x in (-0.45, -0.2, 0.0, 0.3, 0.5) for y in (-0.35, 0.0, 0.3)])


@pytest.mark.parametrize("name", LENSES)
def test_points_are_where_opencv_says(name: str) -> None:
    made = lens(**LENSES[name])
    color = through(made, spotted(made, GRID)).color
    wanted = in_picture(GRID, **LENSES[name])
    inside = ((wanted > 8) & (wanted < (312, 232))).all(axis=1)
    assert inside.sum() >= 11
    found = np.array([spot(color[..., 1], near) for near in wanted[inside]])
    assert np.abs(found - wanted[inside]).max() < 0.1
    # And that is not where a pinhole has them.
    straight = GRID * (PINHOLE.fx, PINHOLE.fy) + (PINHOLE.cx, PINHOLE.cy)
    assert np.abs(straight - wanted).max() > 2


@pytest.mark.parametrize(("k1", "bows"), [(-0.15, 1), (0.15, -1), (0.0, 0)])
def test_lines_curve(k1: float, bows: int) -> None:
    """A straight line above the middle bows up in a barrel, down in a pincushion."""
    made = lens(distortion=(k1,))
    drawing = gray(made, 0)
    y = made.drawn.rays()[:, 0, 1]
    drawing[np.abs(y + 0.35).argmin()] = 255
    color = through(made, drawing).color[..., 1].astype(np.float64)
    rows = (color * np.arange(240)[:, None]).sum(axis=0) / color.sum(axis=0)
    sagitta = (rows[20] + rows[310]) / 2 - rows[165]
    assert abs(sagitta) < 0.05 if bows == 0 else bows * sagitta > 2


@pytest.mark.parametrize("name", LENSES)
def test_no_corner_is_black(name: str) -> None:
    made = lens(**LENSES[name], chromatic_aberration=0.01)
    frame = through(made, gray(made))
    assert (frame.color == 200).all()
    assert (frame.depth_m == 2.0).all()


def test_depth_and_labels_are_of_the_nearest_drawn_pixel() -> None:
    made = lens(distortion=BARREL)
    labels = through(made, gray(made)).labels
    assert labels is not None
    rows, columns = np.divmod(labels, made.drawn.width)
    points = made.drawn.rays()[rows, columns, :2].reshape(-1, 2)
    wanted = np.stack(np.meshgrid(np.arange(320), np.arange(240)), axis=-1).reshape(-1, 2)
    assert np.abs(in_picture(points, distortion=BARREL) - wanted).max() < 0.75


def test_a_fisheye_is_black_beyond_its_circle() -> None:
    wide = Pinhole(320, 240, 125.0, 125.0, 159.5, 119.5)  # 147 degrees across, 183 in the corners
    made = LensOptics(cameras.Lens(model="equidistant"), wide)
    frame = through(made, gray(made))
    angle = np.hypot(*np.moveaxis(wide.rays()[..., :2], -1, 0))
    assert (frame.color[angle < EDGE - 0.02] == 200).all()
    assert (frame.color[angle > EDGE + 0.02] == 0).all()
    assert np.isinf(frame.depth_m[angle > EDGE + 0.02]).all()
    assert frame.labels is not None
    assert (frame.labels[angle > EDGE + 0.02] == -1).all()
    assert made.drawn.width * made.drawn.height <= 1.05 * MOST_PIXELS * 320 * 240


@pytest.mark.parametrize(
    ("fields", "pinhole"),
    [
        ({"model": "equidistant"}, Pinhole(320, 240, 120.0, 120.0, 159.5, 119.5)),
        ({"distortion": (-0.9,)}, PINHOLE),
        ({"model": "equidistant", "distortion": (-0.9,)}, PINHOLE),
    ],
)
def test_what_cannot_be_drawn_is_refused(fields: dict[str, Any], pinhole: Pinhole) -> None:
    with pytest.raises(UserError, match="150 degrees or folds back") as caught:
        LensOptics(cameras.Lens(**fields), pinhole)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", LENSES)
def test_models_go_there_and_back(name: str) -> None:
    spec = cameras.Lens(**LENSES[name])
    model, coefficients = MODELS[spec.model], np.array(spec.coefficients)
    back = model.straight(model.bent(GRID, coefficients), coefficients)
    assert back == pytest.approx(GRID, abs=1e-5)


@pytest.mark.parametrize("aberration", [0.01, -0.01, 0.0])
@pytest.mark.parametrize("distortion", [(), BARREL])
def test_colors_part_with_the_distance_from_the_middle(
    aberration: float, distortion: tuple[float, ...]
) -> None:
    made = lens(chromatic_aberration=aberration, distortion=distortion)
    color = through(made, spotted(made, GRID)).color
    middle = np.array([PINHOLE.cx, PINHOLE.cy])
    for near in in_picture(GRID, distortion=distortion):
        if not ((near > 12) & (near < (308, 228))).all():
            continue
        red, green, blue = (spot(color[..., i], near) for i in range(3))
        assert red - green == pytest.approx(aberration * (near - middle), abs=0.12)
        assert blue - green == pytest.approx(-aberration * (near - middle), abs=0.12)


@pytest.mark.parametrize("vignetting", [0.0, 0.2, 0.8])
def test_light_falls_off_to_the_corners(vignetting: float) -> None:
    made = lens(vignetting=vignetting)
    light = (through(made, gray(made)).color / 255.0) ** 2
    squared = ((np.moveaxis(PINHOLE.rays()[..., :2], -1, 0).T * (PINHOLE.fx, PINHOLE.fy)) ** 2).sum(
        axis=-1
    )
    left = 1 / (1 + vignetting * squared.T / squared.max()) ** 2
    wanted = (200 / 255) ** 2 * np.repeat(left[..., None], 3, axis=-1)
    assert np.abs(light - wanted).max() < 0.008
    assert light.min() < 0.95 * light.max() or vignetting == 0


def edge_width_px(depth_m: float, **fields: Any) -> float:
    """Return the standard deviation of what an edge at a distance is blurred with."""
    made = lens(**fields)
    drawing = gray(made, 0)
    drawing[:, 160:] = 255
    rise = np.diff(through(made, drawing, depth_m).color[120, :, 1].astype(np.float64)) / 255
    at = np.arange(len(rise))
    return float(np.sqrt(rise @ (at - rise @ at) ** 2))


@pytest.mark.parametrize("depth_m", [0.3, 0.5, 1.0, 2.0, 4.0, 100.0, np.inf])
def test_blur_is_by_the_circle_of_confusion(depth_m: float) -> None:
    focal_px = (PINHOLE.fx + PINHOLE.fy) / 2
    diameter = focal_px * 0.02 * abs(1 / depth_m - 1 / 2.0)
    # A disc's standard deviation along a line is a quarter of its diameter.
    assert edge_width_px(depth_m, aperture_m=0.02) == pytest.approx(diameter / 4, abs=0.1, rel=0.05)
    assert edge_width_px(depth_m, aperture_m=0.0) == 0.0


@pytest.mark.parametrize("near", [slice(0, 12), slice(100, 130), slice(225, 240)])
def test_near_rows_are_blurred_as_in_a_picture_that_is_near_everywhere(near: slice) -> None:
    color = np.random.default_rng(5).integers(0, 256, (240, 320, 3), np.uint8)
    focus = Focus(spread_px_m=5.0, focus_m=2.0)
    nothing = np.empty((0, 0), np.int32)
    mixed = np.full(color.shape[:2], 2.0, np.float32)
    mixed[near] = 0.3  # 14 px
    blurred = focus.seen(Frame(color, np.full_like(mixed, 0.3), nothing))
    seen = focus.seen(Frame(color, mixed, nothing))
    assert np.array_equal(seen[near], blurred[near])
    sharp = np.ones(240, bool)
    sharp[near] = False
    assert np.array_equal(seen[sharp], color[sharp])
    assert not np.array_equal(seen[near], color[near])


def test_an_ideal_lens_changes_nothing() -> None:
    made = lens(focus_m=1.0)
    assert made.drawn is PINHOLE
    frame = Frame(gray(made), np.ones((240, 320), np.float32), None)
    assert made.seen(frame) is frame


def test_too_many_coefficients_are_refused() -> None:
    with pytest.raises(ValueError, match="takes up to 4: k1, k2, k3, k4"):
        cameras.Lens(model="equidistant", distortion=(0.0,) * 5)
