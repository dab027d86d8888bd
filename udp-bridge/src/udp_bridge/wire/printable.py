# SPDX-License-Identifier: Apache-2.0
"""Escapes text of a peer for log lines, so that no name can start a line or move the cursor."""

from __future__ import annotations


def printable(text: str) -> str:
    """Return a text with every unprintable character and every backslash escaped."""
    if text.isprintable() and "\\" not in text:
        return text
    return "".join(
        character
        if character.isprintable() and character != "\\"
        else character.encode("unicode_escape", "surrogatepass").decode()
        for character in text
    )
