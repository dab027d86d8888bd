# SPDX-License-Identifier: Apache-2.0
"""Shared keys from a file or the environment, and hints about refusals that a user can fix.

No error shows a key, or what stood in its place.
"""

from __future__ import annotations

import os
import stat
import string
from typing import Dict, List, Mapping, Optional

SMALLEST_KEY = 16
LARGEST_TEXT = 4096
"""A larger file is no key."""


class BadKey(ValueError):
    """There is no usable key; the text is one line with the reason and the fix."""


def read_key(
    file: Optional[str], variable: Optional[str], environment: Mapping[str, str]
) -> Optional[bytes]:
    """Return the key of a file or of an environment variable; None when neither is named.

    Raises
    ------
    BadKey
        When the key is not there, not private, or too short, or when both are named.
    """
    if file is not None and variable is not None:
        raise BadKey("both a key file and a key variable are given; choose one")
    if file is not None:
        return key_of_file(file)
    if variable is None:
        return None
    if variable not in environment:
        raise BadKey(f"the environment has no variable {variable}, which should hold the key")
    return parse_key(os.fsencode(environment[variable]), f"environment variable {variable}")


def key_of_file(file: str) -> bytes:
    """Return the key in a file that only its owner can read.

    Raises
    ------
    BadKey
        When there is none.
    """
    path = os.path.expanduser(file)
    try:
        with open(path, "rb") as opened:
            status = os.fstat(opened.fileno())
            text = opened.read(LARGEST_TEXT + 1)
    except OSError as error:
        raise BadKey(f"key file {file}: {(error.strerror or str(error)).lower()}") from None
    if stat.S_IMODE(status.st_mode) & 0o077:
        raise BadKey(f"key file {file}: others may use it; `chmod 600 {file}`")
    return parse_key(text, f"key file {file}")


def parse_key(text: bytes, where: str) -> bytes:
    """Return the key in a text: decoded when it is all hexadecimal digits, else as it is.

    Raises
    ------
    BadKey
        When the text is no key; the error says `where`, never the text.
    """
    if len(text) > LARGEST_TEXT:
        raise BadKey(f"{where}: this is no key, it has more than {LARGEST_TEXT} bytes")
    key = text.rstrip(b"\r\n")
    if key and all(chr(byte) in string.hexdigits for byte in key):
        if len(key) % 2:
            raise BadKey(f"{where}: an odd number of hexadecimal digits")
        key = bytes.fromhex(key.decode("ascii"))
    if len(key) < SMALLEST_KEY:
        raise BadKey(
            f"{where}: the key has {len(key)} bytes, expected {SMALLEST_KEY} or more; "
            "`openssl rand -hex 32` makes one"
        )
    return key


REFUSAL_HINTS: Dict[str, str] = {
    "bad_tag": "the other end has another key, or bits were flipped on the way",
    "unsealed": "this end has a key and the other one has none",
    "sealed": "the other end has a key and this one has none",
    "unvalidated": "a sender asks for messages and does not prove its address, as older versions "
    "can't; name it as the peer, or give both ends a key",
    "stale": "the clocks of the two ends differ by more than 10 s, or somebody repeats old ones",
}
"""Explanations of refusals, by reason."""
TOLERATED: Dict[str, int] = {"unvalidated": 100}
"""Refusals before a hint is given: a sender is refused some times before it is validated."""


class RefusalHints:
    """Log lines about refused datagrams that a user can fix; one line for each reason."""

    def __init__(self) -> None:
        self._reported: Dict[str, str] = {}

    def new(self, refused: Mapping[str, int]) -> List[str]:
        """Return lines for the reasons that were not reported before."""
        found = {
            why: text
            for why, text in REFUSAL_HINTS.items()
            if refused.get(why, 0) > TOLERATED.get(why, 0)
        }
        lines = [
            f"refuses datagrams as {why}: {text}"
            for why, text in found.items()
            if why not in self._reported
        ]
        self._reported.update(found)
        return lines
