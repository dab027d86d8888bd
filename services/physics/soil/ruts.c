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

/* Return the number of a vertex's tile, which is added if it is new; -1 if there are too many. */
static int32_t tile_of(struct rut_grid *grid, int64_t row, int64_t column)
{
    int64_t key = row / RUT_SIDE * grid->tile_columns + column / RUT_SIDE;
    size_t slot = rut_slot(grid, key);
    if (grid->slots[slot] < 0) {
        if (grid->count == grid->most)
            return -1;
        grid->slots[slot] = (int32_t)grid->count;
        grid->keys[grid->count++] = key;
    }
    return grid->slots[slot];
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
    while (next(&print, &row, &column, &along)) {
        /* The rim is close to a parabola. */
        double ahead = fmax(fabs(along) * grid->cell - swept, 0.0);
        double pressed = (depth - ahead * ahead / (2.0 * radius)) / RUT_STEP + 0.5;
        if (!(pressed >= 1.0))
            continue;
        uint16_t steps = pressed < UINT16_MAX ? (uint16_t)pressed : UINT16_MAX;
        if (steps <= rut_depth(grid, row, column))
            continue;
        int32_t tile = tile_of(grid, row, column);
        if (tile < 0) {
            ruts->is_full = 1;
            continue;
        }
        grid->depths[tile][row % RUT_SIDE * RUT_SIDE + column % RUT_SIDE] = steps;
        if (!ruts->is_pending[tile]) {
            ruts->is_pending[tile] = 1;
            ruts->pending[ruts->pending_count++] = tile;
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
    while (next(&print, &row, &column, &along)) {
        sum += rut_depth(grid, row, column);
        vertices++;
    }
    return vertices ? sum / vertices * RUT_STEP : 0.0;
}
