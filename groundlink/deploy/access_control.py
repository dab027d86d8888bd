# SPDX-License-Identifier: Apache-2.0
"""Who may say what on a bus that strangers reach, in the words of Zenoh's access control.

Rule: what is not granted is denied. Whoever has a certificate of the run hears all of it; only
physics tells the state, a sensor only its own readings, only the gateway and a vehicle's driver
command it, and only the operator, and ROS by the gateway, pause a run; only the operator breaks a
sensor. The subject is the common name of
the certificate, which is the name of the process.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from groundlink.bus.core_topics import ACK, CLOCK, COMMAND, HEALTH, ROOT, STATE
from groundlink.bus.queries import (
    asset_key,
    control_key,
    faults_key,
    history_key,
    journal_key,
    link_key,
    scenario_key,
)
from groundlink.bus.topics import (
    BODIES,
    FAULTS,
    FROM_ROS,
    GAPS,
    GROUND_TRUTH,
    JOINT_COMMAND,
    JOINTS,
    RELAYED,
    TRUE_WHEELS,
    VITALS,
    WHEEL_COMMAND,
    driver_names,
    sensor_outputs,
)
from groundlink.process.name_claim import claims_key
from groundlink.scenario import Scenario

OPERATOR = "operator"
"""Who has its certificate may pause a run, drive, spawn, break sensors and links."""

OBSERVERS = ("recorder", "view")

ALL = f"{ROOT}/**"

_ALSO_ASKS = {OPERATOR: ["operate"], "gateway": ["wish"]}
"""Rules of those who may ask more than all may: the gateway tells what ROS wishes about time."""

_ASKED_BY_ALL = (scenario_key, asset_key, history_key, journal_key)

_HEARS = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
_ASKS = ["query"]
_SAYS = ["put", "liveliness_token"]
_ANSWERS = ["declare_queryable", "reply"]
_EVERYTHING = [*_HEARS, *_ASKS, *_SAYS, *_ANSWERS]


class Grant(NamedTuple):
    """What one process may do beside hearing."""

    says: tuple[str, ...]
    """Keys that it publishes, or is there under."""

    answers: tuple[str, ...] = ()
    """Keys that it answers questions of, with all below them."""


def grants(scenario: Scenario) -> Iterator[tuple[str, Grant]]:
    """Yield every process of a scenario, and the others that may come, with what it may do."""
    told = (STATE, CLOCK, BODIES, GROUND_TRUTH, TRUE_WHEELS, JOINTS, VITALS)
    served = (*(key("*") for key in _ASKED_BY_ALL), control_key("*"))
    yield "physics", Grant((*_own("physics"), *(row.key_in("*") for row in told)), served)
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            name = f"{vehicle.name}/{sensor.name}"
            names = {"vehicle": vehicle.name, "sensor": sensor.name}
            said = (output.row.key_in("*", **names) for output in sensor_outputs(sensor))
            wrong = (row.key_in("*", process=name) for row in (FAULTS, GAPS))
            yield name, Grant((*_own(name), *wrong, *said), (faults_key("*", name),))
    for name in driver_names(scenario):
        vehicle_name = name.partition("/")[0]
        yield name, Grant((*_own(name), COMMAND.key_in("*", vehicle=vehicle_name)))
    commands = tuple(row.key_in("*") for row in (COMMAND, WHEEL_COMMAND, JOINT_COMMAND))
    told_by_ros = (*FROM_ROS.values(), RELAYED)
    heard = (row.key_in("*") for row in told_by_ros if row is not JOINT_COMMAND)
    yield "gateway", Grant((*_own("gateway"), *commands, *heard), (link_key("*"),))
    for name in OBSERVERS:
        yield name, Grant((*_own(name), *_own(f"{name}/*")))
    yield OPERATOR, Grant((*commands, *_own(f"{OPERATOR}/*")))


def access_control(scenario: Scenario) -> dict[str, Any]:
    """Return the part `access_control` of the configuration of the scenario's router."""
    rules = [
        _rule("hear", _EVERYTHING, [ALL], flow="egress"),
        _rule("listen", _HEARS, [ALL]),
        _rule("ask", _ASKS, [f"{key('*')}/**" for key in _ASKED_BY_ALL]),
        _rule("wish", _ASKS, [f"{control_key('*')}/**"]),
        _rule("operate", _ASKS, [ALL]),
    ]
    subjects, policies = [], []
    for process, grant in grants(scenario):
        own = ["hear", "listen", "ask", *_ALSO_ASKS.get(process, ())]
        for verb, messages, keys in (
            ("says", _SAYS, list(grant.says)),
            ("answers", _ANSWERS, [f"{key}/**" for key in grant.answers]),
        ):
            if keys:
                rules.append(_rule(f"{process} {verb}", messages, keys))
                own.append(f"{process} {verb}")
        subjects.append({"id": process, "cert_common_names": [process]})
        policies.append({"rules": own, "subjects": [process]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _own(process: str) -> tuple[str, ...]:
    """Return the keys under which every process tells of itself."""
    rows = (row.key_in("*", process=process) for row in (HEALTH, ACK))
    return (*rows, f"{claims_key('*', process)}/*")


def _rule(name: str, messages: list[str], keys: list[str], flow: str = "ingress") -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": keys,
    }
