# SPDX-License-Identifier: Apache-2.0
"""Reports of faults and the effect of requests, without a bus, with a stand-in sensor."""

import msgspec
import pytest
from msgspec.structs import replace

from groundlink.episode.fault_messages import CLEAR, FaultAnswer, Faults
from groundlink.messages.base import BusMessage, Imu
from groundlink.scenario.faults import Bias, Fault, NoiseBurst, Off, RateChange, Stuck
from services.sensors.faults.live import LiveFaults
from services.sensors.imu.spec import InertialUnit
from tests.services.sensors.broken import EPOCH_NANOS, READINGS, Line, Repeats, states, wrapped
from tests.services.sensors.states import scenario


class Bench:
    """A sensor's process with its faults."""

    def __init__(self, *faults: Fault) -> None:
        self.told: list[Faults] = []
        self.line = Line()
        self.model = wrapped(Repeats(READINGS[Imu]), Imu, *faults)
        process = self.line.process(self.model)
        self.live = LiveFaults(
            process,
            self.model,
            vehicle=scenario().vehicles[0],
            spec=InertialUnit(name="imu", topic="/imu", frame="imu", rate_hz=100.0),
            report=self.told.append,
            acknowledge=process.report_progress,
        )

    def take(self, *ticks: int) -> None:
        for state in states(range(*ticks)):
            self.live.take(state)

    def ask(self, request: str | Fault) -> FaultAnswer:
        text = request if isinstance(request, str) else msgspec.json.encode(request).decode()
        [reply] = self.live.answer(text)
        return msgspec.json.decode(reply, type=FaultAnswer)

    def events(self) -> list[tuple[int, list[str]]]:
        assert all(t.stamp_nanos == EPOCH_NANOS + t.tick * 2_500_000 for t in self.told)
        assert {t.sensor for t in self.told} <= {"rover/imu"}
        return [(told.tick, [fault.kind for fault in told.active]) for told in self.told]


def test_begin_and_end_of_each_fault_are_reported_once() -> None:
    bench = Bench(Off(at_s=0.1, for_s=0.1), Bias(value=1.0, at_s=0.15))
    bench.take(200)
    assert bench.events() == [(40, ["off"]), (60, ["off", "bias"]), (80, ["bias"])]


def test_a_live_fault_begins_at_the_next_tick_and_ends_by_itself() -> None:
    bench = Bench()
    bench.take(101)
    answer = bench.ask(Stuck(for_s=0.5))
    assert answer == FaultAnswer("", 101, (Stuck(at_s=0.2525, for_s=0.5),))
    bench.take(101, 500)
    assert bench.events() == [(101, ["stuck"]), (301, [])]


def test_the_same_in_a_scenario_gives_the_same_bytes() -> None:
    live = Bench()
    for tick in range(400):
        live.take(tick, tick + 1)
        if tick == 122:
            [noise] = live.ask(NoiseBurst(stddev=0.5, for_s=0.3)).active
        if tick == 300:
            live.ask(Stuck())
        if tick == 350:
            assert live.ask(CLEAR).active == ()
    stuck = Stuck(at_s=0.7525, for_s=0.125)
    assert live.model.faults == (noise, stuck)
    by_scenario = Bench(noise, stuck)
    by_scenario.take(400)
    assert by_scenario.line.bodies == live.line.bodies
    assert by_scenario.events() == live.events()


def test_clear_ends_active_faults_only() -> None:
    bench = Bench(Off(at_s=0.1), Bias(value=1.0, at_s=0.5))
    bench.take(81)
    bench.ask(Stuck())
    assert bench.ask(CLEAR) == FaultAnswer("", 81, ())
    bench.take(81, 300)
    assert bench.events() == [(40, ["off"]), (81, []), (200, ["bias"])]
    assert bench.model.faults[0] == Off(at_s=0.1, for_s=0.1025)


def test_to_ask_changes_nothing() -> None:
    bench = Bench(Off(at_s=0.1))
    bench.take(60)
    acks = len(bench.line.acks)
    assert bench.ask("") == FaultAnswer("", 60, (Off(at_s=0.1),))
    assert len(bench.line.acks) == acks


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ("nonsense", "malformed"),
        ('{"kind":"broken"}', "Invalid value 'broken'"),
        (Bias(value=(1.0, 2.0)), "`value`: 2 numbers"),
        (Bias(value=1.0, quantity="range"), "no quantity `range`; expected one of acceleration"),
        (RateChange(rate_hz=100.0), "expected less than the declared 100 Hz"),
        ('{"kind":"occluded_sector","from_deg":0,"to_deg":9}', "does not look around"),
    ],
)
def test_invalid_faults_give_one_line(asked: str | Fault, why: str) -> None:
    bench = Bench()
    bench.take(10)
    answer = bench.ask(asked)
    assert why in answer.error
    assert "\n" not in answer.error
    assert bench.model.faults == ()


def test_before_the_first_state_there_is_no_next_tick() -> None:
    assert "no state yet" in Bench().ask(Off()).error


def test_a_live_fault_is_acknowledged_at_once_so_that_a_crash_does_not_end_it() -> None:
    first, second = Bench(), Bench()
    first.take(120)
    first.ask(Stuck())
    second.live.resume(first.line.acks[-1])
    second.take(300)
    assert second.model.faults == (Stuck(at_s=0.3),)
    # Told by the first: what it did not come to tell. The tick before is known to both.
    assert second.events() == [(120, ["stuck"])]


def test_successor_repeats_no_report() -> None:
    first, second = Bench(Off(at_s=0.1, for_s=0.5)), Bench(Off(at_s=0.1, for_s=0.5))
    first.take(160)
    second.live.resume(first.line.acks[-1])
    second.take(300)
    assert second.events() == [(240, [])]


def test_sensor_that_begins_again_in_its_episode_repeats_no_report() -> None:
    bench = Bench(Off(at_s=0.1, for_s=0.5))
    bench.take(160)
    before = bench.events()
    bench.live.resume(bench.line.acks[-1])
    bench.take(300)
    assert bench.events() == [*before, (240, [])]


def test_late_sensor_reports_active_faults() -> None:
    bench = Bench()
    bench.take(500, 510)
    assert bench.events() == [(500, [])]


def test_a_new_episode_begins_without_live_faults() -> None:
    bench = Bench(Bias(value=1.0, at_s=0.05))
    bench.take(50)
    bench.ask(Stuck())
    bench.take(50, 60)
    for state in states(range(60)):
        bench.live.take(replace(state, episode=7, epoch_nanos=7))
    kinds = [[fault.kind for fault in told.active] for told in bench.told]
    assert kinds == [["bias"], ["bias", "stuck"], ["bias"]]
    assert (bench.told[2].tick, bench.told[2].stamp_nanos) == (20, 7 + 20 * 2_500_000)
    assert isinstance(bench.told[2], BusMessage)
