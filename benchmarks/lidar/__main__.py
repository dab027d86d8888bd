# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.lidar [--only PART] [--scenario FILE] [--rounds N] [--check]`.

Ours is timed from the states of a revolution to its finished cloud (poses, rays, noise, records)
while everything drives; what others are compared by is the rays alone, made for them beforehand, in
a world at rest (PyBullet) or already built (Embree). PyBullet gets the world in two forms, and the
faster one counts. Turn by turn; figures are medians, and ratios are medians of the turns' ratios.
Times are of the processor, all threads together, where `elapsed` is not said.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from benchmarks.claims import Claim, add_options, judge
from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.core.frames import Floats
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED, read_datasheet
from groundlink.messages.base import PointCloud, State
from groundlink.process.memory import keep_memory
from groundlink.world.triangles import of_ground
from groundlink.world.weather import Sun
from services.sensors.lidar.model import LidarModel
from services.sensors.lidar.spec import Lidar
from services.sensors.rays.scene import Reals

from . import driving
from .bullet import Bullet
from .hills import Hills, ground
from .raw import RawEmbree

SENSORS = SHIPPED / "sensors"
WARM_UP = 2
BODIES = 100
MILLISECONDS_PER_REVOLUTION = 100.0
TICKS = round(MILLISECONDS_PER_REVOLUTION * 1e-3 / TICK_SECONDS)
SIZES = 1, 2, 4, 8, 16
"""Of the fits, in shares of the smallest."""


def clocks() -> Floats:
    """Return elapsed and processor time, milliseconds."""
    return 1e3 * np.array([time.perf_counter(), time.process_time()])


def timed(call: Callable[[], object]) -> Floats:
    """Return what a call takes, as `clocks`."""
    started = clocks()
    call()
    return clocks() - started


def stay_on_one_core() -> None:
    """Let this process run on one core from now on."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def lidar(sheet: str, **fields: Any) -> Lidar:
    """Return a LiDAR by its data sheet."""
    own = {"name": "lidar", "topic": "/points", "frame": "lidar_link"}
    document = read_datasheet(SENSORS / f"{sheet}.yaml").value
    return msgspec.convert({**document, **own, **fields}, Lidar)


class Runs:
    """A model on its way, revolution by revolution."""

    def __init__(self, model: LidarModel, states: Iterator[State]) -> None:
        self.model, self._states = model, states
        for _ in range(WARM_UP):
            self.revolution()

    def revolution(self) -> Floats:
        """Return what it takes from the states of the next revolution to its cloud."""
        states = list(islice(self._states, TICKS))
        started = clocks()
        clouds = [cloud for state in states for cloud in self.model.readings(state)]
        spent = clocks() - started
        self.returns = sum(
            len(cloud.records()) for cloud in clouds if isinstance(cloud, PointCloud)
        )
        return spent

    @property
    def rays(self) -> tuple[Reals, Reals, Reals]:
        """Origins, directions and times of the rays of the last revolution."""
        sweep = self.model.scanner.sweep
        return sweep.origins_in_world, sweep.directions_in_world, sweep.times


Calls = Mapping[str, Callable[[], Floats]]
"""By what is timed: each returns what it takes, as `clocks`."""

Times = Mapping[str, Floats]
"""By what was timed: elapsed and processor time of each turn, shape (turns, 2)."""


def by_turns(calls: Calls, rounds: int) -> Times:
    """Return what calls take that are made in turn; print their medians."""
    rows = np.array([[call() for call in calls.values()] for _ in range(rounds)])
    print(f"  {'median ms':<52}{'elapsed':>9}{'processor':>11}")
    for name, (elapsed, processor) in zip(calls, np.median(rows, axis=0), strict=True):
        print(f"  {name:<52}{elapsed:9.2f}{processor:11.2f}", flush=True)
    return {name: rows[:, number] for number, name in enumerate(calls)}


def ratio(times: Times, slow: str, fast: str, *, clock: int = 1) -> float:
    """Return the median of the turns' ratios, of processor times or of elapsed ones (0)."""
    return float(np.median(times[slow][:, clock] / times[fast][:, clock]))


def room(rounds: int, scenario_file: Path) -> list[Claim]:
    """Compare with PyBullet in a scenario."""
    scenario = load(scenario_file)
    lidars = [(v, s) for v in scenario.vehicles for s in v.sensors if isinstance(s, Lidar)]
    if not lidars:
        raise UserError(f"{scenario_file}: `sensors`: expected a LiDAR, found none")
    vehicle, spec = lidars[0]
    ours = Runs(LidarModel(scenario, vehicle, spec), driving.states(scenario))
    with tempfile.TemporaryDirectory() as folder:
        solids, meshes = (
            driving.in_bullet(scenario),
            driving.as_meshes_in_bullet(scenario, Path(folder)),
        )
    for bullet in (solids, meshes):
        bullet.aim(*ours.rays[:2], spec.max_range_m)
    print(
        f"{scenario.name}: {ours.rays[2].size} rays, {ours.returns} returns, {solids.bodies} bodies"
    )
    calls: Calls = {
        "ours": ours.revolution,
        "PyBullet, a body for each solid": partial(timed, solids.cast),
        "PyBullet, a mesh for each link": partial(timed, meshes.cast),
    }
    times = by_turns(calls, rounds)
    as_solids, as_meshes = (ratio(times, name, "ours") for name in list(calls)[1:])
    return [Claim("room: PyBullet's time over ours, its best form", min(as_solids, as_meshes), 17)]


def hills(rounds: int, _: Path) -> list[Claim]:
    """Compare with PyBullet and with raw Embree on a large terrain, among many bodies.

    Raw Embree takes rays one by one and, like ours, the bodies' motion; or eight by eight, in one
    mesh at rest. It computes no normals, labels, noise or cloud.
    """
    terrain = ground()
    mesh_of = of_ground(terrain, first_label=0)
    world = Hills(terrain, BODIES)
    paper = lidar("vlp16_paper", block_deg=0.0)
    exact = lidar("vlp16_paper", block_deg=0.0, range_stddev_m=0.0)
    ours, quiet = (Runs(world.lidar(s), world.states()) for s in (paper, exact))
    relief = Runs(world.lidar(exact, as_heights=True), world.states())
    field, mesh = Bullet(), Bullet()
    field.add_heights(terrain.heights, terrain.cell_m)
    with tempfile.TemporaryDirectory() as folder:
        raw = RawEmbree(Path(folder), mesh_of, world.body, world.motion(41))
        mesh.add_mesh(mesh_of, Path(folder))
        for bullet in (field, mesh):
            bullet.add_mesh(world.body, Path(folder), world.poses(0))
    for bullet in (field, mesh):
        bullet.aim(*quiet.rays[:2], paper.max_range_m)
    print(
        f"hills: {ours.rays[2].size} rays, {ours.returns} returns, {len(mesh_of.faces)} triangles, "
        f"{world.bodies} bodies of {len(world.body.faces)}"
    )
    calls: Calls = {
        "ours": ours.revolution,
        "ours, without noise": quiet.revolution,
        "ours, without noise, terrain as heights": relief.revolution,
        "Embree from C, one ray after the other": lambda: timed(
            partial(raw.cast, *quiet.rays, paper.max_range_m)
        ),
        "Embree from C, the bodies' motion": partial(timed, raw.move),
        "Embree from C, eight by eight, all at rest": partial(
            timed, partial(raw.cast_at_rest, *quiet.rays[:2], paper.max_range_m)
        ),
        "PyBullet, terrain as heights": partial(timed, field.cast),
        "PyBullet, terrain as a mesh": partial(timed, mesh.cast),
    }
    times = dict(by_turns(calls, rounds))
    noisy, _quiet, by_heights, rays, motion, eights, as_heights, as_mesh = calls
    times["raw"] = times[rays] + times[motion]
    bullets = [ratio(times, name, noisy) for name in (as_heights, as_mesh)]
    return [
        Claim("hills: PyBullet's time over ours, its best form", min(bullets), 14.5),
        Claim("hills: raw Embree's over ours", ratio(times, "raw", noisy), 1.5),
        Claim("hills: its rays alone over ours, whole", ratio(times, rays, noisy), 1.2),
        Claim("hills: eight by eight at rest over ours", ratio(times, eights, noisy), 0.45),
        Claim("hills: raw Embree's over ours, as heights", ratio(times, "raw", by_heights), 1.2),
    ]


def core(rounds: int, _: Path) -> list[Claim]:
    """Tell how many LiDARs one core carries in real time, in the same hills."""
    stay_on_one_core()
    world = Hills(ground(), BODIES)
    claims = []
    for sheet, least in (("vlp16_paper", 12), ("vlp16", 18)):
        runs = Runs(world.lidar(lidar(sheet, block_deg=0.0)), world.states())
        times = by_turns({f"{sheet}, {runs.rays[2].size} rays": runs.revolution}, 3 * rounds)
        (rows,) = times.values()
        carried = MILLISECONDS_PER_REVOLUTION / float(np.median(rows[:, 1]))
        claims.append(Claim(f"LiDARs of {sheet} on one core", carried, least))
    return claims


def sizes(rounds: int, _: Path) -> list[Claim]:
    """Fit what a revolution costs to the number of its rays, and to that of the bodies."""
    stay_on_one_core()
    terrain = ground()
    few = Hills(terrain, BODIES)
    by_rays = {
        f"{16 * firings} rays": Runs(
            few.lidar(lidar("vlp16_paper", block_deg=0.0, firings_per_revolution=firings)),
            few.states(),
        ).revolution
        for firings in (900 * size for size in SIZES)
    }
    rays = by_turns(by_rays, rounds)
    by_bodies = {}
    for bodies in (50 * size for size in SIZES):
        world = Hills(terrain, bodies)
        runs = Runs(world.lidar(lidar("vlp16_paper", block_deg=0.0)), world.states())
        by_bodies[f"{bodies} bodies"] = runs.revolution
    bodies_times = by_turns(by_bodies, rounds)
    return [
        Claim("exponent of cost by rays", exponent(rays), 1.1, is_at_least=False),
        Claim("exponent of cost by bodies", exponent(bodies_times), 1.1, is_at_least=False),
    ]


def echoes(rounds: int, scenario_file: Path) -> list[Claim]:
    """Tell what the effects on echoes cost in a scenario, all together.

    These are noise and dropout by echo power, mixed pixels, blooming, sunlight, and crosstalk of
    one more LiDAR.
    """
    stay_on_one_core()
    scenario = load(scenario_file)
    vehicle = scenario.vehicles[0]
    lidars = replace(vehicle, sensors=(lidar("vlp16"), lidar("vlp16", name="other")))
    world = replace(scenario.world, light=Sun(azimuth_deg=0.0, elevation_deg=5.0))
    scenario = replace(scenario, world=world, vehicles=(lidars, *scenario.vehicles[1:]))
    effects = {
        "mixed_pixels": True,
        "blooming": {"share": 0.001, "width_mrad": 8.0},
        "sun": {"reach_share": 0.7, "false_share": 1e-4, "glare_deg": 2.0},
        "crosstalk_share": 1e-3,
    }
    plain, fitted = (
        Runs(LidarModel(scenario, lidars, spec), driving.states(scenario))
        for spec in (lidar("vlp16"), lidar("vlp16_fitted", **effects))
    )
    calls: Calls = {"vlp16": plain.revolution, "vlp16_fitted, all effects": fitted.revolution}
    times = by_turns(calls, 5 * rounds)
    cost = ratio(times, "vlp16_fitted, all effects", "vlp16")
    return [Claim("echoes: all effects over none", cost, 1.3, is_at_least=False)]


def exponent(times: Times) -> float:
    """Return the slope of the logarithm of processor time over that of size, by least squares."""
    costs = [np.median(rows[:, 1]) for rows in times.values()]
    return float(np.polyfit(np.log(SIZES), np.log(costs), 1)[0])


PARTS: dict[str, Callable[[int, Path], list[Claim]]] = {
    "room": room,
    "hills": hills,
    "core": core,
    "sizes": sizes,
    "echoes": echoes,
}


def main(arguments: Sequence[str]) -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.lidar", description=__doc__)
    add_options(parser)
    parser.add_argument("--only", choices=PARTS, help="measure one part only")
    parser.add_argument(
        "--scenario", type=Path, default=SHIPPED / "indoor_lab.yaml", help="of `room` and `echoes`"
    )
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args(arguments)
    keep_memory()  # As the process of a sensor does.
    claims = []
    for name in [options.only] if options.only else PARTS:
        claims += PARTS[name](options.rounds, options.scenario)
    return judge(claims, options)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
