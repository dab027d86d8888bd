# SPDX-License-Identifier: Apache-2.0
"""Initial layout of the Rerun viewer (its blueprint), derived from the scenario.

The world is on the left with the cameras below; the state of the run and plots are on the right.
There are no panels for what the scenario lacks.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import rerun.blueprint as rrb

from groundlink.ros.streams import RosStream
from groundlink.scenario import Scenario

from .link_panel import AGES, LOSSES, RATES
from .plots import TIMELINE

BACKGROUND = (16, 18, 24)
PLOT_SECONDS = 15.0

TEXT = "run"


def layout(
    scenario: Scenario, streams: Mapping[str, RosStream], *, whole: bool = False
) -> rrb.Blueprint:
    """Return the blueprint of a scenario.

    Parameters
    ----------
    streams
        streams that can be drawn, by the path of their entity.
    whole
        whether this is a complete run, as in a file: it has no link to ROS and is played from its
        start, with a slider.
    """
    kinds: dict[str, list[str]] = {}
    for path, stream in streams.items():
        if "/ground_truth" in path:
            continue
        kinds.setdefault(stream.message.__name__, []).append(path)
    pictures = [*kinds.get("Image", ()), *kinds.get("CompressedImage", ())]
    left: rrb.Container | rrb.View = _world(scenario)
    if pictures:
        views = [rrb.Spatial2DView(origin=path, name=path) for path in pictures]
        left = rrb.Vertical(left, rrb.Grid(*views), row_shares=[5, 2])
    right: list[rrb.Container | rrb.View] = [
        rrb.TextDocumentView(origin=TEXT, name="Run"),
        *_plots(scenario, kinds),
    ]
    if not whole:
        right.append(_link())
    shares = [2.6, *(1.25 for _ in right[1:])]
    if fixes := kinds.get("NavSatFix"):
        right.insert(1, rrb.MapView(origin="/", contents=[f"{f}/**" for f in fixes], name="Map"))
        shares.insert(1, 2.0)
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*right, row_shares=shares), column_shares=[1.75, 1]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        _time(whole=whole),
        auto_views=False,
        auto_layout=False,
    )


def _world(scenario: Scenario) -> rrb.View:
    return rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", "- /tf/**", f"- /{TEXT}", "- /link/**"],
        name="World",
        background=BACKGROUND,
        line_grid=False,
        eye_controls=_eye(scenario),
    )


def _eye(scenario: Scenario) -> rrb.EyeControls3D:
    """Look into a room from above its corner; elsewhere follow the first vehicle."""
    room = scenario.world.room
    if room:
        length, width, height = room.size_m
        reach = math.hypot(length, width)
        return rrb.EyeControls3D(
            position=(-0.51 * length, -0.97 * width, height + 0.53 * reach),
            look_target=(-0.01 * length, 0.0, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        )
    vehicle = scenario.vehicles[0]
    place = vehicle.placement
    yaw = math.radians(place.yaw_deg)
    behind = (place.x_m - 6 * math.cos(yaw), place.y_m - 6 * math.sin(yaw), place.z_m + 4)
    return rrb.EyeControls3D(
        position=behind,
        look_target=(place.x_m, place.y_m, place.z_m),
        eye_up=(0.0, 0.0, 1.0),
        tracking_entity=f"{vehicle.name}/links/{vehicle.model.base_frame}",
    )


def _plots(scenario: Scenario, kinds: dict[str, list[str]]) -> Iterator[rrb.View | rrb.Container]:
    vehicles = [vehicle.name for vehicle in scenario.vehicles]
    yield rrb.Tabs(
        _plot("Speed, m/s", [f"{v}/speed" for v in vehicles]),
        _plot("Turn rate, rad/s", [f"{v}/turning" for v in vehicles]),
        name="Motion",
    )
    if wheels := kinds.get("WheelEncoders"):
        yield _plot("Wheels by their encoders, m/s", wheels)
    if imus := kinds.get("Imu"):
        yield rrb.Tabs(
            _plot("Angular velocity, rad/s", [f"{i}/angular_velocity" for i in imus]),
            _plot("Acceleration, m/s²", [f"{i}/acceleration" for i in imus]),
            name="Inertial",
        )
    if others := [*kinds.get("JointState", ()), *kinds.get("Range", ())]:
        yield _plot("Joints and distances", others)


def _link() -> rrb.Container:
    return rrb.Tabs(
        _plot("Age in ROS, ms (median)", [AGES]),
        _plot("Age in ROS, ms (99 %)", [f"{AGES}_p99"]),
        _plot("Rate in ROS, Hz", [RATES]),
        _plot("Lost on the wire", [LOSSES]),
        name="Link",
    )


def _time(*, whole: bool) -> rrb.TimePanel:
    if whole:
        return rrb.TimePanel(state="expanded", timeline=TIMELINE, play_state="playing")
    return rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following")


def _plot(name: str, paths: Sequence[str]) -> rrb.View:
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"+ /{path}/**" for path in paths],
        name=name,
        time_ranges=rrb.VisibleTimeRange(
            TIMELINE,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-PLOT_SECONDS),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        ),
        plot_legend=rrb.PlotLegend(corner="LeftTop"),
    )
