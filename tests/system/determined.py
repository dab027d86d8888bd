# SPDX-License-Identifier: Apache-2.0
"""Run with every kind of sensor and an autopilot, and a recorder of every published byte.

`python -m tests.system.determined FOLDER ENDPOINT` runs it without its LiDAR, which joins from
another machine, and writes the received messages.
"""

import hashlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import process_names, sensor_outputs
from groundlink.core.clock import NANOS
from groundlink.loader import load
from groundlink.messages.base import BusMessage, M, decode, measured_nanos

from .rig import Rig, rig, wait_for

SECONDS = 5
UNTIL_NANOS = SECONDS * NANOS
RUN = "every_sensor"
HEARD = "heard.json"
TIMEOUT_SECONDS = 100.0

SCENARIO = Path(__file__).with_name("every_sensor.yaml")

Heard = dict[str, list[tuple[int, str]]]
"""By stream: the instant and the sha256 of each body before `UNTIL_NANOS`, in order."""


class _Stream(BusInbox[BusMessage]):
    """Hashes what arrives at once, on the transport's thread."""

    def __init__(self) -> None:
        super().__init__(depth=1)
        self.reached_nanos = -1
        self.heard: list[tuple[int, str]] = []

    def put(self, key: str, payload: bytes, message_type: type[M]) -> None:
        nanos = measured_nanos(decode(payload, message_type))
        if nanos <= self.reached_nanos:
            return  # a successor repeats what its predecessor had not acknowledged
        self.reached_nanos = nanos
        if nanos < UNTIL_NANOS:
            self.heard.append((nanos, hashlib.sha256(payload).hexdigest()))


class Witness:
    """Hears every stream of every sensor."""

    def __init__(self, bus: Bus, scenario: Path) -> None:
        self._streams: dict[str, _Stream] = {}
        for vehicle in load(str(scenario)).vehicles:
            for spec in vehicle.sensors:
                for output in sensor_outputs(spec):
                    key = output.row.key_in(RUN, vehicle=vehicle.name, sensor=spec.name)
                    stream = self._streams[key] = _Stream()
                    bus.subscribe(key, output.row.message, stream)

    @property
    def reached_nanos(self) -> int:
        """The instant that every stream has come to."""
        return min(stream.reached_nanos for stream in self._streams.values())

    def wait(self, until_nanos: int = UNTIL_NANOS) -> None:
        """Wait until every stream has come to an instant."""
        what = f"every stream comes to {until_nanos / 1e9:g} s"
        wait_for(lambda: self.reached_nanos >= until_nanos, TIMEOUT_SECONDS, what)

    def heard(self) -> Heard:
        """Return what every stream brought until its end."""
        self.wait()
        return self.so_far()

    def so_far(self) -> Heard:
        """Return what every stream has brought by now."""
        return {key: list(stream.heard) for key, stream in self._streams.items()}


def difference(heard: Heard, expected: Heard) -> str | None:
    """Return the first difference of two runs, or None."""
    if heard.keys() != expected.keys():
        return f"streams differ: {sorted(heard.keys() ^ expected.keys())}"
    found = []
    for key, bodies in heard.items():
        others = expected[key]
        pairs = zip(bodies, others, strict=False)
        first = next((i for i, (one, other) in enumerate(pairs) if one != other), None)
        if first is not None:
            nanos = min(bodies[first][0], others[first][0])
            found.append((nanos, f"{key}: body {first}, at {nanos / 1e9} s"))
        elif len(bodies) != len(others):
            found.append((UNTIL_NANOS, f"{key}: {len(bodies)} bodies, expected {len(others)}"))
    return min(found)[1] if found else None


class Run:
    """The run on a bus of its own whose router is here; nothing of it has been started yet."""

    def __init__(self, it: Rig, time: str) -> None:
        self.rig = it
        gateway = f"{{bind: {it.address(it.bind)}, peer: {it.address(it.peer)}}}"
        more = f"gateway: {gateway}\ntime: {{epoch: zero, {time}}}\n"
        it.scenario.write_text(SCENARIO.read_text(encoding="utf-8") + more, encoding="utf-8")
        self.bus = Bus(listen=it.endpoint)
        self.witness = Witness(self.bus, it.scenario)
        self._modules = process_names(load(str(it.scenario)))
        self.names = [name for name in self._modules if name != "gateway"]
        """Physics, the sensors and the driver."""

        self.pids: dict[str, int] = {}

    def start(self, *names: str) -> None:
        """Start processes of the run, each with what it needs to know."""
        for name in names:
            own = (str(self.rig.scenario),) if name == "physics" else ()
            named = ("--name", name) if "/" in name else ()
            self.start_module(name, self._modules[name], *own, *named)

    def start_module(self, name: str, module: str, *arguments: str) -> None:
        """Start one process that joins the run."""
        join = ("--connect", self.rig.endpoint, "--run", RUN)
        log = f"{name.replace('/', '_')}.log"
        self.pids[name] = self.rig.start("-m", module, *arguments, *join, log=log).pid

    def close(self) -> None:
        """Leave the bus; what was started ends with the rig."""
        self.bus.close()


@contextmanager
def run(folder: Path, time: str = "mode: fast", *, endpoint: str = "") -> Iterator[Run]:
    """Make the run ready."""
    with rig(folder) as it:
        it.endpoint = endpoint or it.endpoint
        ready = Run(it, time)
        try:
            yield ready
        finally:
            it.stop()
            ready.close()


def main(folder: str, endpoint: str) -> None:
    """Run with all but the LiDAR here, for one that joins from elsewhere."""
    with run(Path(folder), endpoint=endpoint) as here:
        here.start(*(name for name in here.names if name != "rover/lidar"))
        heard = here.witness.heard()
    Path(folder, HEARD).write_bytes(msgspec.json.encode(heard))


if __name__ == "__main__":
    main(*sys.argv[1:])
