# SPDX-License-Identifier: Apache-2.0
"""Faults that a sensor told become rows with a begin and an end."""

from groundlink.episode.fault_messages import Faults
from groundlink.report.analysis.fault_history import FaultPeriod, SensorFaultHistory
from groundlink.scenario.faults import Bias, Fault, Off, Stuck


def test_each_fault_has_its_begin_and_its_end() -> None:
    off, stuck, bias = Off(at_s=1.0), Stuck(at_s=2.0), Bias(value=1.0)
    told: list[tuple[float, tuple[Fault, ...]]] = [
        *((1.0, (off,)), (2.0, (off, stuck)), (3.0, (stuck,))),
        *((4.0, (bias,)), (5.0, ()), (6.0, (off,))),
    ]
    failures = SensorFaultHistory("rover/imu")
    for seconds, active in told:
        failures.add(seconds, Faults(0, "rover/imu", 0, active))
    assert failures.all == [
        FaultPeriod(off, 1.0, 3.0),
        FaultPeriod(stuck, 2.0, 4.0),
        FaultPeriod(bias, 4.0, 5.0),
        FaultPeriod(off, 6.0, None),
    ]
