# SPDX-License-Identifier: Apache-2.0
"""The color camera: what it sends, when, and that it says the truth of it."""

from typing import Any

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.frames import transform
from groundlink.messages.base import BadBusMessage, BusMessage, State
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image
from groundlink.ros.message_sizes import body_bytes
from groundlink.ros.streams import outgoing, static_transforms
from groundlink.scenario.cameras import Imager, Lens
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from services.sensors.camera.model import CameraModel
from services.sensors.camera.spec import Camera
from services.sensors.rendering.cameras.eye import Eye
from services.sensors.rendering.cameras.messages import jpeg
from services.sensors.rendering.gl.target import ALL_LAYERS
from services.sensors.rendering.optics.lens import LensOptics
from services.sensors.runtime.model import LeftOut, stream_and_message
from services.view.drawing import Track
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import box, moving, resting, yard

MOUNT = Mount((0.2, 0.0, 1.0), (0.0, 0.0, 0.0))


def spec(**fields: Any) -> Camera:
    defaults = {"width": 160, "height": 120, "rate_hz": 30.0, "mount": MOUNT, "publish": "both"}
    return Camera(
        name="camera",
        topic="/camera/image_raw",
        frame="camera_optical_frame",
        **{**defaults, **fields},
    )


def world() -> Scenario:
    return yard(
        box("ground", (40, 40, 1), (0, 0, -1.5)),
        box("crate", (1, 1, 1), (5, 0.8, 0.5), "black"),
        frame_prefix="one/",
    )


def camera(**fields: Any) -> CameraModel:
    made = world()
    return CameraModel(made, made.vehicles[0], spec(**fields))


def taken(
    model: CameraModel, run: list[State], waiting: int = 0, *, span_ticks: int = 0
) -> dict[str, list[BusMessage]]:
    """Return the messages of each stream."""
    streams: dict[str, list[BusMessage]] = {}
    for state in run:
        model.behind(waiting)
        for made in model.readings(state):
            if not isinstance(made, LeftOut):
                output, message = stream_and_message(made)
                streams.setdefault(output, []).append(message)
        assert model.settled_tick() in (-1, state.tick - span_ticks)
    return streams


def pixels(message: BusMessage) -> np.ndarray[Any, np.dtype[np.uint8]]:
    assert isinstance(message, Image)
    flat = np.frombuffer(message.data, np.uint8).reshape(message.height, message.row_bytes)
    return flat.reshape(message.height, message.width, -1).squeeze()


def test_pictures_come_at_the_rate_with_their_stamps() -> None:
    streams = taken(camera(), resting(81))
    thirtieths = [EPOCH_NANOS + i * 1_000_000_000 // 30 for i in range(7)]
    assert list(streams) == ["camera_info", "image", ""]
    for messages in streams.values():
        assert [message.stamp_nanos for message in messages] == thirtieths  # type: ignore[attr-defined]
        assert {message.frame for message in messages} == {"one/camera_optical_frame"}  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("publish", "streams"),
    [("compressed", {"", "camera_info"}), ("raw", {"image", "camera_info"})],
)
def test_only_requested_outputs(publish: str, streams: set[str]) -> None:
    assert taken(camera(publish=publish), resting(1)).keys() == streams
    made = world()
    rover = replace(made.vehicles[0], sensors=(spec(publish=publish),))
    topics = {s.topic for s in outgoing(replace(made, vehicles=(rover,)), "run")}
    asked = {"compressed": "/camera/image_raw/compressed", "raw": "/camera/image_raw"}[publish]
    of_camera = {topic for topic in topics if topic.startswith("/camera")}
    assert of_camera == {"/camera/camera_info", asked}


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "mono8"])
def test_encodings_show_the_same(encoding: str) -> None:
    made = world()
    eye = Eye(made, made.vehicles[0], spec())
    eye.take(resting(1)[0])
    rgb = eye.look(0).color.copy()
    streams = taken(camera(encoding=encoding, jpeg_quality=95), resting(1))
    (raw,), (file,) = streams["image"], streams[""]
    assert isinstance(raw, Image)
    assert raw.encoding == encoding
    wanted = {
        "rgb8": rgb,
        "bgr8": rgb[..., ::-1],
        "mono8": cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY),
    }
    assert np.array_equal(pixels(raw), wanted[encoding])
    assert isinstance(file, CompressedImage)
    decoded = cv2.imdecode(np.frombuffer(file.data, np.uint8), cv2.IMREAD_UNCHANGED)
    bgr = wanted["mono8"] if encoding == "mono8" else rgb[..., ::-1]
    assert decoded is not None
    assert decoded.shape == bgr.shape
    assert np.abs(decoded.astype(int) - bgr).mean() < 2.0
    stored = "mono8; jpeg compressed mono8" if encoding == "mono8" else "rgb8; jpeg compressed bgr8"
    assert file.format == stored


def test_bayer_has_one_color_a_pixel() -> None:
    color = pixels(taken(camera(publish="raw"), resting(1))["image"][0])
    mosaic = pixels(taken(camera(publish="raw", encoding="bayer_rggb8"), resting(1))["image"][0])
    assert np.array_equal(mosaic[::2, ::2], color[::2, ::2, 0])
    assert np.array_equal(mosaic[1::2, ::2], color[1::2, ::2, 1])
    assert np.array_equal(mosaic[::2, 1::2], color[::2, 1::2, 1])
    assert np.array_equal(mosaic[1::2, 1::2], color[1::2, 1::2, 2])


def test_quality_is_size() -> None:
    sizes = [
        len(taken(camera(jpeg_quality=quality), resting(1))[""][0].data)  # type: ignore[attr-defined]
        for quality in (20, 80, 98)
    ]
    assert sizes == sorted(sizes)
    assert sizes[2] > 2 * sizes[0]


def test_raw_size_matches_its_declaration() -> None:
    told = body_bytes(world().vehicles[0], spec(publish="raw"))
    assert 57600 <= told <= 57600 + 100


@pytest.mark.parametrize("quality", [20, 50, 70, 80, 85, 90, 95, 98, 100])
def test_largest_jpeg_matches_its_declaration(quality: int) -> None:
    """A picture of pure noise is the largest there is."""
    told = body_bytes(world().vehicles[0], spec(publish="compressed", jpeg_quality=quality))
    noise = np.random.default_rng(1).integers(0, 256, (120, 160, 3), np.uint8)
    made_of_noise = jpeg(0, "camera_optical_frame", noise, gray=False, quality=quality)
    assert len(made_of_noise.data) < told
    assert told < 1.3 * len(made_of_noise.data) or quality < 50


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"intrinsics": (1.0, 1.0, 1.0, 1.0), "vertical_fov_deg": 60.0}, "keep one"),
        ({"encoding": "bayer_rggb8"}, "publish: raw"),
    ],
)
def test_conflicting_fields_are_refused(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        spec(**fields)


@pytest.mark.parametrize(
    ("fields", "matrix"),
    [
        ({"vertical_fov_deg": 90.0}, (60.0, 60.0, 79.5, 59.5)),
        ({"horizontal_fov_deg": 90.0}, (80.0, 80.0, 79.5, 59.5)),
        ({"horizontal_fov_deg": 90.0, "vertical_fov_deg": 90.0}, (80.0, 60.0, 79.5, 59.5)),
        ({"intrinsics": (100.0, 110.0, 70.0, 65.0)}, (100.0, 110.0, 70.0, 65.0)),
        ({}, (60 / np.tan(np.radians(30)),) * 2 + (79.5, 59.5)),
    ],
)
def test_camera_info_has_the_matrix(
    fields: dict[str, Any], matrix: tuple[float, float, float, float]
) -> None:
    (info,) = taken(camera(**fields), resting(1))["camera_info"]
    assert isinstance(info, CameraInfo)
    fx, fy, cx, cy = matrix
    k = np.frombuffer(info.intrinsic).reshape(3, 3)
    assert k == pytest.approx(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]))
    p = np.frombuffer(info.projection).reshape(3, 4)
    assert np.array_equal(p, np.hstack([k, np.zeros((3, 1))]))
    assert np.array_equal(np.frombuffer(info.rectification).reshape(3, 3), np.eye(3))
    assert (info.width, info.height, info.distortion_model) == (160, 120, "plumb_bob")
    assert np.array_equal(np.frombuffer(info.distortion), np.zeros(5))


def test_a_picture_is_of_its_own_instant() -> None:
    """Between two ticks of a fast vehicle, a picture differs from those of the ticks around it."""
    run = list(moving([(0.2 * tick, 0.0, 0.0) for tick in range(15)]))
    made = world()
    (_, second) = taken(camera(publish="raw"), run)["image"]
    # The second picture is at 33.33 ms, a third of the way from tick 13 to tick 14.
    eye = Eye(made, made.vehicles[0], spec())
    eye.take(resting(1, (0.2 * 40 / 3, 0.0, 0.0))[0])
    assert np.abs(pixels(second).astype(int) - eye.look(0).color).max() <= 1
    for tick in (13, 14):
        eye.restart()
        eye.take(resting(1, (0.2 * tick, 0.0, 0.0))[0])
        assert np.abs(pixels(second).astype(int) - eye.look(0).color).max() > 20


def test_a_vehicle_that_trembles_at_rest_is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its pictures are equal but for noise, and one that moves has others."""
    bends = []
    seen = LensOptics.seen
    monkeypatch.setattr(LensOptics, "seen", lambda *args: bends.append(1) or seen(*args))
    trembling = [(1e-8 * (-1) ** tick, 0.0, 0.0) for tick in range(30)]
    driving = [(1e-4 * tick, 0.0, 0.0) for tick in range(30)]
    lens = Lens(distortion=(-0.2, 0.05, 0.0, 0.0))
    for positions, expected in ((trembling, 1), (driving, 3)):
        bends.clear()
        images = taken(camera(publish="raw", lens=lens), list(moving(positions)))["image"]
        assert len(images) == 3
        assert len(bends) == expected
        equal = [np.array_equal(pixels(images[0]), pixels(image)) for image in images]
        assert equal == [True, *[expected == 1] * 2]
    grainy = camera(publish="raw", lens=lens, imager=Imager(**GRAIN))
    first, second, _ = map(pixels, taken(grainy, list(moving(trembling)))["image"])
    assert not np.array_equal(first, second)


def test_tf_leads_to_the_optical_frame() -> None:
    """What tf and CameraInfo say of a point is where it is in the picture."""
    made = world()
    tilted = Mount((0.2, 0.1, 1.0), (5.0, 10.0, 8.0))
    rover = replace(made.vehicles[0], sensors=(spec(mount=tilted),))
    transforms = static_transforms(replace(made, vehicles=(rover,)), 0)
    assert transforms is not None
    (to_camera,) = transforms.transforms
    assert (to_camera.parent, to_camera.child) == ("one/base_link", "one/camera_optical_frame")
    base_from_optical = transform(to_camera.translation_m, to_camera.rotation)
    link, base_from_viewed = Track(rover).link_from(to_camera.child) or (None, None)
    assert (link, base_from_viewed) == (0, pytest.approx(base_from_optical))
    eye = Eye(made, made.vehicles[0], spec(mount=tilted), layers=ALL_LAYERS)
    eye.take(resting(1)[0])
    labels = eye.look(0).labels
    assert labels is not None
    x, y, z, _ = np.linalg.inv(base_from_optical) @ (5, 0.8, 0.5, 1)
    u, v, _ = eye.pinhole.matrix() @ (x / z, y / z, 1)
    rows, columns = np.nonzero(labels == eye.renderer.labels.instances.index("crate"))
    assert (columns.mean(), rows.mean()) == pytest.approx((u, v), abs=1.5)


def left_out(model: CameraModel, ticks: int, waiting: int) -> list[LeftOut]:
    found = []
    for state in resting(ticks):
        model.behind(waiting)
        found += [made for made in model.readings(state) if isinstance(made, LeftOut)]
    return found


def test_late_pictures_are_left_out_and_marked() -> None:
    period = 14  # ticks of 30 Hz, rounded up
    marks = [LeftOut(i * 1_000_000_000 // 30, "overloaded") for i in range(7)]
    assert left_out(camera(), 81, period) == marks
    assert taken(camera(), resting(81), waiting=period) == {}
    # A little behind is no reason: the next picture is not due.
    assert left_out(camera(), 81, period - 2) == []
    assert len(taken(camera(), resting(81), waiting=period - 2)["image"]) == 7


def test_a_state_without_its_vehicle_is_refused_and_forgotten() -> None:
    model = camera()
    run = resting(20)
    model.readings(run[0])
    with pytest.raises(BadBusMessage, match="link poses"):
        model.readings(replace(run[1], vehicles={}))
    assert model.settled_tick() == -1
    assert len(taken(model, run[2:])["image"]) == 1


LENS = Lens(distortion=(-0.2, 0.05), chromatic_aberration=0.004, vignetting=0.4, aperture_m=0.01)
GRAIN = {"full_well_electrons": 3000.0, "read_noise_electrons": 5.0}


@pytest.mark.parametrize(
    ("lens", "told"),
    [
        (LENS, (-0.2, 0.05, 0.0, 0.0, 0.0)),
        (Lens(model="equidistant", distortion=(-0.02,)), (-0.02, 0.0, 0.0, 0.0)),
    ],
)
def test_camera_info_describes_the_lens(lens: Lens, told: tuple[float, ...]) -> None:
    (info,) = taken(camera(lens=lens, vertical_fov_deg=60.0), resting(1))["camera_info"]
    assert isinstance(info, CameraInfo)
    assert info.distortion_model == lens.model
    assert tuple(np.frombuffer(info.distortion)) == told
    # The edge of the picture is where the lens, without its coefficients, has 30 degrees.
    radius = np.radians(30) if lens.model == "equidistant" else np.tan(np.radians(30))
    assert np.frombuffer(info.intrinsic)[4] == pytest.approx(60 / radius)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "mono8"])
def test_both_streams_have_the_same_noise(encoding: str) -> None:
    streams = taken(camera(encoding=encoding, jpeg_quality=100, imager=Imager(**GRAIN)), resting(1))
    (raw,), (file,) = streams["image"], streams[""]
    assert isinstance(file, CompressedImage)
    decoded = cv2.imdecode(np.frombuffer(file.data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded is not None
    told = pixels(raw) if encoding != "rgb8" else pixels(raw)[..., ::-1]
    quiet = pixels(taken(camera(encoding=encoding), resting(1))["image"][0])
    quiet = quiet if encoding != "rgb8" else quiet[..., ::-1]
    grain = (told.astype(float) - quiet).mean(axis=2) if told.ndim == 3 else told - 1.0 * quiet
    sent = decoded.astype(float) - quiet
    sent = sent.mean(axis=2) if sent.ndim == 3 else sent
    assert grain.std() > 1
    assert np.corrcoef(grain.ravel(), sent.ravel())[0, 1] > 0.7


def test_a_mosaic_has_its_noise_behind_the_filter() -> None:
    """Noise of each pixel is its own, by its own light, not that of a color beside it."""
    fields: dict[str, Any] = {"publish": "raw", "encoding": "bayer_rggb8"}
    quiet = pixels(taken(camera(**fields), resting(1))["image"][0])
    noisy = pixels(taken(camera(**fields, imager=Imager(**GRAIN)), resting(1))["image"][0])
    light, read = (quiet / 255.0) ** 2, (noisy / 255.0) ** 2
    plain = (quiet > 60) & (quiet < 220)
    variance = np.mean((read - light)[plain] ** 2)
    assert variance == pytest.approx(np.mean(light[plain]) / 3000 + (5 / 3000) ** 2, rel=0.15)


def test_the_same_seed_sends_the_same_bytes() -> None:
    imager = Imager(exposure_s=0.01, readout_s=0.02, poses=6, **GRAIN)
    run = list(moving([(0.01 * tick, 0.0, 0.0) for tick in range(60)]))
    once, again = (taken(camera(lens=LENS, imager=imager), run, span_ticks=12) for _ in range(2))
    assert once == again
    later = taken(camera(lens=LENS, imager=imager), run[25:], span_ticks=12)
    assert len(once["image"]) == 4
    for name, pictures in later.items():  # none that began before what is known
        assert pictures == once[name][-2:]
    # Grain changes from picture to picture.
    still = taken(camera(imager=Imager(**GRAIN)), resting(40))["image"]
    assert not np.array_equal(pixels(still[0]), pixels(still[1]))


def test_a_picture_waits_for_the_end_of_its_exposure() -> None:
    imager = Imager(exposure_s=0.011, readout_s=0.01, poses=2)  # 8.4 ticks
    model = camera(imager=imager)
    seen = {state.tick: model.readings(state) for state in resting(40)}
    assert [tick for tick, made in seen.items() if made] == [9, 14 + 9, 27 + 9]
    first = seen[9][0]
    assert not isinstance(first, LeftOut)
    assert stream_and_message(first)[1].stamp_nanos == EPOCH_NANOS  # type: ignore[attr-defined]
    assert model.settled_tick() == 39 - 9
    for waiting, skipped in ((14, 3), (12, 0)):
        assert len(left_out(camera(imager=imager), 40, waiting)) == skipped


def test_exposure_and_gain_make_pictures_brighter() -> None:
    def mean(**imager: Any) -> float:
        model = camera(publish="raw", imager=Imager(**imager))
        return float(pixels(taken(model, resting(20), span_ticks=2)["image"][0]).mean())

    dark, usual, bright = (mean(exposure_s=0.005, gain=gain) for gain in (1.0, 2.0, 4.0))
    assert dark < usual - 10 < bright - 20


def sideways(step_m: float) -> list[State]:
    return list(moving([(0.0, step_m * tick, 0.0) for tick in range(30)]))


def test_a_vehicle_that_moves_is_blurred_and_sheared() -> None:
    """The camera goes to the left past the crate, which goes to the right in the picture."""
    run, fields = sideways(0.05), {"publish": "raw", "width": 320, "height": 240}

    def shot(**imager: Any) -> np.ndarray[Any, np.dtype[np.uint8]]:
        model, span_s = camera(imager=Imager(**imager), **fields), Imager(**imager).span_s
        return pixels(taken(model, run, span_ticks=round(span_s / 0.0025))["image"][0])

    def left_side(picture: np.ndarray[Any, np.dtype[np.uint8]], row: int) -> tuple[float, int]:
        """Return where the left side of the crate is, and over how many columns."""
        light = (picture[row, :140, 1] / 255.0) ** 2
        steps = np.diff(light)
        steps[np.abs(steps) < 0.02] = 0
        return float(np.arange(len(steps)) @ steps / steps.sum()), np.count_nonzero(steps)

    upper, lower = 125, 160
    still, blurred = shot(), shot(exposure_s=0.01, poses=16)
    rolled = shot(readout_s=0.025, poses=32)
    speed_px = 20 * 207.8 / 4.3  # 20 m/s, f, 4.3 m away
    at, wide = left_side(still, upper)
    assert wide <= 2
    assert left_side(still, lower)[0] == pytest.approx(at, abs=1.0)
    for row in (upper, lower):
        assert left_side(rolled, row)[0] - at == pytest.approx(
            speed_px * 0.025 * row / 239, abs=1.5
        )
        assert left_side(blurred, row)[0] - at == pytest.approx(speed_px * 0.005, abs=1.0)
        assert left_side(blurred, row)[1] == pytest.approx(speed_px * 0.01, abs=2)


def test_pictures_outlive_the_next_one() -> None:
    """Their bytes are the message's own: a fault may hold them up."""
    model, shown = camera(publish="raw"), []
    for state in moving([(0.1 * tick, 0.0, 0.0) for tick in range(30)]):
        for output, message in map(stream_and_message, model.readings(state)):
            if output == "image":
                shown.append((message, pixels(message).copy()))
    assert len(shown) == 3
    for message, first in shown:
        assert np.array_equal(pixels(message), first)


def test_exposures_longer_than_the_period_are_refused() -> None:
    with pytest.raises(ValueError, match=r"expected up to 0\.03333 s"):
        spec(imager=Imager(exposure_s=0.03, readout_s=0.01, poses=2))
