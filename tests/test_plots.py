# SPDX-License-Identifier: Apache-2.0
"""The plots of the documents are those of the command that makes them."""

import pytest

from tools.plots.__main__ import FIGURES, FOLDER
from tools.plots.page_style import styled

PAGES = FOLDER.parents[1] / "explanation"
SLOW = {"gnss_error", "imu_allan", "vehicle_skid"}


def test_every_plot_has_a_small_file_and_a_page() -> None:
    sizes = {file.stem: file.stat().st_size for file in FOLDER.iterdir()}
    assert sizes.keys() == FIGURES.keys()
    assert max(sizes.values()) < 150_000
    pages = "".join(page.read_text(encoding="utf-8") for page in PAGES.glob("*.md"))
    assert [name for name in FIGURES if f"pictures/models/{name}.svg)" not in pages] == []


@pytest.mark.parametrize("name", sorted(FIGURES.keys() - SLOW))
def test_a_plot_can_be_made(name: str) -> None:
    with styled():
        figure = FIGURES[name]()
    assert all(axes.has_data() for axes in figure.axes)
