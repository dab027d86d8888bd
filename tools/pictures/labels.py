# SPDX-License-Identifier: Apache-2.0
"""Picture of labels: what the scenario of docs/how-to/labels.md records, in three panels.

`python -m tools.pictures` starts it with the file to write.
"""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import groundlink
from groundlink.core.frames import matrix_from_quaternion
from groundlink.data.dataset import Dataset
from services.sensors.rendering.portrait.snapshot import colors

from .panels import Pixels, sheet

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "how-to" / "labels.md"
FOLDER = ROOT / "build" / "pictures"
CAMERA, POINTS = "/camera/image_raw", "/points"

SIZE = (400, 300)
"""Size of a panel in pixels."""

VISIBLE, SMALLEST_PX = 0.5, 2500
"""Objects of which less is visible, or whose box has a smaller area, have no box in the picture: it
would be crowded."""

VIEW_M = (-2.0, 11.2, -4.95, 4.95)
"""Part of the cloud that is drawn: x ahead of the sensor from and to, y to its left."""

PALETTE = np.vstack([[[20, 20, 20]], colors(255)]).astype(np.uint8)
"""Color of each class."""


def record() -> Path:
    """Record the scenario that the page shows; return the file."""
    scenario = PAGE.read_text(encoding="utf-8").partition("```yaml\n")[2].partition("```")[0]
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "labels.yaml").write_text(scenario, encoding="utf-8")
    file = FOLDER / "labels.mcap"
    file.unlink(missing_ok=True)
    command = ["record", str(FOLDER / "labels.yaml"), "--out", str(file), "--duration", "1"]
    subprocess.run([sys.executable, "-m", "groundlink", *command], check=True)
    return file


def first(run: Dataset, topic: str) -> NDArray[np.void]:
    """Return the detections of the first message of a topic."""
    every = run.array(topic)
    found: NDArray[np.void] = every[every["stamp"] == every["stamp"][0]]
    return found


def boxes(run: Dataset) -> Pixels:
    """Draw the picture with the boxes of mostly visible objects, and their names."""
    _, picture = next(run.contents(f"{CAMERA}/compressed"))
    page = Image.fromarray(picture)
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(20)
    for box in first(run, f"{CAMERA}/labels/boxes_2d"):
        size = np.array([box["bbox.size_x"], box["bbox.size_y"]])
        if box["score"] < VISIBLE or size.prod() < SMALLEST_PX:
            continue
        middle, half = box["bbox.center.position"], size / 2
        color = tuple(PALETTE[int(box["class_id"])].tolist())
        draw.rectangle([*(middle - half), *(middle + half)], outline=color, width=3)
        draw.text(middle - half - (0, 24), str(box["id"]), font=font, fill=color)
    return _small(np.asarray(page))


def classes(run: Dataset) -> Pixels:
    """Draw the class of each pixel."""
    _, found = next(run.contents(f"{CAMERA}/labels/semantic"))
    return _small(PALETTE[found])


def cloud(run: Dataset) -> Pixels:
    """Draw the cloud below eye level from above, in the colors of its classes, with boxes."""
    _, points = next(run.contents(f"{POINTS}/labels/points"))
    low = points[points["z"] < 0.5]
    low = low[np.argsort(low["z"])]
    page = Image.new("RGB", SIZE, "white")
    at = _pixels(np.column_stack([low["x"], low["y"]]))
    seen = (at >= 0).all(axis=1) & (at < SIZE).all(axis=1)
    drawn = np.array(page)
    drawn[at[seen, 1], at[seen, 0]] = PALETTE[low["label"][seen]]
    page = Image.fromarray(drawn)
    draw = ImageDraw.Draw(page)
    for box in first(run, f"{POINTS}/labels/boxes_3d"):
        half = box["bbox.size"] / 2
        corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * half[:2]
        turn = matrix_from_quaternion(box["bbox.center.orientation"])
        outline = corners @ turn[:2, :2].T + box["bbox.center.position"][:2]
        color = tuple(PALETTE[int(box["class_id"])].tolist())
        draw.polygon([*map(tuple, _pixels(outline).tolist())], outline=color)
    return np.asarray(page)


def _pixels(xy_m: NDArray[np.floating[Any]]) -> NDArray[np.int64]:
    """Return columns and rows of places, x to the right and y up."""
    left, right, bottom, top = VIEW_M
    share = (xy_m - (left, bottom)) / (right - left, top - bottom)
    share[:, 1] = 1 - share[:, 1]
    found: NDArray[np.int64] = np.floor(share * SIZE).astype(np.int64)
    return found


def _small(picture: Pixels) -> Pixels:
    return np.asarray(cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA), np.uint8)


def main(arguments: Sequence[str]) -> None:
    """Record, and write the picture."""
    [out] = arguments
    with groundlink.open(record()) as run:
        panels = [
            ("image and boxes_2d", boxes(run)),
            ("semantic", classes(run)),
            ("labels/points from above, boxes_3d", cloud(run)),
        ]
    sheet(panels, 3).save(out)


if __name__ == "__main__":
    main(sys.argv[1:])
