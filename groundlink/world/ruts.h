// SPDX-License-Identifier: Apache-2.0
/* Depths of ruts on a fine grid; `ruts.py` fills the structure and documents units. */

#ifndef GROUNDLINK_RUTS_H
#define GROUNDLINK_RUTS_H

#include <stddef.h>
#include <stdint.h>

/* Vertices along the side of a tile. */
#define RUT_SIDE 16

/* Unit of depths. */
#define RUT_STEP 1e-4

struct rut_grid {
    double x0, y0, cell;      /* place of the first vertex, and from one to the next */
    int64_t rows, columns;    /* of vertices */
    int64_t tile_columns;
    int32_t *slots;           /* a hash table with numbers of tiles, or -1; twice as many as tiles */
    int64_t *keys;            /* of each tile, its row times `tile_columns` plus its column */
    uint16_t (*depths)[RUT_SIDE * RUT_SIDE]; /* of each tile, row by row */
    size_t count, most;
    int32_t shift;            /* of a hash, which leaves the place of a slot */
};

/* Return the slot of a tile: where its number is, or where it belongs. */
static inline size_t rut_slot(const struct rut_grid *grid, int64_t key)
{
    size_t slot = (uint64_t)key * 0x9E3779B97F4A7C15u >> grid->shift;
    while (grid->slots[slot] >= 0 && grid->keys[grid->slots[slot]] != key)
        slot = (slot + 1) & (2 * grid->most - 1);
    return slot;
}

/* Return the depth at a vertex. */
static inline uint16_t rut_depth(const struct rut_grid *grid, int64_t row, int64_t column)
{
    if (row < 0 || column < 0 || row >= grid->rows || column >= grid->columns)
        return 0;
    int64_t key = row / RUT_SIDE * grid->tile_columns + column / RUT_SIDE;
    int32_t tile = grid->slots[rut_slot(grid, key)];
    return tile < 0 ? 0 : grid->depths[tile][row % RUT_SIDE * RUT_SIDE + column % RUT_SIDE];
}

#endif
