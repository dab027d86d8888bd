# SPDX-License-Identifier: Apache-2.0
"""Counts, gaps and bins, however long a run is."""

import numpy as np
import pytest

from groundlink.core.clock import NANOS
from groundlink.episode.fault_messages import Faults
from groundlink.messages.ground_truth import Contact, Vitals
from groundlink.report.analysis.diagnostics import FaultPeriod, SensorFaultHistory
from groundlink.report.analysis.energy import MAX_EVENTS, Energy
from groundlink.report.analysis.motion import MAX_POINTS, passages, stride
from groundlink.report.analysis.streams import LARGEST_KEPT, MAX_BINS, StreamTimes, bin_nanos
from groundlink.scenario.faults import Bias, Fault, Off, Stuck


def track(declared_hz: float | None, nanos: list[int]) -> StreamTimes:
    stream = StreamTimes("/t", "x/T", declared_hz, first_nanos=nanos[0], last_nanos=nanos[-1])
    for each in nanos:
        stream.add(each, 10)
    return stream


def test_without_a_declared_rate_there_are_no_gaps() -> None:
    stream = track(None, [0, NANOS, 5 * NANOS])
    assert stream.gaps == 0
    assert stream.bins() is None
    assert stream.measured_hz == pytest.approx(0.4)
    assert stream.bytes == 30


def test_the_largest_gaps_are_kept() -> None:
    times = [0]
    for i in range(50):
        times.append(times[-1] + (i % 10 + 1) * NANOS)
    stream = track(1.0, times)
    assert [gap.nanos // NANOS for gap in stream.largest_gaps] == [10] * LARGEST_KEPT
    assert stream.gaps == 45


def test_one_message_or_none_has_no_rate() -> None:
    assert track(1.0, [5]).measured_hz is None
    empty = StreamTimes("/t", "x/T", 10.0, first_nanos=0, last_nanos=3 * NANOS)
    assert empty.measured_hz is None
    assert empty.largest_gaps == []


@pytest.mark.parametrize("rate_hz", [1.0, 7.5, 29.97, 400.0])
@pytest.mark.parametrize("seconds", [3.0, 9.3])
def test_a_steady_stream_keeps_its_rate_in_every_bin(rate_hz: float, seconds: float) -> None:
    begin = 1_700_000_000 * NANOS
    times = [begin + round(i / rate_hz * NANOS) for i in range(int(seconds * rate_hz) + 1)]
    bins = track(rate_hz, times).bins()
    assert bins is not None
    assert bins.kept.all()


@pytest.mark.parametrize("rate_hz", [10.0, 30.0])
def test_one_lost_message_is_seen_in_its_bin(rate_hz: float) -> None:
    times = [round(i / rate_hz * NANOS) for i in range(int(4 * rate_hz) + 1)]
    del times[int(1.5 * rate_hz)]
    bins = track(rate_hz, times).bins()
    assert bins is not None
    assert bins.kept.tolist() == [True, False, True, True]


def test_silence_is_no_rate() -> None:
    bins = track(0.5, [0, 6 * NANOS]).bins()
    assert bins is not None
    assert bins.silent.tolist() == [False, True, True, True, True, False]
    slow = track(10.0, [0, 3 * NANOS]).bins()
    assert slow is not None
    assert not slow.kept.any()


@pytest.mark.parametrize("seconds", [0.01, 1, 599, 601, 86_400])
def test_bins_are_whole_seconds_and_few(seconds: float) -> None:
    span = round(seconds * NANOS)
    width = bin_nanos(span)
    assert width % NANOS == 0
    assert span / width <= MAX_BINS


def test_a_long_run_is_thinned() -> None:
    assert stride(MAX_POINTS) == 1
    assert stride(MAX_POINTS + 1) == 2
    assert stride(0) == 1


def test_things_touched_apart_in_time_are_two_events() -> None:
    energy = Energy("rover", 1)
    for at in (1.0, 1.1, 1.6, 2.2):
        touch = (Contact("wall", 10.0 * at, int(at * 400), 2), Contact("box", 1.0, 0, 1))
        energy.add(at, Vitals(0, "rover", 0, at, 0.0, touch))
    assert [(e.name, e.begin_seconds, e.end_seconds) for e in energy.events] == [
        ("wall", 1.0, 1.6),
        ("box", 1.0, 1.6),
        ("wall", 2.2, 2.2),
        ("box", 2.2, 2.2),
    ]
    assert energy.events[0].force_n == pytest.approx(16.0)
    assert energy.events[0].ticks == 6


def test_events_are_bounded() -> None:
    energy = Energy("rover", 1)
    for at in range(MAX_EVENTS + 7):
        energy.add(float(at), Vitals(0, "rover", 0, 0.0, 0.0, (Contact("wall", 1.0, 0, 1),)))
    assert len(energy.events) == MAX_EVENTS
    assert energy.further_events == 7


def test_there_and_back_is_two_passages_each_at_its_nearest() -> None:
    seconds = np.arange(0, 30, 0.02)
    x = 15 - np.abs(seconds - 15)  # 1 m/s, 15 m there and back
    track = np.stack([seconds, x, np.full_like(x, 0.1)], axis=-1)
    found = passages(track, {"middle": (7.5, 0.0), "end": (15.0, 0.0), "aside": (5.0, 3.0)})
    assert [passage.checkpoint for passage in found] == ["middle", "end", "middle"]
    assert [passage.seconds for passage in found] == pytest.approx([7.5, 15.0, 22.5], abs=0.02)
    assert [passage.apart_m for passage in found] == pytest.approx([0.1] * 3, abs=1e-3)


def test_a_way_that_never_moves_has_at_most_one_passage() -> None:
    track = np.tile([0.0, 1.0, 1.0], (5, 1))
    assert [passage.seconds for passage in passages(track, {"here": (1.0, 1.5)})] == [0.0]
    assert passages(np.empty((0, 5)), {"here": (1.0, 1.5)}) == []


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
