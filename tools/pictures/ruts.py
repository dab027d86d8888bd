# SPDX-License-Identifier: Apache-2.0
"""Picture of a tank and a rover that leave ruts in dry sand: ``python -m tools.pictures.ruts OUT``.

Drives both in this process and draws what a camera beside them sees.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ
from groundlink.loader import load
from groundlink.messages.base import Command, State
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from groundlink.scene.build import solids
from services.physics.simulation.simulation import Simulation
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import COLOR_ALONE
from services.sensors.runtime.world_replica import WorldReplica

from .viewpoints import looking

WORLD = """\
name: ruts
time: {mode: fast}
world:
  name: dune
  materials: {sand: {color: [0.55, 0.42, 0.26], texture: soil, soil: dry_sand, friction: 1.0}}
  terrain:
    {kind: hills, size_m: [80, 80], cell_m: 1.0, height_m: 2.0, longest_m: 40.0, material: sand}
vehicles:
  - {name: tank, model: tank, placement: {x_m: -9.0, y_m: 3.0}}
  - {name: rover, model: rover, placement: {x_m: -6.0, y_m: -3.0, yaw_deg: 25.0}}
"""

COMMANDS = {"tank": (2.0, -0.12), "rover": (0.9, 0.02)}
"""Velocities: m/s and rad/s."""

SECONDS = 7.0
WIDTH, HEIGHT = 960, 540


def main(arguments: Sequence[str]) -> int:
    """Drive, draw and store the picture."""
    parser = argparse.ArgumentParser(prog="tools.pictures.ruts", description=__doc__)
    parser.add_argument("out", type=Path)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "ruts.yaml")
        file.write_text(WORLD, encoding="utf-8")
        scenario = load(file)
    Image.fromarray(picture(scenario)).save(options.out)
    return 0


def picture(scenario: Scenario) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return what a camera sees after both vehicles have driven."""
    around = WorldReplica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 50.0)))
    with Simulation(scenario, solids(scenario)) as simulation:
        assert simulation.ruts
        for tick in range(1, round(SECONDS * TICK_RATE_HZ) + 1):
            for name, (speed, turn) in COMMANDS.items():
                stamp = simulation.sim_nanos
                simulation.command(name, Command(stamp, (speed, 0.0, 0.0), (0.0, 0.0, turn)))
            simulation.step()
            states, ruts = simulation.vehicle_states(), simulation.ruts.at(tick)
            around.take(State("", 0, 0, tick, tick * TICK_NANOS, "", states, ruts=ruts))
            around.forget(tick)
    around.press(tick)
    assert around.ruts
    pinhole = Pinhole(WIDTH, HEIGHT, 700.0, 700.0, WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5)
    renderer = Renderer(scenario.world, around, pinhole, layers=COLOR_ALONE, samples=16)
    renderer.place(around.motion(tick, tick)[0])
    renderer.press(around.ruts)
    pose = looking(np.array([-11.5, -3.0, 4.4]), np.array([-1.0, 0.5, 0.8]))
    return renderer.draw(pose).color


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
