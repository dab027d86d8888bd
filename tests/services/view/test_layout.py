# SPDX-License-Identifier: Apache-2.0
"""The layout shows what the scenario has, and no empty panels."""

from typing import Any

import rerun.blueprint as rrb

from services.view.layout import layout
from services.view.viewer_subscriptions import streams_of

from .scenes import SCENARIO, with_streams

CAMERA = {"name": "front", "kind": "compressed_image", "topic": "/front", "rate_hz": 30}
GNSS = {"name": "gnss", "kind": "nav_sat_fix", "topic": "/fix", "rate_hz": 5}


def views(scenario: Any) -> dict[str, type]:
    found: dict[str, type] = {}

    def walk(part: Any) -> None:
        for child in getattr(part, "contents", ()):
            if isinstance(child, rrb.View):
                found[str(child.name)] = type(child)
            elif not isinstance(child, str):
                walk(child)

    walk(layout(scenario, streams_of(scenario, "run")).root_container)
    return found


def test_the_laboratory_has_its_panels_and_no_others() -> None:
    shown = views(SCENARIO)
    assert {"World", "Run", "Speed, m/s", "Wheels by their encoders, m/s"} <= set(shown)
    assert "Acceleration, m/s²" in shown
    assert rrb.MapView not in shown.values()
    pictures = [name for name, view in shown.items() if view is rrb.Spatial2DView]
    assert pictures == ["rover/camera"]


def test_a_camera_and_gnss_bring_theirs() -> None:
    shown = views(with_streams(CAMERA, GNSS))
    assert shown["rover/front"] is rrb.Spatial2DView
    assert shown["Map"] is rrb.MapView
