# SPDX-License-Identifier: Apache-2.0
"""Registry of sensor kinds.

A kind is one folder (or one distribution of its own) with a `SensorKind`. Installed kinds are found
through the entry-point group `groundlink.sensors`. Topics, schemas, processes, access rules, codecs
and drawings are derived from this registry.
"""

import os
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, Union

from groundlink.core.errors import UserError
from groundlink.messages.base import BusMessage

from .every_sensor import SensorSpec, UnknownSensor

GROUP = "groundlink.sensors"
"""Entry-point group. An entry's name is the kind; its object is a `SensorKind`."""

OWN_DISTRIBUTION = "groundlink"


@dataclass(frozen=True, kw_only=True)
class MessageSupport:
    """Parts that Groundlink needs to handle a message type that a kind defines.

    Both are `module:object` references. Only the processes that need them import them.
    """

    codec: str
    """A `groundlink.ros.codec.Codec`: ROS type, encoding and decoding."""

    drawing: str = ""
    """Function that draws the message in the viewer (`services.view.draw_messages.Form`)."""


class Problem(NamedTuple):
    """Mistake in a scenario that a kind found in one of its sensors."""

    path: tuple[str | int, ...]
    """Field of the sensor; empty for the sensor as a whole."""

    text: str


@dataclass(frozen=True, kw_only=True)
class SensorKind:
    """One kind of sensor: its specification, its streams and the reference to its model.

    Models and all that they import are `module:object` references. Only the sensor's own process
    imports them. The package that holds the model must run as `python -m <package>`.
    """

    spec: type[SensorSpec]
    """Struct with the fields of a scenario. Its tag is the name of the kind."""

    streams: Mapping[str, type[BusMessage]]
    """BusMessage type of each stream; the main stream has the empty name."""

    model: str
    """Factory of the model: a callable `(scenario, vehicle, spec) -> SensorModel`."""

    check: str = ""
    """Callable `(spec, vehicle, scenario) -> Iterable[Problem]` for checks that types cannot state.
    """

    native: str = ""
    """Callable `(model, spec) -> NativeDevice`, if the device's own datagrams are implemented."""

    extra: str = ""
    """Extra of Groundlink that installs the libraries of the model."""

    sees_world: bool = False
    """Whether the model has a copy of the world. It is built again after a change of the world."""

    light: bool = False
    """Whether the model takes so little time for a state that it shares a process with others."""

    bulky: bool = False
    """Whether messages are so large that small messages must not wait behind them."""

    streamable: bool = True
    """Whether other processes may publish the main stream (`vehicles.streams` in a scenario)."""

    messages: Mapping[type[BusMessage], MessageSupport] = field(default_factory=dict)
    """BusMessage types that the kind defines."""

    disturb: Mapping[str, str] = field(default_factory=dict)
    """For each quantity of the specification, a callable `(reading, offsets) -> reading` that
    applies a fault. A quantity with a `field` needs none."""

    cover: str = ""
    """Callable `(reading, begin_rad, width_rad) -> reading` that applies the fault
    `occluded_sector`."""

    @property
    def name(self) -> str:
        """Name of the kind in scenarios and on the bus."""
        return str(self.spec.__struct_config__.tag)

    @property
    def package(self) -> str:
        """Package that runs as the process of one sensor of this kind."""
        return self.model.partition(":")[0].rpartition(".")[0]


_METADATA_FILES = {".dist-info": "METADATA", ".egg-info": "PKG-INFO"}
"""File with the name of a distribution, by the ending of its metadata folder."""


class InstalledEntry(NamedTuple):
    """Entry point of an installed distribution."""

    name: str
    value: str
    """Reference to an object, such as `module:object`."""

    distribution: str
    """Name of the distribution."""


def entry_points(group: str) -> list[InstalledEntry]:
    """Return the entry points of a group.

    Of several distributions with the same name, the first on `sys.path` counts. Does not use
    `importlib.metadata`: it imports `email` and `zipfile`, which takes a tenth of the start of a
    sensor, and each process of a run reads the entry points.
    """
    folders: dict[str, Path] = {}
    for folder in sys.path:
        for info in _metadata_folders(folder or "."):
            name = re.sub(r"[-_.]+", "_", info.stem.partition("-")[0]).lower()
            folders.setdefault(name, info)
    return [
        InstalledEntry(name, value, _distribution(info))
        for info in folders.values()
        for name, value in _lines(info / "entry_points.txt", group)
    ]


def load_reference(reference: str) -> Any:
    """Return the object that a `module:object` reference names."""
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name)


@cache
def sensor_kinds() -> Mapping[str, SensorKind]:
    """Return all installed kinds by name: shipped kinds first, each group sorted by name.

    Raises
    ------
    UserError
        when no kind is installed, or when an entry point cannot be used.
    """
    kinds = {}
    for entry in sorted(entry_points(GROUP), key=_shipped_first):
        kinds[entry.name] = _loaded(entry)
    if not kinds:
        raise UserError(
            f"no sensor kinds: no installed distribution has entry points in the group `{GROUP}`. "
            "Fix: install Groundlink again (pip install -e .)"
        )
    return kinds


@cache
def distribution_of(kind: str) -> str:
    """Return the name of the distribution that installs a kind."""
    (name,) = (entry.distribution for entry in entry_points(GROUP) if entry.name == kind)
    return name


def sheet_folders() -> list[Path]:
    """Return the `sheets` folders of all kinds' packages that have one."""
    specs = (find_spec(kind.package) for kind in sensor_kinds().values())
    folders = [
        Path(location) / "sheets"
        for spec in specs
        if spec is not None
        for location in spec.submodule_search_locations or ()
    ]
    return [folder for folder in folders if folder.is_dir()]


def shares_process(spec: SensorSpec) -> bool:
    """Return whether a sensor shares a process with others of its vehicle, on one machine."""
    kind = sensor_kinds().get(spec.kind)
    return kind is not None and (spec.process == "shared" or (spec.process is None and kind.light))


def kind_of(spec: SensorSpec) -> SensorKind:
    """Return the kind of a sensor.

    Raises
    ------
    UserError
        when the kind is not installed; the error names the package to install.
    """
    if isinstance(spec, UnknownSensor):
        raise UserError(spec.problem)
    return sensor_kinds()[spec.kind]


def sensor_union() -> Any:
    """Return the tagged union of the specifications of all installed kinds, for msgspec."""
    return Union[tuple(kind.spec for kind in sensor_kinds().values())]  # noqa: UP007


def _metadata_folders(folder: str) -> list[Path]:
    try:
        names = os.listdir(folder)
    except OSError:  # `sys.path` also names folders that do not exist, and archives.
        return []
    return [Path(folder, name) for name in names if name.endswith(tuple(_METADATA_FILES))]


def _lines(file: Path, group: str) -> Iterator[tuple[str, str]]:
    """Yield name and value of each line of a section."""
    try:
        text = file.read_text(encoding="utf-8")
    except OSError:  # Most distributions have no entry points; some have a file as metadata.
        return
    section = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("["):
            section = line.strip("[]")
        elif section == group and "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            yield name.strip(), value.strip()


def _distribution(info: Path) -> str:
    with (info / _METADATA_FILES[info.suffix]).open(encoding="utf-8") as headers:
        return next(line[5:].strip() for line in headers if line.startswith("Name:"))


def _loaded(entry: InstalledEntry) -> SensorKind:
    where = f"sensor kind `{entry.name}` of the package `{entry.distribution}`"
    try:
        kind = load_reference(entry.value)
    except Exception as error:  # The package is not ours and may raise anything.
        raise UserError(
            f"{where}: cannot import {entry.value}: {error}. Fix: update or uninstall the package"
        ) from error
    if not isinstance(kind, SensorKind) or kind.name != entry.name:
        raise UserError(
            f"{where}: {entry.value} is not a SensorKind of this name. "
            "Fix: name the entry point like the tag of the specification"
        )
    return kind


def _shipped_first(entry: InstalledEntry) -> tuple[bool, str]:
    return entry.distribution != OWN_DISTRIBUTION, entry.name
