# SPDX-License-Identifier: Apache-2.0
"""Pictures as files: what comes back is what was drawn."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundlink.core.errors import UserError
from services.sensors.rendering.gl.target import ALL_LAYERS
from services.sensors.rendering.portrait.files import colors, write
from tests.services.sensors.rendering import views


def test_files_hold_the_picture(tmp_path: Path) -> None:
    made = views.renderer(views.laboratory(), layers=ALL_LAYERS)
    frame = made.draw(views.looking((3.0, -1.0, 1.0), yaw_deg=-60.0))  # through the door, too
    files = write(tmp_path / "new", "shot", frame, made.labels)
    assert [file.name for file in files] == [
        *("shot_colour.png", "shot_depth.png", "shot_labels.png", "shot_labels.json")
    ]
    color, depth, labels = (cv2.imread(str(f), cv2.IMREAD_UNCHANGED) for f in files[:3])
    assert color is not None
    assert np.array_equal(color[..., ::-1], frame.color)
    seen = np.isfinite(frame.depth_m)
    assert 0 < np.mean(~seen) < 0.5
    assert depth is not None
    assert depth.dtype == np.uint16
    assert (depth[~seen] == 0).all()
    assert np.abs(depth[seen] / 1000 - frame.depth_m[seen]).max() < 0.00051
    legend = json.loads(files[3].read_text(encoding="utf-8"))
    assert labels is not None
    assert frame.labels is not None
    for row, column in np.argwhere(seen)[::1500].tolist():
        blue, green, red = labels[row, column].tolist()
        number = frame.labels[row, column]
        thing = {"instance": made.labels.instances[number], "class": made.labels.classes[number]}
        assert legend[f"#{red:02x}{green:02x}{blue:02x}"] == thing
    assert (labels[~seen] == 0).all()
    assert len(legend) == len(np.unique(frame.labels[seen]))


def test_things_have_colors_of_their_own() -> None:
    assert len({tuple(color) for color in colors(150).tolist()}) == 150


def test_a_folder_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    made = views.renderer(views.laboratory(), layers=ALL_LAYERS)
    frame = made.draw(views.looking((0.0, 0.0, 1.0)))
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(UserError, match="file"):
        write(tmp_path / "file", "shot", frame, made.labels)
