# SPDX-License-Identifier: Apache-2.0
"""Asset store: large data (heights, meshes, pictures) in files named by their SHA-256.

A file whose content does not match its name counts as missing. The folder is a cache: the loader
fills it again, so it may be deleted while no run needs it.
"""

import hashlib
import mmap
import os
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from groundlink.core.errors import UserError

Digest = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$")]
"""The sha256 of an asset's content, in hexadecimal: its name."""

VARIABLE = "GROUNDLINK_ASSETS"


class MissingAsset(UserError):
    """An asset is not in the store."""


def folder() -> Path:
    """Return the folder of the asset store, which may not exist yet."""
    if given := os.environ.get(VARIABLE):
        return Path(given)
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "groundlink" / "assets"


def put(content: bytes) -> str:
    """Store an asset and return its digest.

    Raises
    ------
    UserError
        when the folder cannot be written.
    """
    digest = hashlib.sha256(content).hexdigest()
    file = folder() / digest
    if has(digest):
        return digest
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        # Atomic rename: the final name never holds a partial file.
        with tempfile.NamedTemporaryFile(dir=file.parent, prefix=".", delete=False) as part:
            part.write(content)
        os.replace(part.name, file)
    except OSError as error:
        raise UserError(
            f"cannot write assets to {file.parent}: {(error.strerror or str(error)).lower()}. "
            f"Fix: name another folder in {VARIABLE}"
        ) from None
    return digest


def has(digest: str) -> bool:
    """Return whether the store holds an intact asset."""
    try:
        map_asset(digest)
    except MissingAsset:
        return False
    return True


def missing(digests: Iterable[str]) -> list[str]:
    """Return the assets that the store lacks."""
    return [digest for digest in dict.fromkeys(digests) if not has(digest)]


def read(digest: str) -> bytes:
    """Return an asset's content.

    Raises
    ------
    MissingAsset
        when the store does not hold it.
    """
    return bytes(map_asset(digest))


def map_asset(digest: str) -> memoryview:
    """Return an asset's content as a read-only memory map.

    Raises
    ------
    MissingAsset
        when the store does not hold it.
    """
    content: memoryview | None = None
    with suppress(OSError), (folder() / digest).open("rb") as file:
        size = os.fstat(file.fileno()).st_size  # Nothing cannot be mapped.
        content = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if size else b"")
    if content is None or hashlib.sha256(content).hexdigest() != digest:
        raise MissingAsset(
            f"the world's data {digest[:12]} are not in {folder()}; load the scenario from its "
            f"files on this machine once, or copy that folder from where the run was"
        )
    return content
