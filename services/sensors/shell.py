# SPDX-License-Identifier: Apache-2.0
"""The process around a sensor model: joins a run, feeds states in order, publishes readings.

Rule: everything that is not the sensor. A model is restarted after every gap in ticks, and readings
that a predecessor has already published are not published again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

from groundlink import process
from groundlink.bus import Bus
from groundlink.errors import UserError
from groundlink.messages import Ack, BadMessage, Message, State
from groundlink.scenario import Scenario
from groundlink.scenario.load import nearest
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.sensors import Sensor
from groundlink.topics import ACK, SENSOR_TOPICS
from groundlink.world.build import world_hash

from .model import RememberingModel, SensorModel
from .native import NativeLink

ACKS_PER_WINDOW = 8
"""How often progress is told while physics gets as far ahead as it may."""

S = TypeVar("S", bound=Sensor)
M = TypeVar("M", bound=SensorModel)


class SensorProcess:
    """A model between the states of a run and its readings."""

    def __init__(
        self,
        model: SensorModel,
        *,
        expected_world_hash: str,
        ack_ticks: int,
        publish: Callable[[Message], object],
        acknowledge: Callable[[Ack], object],
    ) -> None:
        self._model = model
        self._expected_world_hash = expected_world_hash
        self._ack_ticks = ack_ticks
        self._publish = publish
        self._acknowledge = acknowledge
        self._epoch_nanos: int | None = None
        self._published_to = -1
        self.tick = -1
        self.readings = 0
        self.missed_ticks = 0
        self.refused = 0

    def resume(self, ack: Ack) -> None:
        """Go on where a predecessor stopped: what it has settled is not published again."""
        self._epoch_nanos = ack.epoch_nanos
        self._published_to = ack.settled_tick
        # Others may need earlier states; what is remembered here is of the settled tick.
        self.tick = max(ack.settled_tick, 0) - 1
        if isinstance(self._model, RememberingModel):
            self._model.remember(ack.memory)
        self._acknowledge(ack)

    def take(self, state: State) -> None:
        """Feed one state; publish what it makes measurable.

        Raises
        ------
        UserError
            when physics simulates another world than this replica holds.
        """
        if state.world_hash != self._expected_world_hash:
            raise UserError(
                f"the world differs: physics has {state.world_hash[:12]}, this process has "
                f"{self._expected_world_hash[:12]}; run the same version of Groundlink on every "
                "host, and restart this sensor after the scenario was changed"
            )
        if state.epoch_nanos != self._epoch_nanos:
            self._epoch_nanos, self._published_to, self.tick = state.epoch_nanos, -1, -1
            self._model.restart()
            if isinstance(self._model, RememberingModel):
                self._model.remember(b"")
        elif state.tick <= self.tick:
            return
        elif self.tick >= 0 and state.tick != self.tick + 1:
            self.missed_ticks += state.tick - self.tick - 1
            self._model.restart()
        self.tick = state.tick
        settled_before = self._model.settled_tick()
        try:
            readings = list(self._model.readings(state))
        except BadMessage:  # a state that is well formed and lacks what is measured
            self.refused += 1
            return
        for reading in readings:
            if settled_before >= self._published_to:
                self._published_to = -1
                self._publish(reading)
                self.readings += 1
        if state.tick % self._ack_ticks == 0:
            memory = self._model.memory() if isinstance(self._model, RememberingModel) else b""
            settled = self._model.settled_tick()
            self._acknowledge(Ack(state.epoch_nanos, state.tick, settled, memory))


def run(
    spec_type: type[S],
    make_model: Callable[[Scenario, Vehicle, S], M],
    native: Callable[[M, Any], Iterable[bytes]] | None = None,
) -> None:
    """Run the process of a sensor whose data are a `spec_type` until it is asked to end.

    Parameters
    ----------
    spec_type, make_model
        What the scenario says of the sensor, and the model made of it.
    native
        From the model and a reading that it has just yielded to the datagrams that the device
        itself would send for it; none where the device's own format is not known.
    """
    kind = SENSOR_TOPICS[spec_type].name
    process.run(
        f"sensors.{kind}",
        lambda arguments, stop: _main(spec_type, make_model, native, arguments, stop),
    )


def _main(
    spec_type: type[S],
    make_model: Callable[[Scenario, Vehicle, S], M],
    native: Callable[[M, Any], Iterable[bytes]] | None,
    arguments: Sequence[str],
    stop: threading.Event,
) -> None:
    topic = SENSOR_TOPICS[spec_type]
    parser = process.parser(
        f"sensors.{topic.name}", f"Simulate a sensor of kind `{topic.name}` in a run."
    )
    parser.add_argument("--name", required=True, help="vehicle/sensor, as in rover/lidar")
    if native is not None:
        parser.add_argument(
            "--native", metavar="HOST:PORT", help="send the device's own datagrams there, too"
        )
    options = parser.parse_args(arguments)
    link = NativeLink(options.native) if native is not None and options.native else None
    endpoint = process.endpoint(options)
    with Bus(connect=endpoint) as bus:
        run_name, scenario = process.join(bus, options.run, stop)
        vehicle, spec = _find(scenario, options.name, spec_type)
        key = topic.key_in(run_name, vehicle=vehicle.name, sensor=spec.name)
        model = make_model(scenario, vehicle, spec)
        publish = bus.publisher(key, topic.delivery)

        def send(reading: Message) -> None:
            publish(reading)
            if link is not None and native is not None:
                link.send(native(model, reading))

        sensor = SensorProcess(
            model,
            expected_world_hash=world_hash(scenario),
            ack_ticks=scenario.time.window_ticks // ACKS_PER_WINDOW,
            publish=send,
            acknowledge=bus.publisher(ACK.key_in(run_name, process=options.name), ACK.delivery),
        )

        def counters() -> dict[str, int]:
            counts = {
                "readings": sensor.readings,
                "missed_ticks": sensor.missed_ticks,
                "refused": sensor.refused,
            }
            if link is not None:
                counts |= {"native": link.sent, "native_unsent": link.unsent}
            return counts

        process.follow_states(bus, run_name, options.name, sensor, counters, stop.is_set)
        if link is not None:
            link.close()


def _find(scenario: Scenario, name: str, spec_type: type[S]) -> tuple[Vehicle, S]:
    """Return the sensor called `name` if it is of the right kind."""
    found = scenario.sensor(name)
    if found is None:
        hint = nearest(name, scenario.sensor_names())
        raise UserError(f"scenario `{scenario.name}` has no sensor `{name}`; {hint}")
    vehicle, spec = found
    if not isinstance(spec, spec_type):
        right = SENSOR_TOPICS[type(spec)].name
        raise UserError(f"`{name}` is of kind `{right}`: start python -m services.sensors.{right}")
    return vehicle, spec
