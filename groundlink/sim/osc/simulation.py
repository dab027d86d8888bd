# SPDX-License-Identifier: Apache-2.0
"""The run of a scenario of scenario-execution: each tick of its behavior tree is one step."""

from pathlib import Path
from typing import Any

import msgspec
from scenario_execution.scenario_execution_base import ScenarioExecutionConfig
from scenario_execution.simulation import SimulationInterface

from groundlink.core.errors import UserError
from groundlink.episode.world_queries import (
    EntitiesQuery,
    EntityReport,
    RemoveQuery,
    SpawnQuery,
)
from groundlink.scenario.faults import Fault
from groundlink.sim.stepped_run import SteppedRun

RECORDING = "run.mcap"
RUN = "osc"
"""Name of the run: the same each time, because a recording has it."""


class GroundlinkSimulation(SimulationInterface):  # type: ignore[misc]
    """Starts a stepped run for each scenario, and steps it before each tick of the tree.

    Sim time stands still while the tree is ticked, so the same scenario gives the same bytes. The
    scenario has the parameter `scenario_file`, see `reset`. With an output folder the run is
    recorded to `run.mcap` in it, `run_2.mcap` for the second scenario of a file.
    """

    dt = 0.05
    """Seconds of sim time between two ticks of the tree; a multiple of the period of the clock."""

    def __init__(self) -> None:
        self._run: SteppedRun | None = None
        self._logger: Any = None
        self._output: Path | None = None
        self._scenarios = 0
        self._touched: dict[str, dict[str, float]] = {}

    @property
    def run(self) -> SteppedRun:
        """The run of the present scenario."""
        if self._run is None:
            raise RuntimeError("`reset` starts the run")
        return self._run

    def setup(self, *, logger: Any, output_dir: str | None = None, **_: Any) -> None:
        """Take the logger and the folder for recordings."""
        self._logger = logger
        self._output = None if output_dir is None else Path(output_dir)

    def reset(self, scenario_file: str, record: bool = True) -> None:
        """Start the run of the next scenario.

        Parameters
        ----------
        scenario_file
            scenario of Groundlink: a file, relative to the folder of the `.osc` file, a saved run,
            or name of a shipped scenario. It must not have a route.
        record
            whether the run is recorded if there is an output folder.
        """
        self.shutdown()
        self._touched = {}
        recording = self._recording() if record else None
        self._run = SteppedRun(self.path(scenario_file), record=recording, name=RUN)

    def step(self) -> None:
        """Advance sim time by `dt`."""
        run = self.run
        run.step(self.dt)
        for vehicle in run.scenario.vehicles:
            if (vitals := run.latest(f"{vehicle.name}/vitals")) is not None:
                touched = self._touched.setdefault(vehicle.name, {})
                for contact in vitals.contacts:
                    touched.setdefault(contact.name, run.time_s)

    def shutdown(self) -> None:
        """End the run."""
        if self._run is not None:
            self._run.close()
            self._run = None

    def command(self, vehicle: str, linear_mps: float, angular_radps: float) -> None:
        """Command the velocity of a vehicle in the next step."""
        self.run.command(vehicle, linear_mps, angular_radps)

    def entity(self, name: str) -> EntityReport:
        """Return the true state of a vehicle, an actor or a solid."""
        (found,) = self.run.ask(EntitiesQuery(name))["entities"]
        return msgspec.convert(found, EntityReport)

    def spawn(self, query: SpawnQuery) -> None:
        """Add an entity to the world; it exists in the next step."""
        self.run.ask(query)

    def delete(self, name: str) -> None:
        """Remove an entity from the world."""
        self.run.ask(RemoveQuery(name))

    def fault(self, sensor: str, fault: Fault | None) -> None:
        """Inject a fault into a sensor such as `rover/imu`; None ends all of its faults."""
        if fault is None:
            self.run.clear_faults(sensor)
        else:
            self.run.fault(sensor, fault)

    def touched(self, vehicle: str) -> dict[str, float]:
        """Return what a vehicle has touched, besides the ground, and when first: sim time in s."""
        vehicles = [known.name for known in self.run.scenario.vehicles]
        if vehicle not in vehicles:
            raise UserError(f"no vehicle `{vehicle}`; expected one of {', '.join(vehicles)}")
        return self._touched.get(vehicle, {})

    def path(self, name: str) -> str:
        """Return the path of a file that is named relative to the folder of the `.osc` file."""
        folder = ScenarioExecutionConfig().scenario_file_directory
        beside = Path(folder or ".", name)
        return str(beside) if beside.is_file() else name

    def _recording(self) -> Path | None:
        """Return the file for the recording of the next scenario, which replaces an older one."""
        if self._output is None:
            return None
        self._scenarios += 1
        file = self._output / RECORDING
        if self._scenarios > 1:
            file = file.with_stem(f"{file.stem}_{self._scenarios}")
        file.unlink(missing_ok=True)
        self._logger.info(f"Recording the run to {file}")
        return file
