# SPDX-License-Identifier: Apache-2.0
"""The README is short, begins with the moving picture, and leads to a page of each sensor kind."""

import re
from pathlib import Path

from PIL import Image

from groundlink.scenario.sensor_kinds import sensor_kinds

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_fits_120_lines() -> None:
    assert len(README.splitlines()) <= 120


def test_the_first_picture_moves_and_is_small() -> None:
    [first, *_] = re.findall(r"!\[[^]]+\]\(([^)]+)\)", README)
    file = ROOT / first
    assert file.suffix == ".webp"
    assert file.stat().st_size < 1_500_000
    with Image.open(file) as picture:
        assert 80 <= getattr(picture, "n_frames", 1) <= 120  # 10 a second


def test_every_shipped_kind_has_a_row_with_a_link() -> None:
    rows = dict(re.findall(r"^\| \[`(\w+)`\]\(([\w/.-]+)[#)]", README, re.MULTILINE))
    shipped = {
        kind.name for kind in sensor_kinds().values() if kind.package.startswith("services.")
    }
    assert rows.keys() == shipped
    assert [page for page in rows.values() if not (ROOT / page).exists()] == []
