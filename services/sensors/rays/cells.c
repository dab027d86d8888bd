// SPDX-License-Identifier: Apache-2.0
/* Where exactly rays meet terrain, and what they meet there: each cell is cut in two triangles
 * (a, b, c) and (d, c, b) as `groundlink.world.terrain` says.
 *
 * Rule: how high a ray is above a triangle goes linearly as long as it is above that triangle, so it
 * is enough to look where it leaves one. None slips through an edge or a corner, however these are
 * rounded: what was not seen on leaving one triangle is seen on leaving the next.
 */

#include <math.h>

#include "terrain.h"

/* A triangle's plane as a ray sees it: how high the ray is above it at its start, and its rise. */
struct view {
    double height, rate;
};

static inline struct view view_of(const struct terrain *terrain, const struct courses *courses,
                                  int lane, int32_t column, int32_t row, int half)
{
    const double sign = courses->sign[lane];
    const float *south = terrain->heights + (ptrdiff_t)row * (terrain->cells[0] + 1) + column;
    const float *north = south + terrain->cells[0] + 1;
    const double b = sign * south[1], c = sign * north[0];
    const double corner = half ? sign * north[1] : sign * south[0];
    const double east = half ? corner - c : b - corner, upwards = half ? corner - b : c - corner;
    const double x = courses->start[0][lane] - column - half;
    const double y = courses->start[1][lane] - row - half;
    return (struct view){courses->start[2][lane] - corner - east * x - upwards * y,
                         courses->way[2][lane] - east * courses->way[0][lane] -
                             upwards * courses->way[1][lane]};
}

/* Meet a triangle between two instants, all of which are above it. */
static inline int meet(const struct terrain *terrain, struct courses *courses, int lane,
                       int32_t column, int32_t row, int half, double in, double out)
{
    const struct view view = view_of(terrain, courses, lane, column, row, half);
    if (view.height + out * view.rate > 0)
        return 0;
    /* No number where the ray runs along the plane. */
    courses->end[lane] = most(least(-view.height / view.rate, out), in);
    courses->triangle[lane] = 2 * (row * terrain->cells[0] + column) + half;
    return 1;
}

/* Meet a cell's triangles between two instants, all of which are above the cell. */
static int meet_cell(const struct terrain *terrain, struct courses *courses, int lane,
                     int32_t column, int32_t row, double in, double out)
{
    const double start = courses->start[0][lane] - column + (courses->start[1][lane] - row) - 1;
    const double rate = courses->way[0][lane] + courses->way[1][lane];
    const double enters = start + in * rate, leaves = start + out * rate;
    if (enters * leaves < 0) {
        const double middle = in + (out - in) * (enters / (enters - leaves));
        return meet(terrain, courses, lane, column, row, enters > 0, in, middle) ||
               meet(terrain, courses, lane, column, row, leaves > 0, middle, out);
    }
    return meet(terrain, courses, lane, column, row, enters + leaves > 0, in, out);
}

void groundlink_cross_cells(const struct terrain *terrain, struct courses *courses, int lane,
                            double from, double to)
{
    const double start_x = courses->start[0][lane], way_x = courses->way[0][lane];
    const double start_y = courses->start[1][lane], way_y = courses->way[1][lane];
    const double start_z = courses->start[2][lane] - CLEARANCE, way_z = courses->way[2][lane];
    const double inverse_x = courses->inverse[0][lane], inverse_y = courses->inverse[1][lane];
    const float sign = (float)courses->sign[lane];
    const ptrdiff_t width = terrain->cells[0] + 1;
    int32_t column = within(start_x + from * way_x, terrain->cells[0]);
    int32_t row = within(start_y + from * way_y, terrain->cells[1]);
    const int32_t eastwards = way_x > 0 ? 1 : -1, northwards = way_y > 0 ? 1 : -1;
    const int32_t ahead_x = way_x > 0, ahead_y = way_y > 0;
    double x = way_x == 0 ? INFINITY : (column + ahead_x - start_x) * inverse_x;
    double y = way_y == 0 ? INFINITY : (row + ahead_y - start_y) * inverse_y;
    const float *south = terrain->heights + row * width + column;
    for (double in = from;;) {
        const double next = least(x, y);
        const double out = most(least(next, to), in);
        const float a = sign * south[0], b = sign * south[1], c = sign * south[width],
                    d = sign * south[width + 1];
        const float ab = a > b ? a : b, cd = c > d ? c : d;
        if (start_z + (way_z < 0 ? out : in) * way_z <= (ab > cd ? ab : cd) &&
            meet_cell(terrain, courses, lane, column, row, in, out))
            return;
        if (!(next < to))
            return;
        in = out;
        if (x < y) {
            column += eastwards;
            south += eastwards;
            x = (column + ahead_x - start_x) * inverse_x;
        } else {
            row += northwards;
            south += northwards * width;
            y = (row + ahead_y - start_y) * inverse_y;
        }
    }
}

void groundlink_choose_side(const struct terrain *terrain, struct courses *courses, int lane)
{
    const double begin = courses->begin[lane];
    const double x = courses->start[0][lane] + begin * courses->way[0][lane];
    const double y = courses->start[1][lane] + begin * courses->way[1][lane];
    const int32_t column = within(x, terrain->cells[0]), row = within(y, terrain->cells[1]);
    const int half = x - column + (y - row) > 1;
    const struct view view = view_of(terrain, courses, lane, column, row, half);
    const double height = view.height + begin * view.rate;
    if (height < 0) {
        courses->sign[lane] = -1;
        courses->start[2][lane] = -courses->start[2][lane];
        courses->way[2][lane] = -courses->way[2][lane];
        courses->inverse[2][lane] = -courses->inverse[2][lane];
    } else if (height == 0) {
        courses->end[lane] = begin;
        courses->triangle[lane] = 2 * (row * terrain->cells[0] + column) + half;
    }
}

int32_t groundlink_terrain_label(const struct terrain *terrain, int32_t triangle, double normal[3])
{
    const int32_t cell = triangle / 2, column = cell % terrain->cells[0],
                  row = cell / terrain->cells[0];
    const float *south = terrain->heights + (ptrdiff_t)row * (terrain->cells[0] + 1) + column;
    const float *north = south + terrain->cells[0] + 1;
    const double a = south[0], b = south[1], c = north[0], d = north[1];
    normal[0] = (triangle & 1 ? c - d : a - b) * terrain->per_m[0];
    normal[1] = (triangle & 1 ? b - d : a - c) * terrain->per_m[1];
    normal[2] = 1;
    const double inverse_length = 1 / sqrt(dot(normal, normal));
    for (int axis = 0; axis < 3; axis++)
        normal[axis] *= inverse_length;
    return terrain->first_label + terrain->surface[cell];
}
