# SPDX-License-Identifier: Apache-2.0
"""Which files are pictures, by their ending."""

from __future__ import annotations

from pathlib import Path

ENDINGS = (".png", ".jpg", ".jpeg")
"""Of the formats that commands write."""


def is_picture(file: Path) -> bool:
    """Return whether a file's ending is that of a picture."""
    return file.suffix.lower() in ENDINGS
