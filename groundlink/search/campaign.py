# SPDX-License-Identifier: Apache-2.0
"""Fault campaign: each fault of each sensor at several times, over several links, as a matrix."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from groundlink.core.errors import UserError, did_you_mean
from groundlink.emulation.script import LinkScript
from groundlink.emulation.settings import Impairment
from groundlink.loader.document import parse
from groundlink.loader.overrides import FieldChange
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.fault_checks import fault_problem
from groundlink.scenario.faults import KINDS, Fault, FaultSpec, fault_from
from groundlink.scenario.schema import Scenario, Vehicle

from .point_journal import Values

SENSOR, FAULT, PARAMETERS, BEGIN, LINK = "sensor", "fault", "parameters", "begin s", "link"
"""Columns that identify a cell. A campaign without links has no `LINK`."""

NONE = "none"
"""Value of `FAULT` and `LINK`: no fault, or a link without impairments."""

LINK_FIELD = "gateway.link"
"""Field of a scenario that has the link."""

SIZES = {"m": 0.5, "m/s": 0.5, "m/s^2": 1.0, "rad": 0.2, "rad/s": 0.2, "ticks": 50.0}
"""Size of a typical bias by the unit of the quantity; also of a drift per second and of noise."""

OTHER_SIZE = 1.0
"""The same for units of other packages."""


@dataclass(frozen=True)
class SensorFault:
    """One fault of one sensor."""

    vehicle: str
    sensor: SensorSpec
    fault: Fault

    @property
    def name(self) -> str:
        """The sensor as `vehicle/sensor`."""
        return f"{self.vehicle}/{self.sensor.name}"

    @property
    def parameters(self) -> str:
        """What the fault has besides its kind and begin."""
        fields = self._stated(self.fault)
        return ", ".join(f"{k}: {v}" for k, v in fields.items() if k not in ("kind", "at_s"))

    @property
    def change(self) -> FieldChange:
        """The change of the scenario: the fault beside those that the sensor has."""
        faults = [self._stated(each) for each in (*self.sensor.faults, self.fault)]
        return FieldChange(f"vehicles.{self.vehicle}.sensors.{self.sensor.name}.faults", faults)

    def __str__(self) -> str:
        parameters = f" ({self.parameters})" if self.parameters else ""
        return f"{self.name} {self.fault.kind}{parameters} from {self.fault.at_s:g} s"

    @staticmethod
    def _stated(fault: FaultSpec) -> dict[str, Any]:
        return {k: v for k, v in msgspec.to_builtins(fault).items() if v is not None}


@dataclass(frozen=True)
class LinkCondition:
    """A link of all runs of a row."""

    text: str
    """As the user has given it."""

    script: LinkScript
    change: FieldChange
    """The change of the scenario."""

    def impairments(self, direction: str) -> list[str]:
        """Return the impairments that a direction has at some time, by name of their field."""
        initial = getattr(self.script, direction)
        changes = [getattr(event, direction) for event in self.script.events]
        return [
            field.name
            for field in msgspec.structs.fields(Impairment)
            if getattr(initial, field.name) != field.default
            or any(each.get(field.name, field.default) != field.default for each in changes)
        ]


@dataclass(frozen=True)
class CampaignCell:
    """A fault, a link, or both."""

    fault: SensorFault | None
    link: LinkCondition | None
    """None in a campaign without links."""

    @property
    def values(self) -> Values:
        """What identifies the cell."""
        fault = self.fault
        return {
            SENSOR: fault.name if fault else None,
            FAULT: fault.fault.kind if fault else NONE,
            PARAMETERS: fault.parameters if fault else "",
            BEGIN: fault.fault.at_s if fault else None,
        } | ({LINK: self.link.text} if self.link else {})

    @property
    def changes(self) -> list[FieldChange]:
        """The changes of the scenario."""
        return [part.change for part in (self.fault, self.link) if part is not None]

    def __str__(self) -> str:
        words = [str(self.fault or "no fault")]
        return ", ".join([*words, f"link {self.link.text}"] if self.link else words)


def link_condition(text: str) -> LinkCondition:
    """Return the link of an argument of `--link`.

    Raises
    ------
    UserError
        when it is neither `none` nor a link as a scenario has it.
    """
    try:
        given = parse("{}" if text == NONE else text, Path("--link")).value
        script = msgspec.convert(given, LinkScript)
    except (UserError, msgspec.ValidationError) as error:
        problem = str(error)
        raise UserError(f"--link {text}: {problem[:1].lower()}{problem[1:]}") from None
    return LinkCondition(text, script, FieldChange(LINK_FIELD, given))


def cells(
    scenario: Scenario,
    *,
    sensors: Sequence[str],
    faults: Sequence[str],
    begins_s: Sequence[float],
    for_s: float | None,
    links: Sequence[str] = (),
) -> list[CampaignCell]:
    """Return the cells of a campaign: each fault over each link, but for none of both.

    Parameters
    ----------
    scenario
        scenario with the sensors.
    sensors
        names such as `rover/imu`; none: all.
    faults
        kinds, or faults as a scenario has them, in braces, or `none`; none: all kinds, and with
        links also `none`.
    begins_s
        sim times at which a fault begins.
    for_s
        duration of each fault; None: to the end.
    links
        links as a scenario has them, in braces, or `none`.

    Raises
    ------
    UserError
        if there is no such sensor or fault, none of the sensors can have a fault, or a link is
        invalid.
    """
    over: Sequence[LinkCondition | None] = [
        link_condition(text) for text in dict.fromkeys(links)
    ] or [None]
    chosen: list[SensorFault | None] = []
    if NONE in faults or (links and not faults):
        chosen.append(None)
    if kinds := [text for text in faults if text != NONE] or ([] if faults else KINDS):
        chosen += _sensor_faults(scenario, sensors, kinds, begins_s, for_s, are_all=not faults)
    return [
        CampaignCell(fault, link)
        for fault in chosen
        for link in over
        if fault is not None or (link is not None and link.text != NONE)
    ]


def _sensor_faults(
    scenario: Scenario,
    sensors: Sequence[str],
    faults: Iterable[str],
    begins_s: Sequence[float],
    for_s: float | None,
    *,
    are_all: bool,
) -> list[SensorFault]:
    """Return those faults that the kinds of the sensors can have."""
    known = [f"{v.name}/{s.name}" for v in scenario.vehicles for s in v.sensors]
    for name in sensors:
        if name not in known:
            raise UserError(f"--sensors {name}: no such sensor; {did_you_mean(name, known)}")
    found: list[SensorFault] = []
    for text in faults:
        of_fault = [
            SensorFault(vehicle.name, spec, msgspec.structs.replace(fault, at_s=at_s, for_s=for_s))
            for vehicle in scenario.vehicles
            for spec in vehicle.sensors
            if not sensors or f"{vehicle.name}/{spec.name}" in sensors
            for fault in _suitable(text, spec, vehicle)
            for at_s in begins_s
        ]
        if not are_all and not of_fault:
            raise UserError(f"--fault {text}: none of the sensors can have it")
        found += of_fault
    order = {name: number for number, name in enumerate(known)}
    return sorted(found, key=lambda each: order[each.name])


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
