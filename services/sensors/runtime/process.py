# SPDX-License-Identifier: Apache-2.0
"""Process of one sensor: join the run, build the model and follow the states.

A sensor behaves the same in its own process and in a process shared with other sensors.
"""

import socket
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from groundlink.bus.core_topics import ACK, FREQUENT_HZ, is_passed_locally
from groundlink.bus.queries import faults_key, ruts_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import FAULTS, MISSING_READINGS, sensor_outputs
from groundlink.core.errors import UserError, did_you_mean
from groundlink.core.extras import needs
from groundlink.episode.fault_messages import counted
from groundlink.messages.base import BusMessage
from groundlink.messages.missing_readings import counters_of
from groundlink.process import runner as process
from groundlink.process.joining import changed_world, join_world
from groundlink.process.memory import keep_memory
from groundlink.process.name_claim import claim_name
from groundlink.process.runner import address
from groundlink.process.state_follower import StateFollower, follow_states
from groundlink.scenario import Scenario
from groundlink.scenario.sensor_kinds import SensorKind, kind_of, load_reference
from groundlink.scene.build import world_hash
from services.sensors.faults.fault_wrapper import FaultWrapper
from services.sensors.faults.live import LiveFaults
from services.sensors.noise.random_streams import RandomStreams

from .model import (
    ModelDevice,
    NativeDevice,
    PortDevice,
    RemovedSensor,
    SensorModel,
    StreamMessage,
    stream_and_message,
)
from .reading_ledger import ReadingLedger
from .runner import SensorProcess

RUTS_SECONDS = 2.0
"""Longest wait for ruts that a sensor has missed."""


class NativeLink:
    """UDP link of one device to its destination, in the device's native format.

    Datagrams are sent when a reading is published on the bus. They are not acknowledged or
    repeated, and a missing receiver has no effect on the run.

    Raises
    ------
    UserError
        when `destination` is not a valid HOST:PORT.
    """

    def __init__(self, device: NativeDevice, destination: str) -> None:
        self._device = device
        self._host, self._port = address(destination)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        if isinstance(device, PortDevice):
            # Several devices of this machine may send from the same port.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.bind(("", device.source_port))
        self.counters = {"native": 0, "native_unsent": 0}
        """Number of datagrams sent, and of datagrams that the operating system rejected."""

    def send(self, reading: Any, epoch_nanos: int) -> None:
        """Send the datagrams of a published reading; `epoch_nanos` is the epoch of the run."""
        for payload, port in self._device.datagrams(reading, epoch_nanos):
            try:
                self._socket.sendto(payload, (self._host, port or self._port))
                self.counters["native"] += 1
            except OSError:
                self.counters["native_unsent"] += 1

    def follow(self, model: SensorModel) -> None:
        """Use another model, that of a changed world, if the device uses one."""
        if isinstance(self._device, ModelDevice):
            self._device.follow(model)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class NoLink:
    """Null object for a sensor without native output."""

    def __init__(self) -> None:
        self.counters: dict[str, int] = {}

    def send(self, reading: Any, epoch_nanos: int) -> None:
        """Ignore the reading."""

    def follow(self, model: SensorModel) -> None:
        """Do nothing; no device uses a model."""

    def close(self) -> None:
        """Do nothing; no socket is open."""


def run(kind: SensorKind) -> None:
    """Run the process of one sensor until a signal stops it."""
    process.run(f"sensors.{kind.name}", lambda arguments, stop: _main(kind, arguments, stop))


def _main(kind: SensorKind, arguments: Sequence[str], stop: threading.Event) -> None:
    parser = process.parser(
        f"sensors.{kind.name}", f"Simulate a sensor of kind `{kind.name}` in a run."
    )
    parser.add_argument("--name", required=True, help="vehicle/sensor, as in rover/lidar")
    if kind.native:
        parser.add_argument(
            "--native",
            metavar="HOST:PORT",
            help="send the device's own datagrams there, too (default: `native` of the scenario)",
        )
    options = parser.parse_args(arguments)
    with ExitStack() as opened:
        bus = opened.enter_context(Bus(connect=process.endpoint(options), name=options.name))
        run_name, scenario = join_world(bus, options.run, stop)
        right = kind_in(scenario, options.name)
        if right != kind:
            raise UserError(
                f"`{options.name}` is of kind `{right.name}`. Fix: python -m {right.package}"
            )
        native = options.native if kind.native else None
        sensor = follower(options.name, scenario, bus, run_name, opened, native=native)
        keep_memory()
        follow_states(
            bus, run_name, [sensor], stop.is_set, waited_for=scenario.time.mode != "realtime"
        )


def find_ruts(bus: Bus, run: str, digest: bytes) -> bytes:
    """Return the tiles of a run's ruts with a digest; nothing if physics does not know them."""
    replies = bus.query(ruts_key(run), digest.hex(), seconds=RUTS_SECONDS)
    return b"".join(replies.values())


def kind_in(scenario: Scenario, name: str) -> SensorKind:
    """Return the kind of the sensor named `vehicle/sensor`.

    Raises
    ------
    UserError
        when the sensor does not exist, or its kind is not installed on this machine.
    """
    found = scenario.sensor(name)
    if found is None:
        hint = did_you_mean(name, scenario.sensor_names())
        raise UserError(f"scenario `{scenario.name}` has no sensor `{name}`; {hint}")
    return kind_of(found[1])


def follower(
    name: str,
    scenario: Scenario,
    bus: Bus,
    run_name: str,
    opened: ExitStack,
    *,
    native: str | None = None,
) -> StateFollower:
    """Return the state follower of the named sensor.

    Parameters
    ----------
    opened
        Exit stack that closes the sensor's resources.
    native
        HOST:PORT for the device's own datagrams; overrides the scenario.
    """
    kind = kind_in(scenario, name)
    found = scenario.sensor(name)
    assert found is not None, "kind_in found it"
    vehicle, spec = found
    with needs(kind.extra):
        make_model = load_reference(kind.model)
    claim = claim_name(bus, run_name, name)
    model = make_model(scenario, vehicle, spec)
    link: NativeLink | NoLink = NoLink()
    if kind.native and (destination := native or getattr(spec, "native", None)):
        link = NativeLink(load_reference(kind.native)(model, spec), destination)
        opened.callback(link.close)
    # Others get states in batches, each up to 7.5 ms late.
    is_urgent = scenario.time.mode == "realtime" and spec.message_rate_hz > FREQUENT_HZ
    names = {"vehicle": vehicle.name, "sensor": spec.name}
    # All messages of the sensor use one connection, so a participant that has received the sensor's
    # progress has also received its readings. In real time nobody waits for them in this order.
    publisher = partial(bus.publisher, bulky=kind.bulky)
    publish = {
        output.name: bus.reading_publisher(
            *(output.row.key_in(run_name, **names), output.row.delivery),
            bulky=kind.bulky,
            local=is_passed_locally(
                scenario.time.mode, spec.message_rate_hz, bulky=output.row.bulky
            ),
        )
        for output in sensor_outputs(spec)
    }

    def send(reading: BusMessage | StreamMessage) -> None:
        output, message = stream_and_message(reading)
        publish[output](message)
        if not output:
            link.send(message, sensor.epoch_nanos)

    wrapped = FaultWrapper(
        model,
        faults=spec.faults,
        messages={output.name: output.row.message for output in sensor_outputs(spec)},
        streams=RandomStreams(spec.noise_seed(scenario.seed), name),
    )

    publish_missing = publisher(
        MISSING_READINGS.key_in(run_name, process=name), MISSING_READINGS.delivery
    )
    ledger = ReadingLedger(name, spec.schedule(), publish, publish_missing)

    def renew(world: str) -> bool:
        changed = changed_world(bus, run_name, world)
        if changed is None or world_hash(changed) != world:
            return False
        found = changed.sensor(name)
        if found is None:
            ledger.because("removed")
            wrapped.renew(RemovedSensor())
        elif kind.sees_world or wrapped.has_gone:
            ledger.because("world changed")
            model = make_model(changed, found[0], spec)
            wrapped.renew(model)
            link.follow(model)
        return True

    time = scenario.time
    sensor = SensorProcess(
        wrapped,
        expected_world_hash=world_hash(scenario),
        renew=renew,
        ack_ticks=time.ack_ticks,
        publish=send,
        acknowledge=publisher(ACK.key_in(run_name, process=name), ACK.delivery),
        ledger=ledger,
        reconnects=bus.reconnects,
        # No participant waits for this sensor. A state older than one window, the distance by which
        # physics runs ahead of the participants that it waits for, is obsolete.
        max_waiting_ticks=None if time.waits else time.window_ticks,
        ruts=partial(find_ruts, bus, run_name) if kind.sees_world else None,
    )
    live = LiveFaults(
        sensor,
        wrapped,
        vehicle=vehicle,
        spec=spec,
        report=publisher(FAULTS.key_in(run_name, process=name), FAULTS.delivery),
        acknowledge=sensor.report_progress,
    )
    bus.serve(faults_key(run_name, name), live.answer)

    def counters() -> dict[str, int]:
        counts = {
            "readings": sensor.readings,
            "missed_ticks": sensor.missed_ticks,
            "refused": sensor.refused,
            "worlds": sensor.worlds,
        }
        return counts | counters_of(ledger.missing) | counted(live.active) | link.counters

    return StateFollower(name, live, counters, claim, is_urgent=is_urgent)
