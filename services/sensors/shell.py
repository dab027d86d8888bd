# SPDX-License-Identifier: Apache-2.0
"""The process around a sensor model: joins a run, feeds states in order, publishes readings.

Rule: everything that is not the sensor. A model is restarted after every gap in ticks, and readings
that a predecessor has already published are not published again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TypeVar

from groundlink import process
from groundlink.bus import Bus
from groundlink.errors import UserError
from groundlink.faults import counted
from groundlink.messages import Ack, BadMessage, Message, State
from groundlink.questions import faults_key
from groundlink.scenario import Scenario
from groundlink.scenario.explain import nearest
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.sensors import Sensor, WithNative
from groundlink.topics import ACK, FAULTS, SENSOR_TOPICS, sensor_outputs
from groundlink.world.build import world_hash

from .faulty import FaultyModel
from .live_faults import LiveFaults
from .model import Beside, Gone, NativeDevice, RememberingModel, SensorModel, SkippingModel, parted
from .native import NativeLink, NoLink
from .streams import RandomStreams

ACKS_PER_WINDOW = 8
"""How often progress is told while physics gets as far ahead as it may."""

S = TypeVar("S", bound=Sensor)
M = TypeVar("M", bound=SensorModel)


def _never(world: str) -> bool:
    """Know of no other world."""
    return False


class SensorProcess:
    """A model between the states of a run and its readings.

    Parameters
    ----------
    expected_world_hash
        Of the world that the model was made for.
    renew
        Makes the model one for the world of another hash; False where there is none.
    """

    def __init__(
        self,
        model: SensorModel,
        *,
        expected_world_hash: str,
        renew: Callable[[str], object] = _never,
        ack_ticks: int,
        publish: Callable[[Message | Beside], object],
        acknowledge: Callable[[Ack], object],
    ) -> None:
        self._model = model
        self._expected_world_hash, self._renew = expected_world_hash, renew
        self.worlds = 1
        self._ack_ticks = ack_ticks
        self._publish = publish
        self._acknowledge = acknowledge
        self.epoch_nanos = 0
        self._life: int | None = None
        self._published_to = -1
        self.tick = -1
        self.readings = 0
        self.missed_ticks = 0
        self.refused = 0

    def resume(self, ack: Ack) -> None:
        """Go on where a predecessor stopped: what it has settled is not published again."""
        self._life = ack.life
        self._published_to = ack.settled_tick
        # Others may need earlier states; what is remembered here is of the settled tick.
        self.tick = max(ack.settled_tick, 0) - 1
        if isinstance(self._model, RememberingModel):
            self._model.remember(ack.memory)
        self._acknowledge(ack)

    def take(self, state: State, waiting: int = 0) -> None:
        """Feed one state; publish what it makes measurable. So many more have arrived by now.

        Raises
        ------
        UserError
            when physics simulates another world than this replica holds.
        """
        if state.world_hash != self._expected_world_hash:
            if not self._renew(state.world_hash):
                raise UserError(
                    f"the world differs: physics has {state.world_hash[:12]}, this process has "
                    f"{self._expected_world_hash[:12]}; run the same version of Groundlink on "
                    "every host, and restart this sensor after the scenario was changed"
                )
            self._expected_world_hash = state.world_hash
            self.worlds += 1
        self.epoch_nanos = state.epoch_nanos
        if state.life != self._life:
            self._life, self._published_to, self.tick = state.life, -1, -1
            self._model.restart()
            if isinstance(self._model, RememberingModel):
                self._model.remember(b"")
        elif state.tick <= self.tick:
            return
        elif self.tick >= 0 and state.tick != self.tick + 1:
            self.missed_ticks += state.tick - self.tick - 1
            self._model.restart()
        self.tick = state.tick
        if isinstance(self._model, SkippingModel):
            self._model.behind(waiting)
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
            self.tell_progress()

    def tell_progress(self) -> None:
        """Acknowledge the last state, with what a successor has to know."""
        assert self._life is not None, "no state was taken"
        memory = self._model.memory() if isinstance(self._model, RememberingModel) else b""
        settled = self._model.settled_tick()
        self._acknowledge(Ack(self._life, self.tick, settled, memory))


def run(
    spec_type: type[S],
    make_model: Callable[[Scenario, Vehicle, S], M],
    native: Callable[[M, S], NativeDevice] | None = None,
    *,
    sees_world: bool = False,
) -> None:
    """Run the process of a sensor whose data are a `spec_type` until it is asked to end.

    Parameters
    ----------
    spec_type, make_model
        What the scenario says of the sensor, and the model made of it.
    native
        Makes the device of a model, where the device's own form is known.
    sees_world
        Whether the model has a copy of the world, and so is made anew when that changes.
    """
    kind = SENSOR_TOPICS[spec_type].name
    process.run(
        f"sensors.{kind}",
        lambda arguments, stop: _main(spec_type, make_model, native, sees_world, arguments, stop),
    )


def _main(
    spec_type: type[S],
    make_model: Callable[[Scenario, Vehicle, S], M],
    native: Callable[[M, S], NativeDevice] | None,
    sees_world: bool,
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
            "--native",
            metavar="HOST:PORT",
            help="send the device's own datagrams there, too (default: `native` of the scenario)",
        )
    options = parser.parse_args(arguments)
    endpoint = process.endpoint(options)
    with Bus(connect=endpoint, name=options.name) as bus:
        run_name, scenario = process.join_world(bus, options.run, stop)
        vehicle, spec = _find(scenario, options.name, spec_type)
        process.alone(bus, run_name, options.name)
        model = make_model(scenario, vehicle, spec)
        link: NativeLink | NoLink = NoLink()
        if native is not None and isinstance(spec, WithNative):
            if destination := options.native or spec.native:
                link = NativeLink(native(model, spec), destination)
        names = {"vehicle": vehicle.name, "sensor": spec.name}
        publish = {
            output.name: bus.publisher(output.row.key_in(run_name, **names), output.row.delivery)
            for output in sensor_outputs(spec)
        }

        def send(reading: Message | Beside) -> None:
            output, message = parted(reading)
            publish[output](message)
            if not output:
                link.send(message, sensor.epoch_nanos)

        faulty = FaultyModel(
            model,
            faults=spec.faults,
            messages={output.name: output.row.message for output in sensor_outputs(spec)},
            streams=RandomStreams(scenario.seed, options.name),
        )

        def renew(world: str) -> bool:
            changed = process.changed_world(bus, run_name, world)
            if changed is None or world_hash(changed) != world:
                return False
            found = changed.sensor(options.name)
            if found is None:
                faulty.renew(Gone())
            elif sees_world or faulty.has_gone:
                faulty.renew(make_model(changed, found[0], spec))
            return True

        sensor = SensorProcess(
            faulty,
            expected_world_hash=world_hash(scenario),
            renew=renew,
            ack_ticks=scenario.time.window_ticks // ACKS_PER_WINDOW,
            publish=send,
            acknowledge=bus.publisher(ACK.key_in(run_name, process=options.name), ACK.delivery),
        )

        live = LiveFaults(
            sensor,
            faulty,
            vehicle=vehicle,
            spec=spec,
            report=bus.publisher(FAULTS.key_in(run_name, process=options.name), FAULTS.delivery),
            acknowledge=sensor.tell_progress,
        )
        bus.serve(faults_key(run_name, options.name), live.answer)

        def counters() -> dict[str, int]:
            counts = {
                "readings": sensor.readings,
                "missed_ticks": sensor.missed_ticks,
                "refused": sensor.refused,
                "worlds": sensor.worlds,
            }
            if isinstance(model, SkippingModel):
                counts["skipped"] = faulty.skipped
            return counts | counted(live.active) | link.counters

        process.follow_states(bus, run_name, options.name, live, counters, stop.is_set)
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
