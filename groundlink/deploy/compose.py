# SPDX-License-Identifier: Apache-2.0
"""Compose file of a scenario: one container for each process, plus router, ROS, recorder, viewer.

`HEAD` has the settings that all containers share. They differ by a row of `_IMAGES` and their
command lines.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from groundlink.bus.topics import process_names
from groundlink.core.errors import UserError, did_you_mean
from groundlink.scenario import Scenario
from groundlink.scenario.sensor_kinds import sensor_kinds

MAIN = "main"
"""Host of the router, of physics, and of all processes without a label."""

ROUTER = "tcp/router:7447"

BRIDGE_KEY = "bridge.key"
"""File next to the folders of credentials."""

HEAD = """\
# Settings of every container: read-only, no capabilities, not root (the user of the images),
# restart after a crash, unhealthy after two failed checks of a liveness file older than 5 s.
x-process: &process
  restart: unless-stopped
  init: true
  read_only: true
  user: "${GROUNDLINK_USER:-65532:65532}"
  tmpfs: ["/tmp:size=256m,mode=1777"]
  cap_drop: [ALL]
  security_opt: ["no-new-privileges:true"]
  pids_limit: 1024
  environment:
    ALIVE_FILE: /tmp/alive
    GROUNDLINK_ROUTER: $ROUTER
  healthcheck:
    test: ["CMD-SHELL", "find /tmp/alive -newermt '5 seconds ago' | grep -q ."]
    interval: $INTERVAL
    timeout: 5s
    retries: 2
    start_period: 60s
  logging: {driver: json-file, options: {max-size: 10m, max-file: "3"}}
"""

CHECKS_HZ = 3
"""Total rate of health checks. The engine starts a process for each check, which takes 0.05 to 0.1
s of a core."""

FAST_INTERVAL = "2s"
"""Check interval of containers that others depend on."""

_HEALTHCHECK = yaml.safe_load(HEAD)["x-process"]["healthcheck"]


class _Row(NamedTuple):
    """Settings of all containers of an image."""

    memory: str
    networks: tuple[str, ...] = ("bus",)


_IMAGES = {
    "router": _Row("256m"),
    "physics": _Row("1g"),
    "sensor": _Row("768m"),
    "camera": _Row("1g"),
    "gateway": _Row("512m", ("bus", "ros")),
    "ros2": _Row("512m", ("ros",)),
    "recorder": _Row("512m"),
    "viewer": _Row("2g"),
}

Service = dict[str, Any]


class Deployment:
    """A scenario on one host or several.

    Parameters
    ----------
    file
        file of the scenario; physics reads its folder.
    sources
        build context of the images.
    router
        endpoint of the router for processes on other hosts.
    overload
        default of the environment variable; None: as in the scenario.
    """

    def __init__(
        self,
        scenario: Scenario,
        file: Path,
        *,
        sources: str,
        router: str | None = None,
        overload: str | None = None,
    ) -> None:
        self._scenario, self._file, self._sources, self._router = scenario, file, sources, router
        self._overload = overload or scenario.time.overload

    def hosts(self) -> list[str]:
        """Return the labels of all hosts, the main one first."""
        sensors = (sensor for vehicle in self._scenario.vehicles for sensor in vehicle.sensors)
        return [MAIN, *sorted({sensor.host for sensor in sensors} - {MAIN})]

    def compose(self, host: str = MAIN) -> str:
        """Return the Compose file of one host.

        Raises
        ------
        UserError
            if the scenario has no such host, or the router is unknown.
        """
        router = self._router_of(host)
        services = dict(self._services(host))
        used = {network for service in services.values() for network in service["networks"]}
        rest: dict[str, Any] = {"networks": {network: {} for network in sorted(used)}}
        if host == MAIN:
            rest["volumes"] = {"recordings": {}}
        head = HEAD.replace("$ROUTER", router)
        head = head.replace("$INTERVAL", f"{max(2, math.ceil(len(services) / CHECKS_HZ))}s")
        blocks = [f"name: groundlink\n\n{head}", "services:"]
        blocks += [_indented(name, service) for name, service in services.items()]
        return "\n".join([*blocks, yaml.safe_dump(rest, sort_keys=False)])

    def secured(self, folder: str, host: str = MAIN) -> str:
        """Return the override file of a secured run; errors are those of `compose`.

        `folder` is the folder of credentials, as the file names it.
        """
        services: dict[str, Any] = {}
        router = self._router_of(host).replace("tcp/", "tls/")
        for name, service in self._services(host):
            image = service["image"].removeprefix("groundlink-")
            fields: dict[str, Any] = {"environment": {}, "volumes": []}
            if "bus" in service["networks"]:
                fields["environment"] = {
                    "GROUNDLINK_ROUTER": router,
                    "GROUNDLINK_CREDENTIALS": "/run/credentials",
                }
                fields["volumes"] += [f"{folder}/{name}:/run/credentials:ro"]
            if image == "router":
                fields["command"] = [word.replace("tcp/", "tls/") for word in service["command"]]
            if "ros" in service["networks"]:
                fields["command"] = [*service["command"], "--key-file", "/run/bridge.key"]
                fields["volumes"] += [f"{folder}/{BRIDGE_KEY}:/run/bridge.key:ro"]
            services[name] = {field: value for field, value in fields.items() if value}
        return yaml.safe_dump({"services": services}, sort_keys=False)

    def _router_of(self, host: str) -> str:
        """Return the endpoint of the router as seen from a host."""
        if host not in self.hosts():
            raise UserError(f"no sensor has `host: {host}`; {did_you_mean(host, self.hosts())}")
        if host == MAIN:
            return ROUTER
        if self._router is None:
            raise UserError(
                f"--host {host}: expected --router ENDPOINT as well, the router as seen from that "
                "host, such as tcp/sim.example:7447"
            )
        return self._router

    def _services(self, host: str) -> Iterator[tuple[str, Service]]:
        if host == MAIN:
            yield "router", self._router_service()
        for process, module in process_names(self._scenario).items():
            if self._host_of(process) == host:
                yield process.replace("/", "-"), self._process(process, module, host)
        if host == MAIN:
            yield from self._companions()

    def _host_of(self, process: str) -> str:
        found = self._scenario.sensor(process)
        return MAIN if found is None else found[1].host

    def _process(self, process: str, module: str, host: str) -> Service:
        """Return the service of a process of the run."""
        image = _image_of(process, module)
        command = {
            "physics": [
                f"/scenario/${{GROUNDLINK_SCENARIO:-{self._file.name}}}",
                *("--overload", f"${{GROUNDLINK_OVERLOAD:-{self._overload}}}"),
            ],
            "gateway": ["--bind", "0.0.0.0:7510", "--peer", "${GROUNDLINK_ROS:-ros2:7511}"],
        }.get(process, [module, "--name", process])
        service = self._of(image, command)
        if process == "physics":
            service["volumes"] = [f"{self._file.parent}:/scenario:ro"]
            service["healthcheck"] = _HEALTHCHECK | {"interval": FAST_INTERVAL}
        if host == MAIN:
            needed = "router" if process == "physics" else "physics"
            service["depends_on"] = {needed: {"condition": "service_healthy"}}
        return service

    def _of(self, image: str, command: list[str]) -> Service:
        row = _IMAGES[image]
        return {
            "image": f"groundlink-{image}",
            "build": {
                "context": self._sources,
                "dockerfile": f"deploy/images/{image}.Dockerfile",
            },
            "mem_limit": row.memory,
            "networks": list(row.networks),
            "command": command,
        }

    def _router_service(self) -> Service:
        listens = ["CMD", "bash", "-c", "</dev/tcp/127.0.0.1/7447"]
        return self._of("router", ["services.router", "--listen", "tcp/0.0.0.0:7447"]) | {
            "ports": ["${GROUNDLINK_PUBLISH:-127.0.0.1}:7447:7447"],
            "healthcheck": _HEALTHCHECK | {"test": listens, "interval": FAST_INTERVAL},
        }

    def _companions(self) -> Iterator[tuple[str, Service]]:
        """Yield ROS, and the recorder and viewer of their profiles."""
        yield (
            "ros2",
            # The port is not published; only the network `ros` reaches it.
            self._of("ros2", ["--bind", "0.0.0.0:7511", "--allow-any-peer"])
            | {
                "environment": {
                    "ALIVE_FILE": "/tmp/alive",
                    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
                },
                "shm_size": "512m",
            },
        )
        yield (
            "recorder",
            self._of("recorder", ["--out", "/recordings/run.mcap"])
            | {"profiles": ["record"], "volumes": ["recordings:/recordings"]},
        )
        yield (
            "view",
            self._of("viewer", ["--web", "--host", "0.0.0.0"])
            | {"profiles": ["view"], "ports": ["127.0.0.1:9090:9090", "127.0.0.1:9876:9876"]},
        )


def _image_of(process: str, module: str) -> str:
    """Return the image of a process."""
    kind = module.rpartition(".")[2]
    if kind == "driver":
        return "router"
    if "/" in process:
        cameras = {k.package for k in sensor_kinds().values() if k.extra == "camera"}
        return "camera" if module in cameras else "sensor"
    return kind


def _indented(name: str, service: Service) -> str:
    text = yaml.safe_dump(service, sort_keys=False, default_flow_style=None, width=110)
    lines = ["  <<: *process", *(f"  {line}" for line in text.splitlines())]
    return "\n".join([f"  {name}:", *(f"  {line}" for line in lines), ""])
