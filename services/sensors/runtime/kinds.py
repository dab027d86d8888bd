# SPDX-License-Identifier: Apache-2.0
"""From a kind of sensor to the process of one of its sensors, and what follows the states for it.

Rule: what tells kinds apart is in their `Kind`, which each has in its `__main__`. Where a sensor
runs, in a process of its own or beside others, changes nothing of what it does.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from groundlink.bus.core_topics import ACK
from groundlink.bus.queries import faults_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import FAULTS, GAPS, SENSOR_TOPICS, sensor_outputs
from groundlink.core.errors import UserError, nearest
from groundlink.messages.base import Message
from groundlink.messages.faults import counted
from groundlink.messages.missing_readings import counters_of
from groundlink.messages.reading_schedule import calendar
from groundlink.process import runner as process
from groundlink.process.joining import changed_world, join_world
from groundlink.process.name_claim import claim_name
from groundlink.process.state_follower import StateFollower, follow_states
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.sensors import Sensor, WithNative
from groundlink.world.build import world_hash
from services.sensors.faults.fault_wrapper import FaultyModel
from services.sensors.faults.live import LiveFaults
from services.sensors.noise.random_streams import RandomStreams

from .model import Beside, Gone, NativeDevice, SensorModel, parted
from .native import NativeLink, NoLink
from .reading_ledger import Account
from .runner import SensorProcess

S = TypeVar("S", bound=Sensor)
M = TypeVar("M", bound=SensorModel)


@dataclass(frozen=True)
class Kind(Generic[S, M]):
    """What a kind of sensor is to its process."""

    spec_type: type[S]
    """What the scenario says of a sensor of this kind."""

    make_model: Callable[[Scenario, Vehicle, S], M]
    native: Callable[[M, S], NativeDevice] | None = None
    """Makes the device of a model, where the device's own form is known."""

    sees_world: bool = False
    """Whether the model has a copy of the world, and so is made anew when that changes."""

    @property
    def name(self) -> str:
        """Return what scenarios call it."""
        return SENSOR_TOPICS[self.spec_type].name


def run(kind: Kind[Any, Any]) -> None:
    """Run the process of one sensor until it is asked to end."""
    process.run(f"sensors.{kind.name}", lambda arguments, stop: _main(kind, arguments, stop))


def _main(kind: Kind[Any, Any], arguments: Sequence[str], stop: threading.Event) -> None:
    parser = process.parser(
        f"sensors.{kind.name}", f"Simulate a sensor of kind `{kind.name}` in a run."
    )
    parser.add_argument("--name", required=True, help="vehicle/sensor, as in rover/lidar")
    if kind.native is not None:
        parser.add_argument(
            "--native",
            metavar="HOST:PORT",
            help="send the device's own datagrams there, too (default: `native` of the scenario)",
        )
    options = parser.parse_args(arguments)
    with ExitStack() as opened:
        bus = opened.enter_context(Bus(connect=process.endpoint(options), name=options.name))
        run_name, scenario = join_world(bus, options.run, stop)
        right = kind_name(scenario, options.name)
        if right != kind.name:
            raise UserError(
                f"`{options.name}` is of kind `{right}`: start python -m services.sensors.{right}"
            )
        native = options.native if kind.native is not None else None
        sensor = follower(kind, options.name, scenario, bus, run_name, opened, native=native)
        follow_states(
            bus, run_name, [sensor], stop.is_set, waited_for=scenario.time.mode != "realtime"
        )


def kind_name(scenario: Scenario, name: str) -> str:
    """Return the kind of the sensor that is called `vehicle/sensor`.

    Raises
    ------
    UserError
        when there is none.
    """
    found = scenario.sensor(name)
    if found is None:
        hint = nearest(name, scenario.sensor_names())
        raise UserError(f"scenario `{scenario.name}` has no sensor `{name}`; {hint}")
    return SENSOR_TOPICS[type(found[1])].name


def follower(
    kind: Kind[S, M],
    name: str,
    scenario: Scenario,
    bus: Bus,
    run_name: str,
    opened: ExitStack,
    *,
    native: str | None = None,
) -> StateFollower:
    """Return what follows a run's states for the sensor of this kind and name.

    Parameters
    ----------
    opened
        closes what the sensor opens.
    native
        HOST:PORT for the device's own datagrams, instead of the scenario's.
    """
    found = scenario.sensor(name)
    assert found is not None, "who asks has found it"
    vehicle, spec = found
    assert isinstance(spec, kind.spec_type)
    claim = claim_name(bus, run_name, name)
    model = kind.make_model(scenario, vehicle, spec)
    link: NativeLink | NoLink = NoLink()
    if kind.native is not None and isinstance(spec, WithNative):
        if destination := native or spec.native:
            link = NativeLink(kind.native(model, spec), destination)
            opened.callback(link.close)
    names = {"vehicle": vehicle.name, "sensor": spec.name}
    # All that it says takes the way of its readings: who hears how far it has come has them.
    publisher = partial(bus.publisher, bulky=SENSOR_TOPICS[type(spec)].bulky)
    publish = {
        output.name: publisher(output.row.key_in(run_name, **names), output.row.delivery)
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
        streams=RandomStreams(scenario.seed, name),
    )

    tell_gaps = publisher(GAPS.key_in(run_name, process=name), GAPS.delivery)
    account = Account(name, calendar(spec), publish, tell_gaps)

    def renew(world: str) -> bool:
        changed = changed_world(bus, run_name, world)
        if changed is None or world_hash(changed) != world:
            return False
        found = changed.sensor(name)
        if found is None:
            account.because("removed")
            faulty.renew(Gone())
        elif kind.sees_world or faulty.has_gone:
            account.because("world changed")
            faulty.renew(kind.make_model(changed, found[0], spec))
        return True

    time = scenario.time
    sensor = SensorProcess(
        faulty,
        expected_world_hash=world_hash(scenario),
        renew=renew,
        ack_ticks=time.ack_ticks,
        publish=send,
        acknowledge=publisher(ACK.key_in(run_name, process=name), ACK.delivery),
        account=account,
        links_made=bus.links_made,
        # Nobody waits for it: what is a window late, which is as far as physics goes ahead of those
        # that it does wait for, has lost its worth.
        patience_ticks=None if time.waits else time.window_ticks,
    )
    live = LiveFaults(
        sensor,
        faulty,
        vehicle=vehicle,
        spec=spec,
        report=publisher(FAULTS.key_in(run_name, process=name), FAULTS.delivery),
        acknowledge=sensor.tell_progress,
    )
    bus.serve(faults_key(run_name, name), live.answer)

    def counters() -> dict[str, int]:
        counts = {
            "readings": sensor.readings,
            "missed_ticks": sensor.missed_ticks,
            "refused": sensor.refused,
            "worlds": sensor.worlds,
        }
        return counts | counters_of(account.missing) | counted(live.active) | link.counters

    return StateFollower(name, live, counters, claim)
