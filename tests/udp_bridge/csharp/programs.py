# SPDX-License-Identifier: Apache-2.0
"""The C# library compiled by Mono, and the program that answers what tests ask it."""

import re
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.udp_bridge.reported import Arrival
from tests.udp_bridge.reported import told as reported
from udp_bridge import Message, parse
from udp_bridge.wire.control import LinkReport

FOLDER = Path(__file__).parents[3] / "udp-bridge/csharp"
LIBRARY = FOLDER / "Runtime/UdpBridge"
LINK_REPORT = 2
"""Kind of Control."""
BUFFER = 1 << 30
"""So large that no Credit is due before the end of a message."""
SECOND = 10**9


class Received(NamedTuple):
    """What the receiver in C# made of datagrams."""

    messages: list[tuple[Any, ...]]
    """Type, number, stamp, parts, topic, link, bytes of the body, its sha256."""
    credits: list[bytes]
    refused: dict[str, int]
    counts: tuple[int, ...]
    """Messages, incomplete, late, missing, duplicates, bytes still held."""
    reports: list[Any]
    """As `tests.udp_bridge.reported` has them."""
    link_reports: list[tuple[int, LinkReport]]
    """To whom, and body."""


class Exchange:
    """The program in C#, which stays for all tests."""

    def __init__(self, program: Path) -> None:
        command = ["mono", str(program), str(BUFFER)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def ask(self, question: bytes) -> list[list[str]]:
        """Return the words of each line of the answer; the last line begins with `end`."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(question)
        self.process.stdin.flush()
        lines: list[list[str]] = []
        while not lines or lines[-1][0] != "end":
            lines.append(self.process.stdout.readline().decode().split())
            assert lines[-1], "the program ended"
        return lines

    def receive(self, arrivals: list[Arrival]) -> Received:
        """Let a new receiver take datagrams."""
        rows = [struct.pack("<qBI", now, who, len(d)) + d for now, who, d in arrivals]
        received = Received([], [], {}, (), [], [])
        for word, *rest in self.ask(b"R" + struct.pack("<I", len(rows)) + b"".join(rows)):
            if word == "message":
                kind, number, stamp, parts, topic, link, size, digest = rest
                names = bytes.fromhex(topic[1:]).decode(), bytes.fromhex(link[1:]).decode()
                whole = int(size), digest[1:].lower()
                numbers = int(kind), int(number), int(stamp), int(parts)
                received.messages.append((*numbers, *names, *whole))
            elif word == "credit":
                received.credits.append(bytes.fromhex(rest[0][1:]))
            elif word == "report":
                to, report = int(rest[0]), bytes.fromhex(rest[1][1:])
                body = report[parse(report)[1] :]
                if body[0] == LINK_REPORT:
                    received.link_reports.append((to, LinkReport.parse(body)))
                else:
                    received.reports.append(reported(to, report))
            elif word == "refused":
                received.refused[rest[0]] = int(rest[1])
            else:
                received = received._replace(counts=tuple(map(int, rest)))
        return received

    def send(self, message: Message, size: int, times: int = 1) -> list[bytes]:
        """Return the datagrams of a message that a new sender sends for the last time."""
        head = struct.pack("<BqIi", message.msg_type, message.stamp_nanos, times, size)
        texts = message.topic.encode(), message.link.encode(), bytes(message.body)
        question = b"S" + head + b"".join(struct.pack("<i", len(t)) + t for t in texts)
        *datagrams, (_, is_sent) = self.ask(question)
        assert is_sent == "1" or not datagrams
        return [bytes.fromhex(word[1:]) for _, word in datagrams]


def compiled(out: Path, *sources: Path, uses: tuple[Path, ...] = (), strict: bool = True) -> Path:
    """Return a program, or a library where `out` is a DLL; skip where there is no Mono.

    Every warning is an error, but for code that stands in for something else.
    """
    if not all(shutil.which(program) for program in ("mcs", "mono")):
        pytest.skip("no Mono")
    # With -doc a public thing without documentation is a warning; checked arithmetic is what
    # some projects use.
    options = ["-langversion:7.2", "-checked+", f"-out:{out}"]
    options += ["-warn:4", "-warnaserror", f"-doc:{out}.xml"] if strict else []
    options += ["-target:library"] if out.suffix == ".dll" else []
    options += [f"-r:{used}" for used in (Path("System"), Path("System.Core"), *uses)]
    done = subprocess.run(
        ["mcs", *options, *map(str, sources)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def of_readme(name: str, library: Path) -> Path:
    """Return the program of the README that has a class of this name, compiled.

    It binds any free port.
    """
    blocks = re.findall(r"```csharp\n(.*?)```", (FOLDER / "README.md").read_text(), re.DOTALL)
    (code,) = (block for block in blocks if f"class {name}\n" in block)
    source = library.with_name(f"{name}.cs")
    source.write_text(code.replace("7510", "0"))
    return compiled(source.with_suffix(".exe"), source, uses=(library,))


def library_in(folder: Path) -> Path:
    """Return the library without Unity, as a DLL; programs that use it are compiled beside it."""
    return compiled(folder / "UdpBridge.dll", *sorted(LIBRARY.rglob("*.cs")))


def scene_beside(library: Path) -> Path:
    """Return a scene with each component, and the script of the guide, as a program."""
    folder, here = library.parent, Path(__file__).with_name("unity")
    engine = compiled(folder / "UnityEngine.dll", here / "UnityEngine.cs", strict=False)
    components = sorted((FOLDER / "Runtime/Unity").glob("*.cs"))
    package = compiled(folder / "UdpBridge.Unity.dll", *components, uses=(library, engine))
    drive = folder / "Drive.cs"
    page = (FOLDER.parents[1] / "docs/how-to/unity.md").read_text()
    drive.write_text(page.partition("```csharp\n")[2].partition("```")[0])
    uses = library, engine, package
    return compiled(folder / "Scene.exe", here / "Scene.cs", drive, uses=uses, strict=False)
