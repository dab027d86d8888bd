# SPDX-License-Identifier: Apache-2.0
"""System tests of the report page of a recorded run: not blank, in light and dark themes."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from .browser import assert_not_blank, colors, pixels, screenshot
from .rig import REPOSITORY, free_port

pytestmark = pytest.mark.system

TOUR = REPOSITORY / "scenarios" / "indoor_lab_tour.yaml"
DOCS = REPOSITORY / "docs" / "pictures" / "report.png"
WIDTH, HEIGHT = 1040, 4200


def groundlink(*words: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "groundlink", *words],
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a tour's first seconds, as a user makes it."""
    folder = tmp_path_factory.mktemp("report")
    listen = f"tcp/127.0.0.1:{free_port()}"
    recorded, made = folder / "tour.mcap", folder / "tour.html"
    groundlink("record", str(TOUR), "--out", str(recorded), "--duration", "6", "--listen", listen)
    groundlink("report", str(recorded), "--out", str(made))
    return made


def palette(page: Path, *, dark: bool) -> dict[str, str]:
    """Return the page's colors by name, as its style sheet has them for light or for dark."""
    light_part, _, dark_part = page.read_text(encoding="utf-8").partition("prefers-color-scheme")
    found = re.findall(r"--([a-z]+): (#[0-9a-f]{6})", dark_part if dark else light_part)
    return dict(found)


@pytest.mark.parametrize("dark", [False, True])
def test_there_is_something_on_the_page(page: Path, tmp_path: Path, dark: bool) -> None:
    picture = screenshot(page, tmp_path / "page.png", width=WIDTH, height=HEIGHT, dark=dark)
    image = pixels(picture)
    assert_not_blank(image)
    histogram, names = colors(image), palette(page, dark=dark)
    assert max(histogram, key=histogram.__getitem__) == names["body"]
    # The room's walls, its furniture, the lines of speed and energy, the bars of rates.
    for name, least in (("wall", 4000), ("furniture", 5_000), ("blue", 800), ("green", 20_000)):
        assert histogram.get(names[name], 0) > least, f"{name}: {histogram.get(names[name], 0)}"


def test_blank_page_gives_one_line(tmp_path: Path) -> None:
    empty = tmp_path / "empty.html"
    empty.write_text("<!doctype html><title>empty</title>", encoding="utf-8")
    picture = screenshot(empty, tmp_path / "page.png", width=WIDTH, height=HEIGHT)
    with pytest.raises(AssertionError, match="blank"):
        assert_not_blank(pixels(picture))


def test_the_picture_in_the_docs_is_one() -> None:
    image = pixels(DOCS)
    assert image.shape[1] >= WIDTH
    assert_not_blank(image)
