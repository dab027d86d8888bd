# SPDX-License-Identifier: Apache-2.0
"""Firings out of the data packets of Velodyne and Hesai LiDARs.

Velodyne: User Manuals 63-9243 (VLP-16), 63-9325 (VLP-32C) and 63-9483 (VLS-128), chapters on data
packets. Hesai: user manuals of Pandar40P, Pandar64, PandarQT, PandarXT, chapters on the point cloud
data packet. With two returns only the strongest (Velodyne) or the first (Hesai) is taken.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError

from .firings import Firings, Reals, of_head

Bytes = NDArray[np.uint8]

VELODYNE_BYTES = 1206
_BLOCKS, _BLOCK_BYTES = 12, 100
_DUAL = 0x39


class _Velodyne(NamedTuple):
    """Layout of a Velodyne's packets."""

    unit_m: float
    firings_per_block: int
    """Firings that share a block: two of a VLP-16."""

    blocks_per_firing: int
    """Blocks that share a firing: four of a VLS-128."""


_VELODYNES = {
    0x22: _Velodyne(0.002, 2, 1),
    0x24: _Velodyne(0.002, 2, 1),
    0x28: _Velodyne(0.004, 1, 1),
    0xA1: _Velodyne(0.004, 1, 4),
}
"""Layout by the product's number in the last byte of a packet: VLP-16, Puck Hi-Res, VLP-32C,
VLS-128."""


def of_packets(packets: Sequence[bytes], source: str) -> Firings:
    """Return the firings of packets of one device, in the order in which they were sent.

    Raises
    ------
    UserError
        when the packets are of no known device; `source` names them.
    """
    common = max(map(len, packets), key=[len(packet) for packet in packets].count, default=0)
    data = np.frombuffer(
        b"".join(packet for packet in packets if len(packet) == common), np.uint8
    ).reshape(-1, max(common, 1))
    for is_its, decode in _DECODERS:
        if common and is_its(data):
            return decode(data)
    raise UserError(
        f"{source}: packets of {common} bytes are of no known device; expected a VLP-16, VLP-32C, "
        "VLS-128 (one return), or a Hesai Pandar40P, Pandar64, QT64, QT128, XT16, XT32"
    )


def _velodyne(data: Bytes) -> Firings:
    layout = _VELODYNES[int(data[0, 1205])]
    blocks = data[:, :1200].reshape(-1, _BLOCKS, _BLOCK_BYTES).astype(np.int32)
    azimuth = blocks[..., 2] + 256 * blocks[..., 3]
    in_blocks = blocks[..., 4:].reshape(-1, _BLOCKS, 32, 3)
    if data[0, 1204] == _DUAL:
        # Pairs of blocks: the last return, then the strongest.
        strongest = np.arange(_BLOCKS) % 2 == 1
        azimuth, in_blocks = azimuth[:, strongest], in_blocks[:, strongest]
    per_firing = layout.blocks_per_firing
    cells = in_blocks.reshape(-1, 32 * per_firing // layout.firings_per_block, 3)
    heads = np.radians(azimuth.reshape(-1, per_firing)[:, 0] * 0.01)
    if layout.firings_per_block == 2:
        # The second firing of a block is halfway to the next block.
        ahead = np.remainder(np.diff(heads, append=heads[-1]), 2 * np.pi)
        usual = np.median(ahead)
        regular = np.abs(ahead - usual) < usual / 2
        heads = np.stack([heads, heads + np.where(regular, ahead, usual) / 2], axis=1).ravel()
    return of_head(heads, *_measured(cells, layout.unit_m))


def _measured(cells: NDArray[np.int32], unit_m: float) -> tuple[Reals, Reals]:
    """Return ranges and intensities of cells of a distance, low byte first, and a brightness."""
    distance = (cells[..., 0] + 256 * cells[..., 1]).astype(np.float64)
    return distance * unit_m, cells[..., 2].astype(np.float64)


def _is_velodyne(data: Bytes) -> bool:
    """Return whether packets are known; those of a VLS-128 with two returns are not."""
    if data.shape[1] != VELODYNE_BYTES:
        return False
    mode, product = (int(byte) for byte in data[0, 1204:])
    return product in _VELODYNES and (product, mode) != (0xA1, _DUAL)


def _hesai(data: Bytes, header: int, lasers: int, blocks: int, sync: int, cell: int) -> Firings:
    """Decode blocks of an azimuth and the cells of all lasers; `sync` bytes begin a block."""
    size = sync + 2 + cell * lasers
    body = data[:, header : header + blocks * size].reshape(-1, size).astype(np.int32)
    azimuth = np.radians((body[:, sync] + 256 * body[:, sync + 1]) * 0.01)
    cells = body[:, sync + 2 :].reshape(-1, lasers, cell)
    if np.mean(azimuth[1::2] == azimuth[::2]) > 0.9:  # two returns
        azimuth, cells = azimuth[::2], cells[::2]
    return of_head(azimuth, *_measured(cells, 0.004))


def _pandar40p(data: Bytes) -> Firings:
    return _hesai(data, header=0, lasers=40, blocks=10, sync=2, cell=3)


def _pandar64(data: Bytes) -> Firings:
    return _hesai(data, header=8, lasers=int(data[0, 2]), blocks=int(data[0, 3]), sync=0, cell=3)


def _pandar(data: Bytes) -> Firings:
    return _hesai(data, header=12, lasers=int(data[0, 6]), blocks=int(data[0, 7]), sync=0, cell=4)


def _begins(*start: int) -> Callable[[Bytes], bool]:
    return lambda data: bool((data[:, : len(start)] == start).all())


_DECODERS: list[tuple[Callable[[Bytes], bool], Callable[[Bytes], Firings]]] = [
    (_is_velodyne, _velodyne),
    (_begins(0xEE, 0xFF, 64, 6), _pandar64),
    (_begins(0xEE, 0xFF), _pandar),
    (_begins(0xFF, 0xEE), _pandar40p),
]
"""Whether packets are of a family, and its decoder."""
