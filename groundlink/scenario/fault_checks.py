# SPDX-License-Identifier: Apache-2.0
"""Checks that a sensor can have a fault, beyond what the types of faults state."""

from groundlink.core.errors import did_you_mean
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.faults import EACH_WHEEL, Disturbance, Fault, OccludedSector, RateChange
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.sensor_kinds import kind_of


def fault_problem(fault: Fault, spec: SensorSpec, vehicle: Vehicle) -> tuple[str, str] | None:
    """Return why a vehicle's sensor cannot have a fault, as field and problem; None if it can."""
    if isinstance(fault, Disturbance):
        return _of_disturbance(fault, spec, vehicle)
    if isinstance(fault, OccludedSector) and not kind_of(spec).cover:
        return "kind", "nothing can cover a sector of a sensor that does not look around"
    rate_hz = spec.message_rate_hz
    if isinstance(fault, RateChange) and fault.rate_hz >= rate_hz:
        return "rate_hz", f"{fault.rate_hz:g} Hz; expected less than the declared {rate_hz:g} Hz"
    return None


def _of_disturbance(
    fault: Disturbance, spec: SensorSpec, vehicle: Vehicle
) -> tuple[str, str] | None:
    if not spec.quantities:
        return "kind", "this sensor has no numbers that could be wrong"
    name = fault.quantity or next(iter(spec.quantities))
    if name not in spec.quantities:
        return "quantity", f"no quantity `{name}`; {did_you_mean(name, spec.quantities)}"
    components = spec.quantities[name].components
    count = len(vehicle.model.counted) if components is EACH_WHEEL else len(components) or 1
    if isinstance(fault.numbers, tuple) and len(fault.numbers) != count:
        expected = f"one, or {count} ({', '.join(components)})" if components else "one"
        return fault.numbers_field, f"{len(fault.numbers)} numbers; expected {expected}"
    return None
