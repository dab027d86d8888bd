# SPDX-License-Identifier: Apache-2.0
"""Build interface packages without a wheel, for the ROS 2 that pip installed.

    python ros/ros2/build_messages.py            tf2_msgs and groundlink_msgs, for the node
    python ros/ros2/build_messages.py FOLDER     another package, such as simulation_interfaces

The installed files always match the interface files that they were built from: the hash of the
sources is written last, so an interrupted build is repeated. The script uses the generators of the
ROS wheels, CMake and a compiler, but no network. It installs to the locations of the message
packages' wheels: modules into site-packages, libraries into ``lib`` and the ament index into
``share`` of the same prefix.

It builds only what rclpy needs with Fast DDS: no C++ and no other type support. A ROS 2 workspace
builds ``groundlink_msgs`` with colcon instead and has its own tf2_msgs.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.metadata
import importlib.util
import io
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

ROS_FOLDER = Path(__file__).resolve().parent.parent
PREFIX = Path(sys.prefix)
SITE_PACKAGES = Path(sysconfig.get_paths()["platlib"])
SHARE = PREFIX / "share"
AMENT_INDEX = SHARE / "ament_index" / "resource_index"
BUILT_FROM = "built_from.sha256"

GENERATORS = (
    "rosidl_adapter",
    "rosidl_generator_type_description",
    "rosidl_generator_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_c",
    "rosidl_generator_py",
)


class BuildFailed(Exception):
    """The packages can't be built; the text names the missing requirements."""


KINDS = ("msg", "srv", "action")
"""Folder names in an interface package, which are also the file extensions."""

IMPLIED = {
    "srv": ("service_msgs",),
    "action": ("action_msgs", "service_msgs", "unique_identifier_msgs"),
}
"""Packages whose messages the generators put into every service and action."""


@dataclass(frozen=True)
class InterfacePackage:
    """Interface package: a folder with package.xml and msg/*.msg, srv/*.srv, action/*.action."""

    folder: Path

    @cached_property
    def description(self) -> ElementTree.Element:
        """Content of package.xml."""
        path = self.folder / "package.xml"
        try:
            return ElementTree.parse(path).getroot()
        except (OSError, ElementTree.ParseError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            raise BuildFailed(f"{path} is no description of a package: {reason}") from None

    @property
    def name(self) -> str:
        """ROS name of the package."""
        return str(self.description.findtext("name", "")).strip()

    @cached_property
    def interfaces(self) -> list[Path]:
        """Interface files of all kinds, relative to the folder."""
        files = [path for kind in KINDS for path in sorted((self.folder / kind).glob(f"*.{kind}"))]
        return [path.relative_to(self.folder) for path in files]

    @property
    def depends(self) -> list[str]:
        """Build dependencies (REP 149: `depend` includes `build_depend`)."""
        found = [*self.description.iter("depend"), *self.description.iter("build_depend")]
        return [str(entry.text).strip() for entry in found]

    @cached_property
    def dependencies(self) -> tuple[str, ...]:
        """Packages whose messages are used, directly or indirectly."""
        found: set[str] = set()
        waiting = [*self.depends]
        for interface in self.interfaces:
            waiting += IMPLIED.get(interface.parts[0], ())
        while waiting:
            name = waiting.pop()
            if name not in found:
                found.add(name)
                if (SHARE / name / "package.xml").is_file():  # else reported as missing
                    waiting += InterfacePackage(SHARE / name).depends
        return tuple(sorted(found))

    @property
    def share(self) -> Path:
        """Folder of the installed package."""
        return SHARE / self.name

    @property
    def extension(self) -> str:
        """File name of the module that gives rclpy the type support."""
        return f"{self.name}_s__rosidl_typesupport_c.so"

    def content_hash(self) -> str:
        """Return the hash of all inputs of the build."""
        digest = hashlib.sha256()
        files = (self.folder / path for path in (Path("package.xml"), *self.interfaces))
        for source in (Path(__file__), *files):
            digest.update(source.name.encode() + b"\0" + source.read_bytes() + b"\0")
        for generator in GENERATORS:
            distribution = "ros-" + generator.replace("_", "-")
            digest.update(importlib.metadata.version(distribution).encode() + b"\0")
        digest.update(sys.version.encode())
        return digest.hexdigest()

    def is_installed(self) -> bool:
        """Return whether the installed package was built from these sources."""
        record = self.share / BUILT_FROM
        return (
            record.is_file()
            and (SITE_PACKAGES / self.name / self.extension).is_file()
            and record.read_text().strip() == self.content_hash()
        )


PACKAGES = tuple(ROS_FOLDER / name for name in ("tf2_msgs", "groundlink_msgs"))


def check_wheels(packages: Sequence[InterfacePackage]) -> None:
    """Raise BuildFailed with all missing wheels, unless all ROS wheels are installed."""
    wheels = [*GENERATORS, *sorted({name for row in packages for name in row.dependencies})]
    missing = ["ros-" + name.replace("_", "-") for name in wheels if not _is_found(name)]
    if not _is_found("numpy"):
        missing.append("numpy")
    if missing:
        raise BuildFailed(f"these wheels are missing in {PREFIX}: {', '.join(missing)}")


def _is_found(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def check_tools() -> None:
    """Raise BuildFailed with all missing tools, unless C and C++ can be compiled."""
    missing = [
        f"{what} ({os.environ.get(variable, default)})"
        for variable, default, what in (
            ("CC", "cc", "a C compiler"),
            ("CXX", "c++", "a C++ compiler"),
            ("CMAKE", "cmake", "CMake 3.20 or newer"),
        )
        if shutil.which(os.environ.get(variable, default).split()[0]) is None
    ]
    if not (Path(sysconfig.get_paths()["include"]) / "Python.h").is_file():
        missing.append("the headers of Python (Python.h)")
    if missing:
        raise BuildFailed("missing on this machine: " + ", ".join(missing))


def generate(package: InterfacePackage, build: Path) -> None:
    """Write the sources of one package: ``idl/``, ``include/``, ``typesupport/``, ``py/``."""
    generators = {name: importlib.import_module(name) for name in GENERATORS}
    name = package.name
    idl_folder = build / "idl" / name
    for interface in package.interfaces:
        (idl_folder / interface).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(package.folder / interface, idl_folder / interface)
        with contextlib.redirect_stdout(io.StringIO()):
            generators["rosidl_adapter"].convert_to_idl(package.folder, name, interface, idl_folder)
    stems = [interface.with_suffix("").as_posix() for interface in package.interfaces]
    descriptions = [f"{stem}.idl:{idl_folder}/{stem}.json" for stem in stems]

    def arguments(generator: str, output: Path, **more: Any) -> str:
        path = build / f"{generator}.json"
        content = {
            "package_name": name,
            "idl_tuples": [f"{idl_folder}:{stem}.idl" for stem in stems],
            "output_dir": str(output),
            "template_dir": str(SHARE / generator / "resource"),
            "target_dependencies": [],
            "ros_interface_dependencies": [],
            **more,
        }
        path.write_text(json.dumps(content))
        return str(path)

    include = build / "include" / name
    typesupport = build / "typesupport" / name
    modules = build / "py" / name
    for folder in (include, typesupport, modules):
        for kind in {"msg", *(interface.parts[0] for interface in package.interfaces)}:
            (folder / kind).mkdir(parents=True)
    for generator in ("rosidl_generator_c", "rosidl_typesupport_fastrtps_c"):
        header = f"{generator}__visibility_control.h"
        template = (SHARE / generator / "resource" / f"{header}.in").read_text()
        template = template.replace("@PROJECT_NAME_UPPER@", name.upper())
        (include / "msg" / header).write_text(template.replace("@PROJECT_NAME@", name))

    generators["rosidl_generator_type_description"].generate_type_hash(
        arguments(
            "rosidl_generator_type_description",
            idl_folder,
            include_paths=[f"{other}:{SHARE / other}" for other in package.dependencies],
        )
    )
    generators["rosidl_generator_c"].generate_c(
        arguments(
            "rosidl_generator_c",
            include,
            type_description_tuples=descriptions,
            ros_interface_files=[str(package.folder / path) for path in package.interfaces],
        )
    )
    generators["rosidl_typesupport_fastrtps_c"].generate_typesupport_fastrtps_c(
        arguments("rosidl_typesupport_fastrtps_c", include)
    )
    # With only one type support, the C dispatcher calls it directly.
    generators["rosidl_typesupport_c"].generate_c(
        arguments("rosidl_typesupport_c", typesupport), ["rosidl_typesupport_fastrtps_c"]
    )
    (modules / "__init__.py").touch()
    generators["rosidl_generator_py"].generate_py(
        arguments("rosidl_generator_py", modules), ["rosidl_typesupport_c"]
    )


def compile_sources(package: InterfacePackage, build: Path) -> Path:
    """Compile the sources from `generate`; return the folder of the libraries."""
    numpy = importlib.import_module("numpy")
    libraries = build / "libraries"
    cmake = os.environ.get("CMAKE", "cmake")
    definitions = {
        "PACKAGE": package.name,
        "DEPENDENCIES": ";".join(package.dependencies),
        "GENERATED": build,
        "ROS_PREFIX": PREFIX,
        "PYTHON_INCLUDE": sysconfig.get_paths()["include"],
        "NUMPY_INCLUDE": numpy.get_include(),
        "CMAKE_BUILD_TYPE": "MinSizeRel",
    }
    for command in (
        [cmake, "-S", str(Path(__file__).resolve().parent / "typesupport"), "-B", str(libraries)]
        + [f"-D{key}={value}" for key, value in definitions.items()],
        [cmake, "--build", str(libraries), "--parallel", str(os.cpu_count() or 1)],
    ):
        done = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        if done.returncode != 0:
            sys.stderr.write(done.stdout)
            raise BuildFailed(f"{package.name} does not compile: the output of CMake stands above")
    return libraries


def install(package: InterfacePackage, build: Path, libraries: Path) -> None:
    """Copy the built package into the prefix; the hash of its sources is written last."""
    (package.share / BUILT_FROM).unlink(missing_ok=True)
    for library in libraries.glob("lib*.so"):
        _copy(library, PREFIX / "lib" / library.name)
    modules = build / "py"
    for module in modules.rglob("*.py"):
        _copy(module, SITE_PACKAGES / module.relative_to(modules))
    _copy(libraries / package.extension, SITE_PACKAGES / package.name / package.extension)

    idl_folder = build / "idl" / package.name
    interfaces = sorted(path for path in idl_folder.rglob("*") if path.is_file())
    for interface in interfaces:
        _copy(interface, package.share / interface.relative_to(idl_folder))
    _copy(package.folder / "package.xml", package.share / "package.xml")
    listed = [p.relative_to(idl_folder).as_posix() for p in interfaces if p.suffix != ".json"]
    for kind, content in (
        ("packages", ""),
        ("package_run_dependencies", ";".join(package.dependencies)),
        ("rosidl_interfaces", "\n".join(listed)),
    ):
        (AMENT_INDEX / kind).mkdir(parents=True, exist_ok=True)
        (AMENT_INDEX / kind / package.name).write_text(content)
    (package.share / BUILT_FROM).write_text(package.content_hash() + "\n")


def _copy(source: Path, target: Path) -> None:
    # Rename instead of overwriting, because a process may have loaded the old library.
    target.parent.mkdir(parents=True, exist_ok=True)
    fresh = target.with_name(f".{target.name}.{os.getpid()}")
    shutil.copy(source, fresh)
    fresh.replace(target)


def main(folders: Sequence[str]) -> int:
    """Build and install the packages that are not up to date."""
    packages = [InterfacePackage(Path(folder).resolve()) for folder in folders or PACKAGES]
    try:
        check_wheels(packages)
        for package in packages:
            if package.is_installed():
                print(f"{package.name}: up to date in {SITE_PACKAGES}")
                continue
            check_tools()
            with tempfile.TemporaryDirectory(prefix=f"{package.name}-") as folder:
                build = Path(folder)
                generate(package, build)
                install(package, build, compile_sources(package, build))
            print(f"{package.name}: built and installed into {SITE_PACKAGES}")
    except BuildFailed as reason:
        print(f"build_messages: {reason}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
