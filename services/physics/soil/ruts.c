// SPDX-License-Identifier: Apache-2.0
/* Wheels press soft terrain; see `ruts.py`. */

#include <math.h>

#include "ruts.h"

/* Vertices in a rectangle: those of the rows and columns around it, of which `next` skips others. */
struct footprint {
    double x, y, hx, hy, long_half, wide_half; /* in cells; a unit vector */
    int64_t row, column, first_column, last_row, last_column;
};

static struct footprint footprint_of(const struct rut_grid *grid, const double at[2],
                                     const double heading[2], double long_half, double wide_half)
{
    struct footprint print = {
        .x = (at[0] - grid->x0) / grid->cell,
        .y = (at[1] - grid->y0) / grid->cell,
        .hx = heading[0],
        .hy = heading[1],
        .long_half = long_half / grid->cell,
        .wide_half = wide_half / grid->cell,
    };
    double across = fabs(print.hx) * print.long_half + fabs(print.hy) * print.wide_half;
    double up = fabs(print.hy) * print.long_half + fabs(print.hx) * print.wide_half;
    /* Comparisons that no infinity or NaN passes. */
    double west = fmax(ceil(print.x - across), 0.0), south = fmax(ceil(print.y - up), 0.0);
    double east = fmin(floor(print.x + across), grid->columns - 1.0);
    double north = fmin(floor(print.y + up), grid->rows - 1.0);
    if (!(west <= east && south <= north)) {
        print.row = 1; /* beside the map */
        return print;
    }
    print.first_column = print.column = (int64_t)west;
    print.row = (int64_t)south;
    print.last_column = (int64_t)east;
    print.last_row = (int64_t)north;
    return print;
}

/* Find the next vertex, and where it is along the footprint, in cells; return 0 after the last. */
static int next(struct footprint *print, int64_t *row, int64_t *column, double *along)
{
    while (print->row <= print->last_row) {
        *row = print->row;
        *column = print->column;
        if (++print->column > print->last_column) {
            print->column = print->first_column;
            print->row++;
        }
        double dx = *column - print->x, dy = *row - print->y;
        *along = dx * print->hx + dy * print->hy;
        if (fabs(*along) <= print->long_half &&
            fabs(dy * print->hx - dx * print->hy) <= print->wide_half)
            return 1;
    }
    return 0;
}

/* The tile of the vertex before; the next one is mostly in it, too. */
struct last_tile {
    int64_t key;
    int32_t number; /* -1: there is none */
};

/* Find the tile of a vertex. */
static void find_tile(const struct rut_grid *grid, int64_t row, int64_t column,
                      struct last_tile *last)
{
    int64_t key = row / RUT_SIDE * grid->tile_columns + column / RUT_SIDE;
    if (key != last->key) {
        last->key = key;
        last->number = grid->slots[rut_slot(grid, key)];
    }
}

/* Add the tile that was not found, unless there are too many. */
static void add_tile(struct rut_grid *grid, struct last_tile *last)
{
    if (grid->count == grid->most)
        return;
    last->number = grid->slots[rut_slot(grid, last->key)] = (int32_t)grid->count;
    grid->keys[grid->count++] = last->key;
}

/* Narrower wheels count as this wide: it is at least one vertex, however they turn. */
static double wide_enough(const struct rut_grid *grid, double half)
{
    return fmax(half, 0.71 * grid->cell);
}

void groundlink_ruts_press(struct ruts *ruts, const double at[2], const double heading[2],
                           double width, double radius, double depth, double way)
{
    struct rut_grid *grid = &ruts->grid;
    if (depth < RUT_STEP)
        return;
    /* What is not below the hub yet, or no longer, was or will be deeper there. */
    double swept = way / 2, reach = fmin(groundlink_ruts_contact(radius, depth), grid->cell) + swept;
    double half = wide_enough(grid, width / 2), along;
    struct footprint print = footprint_of(grid, at, heading, reach, half);
    int64_t row, column;
    struct last_tile tile = {-1, -1};
    while (next(&print, &row, &column, &along)) {
        /* The rim is close to a parabola. */
        double ahead = fmax(fabs(along) * grid->cell - swept, 0.0);
        double pressed = (depth - ahead * ahead / (2.0 * radius)) / RUT_STEP + 0.5;
        if (!(pressed >= 1.0))
            continue;
        uint16_t steps = pressed < UINT16_MAX ? (uint16_t)pressed : UINT16_MAX;
        find_tile(grid, row, column, &tile);
        if (tile.number < 0)
            add_tile(grid, &tile);
        if (tile.number < 0) {
            ruts->is_full = 1;
            continue;
        }
        uint16_t *depth_there =
            &grid->depths[tile.number][row % RUT_SIDE * RUT_SIDE + column % RUT_SIDE];
        if (steps <= *depth_there)
            continue;
        *depth_there = steps;
        if (!ruts->is_pending[tile.number]) {
            ruts->is_pending[tile.number] = 1;
            ruts->pending[ruts->pending_count++] = tile.number;
        }
    }
}

double groundlink_ruts_contact(double radius, double depth)
{
    return sqrt(2.0 * radius * depth);
}

double groundlink_ruts_mean(const struct ruts *ruts, const double at[2], const double heading[2],
                            double width)
{
    const struct rut_grid *grid = &ruts->grid;
    double half = wide_enough(grid, width / 2), sum = 0.0, along;
    struct footprint print = footprint_of(grid, at, heading, grid->cell, half);
    int64_t row, column, vertices = 0;
    struct last_tile tile = {-1, -1};
    while (next(&print, &row, &column, &along)) {
        find_tile(grid, row, column, &tile);
        if (tile.number >= 0)
            sum += grid->depths[tile.number][row % RUT_SIDE * RUT_SIDE + column % RUT_SIDE];
        vertices++;
    }
    return vertices ? sum / vertices * RUT_STEP : 0.0;
}
