# SPDX-License-Identifier: Apache-2.0
"""The bus as an interface for others: MessagePack of any library, and `docs/reference/bus.md`."""

import re
import subprocess
import sys
import time
from pathlib import Path

import msgpack
import msgspec
import pytest

from groundlink.bus.core_topics import CLOCK, COMMAND
from groundlink.bus.inbox import BusInbox
from groundlink.bus.reference import reference
from groundlink.bus.session import Bus
from groundlink.bus.topics import TOPICS
from groundlink.messages.base import BusMessage, Clock, Command, encode
from groundlink.monitor.process_commands import free_endpoint
from tests.groundlink.messages.test_base import EXAMPLES, NAMES

DOCUMENT = (Path(__file__).parents[3] / "docs/reference/bus.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("message", EXAMPLES, ids=NAMES)
def test_another_library_reads_and_writes_every_message(message: BusMessage) -> None:
    payload = encode(message)
    plain = msgpack.unpackb(payload)
    assert isinstance(plain, dict)
    assert msgpack.packb(plain) == payload


def test_the_document_is_what_the_code_says() -> None:
    told = DOCUMENT[DOCUMENT.index("## Keys\n") :]
    assert told == reference(), "make it anew: groundlink topics --markdown"


def test_the_document_has_every_message_and_its_fields() -> None:
    sections = {s.partition("\n")[0]: s for s in DOCUMENT.split("\n### ")}
    for example in EXAMPLES:
        if type(example) not in {topic.message for topic in TOPICS}:
            continue
        for field in msgspec.structs.fields(example):
            assert f"| `{field.encode_name}` | " in sections[type(example).__name__]


def test_the_example_reads_the_clock_and_commands_a_vehicle(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", DOCUMENT, re.DOTALL)
    assert len(code.splitlines()) <= 15
    endpoint = free_endpoint()
    own = code.replace("tcp/127.0.0.1:7447", endpoint)
    assert own != code
    commands: BusInbox[Command] = BusInbox(depth=4)
    with Bus(listen=endpoint) as bus:
        bus.subscribe(COMMAND.key_in("indoor_lab", vehicle="rover"), Command, commands)
        publish = bus.publisher(CLOCK.key_in("indoor_lab"), CLOCK.delivery)
        with subprocess.Popen(
            [sys.executable, "-c", own], cwd=tmp_path, stdout=subprocess.PIPE, text=True
        ) as process:
            arrived, deadline = None, time.monotonic() + 60
            while arrived is None and time.monotonic() < deadline:
                publish(Clock(10**18 + 7, 10**18, 3, 1))
                arrived = commands.get(seconds=0.1)
            assert process.stdout
            assert process.stdout.readline() == "tick 3\n"
            process.kill()
    assert arrived is not None
    assert arrived[1] == Command(10**18 + 7, (0.5, 0.0, 0.0), (0.0, 0.0, 0.3))
