# SPDX-License-Identifier: Apache-2.0
"""Client of a sensor's fault queryable: inject a fault, or clear all, and return the answer."""

import msgspec

from groundlink.core.errors import UserError, did_you_mean
from groundlink.episode.fault_messages import CLEAR, FaultAnswer
from groundlink.scenario import Scenario
from groundlink.scenario.fault_checks import fault_problem
from groundlink.scenario.faults import Fault

from .queries import faults_key
from .session import Bus

ANSWER_SECONDS = 3.0
"""Timeout of a sensor, which may be busy with a revolution."""


def send_fault(
    bus: Bus, run: str, scenario: Scenario, sensor: str, fault: Fault | None
) -> FaultAnswer:
    """Inject a fault into a sensor of a run from its next tick on; return the answer.

    The answer holds all active faults. `at_s` of the fault is ignored.

    Parameters
    ----------
    scenario
        the scenario of the run, against which the fault is checked before it is sent.
    sensor
        such as `rover/lidar`.
    fault
        None ends all faults of the sensor.

    Raises
    ------
    UserError
        if there is no such sensor, it cannot have the fault, or it does not answer.
    """
    found = scenario.sensor(sensor)
    if found is None:
        hint = did_you_mean(sensor, scenario.sensor_names())
        raise UserError(f"run `{run}` has no sensor `{sensor}`; {hint}")
    vehicle, spec = found
    if fault is not None and (wrong := fault_problem(fault, spec, vehicle)):
        raise UserError(f"{sensor}: `{wrong[0]}`: {wrong[1]}")
    query = CLEAR if fault is None else msgspec.json.encode(fault).decode()
    replies = bus.query(faults_key(run, sensor), query, seconds=ANSWER_SECONDS)
    if not replies:
        raise UserError(
            f"run `{run}`: {sensor} does not respond. Fix: check that its process is running"
        )
    return read_answer(sensor, next(iter(replies.values())))


def read_answer(sensor: str, payload: bytes) -> FaultAnswer:
    """Return the answer of a sensor.

    Raises
    ------
    UserError
        if the sensor rejected the request.
    """
    answer = msgspec.json.decode(payload, type=FaultAnswer)
    if answer.error:
        raise UserError(f"{sensor}: {answer.error}")
    return answer
