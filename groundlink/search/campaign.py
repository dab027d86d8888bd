# SPDX-License-Identifier: Apache-2.0
"""Fault campaign: each fault of each sensor at several times, as cells of a matrix."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from groundlink.core.errors import UserError, did_you_mean
from groundlink.loader.document import parse
from groundlink.loader.overrides import FieldChange
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.fault_checks import fault_problem
from groundlink.scenario.faults import KINDS, Fault, FaultSpec, fault_from
from groundlink.scenario.schema import Scenario, Vehicle

from .point_journal import Values

SENSOR, FAULT, PARAMETERS, BEGIN = "sensor", "fault", "parameters", "begin s"
"""Columns that identify a cell."""

SIZES = {"m": 0.5, "m/s": 0.5, "m/s^2": 1.0, "rad": 0.2, "rad/s": 0.2, "ticks": 50.0}
"""Size of a typical bias by the unit of the quantity; also of a drift per second and of noise."""

OTHER_SIZE = 1.0
"""The same for units of other packages."""


@dataclass(frozen=True)
class FaultCell:
    """One fault of one sensor."""

    vehicle: str
    sensor: SensorSpec
    fault: Fault

    @property
    def values(self) -> Values:
        """What identifies the cell."""
        fields = self._stated(self.fault)
        parameters = [f"{k}: {v}" for k, v in fields.items() if k not in ("kind", "at_s")]
        return {
            SENSOR: f"{self.vehicle}/{self.sensor.name}",
            FAULT: self.fault.kind,
            PARAMETERS: ", ".join(parameters),
            BEGIN: self.fault.at_s,
        }

    def __str__(self) -> str:
        values = self.values
        parameters = f" ({values[PARAMETERS]})" if values[PARAMETERS] else ""
        return f"{values[SENSOR]} {values[FAULT]}{parameters} from {values[BEGIN]:g} s"

    @property
    def change(self) -> FieldChange:
        """The change of the scenario: the fault beside those that the sensor has."""
        faults = [self._stated(each) for each in (*self.sensor.faults, self.fault)]
        return FieldChange(f"vehicles.{self.vehicle}.sensors.{self.sensor.name}.faults", faults)

    @staticmethod
    def _stated(fault: FaultSpec) -> dict[str, Any]:
        return {k: v for k, v in msgspec.to_builtins(fault).items() if v is not None}


def cells(
    scenario: Scenario,
    *,
    sensors: Sequence[str],
    faults: Sequence[str],
    begins_s: Sequence[float],
    for_s: float | None,
) -> list[FaultCell]:
    """Return the cells of a campaign; a sensor has those faults that its kind can have.

    Parameters
    ----------
    scenario
        scenario with the sensors.
    sensors
        names such as `rover/imu`; none: all.
    faults
        kinds, or faults as a scenario has them, in braces; none: all kinds.
    begins_s
        sim times at which a fault begins.
    for_s
        duration of each fault; None: to the end.

    Raises
    ------
    UserError
        if there is no such sensor or fault, or none of the sensors can have a fault.
    """
    known = [f"{v.name}/{s.name}" for v in scenario.vehicles for s in v.sensors]
    for name in sensors:
        if name not in known:
            raise UserError(f"--sensors {name}: no such sensor; {did_you_mean(name, known)}")
    found: list[FaultCell] = []
    for text in faults or KINDS:
        of_fault = [
            FaultCell(vehicle.name, spec, msgspec.structs.replace(fault, at_s=at_s, for_s=for_s))
            for vehicle in scenario.vehicles
            for spec in vehicle.sensors
            if not sensors or f"{vehicle.name}/{spec.name}" in sensors
            for fault in _suitable(text, spec, vehicle)
            for at_s in begins_s
        ]
        if faults and not of_fault:
            raise UserError(f"--fault {text}: none of the sensors can have it")
        found += of_fault
    order = {name: number for number, name in enumerate(known)}
    return sorted(found, key=lambda cell: order[cell.values[SENSOR]])


def _suitable(text: str, spec: SensorSpec, vehicle: Vehicle) -> Iterator[Fault]:
    """Yield the fault that a text describes, if the sensor can have it."""
    fault = _given(text) if text.startswith("{") else _typical(text, spec)
    if fault is not None and fault_problem(fault, spec, vehicle) is None:
        yield fault


def _given(text: str) -> Fault:
    try:
        return fault_from(parse(text, Path("--fault")).value)
    except UserError as error:
        raise UserError(f"--fault {text}: {error}") from None


def _typical(kind: str, spec: SensorSpec) -> Fault | None:
    """Return the fault of a kind with its typical size; None if the sensor has no such quantity."""
    if kind not in KINDS:
        raise UserError(f"--fault {kind}: no such kind; {did_you_mean(kind, KINDS)}")
    unit = next((quantity.unit for quantity in spec.quantities.values()), None)
    size = SIZES.get(unit, OTHER_SIZE) if unit else None
    parameters: dict[str, dict[str, float | None]] = {
        "bias": {"value": size},
        "drift": {"per_s": size},
        "noise_burst": {"stddev": size},
        "time_jump": {"offset_s": 0.1},
        "delay": {"delay_s": 0.2},
        "drop": {"share": 0.5},
        "rate_change": {"rate_hz": spec.message_rate_hz / 2},
        "occluded_sector": {"from_deg": -45.0, "to_deg": 45.0},
    }
    fields = parameters.get(kind, {})
    if None in fields.values():
        return None
    return fault_from({"kind": kind, **fields})
