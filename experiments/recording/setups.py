# SPDX-License-Identifier: Apache-2.0
"""Setups: a shipped scenario with the changes of an experiment."""

import copy
import hashlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import yaml

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.scenario import Scenario

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = ROOT / "scenarios"
SOURCES = ("groundlink", "services", "udp-bridge/src", "ros/ros2")
"""Sources that determine a recording, besides its scenario."""

TRUTH_HZ = 50.0
"""How often the true pose goes along. Between two of them a vehicle moves nearly evenly: where it
brakes by 1 m/s2, what is interpolated is wrong by a dt^2 / 8 = 0.05 mm."""

CLOCK_HZ = 20.0
"""Of `/clock`, and so how often time waits for ROS. The bridge's node keeps 200 small and 5 large
messages of a topic, which is more than come in between."""

IN_LOCKSTEP: dict[str, Any] = {
    "mode": "fast",
    "lockstep": "ros",
    "epoch": "zero",
    "clock_rate_hz": CLOCK_HZ,
    "answers": {"/recorded": "/clock"},
}
"""Lossless on any machine: each clock waits for the bag's acknowledgement of the last."""

IN_REAL_TIME: dict[str, Any] = {"mode": "realtime", "epoch": "zero", "clock_rate_hz": CLOCK_HZ}
"""As the paper ran it. What the link loses is lost, but for what `repair` gets back."""

CRAWL_MPS = 0.05
"""The slowest that a driver drives."""

Changes = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A run to be recorded on the ROS side."""

    name: str
    """Of the folder; letters, digits and underscores."""

    scenario: str
    """A shipped one, such as `indoor_paper`."""

    seconds: float
    """Of sim time."""

    seed: int = 1
    sensors: Mapping[str, Changes | None] = field(default_factory=dict)
    """By name, of the first vehicle: fields that are other, or None to leave a sensor out. One
    that the scenario lacks is added, with all of its fields. `"*"` is all that the scenario has."""

    vehicle: Changes = field(default_factory=dict)
    """Fields of the first vehicle that are other, such as `placement` and `route`."""

    top: Changes = field(default_factory=dict)
    """Fields of the scenario that are other, such as `world` and `bodies`."""

    link: Changes | None = None
    """`gateway.link`: what happens to datagrams on purpose."""

    repair: Any = None
    """How what the link loses is made good, of every sensor: `none`, `{resend: 0.5}` ..."""

    time: Changes = field(default_factory=lambda: IN_LOCKSTEP)

    @property
    def is_lossless(self) -> bool:
        """Whether the run waits for ROS, so that the bag must be complete."""
        return self.time.get("lockstep") == "ros"

    def varied(self, vary: Mapping[str, Changes]) -> "Setup":
        """Return the setup with changed fields of sensors.

        Raises
        ------
        UserError
            when it has no such sensor.
        """
        names = [sensor["name"] for sensor in self.document()["vehicles"][0]["sensors"]]
        if strange := [name for name in vary if name not in names]:
            raise UserError(
                f"{self.name}: unknown sensor {strange[0]}; expected one of {', '.join(names)}"
            )
        sensors = dict(self.sensors)
        for name, changes in vary.items():
            sensors[name] = {**(sensors.get(name) or {}), **changes}
        return replace(self, sensors=sensors)

    def document(self) -> dict[str, Any]:
        """Return the scenario as a file would have it, without addresses."""
        document = shipped(self.scenario)
        document |= {"name": self.name, "seed": self.seed, "time": dict(self.time)}
        document |= copy.deepcopy(dict(self.top))
        if self.link is not None:
            document.setdefault("gateway", {})["link"] = dict(self.link)
        vehicle = document["vehicles"][0]
        vehicle |= copy.deepcopy(dict(self.vehicle))
        vehicle["ground_truth"] = {"push": True, "rate_hz": TRUTH_HZ}
        vehicle["sensors"] = self._sensors(vehicle["sensors"])
        return document

    def _sensors(self, shipped: list[dict[str, Any]]) -> list[dict[str, Any]]:
        sensors = {sensor["name"]: dict(sensor) for sensor in shipped}
        for name in sensors if "*" in self.sensors else ():
            sensors[name] |= self.sensors["*"] or {}
        for name, changes in self.sensors.items():
            if changes is None:
                del sensors[name]
            elif name != "*":
                sensors[name] = sensors.get(name, {"name": name}) | copy.deepcopy(dict(changes))
        if self.repair is not None:
            for sensor in sensors.values():
                sensor["repair"] = self.repair
        return list(sensors.values())

    def write(self, folder: Path, gateway: Mapping[str, str] | None = None) -> Path:
        """Write the scenario's file, with the gateway's addresses; return where it is."""
        document = self.document()
        if gateway:
            document["gateway"] = document.get("gateway", {}) | dict(gateway)
        file = folder / "scenario.yaml"
        file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
        return file

    def digest(self) -> str:
        """Return the digest of the resolved scenario, the duration and the sources."""
        with tempfile.TemporaryDirectory() as folder:
            scenario = load(self.write(Path(folder)))
        told = msgspec.json.encode([scenario, self.seconds, sources_digest()], order="sorted")
        return hashlib.blake2b(told, digest_size=6).hexdigest()


def shipped(scenario: str) -> dict[str, Any]:
    """Return a shipped scenario as its file has it."""
    text = (SCENARIOS / f"{scenario}.yaml").read_text(encoding="utf-8")
    document: dict[str, Any] = yaml.safe_load(text)
    return document


def waypoints(
    placement: Mapping[str, float],
    points: Sequence[Mapping[str, float]],
    speed_mps: float,
    crawl_m: float,
) -> dict[str, Any]:
    """Return a route that begins at a crawl, in which the vehicle comes to rest on its springs.

    On a slope a run begins with the vehicle just above the ground. A program that takes its first
    readings for those of rest would take the fall for a part of gravity.
    """
    yaw = math.radians(placement["yaw_deg"])
    crawl = {
        "x_m": placement["x_m"] + crawl_m * math.cos(yaw),
        "y_m": placement["y_m"] + crawl_m * math.sin(yaw),
        "speed_mps": CRAWL_MPS,
    }
    points = [crawl, *map(dict, points)]
    return {"kind": "waypoints", "speed_mps": speed_mps, "points": points}


def sources_digest() -> str:
    """Return a digest of the simulator's sources."""
    digest = hashlib.blake2b(digest_size=8)
    for folder in SOURCES:
        for file in sorted((ROOT / folder).rglob("*")):
            if file.suffix in {".py", ".c", ".h"}:
                digest.update(file.read_bytes())
    return digest.hexdigest()


def loaded(folder: Path) -> Scenario:
    """Return the scenario of a recording's folder, resolved."""
    return load(folder / "scenario.yaml")
