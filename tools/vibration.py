# SPDX-License-Identifier: Apache-2.0
"""Print what an IMU feels of roughness and vibration: ``python -m tools.vibration``.

An IMU without errors at the mount `imu` of the shipped vehicles, on level ground of each class of
ISO 8608. The table stands in docs/explanation/vehicle-dynamics.md.
"""

from typing import get_args

import numpy as np

from groundlink.loader import load
from groundlink.messages.base import Command, State
from groundlink.scenario.schema import Scenario, Vehicle, World
from groundlink.scenario.vehicle import Effect, VehicleModel
from groundlink.world.terrain import RoughnessClass
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import FLOOR, MATERIALS, NAME, drive
from services.sensors.imu.model import ImuModel
from services.sensors.imu.spec import InertialUnit

DRIVES = (
    ("tank", "scenarios/outdoor_paper.yaml", 2.4),
    ("rover", "scenarios/indoor_lab.yaml", 1.0),
)
CLASSES: tuple[RoughnessClass | None, ...] = (None, *get_args(RoughnessClass)[:6])
STEADY_SECONDS = 3.0
TICKS = 2400


def felt(
    model: VehicleModel,
    speed_mps: float,
    roughness: RoughnessClass | None,
    effects: tuple[Effect, ...],
) -> tuple[float, float]:
    """Return the deviations of vertical acceleration, m/s^2, and of pitch rate, deg/s."""
    unit = InertialUnit(name="imu", topic="/imu", frame="imu", mount=model.mounts["imu"])
    vehicle = Vehicle(name=NAME, model=model, sensors=(unit,), effects=effects)
    world = World(name="level", materials=MATERIALS, roughness=roughness)
    scenario = Scenario(name="vibration", world=world, vehicles=(vehicle,))
    imu = ImuModel(scenario, vehicle, unit)
    with Simulation(scenario, (FLOOR,)) as simulation:
        drive(simulation, STEADY_SECONDS, (speed_mps, 0.0))
        samples = []
        for _ in range(TICKS):
            ahead = Command(simulation.sim_nanos, (speed_mps, 0.0, 0.0), (0.0, 0.0, 0.0))
            simulation.command(NAME, ahead)
            simulation.step()
            tick, nanos = simulation.tick, simulation.sim_nanos
            state = State("", 0, 0, tick, nanos, "", simulation.vehicle_states())
            samples += imu.readings(state)
    return (
        float(np.std([sample.linear_acceleration_mps2[2] for sample in samples])),
        float(np.degrees(np.std([sample.angular_velocity_radps[1] for sample in samples]))),
    )


def main() -> None:
    """Print the table."""
    print("| vehicle | ground | m/s2 | deg/s | with its vibration, m/s2 | deg/s |")
    print("|---|---|---|---|---|---|")
    for name, scenario, speed_mps in DRIVES:
        model = load(scenario).vehicles[0].model
        for roughness in CLASSES:
            row = [f"{name}, {speed_mps:g} m/s", roughness or "smooth"]
            for effects in ((), ("vibration",)):
                acceleration, rate = felt(model, speed_mps, roughness, effects)
                row += [f"{acceleration:.2g}", f"{rate:.2g}"]
            print("|", " | ".join(row), "|")


if __name__ == "__main__":
    main()
