# SPDX-License-Identifier: Apache-2.0
"""tshark with the project's dissector: returns the fields of a capture."""

import json
import subprocess
from pathlib import Path
from typing import Any

from .programs import need

DISSECTOR = Path(__file__).parents[2] / "udp-bridge" / "wireshark" / "udp_bridge.lua"

Decoded = dict[str, Any]
"""Fields of one datagram by name, without `udpbridge.`; empty if it was not recognized."""


def decode(capture: Path, *options: str) -> list[Decoded]:
    """Return the decoded fields of each packet of a capture, in order."""
    packets = json.loads(_tshark(capture, "-T", "json", *options))
    return [_fields(packet["_source"]["layers"]) for packet in packets]


def columns(capture: Path, fields: list[str]) -> list[list[str]]:
    """Return the values of fields of each packet; a repeated field has all of its values."""
    wanted = [word for field in fields for word in ("-e", field)]
    return [row.split("\t") for row in _tshark(capture, "-T", "fields", *wanted).splitlines()]


def _tshark(capture: Path, *options: str) -> str:
    need("tshark")
    done = subprocess.run(
        ["tshark", "-X", f"lua_script:{DISSECTOR}", "-r", str(capture), *options],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr.lower(), done.stderr  # the only sign of a broken script
    return done.stdout


def _fields(layers: dict[str, Any]) -> Decoded:
    ours = layers.get("udpbridge", {})
    errors = layers.get("_ws.lua.error")
    assert errors is None, errors
    flat: Decoded = {}
    for name, value in ours.items():
        flat.update(value if isinstance(value, dict) else {name: value})
    return {name.removeprefix("udpbridge."): value for name, value in flat.items()}
