# SPDX-License-Identifier: Apache-2.0
"""Access control of a secured bus, as configuration of Zenoh's router.

Everything else is denied. Every process with a certificate of the run may subscribe to everything.
Only physics publishes states, a sensor only its own readings; only the gateway and the driver of a
vehicle command it. Only the operator, and ROS through the gateway, control the run; only the
operator injects faults. A subject is the common name of a certificate, which is the process name.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

from groundlink.bus.core_topics import ACK, CLOCK, COMMAND, HEALTH, ROOT, STATE, STATE_BATCH
from groundlink.bus.queries import (
    asset_key,
    control_key,
    faults_key,
    history_key,
    journal_key,
    link_key,
    ruts_key,
    scenario_key,
    world_query_key,
)
from groundlink.bus.topics import (
    BODIES,
    FAULTS,
    FROM_ROS,
    GROUND_TRUTH,
    JOINT_COMMAND,
    JOINT_GROUP_COMMAND,
    JOINTS,
    MISSING_READINGS,
    RELAYED,
    TRUE_MAP,
    TRUE_WHEELS,
    VITALS,
    WHEEL_COMMAND,
    driver_names,
    sensor_outputs,
)
from groundlink.process.name_claim import claims_key
from groundlink.scenario import Scenario

OPERATOR = "operator"
"""Subject that may control a run, drive, spawn, and inject faults and impairments."""

OBSERVERS = ("recorder", "view")

ALL = f"{ROOT}/**"
"""All keys but those with a chunk that begins with @."""

_EXTRA_QUERIES = {OPERATOR: ["operate"], "gateway": ["control"]}
"""Additional query rules; the gateway sends run commands of ROS."""

_PUBLIC_QUERIES = (scenario_key, asset_key, history_key, journal_key, ruts_key)
_CONTROL_QUERIES = (control_key, world_query_key)

_SUBSCRIBE = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
_QUERY = ["query"]
_PUBLISH = ["put", "liveliness_token"]
_SERVE = ["declare_queryable", "reply"]
_ALL_MESSAGES = [*_SUBSCRIBE, *_QUERY, *_PUBLISH, *_SERVE]


class Grant(NamedTuple):
    """Permissions of a process besides subscribing."""

    publishes: tuple[str, ...]
    """Keys of its messages and liveliness tokens."""

    serves: tuple[str, ...] = ()
    """Keys of its queryables, with all keys below."""


def grants(scenario: Scenario) -> Iterator[tuple[str, Grant]]:
    """Yield the name and permissions of each process of a scenario, observers and the operator."""
    published = (
        *(STATE, STATE_BATCH, CLOCK, BODIES, TRUE_MAP),
        *(GROUND_TRUTH, TRUE_WHEELS, JOINTS, VITALS),
    )
    served = tuple(key("*") for key in (*_PUBLIC_QUERIES, *_CONTROL_QUERIES))
    yield "physics", Grant((*_own("physics"), *(row.key_in("*") for row in published)), served)
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            name = f"{vehicle.name}/{sensor.name}"
            names = {"vehicle": vehicle.name, "sensor": sensor.name}
            streams = (output.row.key_in("*", **names) for output in sensor_outputs(sensor))
            problems = (row.key_in("*", process=name) for row in (FAULTS, MISSING_READINGS))
            yield name, Grant((*_own(name), *problems, *streams), (faults_key("*", name),))
    for name in driver_names(scenario):
        vehicle_name = name.partition("/")[0]
        yield name, Grant((*_own(name), COMMAND.key_in("*", vehicle=vehicle_name)))
    commanding = (COMMAND, WHEEL_COMMAND, JOINT_COMMAND, JOINT_GROUP_COMMAND)
    commands = tuple(row.key_in("*") for row in commanding)
    from_ros = (*FROM_ROS.values(), RELAYED)
    received = (row.key_in("*") for row in from_ros if row is not JOINT_COMMAND)
    yield "gateway", Grant((*_own("gateway"), *commands, *received), (link_key("*"),))
    for name in OBSERVERS:
        yield name, Grant((*_own(name), *_own(f"{name}/*")))
    yield OPERATOR, Grant((*commands, *_own(f"{OPERATOR}/*")))


def access_control(scenario: Scenario) -> dict[str, Any]:
    """Return the section `access_control` of the configuration of the scenario's router."""
    rules = [
        _rule("receive", _ALL_MESSAGES, [ALL, STATE_BATCH.key_in("*")], flow="egress"),
        _rule("subscribe", _SUBSCRIBE, [ALL, STATE_BATCH.key_in("*")]),
        _rule("query", _QUERY, [f"{key('*')}/**" for key in _PUBLIC_QUERIES]),
        _rule("control", _QUERY, [f"{key('*')}/**" for key in _CONTROL_QUERIES]),
        _rule("operate", _QUERY, [ALL]),
    ]
    subjects, policies = [], []
    for process, grant in grants(scenario):
        own = ["receive", "subscribe", "query", *_EXTRA_QUERIES.get(process, ())]
        for verb, messages, keys in (
            ("publishes", _PUBLISH, list(grant.publishes)),
            ("serves", _SERVE, [f"{key}/**" for key in grant.serves]),
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
    """Return the keys of the health, acknowledgements and claims of a process."""
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
