# SPDX-License-Identifier: Apache-2.0
"""Grids of ruts: tiles, and digests by content alone."""

import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.world.ruts import MOST_TILES, NO_RUTS, SIDE, TILE, RutGrid, digest_of, split


def tiles(*keys: int, depth: int = 7) -> NDArray[np.void]:
    made = np.zeros(len(keys), TILE)
    made["key"], made["depths"] = keys, depth
    return made


def grid(cells: int = 10, cell_m: float = 1.0) -> RutGrid:
    return RutGrid((cells + 1, cells + 1), cell_m, 0.0, 0.0)


@pytest.mark.parametrize(
    ("cell_m", "parts"), [(1.0, 20), (0.5, 10), (0.3, 6), (0.05, 1), (0.02, 1), (0.12, 3)]
)
def test_cells_of_the_map_are_divided_to_at_most_five_centimeters(
    cell_m: float, parts: int
) -> None:
    made = grid(10, cell_m)
    assert made.parts == parts
    assert made.cell_m == pytest.approx(cell_m / parts)
    assert made.rows == made.columns == 10 * parts + 1


def test_tiles_are_added_and_replaced() -> None:
    made = grid()
    made.put(tiles(3, 5, 100))
    made.put(tiles(5, depth=9))
    found = {int(tile["key"]): int(tile["depths"].max()) for tile in all_tiles(made)}
    assert found == {3: 7, 5: 9, 100: 7}
    assert made.deepest_m == pytest.approx(9e-4)
    made.clear()
    assert (made.count, made.deepest_m) == (0, 0.0)
    made.put(tiles(5, depth=1))
    assert made.deepest_m == pytest.approx(1e-4)


def all_tiles(made: RutGrid) -> NDArray[np.void]:
    return np.frombuffer(b"".join(made.tile(n) for n in range(made.count)), TILE)


def test_tiles_beside_the_map_are_found_out() -> None:
    made = grid()
    last = -(-made.rows // SIDE) * made.tile_columns - 1
    assert made.are_on_map(tiles(0, last))
    assert not made.are_on_map(tiles(0, last + 1))
    assert not made.are_on_map(tiles(-1))


def test_a_full_grid_drops_what_comes_later() -> None:
    made = grid(4000)
    keys = np.arange(MOST_TILES + 3) * 977
    made.put(tiles(*keys.tolist()))
    assert made.count == MOST_TILES
    assert made.keys[-1] == keys[MOST_TILES - 1]


def test_a_digest_does_not_depend_on_the_way_to_the_ruts() -> None:
    one, two, deeper = split(tiles(1, 2).tobytes()) + split(tiles(2, depth=9).tobytes())
    both = digest_of([one, two])
    assert digest_of([two], digest_of([one])) == both == digest_of([two, one])
    changed = digest_of([two, deeper], both)
    assert changed == digest_of([deeper, one])
    assert len({both, changed, digest_of([one]), NO_RUTS}) == 4
    assert digest_of([one, two], both) == NO_RUTS


def test_points_are_pressed_where_their_nearest_vertex_is() -> None:
    made = grid()
    assert not made.are_pressed(np.array([0.5]), np.array([0.5])).any()
    rut = tiles(1, 2 * made.tile_columns, depth=0)
    rut["depths"][0, 3, 4] = 9  # at x 0.05 (16 + 4), y 0.05 (3)
    made.put(rut)
    x = np.array([1.0, 1.02, 1.03, 0.0, -5.0, 99.0])
    y = np.array([0.15, 0.13, 0.15, 1.6, 0.15, 0.15])
    assert made.are_pressed(x, y).tolist() == [True, True, False, False, False, False]
