# SPDX-License-Identifier: Apache-2.0
"""Packets that the simulated LiDARs write pass the clauses of the kit."""

from types import SimpleNamespace

import numpy as np
import pytest

from sensor_conformance.checking import check_source
from sensor_conformance.clauses.clause import Verdict
from sensor_conformance.sources.memory import MemorySource
from sensor_conformance.sources.source import Received, SourceTopic
from services.sensors.lidar.native import hesai_packets, livox_packets

from .clean_packets import EPOCH

PACKETS = 200


def hesai(returns: int) -> list[bytes]:
    firings = hesai_packets.BLOCKS // returns * PACKETS
    noise = np.random.default_rng(1)
    measured = np.zeros((firings, returns, hesai_packets.LASERS), hesai_packets.ECHO)
    measured["distance"] = noise.integers(100, 20_000, measured.shape)
    step = firings // PACKETS * hesai_packets.FIRING_MICROS * 1000
    stamps = [EPOCH + round(index * step) for index in range(PACKETS)]
    azimuths = np.arange(firings) * 0.18 % 360
    mode = hesai_packets.DUAL if returns == 2 else hesai_packets.STRONGEST
    numbers = range(2**32 - 50, 2**32 - 50 + PACKETS)
    return hesai_packets.data_packets(measured, azimuths, stamps, numbers, mode, 600)


def livox() -> list[bytes]:
    noise = np.random.default_rng(2)
    measured = np.zeros(PACKETS * livox_packets.POINTS, livox_packets.SPOT)
    for axis in "xyz":
        measured[f"{axis}_mm"] = noise.integers(-9000, 9000, len(measured))
    step = livox_packets.POINTS * livox_packets.POINT_NANOS
    stamps = [EPOCH + index * step for index in range(PACKETS)]
    return livox_packets.point_packets(measured, stamps, np.arange(PACKETS) % 208)


@pytest.mark.parametrize(
    ("kind", "packets"),
    [("hesai/packet", hesai(1)), ("hesai/packet", hesai(2)), ("livox/point_packet", livox())],
    ids=["PandarXT-32", "PandarXT-32, dual returns", "Mid-360"],
)
def test_native_packets_pass(kind: str, packets: list[bytes]) -> None:
    messages = [
        Received(EPOCH + index, SimpleNamespace(data=data)) for index, data in enumerate(packets)
    ]
    report = check_source(MemorySource({SourceTopic("/packets", kind): messages}))
    assert [(one.clause.id, one.result.line) for one in report.findings] == []
    assert report.counts()[Verdict.PASSED] >= 5
