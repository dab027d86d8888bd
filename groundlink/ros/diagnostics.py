# SPDX-License-Identifier: Apache-2.0
"""Diagnostics as diagnostic_msgs/DiagnosticArray: health, vitals, faults and missing readings.

Every figure is a key-value pair of text; structured values are JSON. Recordings can therefore be
played without the package groundlink_msgs.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import msgspec
from msgspec import UNSET

from groundlink.episode.fault_messages import Faults
from groundlink.messages.base import NOT_REPORTED, Health, M, StreamReport
from groundlink.messages.ground_truth import BatteryState, Contact, InWater, Vitals, WheelInSoil
from groundlink.messages.missing_readings import MissingReadings, MissingSpan, in_words, parted
from groundlink.scenario.faults import Fault

from .codec import Codec
from .types import STORE, TYPES, header, nanos

DIAGNOSTICS_TOPIC = "/diagnostics"
DIAGNOSTICS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"

T = TypeVar("T")

OK, WARN, ERROR = 0, 1, 2
"""Levels of diagnostic_msgs/DiagnosticStatus."""

CONTACT_PREFIX = "contact "
"""Prefix of the keys of contacts; the name of the touched object follows."""

SOIL_PREFIX = "soil "
"""Prefix of the keys of wheels in soil; the wheel's name follows."""

FAULT_PREFIX = "fault "
"""Prefix of the keys of faults; the fault's number follows."""

_BATTERY, _WATER = "battery", "water"


def diagnostics(stamp_nanos: int, healths: Iterable[Health]) -> memoryview:
    """Return a DiagnosticArray in CDR with the newest health report of every process.

    It has a status for each process and for each stream that a gateway reports. The level is a
    warning if messages were lost or readings are missing.
    """
    statuses = []
    for health in healths:
        facts = msgspec.to_builtins(health)
        name, counters = facts.pop("process"), facts.pop("counters")
        facts.pop("streams")
        missing, _ = parted(counters)
        level, word = (WARN, f"missing {in_words(missing)}") if missing else (OK, "alive")
        statuses.append(_status(name, level, word, facts | counters))
        statuses += [_of_stream(name, stream) for stream in health.streams]
    array = TYPES[DIAGNOSTICS_TYPE](header=header(stamp_nanos, ""), status=statuses)
    return STORE.serialize_cdr(array, DIAGNOSTICS_TYPE)


def _of_stream(process: str, stream: StreamReport) -> Any:
    facts = msgspec.to_builtins(stream)
    lost = stream.lost + stream.dropped
    message = f"{lost} of {stream.sent} lost" if lost else "all arrived"
    if not stream.reported:
        message = NOT_REPORTED
    name = f"{process}: {facts['topic']} {facts['direction']}"
    return _status(name, WARN if lost else OK, message, facts)


def _status(
    name: str, level: int, message: str, facts: Mapping[str, object], hardware_id: str = ""
) -> Any:
    """Return a DiagnosticStatus; the value of a fact that is None is an empty text."""
    pair = TYPES["diagnostic_msgs/msg/KeyValue"]
    values = [
        pair(key=key, value="" if value is None else str(value)) for key, value in facts.items()
    ]
    return TYPES["diagnostic_msgs/msg/DiagnosticStatus"](
        level=level, name=name, message=message, hardware_id=hardware_id, values=values
    )


def _vitals(message: Vitals) -> dict[str, Any]:
    facts: dict[str, object] = {
        "tick": message.tick,
        "motor_work_j": message.motor_work_j,
        "braked_j": message.braked_j,
    }
    if message.battery:
        facts[_BATTERY] = msgspec.json.encode(message.battery).decode()
    if message.water:
        facts[_WATER] = msgspec.json.encode(message.water).decode()
    for wheel in message.soil or ():
        depth = {"slip": wheel.slip, "sinkage_m": wheel.sinkage_m}
        facts[SOIL_PREFIX + wheel.wheel] = msgspec.json.encode(depth).decode()
    for contact in message.contacts:
        rest = {"force_n": contact.force_n, "tick": contact.tick, "ticks": contact.ticks}
        facts[CONTACT_PREFIX + contact.name] = msgspec.json.encode(rest).decode()
    names = ", ".join(contact.name for contact in message.contacts)
    level, summary = (WARN, f"touches {names}") if names else (OK, "touches nothing")
    if message.has_drowned:
        level, summary = ERROR, f"motors have drowned, {summary}"
    return _only(message.stamp_nanos, message.vehicle, "vitals", level, summary, facts)


def from_vitals(array: Any) -> Vitals:
    """Return the vitals in a DiagnosticArray of their codec; ValueError if it has another form."""
    vehicle, facts = _the_only(array)
    try:
        tick, work, braked = (facts[name] for name in ("tick", "motor_work_j", "braked_j"))
    except KeyError as error:
        raise ValueError(f"no value {error}") from None
    battery = msgspec.json.decode(facts[_BATTERY], type=BatteryState) if _BATTERY in facts else None
    return Vitals(
        nanos(array.header.stamp),
        vehicle,
        int(tick),
        float(work),
        float(braked),
        _named(facts, CONTACT_PREFIX, "name", Contact),
        battery,
        _named(facts, SOIL_PREFIX, "wheel", WheelInSoil) or UNSET,
        msgspec.json.decode(facts[_WATER], type=InWater) if _WATER in facts else UNSET,
    )


def _named(facts: Mapping[str, str], prefix: str, field: str, kind: type[T]) -> tuple[T, ...]:
    """Return the structured values whose keys are a prefix and what belongs into a field."""
    return tuple(
        msgspec.convert({field: key.removeprefix(prefix)} | msgspec.json.decode(value), kind)
        for key, value in facts.items()
        if key.startswith(prefix)
    )


def _faults(message: Faults) -> dict[str, Any]:
    facts: dict[str, object] = {"tick": message.tick}
    for number, fault in enumerate(message.active, 1):
        facts[f"{FAULT_PREFIX}{number}"] = msgspec.json.encode(fault).decode()
    level = ERROR if message.active else OK
    summary = ", ".join(fault.kind for fault in message.active) or "none"
    return _only(message.stamp_nanos, message.sensor, "faults", level, summary, facts)


def from_faults(array: Any) -> Faults:
    """Return the faults in a DiagnosticArray of their codec; ValueError if it has another form."""
    sensor, facts = _the_only(array)
    if "tick" not in facts:
        raise ValueError("no value `tick`")
    active = tuple(
        msgspec.json.decode(value, type=Fault)
        for key, value in facts.items()
        if key.startswith(FAULT_PREFIX)
    )
    return Faults(nanos(array.header.stamp), sensor, int(facts["tick"]), active)


def _missing_readings(message: MissingReadings) -> dict[str, Any]:
    missing: Counter[str] = Counter()
    for gap in message.gaps:
        missing[gap.cause] += gap.readings
    facts = {
        f"gap {number}": msgspec.json.encode(gap).decode()
        for number, gap in enumerate(message.gaps, 1)
    }
    return _only(message.stamp_nanos, message.sensor, "gaps", WARN, in_words(missing), facts)


def from_missing_readings(array: Any) -> MissingReadings:
    """Return the missing readings in a DiagnosticArray of their codec; ValueError otherwise."""
    sensor, facts = _the_only(array)
    found = tuple(msgspec.json.decode(value, type=MissingSpan) for value in facts.values())
    return MissingReadings(nanos(array.header.stamp), sensor, found)


def _only(
    stamp_nanos: int, owner: str, what: str, level: int, message: str, facts: Mapping[str, object]
) -> dict[str, Any]:
    """Return the fields of a DiagnosticArray with one status about a vehicle or sensor."""
    row = _status(f"{owner}: {what}", level, message, facts, hardware_id=owner)
    return {"header": header(stamp_nanos, ""), "status": [row]}


def _the_only(array: Any) -> tuple[str, dict[str, str]]:
    """Return the hardware name and the facts of a DiagnosticArray's only status."""
    if len(array.status) != 1:
        raise ValueError(f"{len(array.status)} statuses, expected one")
    (status,) = array.status
    return status.hardware_id, {pair.key: pair.value for pair in status.values}


def _codec(
    message: type[M], encode: Callable[[M], dict[str, Any]], decode: Callable[[Any], M]
) -> Codec[M]:
    return Codec(
        message, DIAGNOSTICS_TYPE, encode, lambda ros, moment: decode(ros), recorded_only=True
    )


CODECS: tuple[Codec[Any], ...] = (
    _codec(Vitals, _vitals, from_vitals),
    _codec(Faults, _faults, from_faults),
    _codec(MissingReadings, _missing_readings, from_missing_readings),
)
