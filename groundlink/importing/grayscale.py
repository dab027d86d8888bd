# SPDX-License-Identifier: Apache-2.0
"""Pictures as arrays of gray: heights and numbers from PNG and TIFF, levels from PGM, PNG and BMP.

The declared size is checked before a picture is decoded.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .file_errors import BadFile

if TYPE_CHECKING:
    from PIL import Image

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
    with _opened(file, ("PNG", "TIFF")) as image:
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


def read_levels(file: Path) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the gray levels of a PGM, PNG or BMP with 8 bits, and where it is opaque.

    Colors become gray by ITU-R 601 luma, 16 bits become 8. Row 0 is the bottom of the picture.

    Raises
    ------
    BadFile
        when it declares more data than the file can hold.
    """
    with _opened(file, ("PPM", "PNG", "BMP")) as image:
        if image.mode.startswith("I"):
            grays = np.rint(np.asarray(image) / 257).astype(np.uint8)
        else:
            grays = np.asarray(image.convert("L"))
        if "A" in image.mode or "transparency" in image.info:
            is_opaque = np.asarray(image.convert("RGBA"))[..., 3] == 255
        else:
            is_opaque = np.ones(grays.shape, np.bool_)
        return grays[::-1], is_opaque[::-1]


@contextmanager
def _opened(file: Path, formats: tuple[str, ...]) -> Iterator["Image.Image"]:
    """Open a picture and check its declared size.

    Raises
    ------
    BadFile
        when it declares more data than the file can hold.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about sizes, which are checked here
            image = Image.open(file, formats=formats)
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
        yield image


def check_count(file: Path, rows: int, columns: int) -> None:
    """Refuse maps that are too large."""
    if rows * columns > MAX_VALUES:
        raise BadFile(
            f"{file}: {columns} x {rows} values are more than {MAX_VALUES // 10**6} million; "
            "use a coarser map or a part of it"
        )
