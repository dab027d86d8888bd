# SPDX-License-Identifier: Apache-2.0
"""Single-channel PNG and TIFF pictures as arrays.

The declared size is checked before a picture is decoded; color pictures are refused.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .file_errors import BadFile

MAX_VALUES = 2**27
"""Half a gigabyte of float32: 15 km x 15 km at 1.3 m."""

MAX_COMPRESSION = 1100
"""Maximum compression of Deflate is 1032."""


@dataclass(frozen=True, eq=False)
class GrayPicture:
    """A single-channel picture."""

    values: NDArray[Any]
    """Shape (rows, columns); row 0 is the bottom of the picture."""

    mode: str
    """Mode of Pillow; `L` or `P` for 8 bits."""

    is_png: bool
    tags: dict[int, Any]
    """Tags of a TIFF."""


def read(file: Path) -> GrayPicture:
    """Return the picture in a file.

    Raises
    ------
    BadFile
        when it is in color, or declares more data than the file can hold.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about sizes, which are checked here
            image = Image.open(file, formats=("PNG", "TIFF"))
    except Image.DecompressionBombError:
        raise BadFile(f"{file}: more than {MAX_VALUES // 10**6} million pixels") from None
    with image:
        columns, rows = image.size
        check_count(file, rows, columns)
        if rows * columns > MAX_COMPRESSION * file.stat().st_size:
            raise BadFile(
                f"{file}: declares {columns} x {rows} pixels, which a file of "
                f"{file.stat().st_size} bytes cannot hold"
            )
        if image.mode not in ("L", "P", "I", "F") and not image.mode.startswith("I;16"):
            raise BadFile(
                f"{file}: a picture in color (mode {image.mode}); expected one gray channel"
            )
        return GrayPicture(
            values=np.asarray(image)[::-1],
            mode=image.mode,
            is_png=image.format == "PNG",
            tags=dict(getattr(image, "tag_v2", {})),
        )


def check_count(file: Path, rows: int, columns: int) -> None:
    """Refuse maps that are too large."""
    if rows * columns > MAX_VALUES:
        raise BadFile(
            f"{file}: {columns} x {rows} values are more than {MAX_VALUES // 10**6} million; "
            "use a coarser map or a part of it"
        )
