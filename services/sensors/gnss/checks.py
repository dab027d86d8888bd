# SPDX-License-Identifier: Apache-2.0
"""Checks of a satellite receiver against its scenario."""

from collections.abc import Iterator

from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensor_kinds import Problem

from .spec import Gnss


def problems(spec: Gnss, vehicle: Vehicle, scenario: Scenario) -> Iterator[Problem]:
    """Yield a problem for each condition that the receiver does not meet."""
    if scenario.world.datum is None:
        yield Problem(
            (),
            f"`{spec.name}` receives satellites, but `world.datum` is missing: add `datum: "
            "{latitude_deg: ..., longitude_deg: ..., altitude_m: ...}` of the world's origin",
        )
    if spec.multipath is not None and not spec.sky_view:
        yield Problem(("multipath",), "reflections need `sky_view: true`")
    for i, walker in enumerate(spec.constellations):
        if walker.satellites % walker.planes:
            yield Problem(
                ("constellations", i, "planes"),
                f"{walker.satellites} satellites cannot be shared out evenly to {walker.planes} "
                "planes: `planes` must be a divisor of `satellites`",
            )
        if walker.phasing >= walker.planes:
            yield Problem(
                ("constellations", i, "phasing"),
                f"expected less than `planes` ({walker.planes}), got {walker.phasing}",
            )
    if spec.solutions:
        # Both set: the reader of a scenario could not tell which one counts.
        for name in ("solution", "satellites_needed", "horizontal", "vertical"):
            if getattr(spec, name) != getattr(_DEFAULTS, name):
                yield Problem((name,), f"`solutions` replaces `{name}`: remove one of them")


_DEFAULTS = Gnss("defaults", "/defaults", "defaults")
