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

/* Tell whether there may be ruts in a cell. */
static int is_rutted(const struct terrain *terrain, int32_t column, int32_t row)
{
    const struct rut_grid *ruts = terrain->ruts;
    if (!ruts || !ruts->count)
        return 0;
    const int64_t parts = terrain->parts;
    for (int64_t j = row * parts / RUT_SIDE; j <= (row + 1) * parts / RUT_SIDE; j++)
        for (int64_t i = column * parts / RUT_SIDE; i <= (column + 1) * parts / RUT_SIDE; i++)
            if (ruts->slots[rut_slot(ruts, j * ruts->tile_columns + i)] >= 0)
                return 1;
    return 0;
}

/* Find the heights at the corners a, b, c, d of a part of a cell, which has ruts. */
static void pressed(const struct terrain *terrain, int32_t column, int32_t row, int32_t i,
                    int32_t j, double corners[4])
{
    const float *south = terrain->heights + (ptrdiff_t)row * (terrain->cells[0] + 1) + column;
    const float *north = south + terrain->cells[0] + 1;
    const double a = south[0], b = south[1], c = north[0], d = north[1];
    const double size = 1.0 / terrain->parts;
    for (int k = 0; k < 4; k++) {
        const int32_t east = i + (k & 1), up = j + (k >> 1);
        const double u = east * size, v = up * size;
        const double height = east + up <= terrain->parts
                                  ? a + u * (b - a) + v * (c - a)
                                  : d + (1 - u) * (c - d) + (1 - v) * (b - d);
        corners[k] = height - RUT_STEP * rut_depth(terrain->ruts,
                                                   (int64_t)row * terrain->parts + up,
                                                   (int64_t)column * terrain->parts + east);
    }
}

/* Return the height of a part of a cell at a place in it. */
static double on_part(const double corners[4], double u, double v)
{
    const double b = corners[1], c = corners[2];
    if (u + v <= 1)
        return corners[0] + u * (b - corners[0]) + v * (c - corners[0]);
    return corners[3] + (1 - u) * (c - corners[3]) + (1 - v) * (b - corners[3]);
}

/* A ray on its way over the parts of a cell, in lengths of these. */
struct fine_course {
    double x, y, way_x, way_y;
};

/* Meet half of a part of a cell between two instants; return when, or infinity. */
static double meet_half(const struct courses *courses, int lane, const struct fine_course *fine,
                        int32_t i, int32_t j, const double corners[4], int half, double in,
                        double out)
{
    const double b = corners[1], c = corners[2], corner = corners[half ? 3 : 0];
    const double east = half ? corner - c : b - corner, upwards = half ? corner - b : c - corner;
    const double height = courses->start[2][lane] - corner - east * (fine->x - i - half) -
                          upwards * (fine->y - j - half);
    const double rate =
        courses->way[2][lane] - east * fine->way_x - upwards * fine->way_y;
    if (height + out * rate > 0)
        return INFINITY;
    return most(least(-height / rate, out), in);
}

/* Meet a part of a cell between two instants, as `meet_cell` does a cell. */
static double meet_part(const struct courses *courses, int lane, const struct fine_course *fine,
                        int32_t i, int32_t j, const double corners[4], double in, double out)
{
    const double start = fine->x - i + (fine->y - j) - 1, rate = fine->way_x + fine->way_y;
    const double enters = start + in * rate, leaves = start + out * rate;
    if (enters * leaves < 0) {
        const double middle = in + (out - in) * (enters / (enters - leaves));
        const double end =
            meet_half(courses, lane, fine, i, j, corners, enters > 0, in, middle);
        return end < INFINITY
                   ? end
                   : meet_half(courses, lane, fine, i, j, corners, leaves > 0, middle, out);
    }
    return meet_half(courses, lane, fine, i, j, corners, enters + leaves > 0, in, out);
}

/* Meet a cell with ruts between two instants. Rays from below pass it as if it had none. */
static int meet_ruts(const struct terrain *terrain, struct courses *courses, int lane,
                     int32_t column, int32_t row, double in, double out)
{
    const int32_t parts = terrain->parts;
    const struct fine_course fine = {
        (courses->start[0][lane] - column) * parts, (courses->start[1][lane] - row) * parts,
        courses->way[0][lane] * parts, courses->way[1][lane] * parts};
    const double inverse_x = courses->inverse[0][lane] / parts;
    const double inverse_y = courses->inverse[1][lane] / parts;
    int32_t i = within(fine.x + in * fine.way_x, parts), j = within(fine.y + in * fine.way_y, parts);
    const int32_t eastwards = fine.way_x > 0 ? 1 : -1, northwards = fine.way_y > 0 ? 1 : -1;
    for (;;) {
        const double x = fine.way_x == 0 ? INFINITY : (i + (fine.way_x > 0) - fine.x) * inverse_x;
        const double y = fine.way_y == 0 ? INFINITY : (j + (fine.way_y > 0) - fine.y) * inverse_y;
        const double next = least(x, y), until = most(least(next, out), in);
        double corners[4];
        pressed(terrain, column, row, i, j, corners);
        const double end = meet_part(courses, lane, &fine, i, j, corners, in, until);
        if (end < INFINITY) {
            courses->end[lane] = end;
            courses->triangle[lane] = 2 * (row * terrain->cells[0] + column);
            return 1;
        }
        if (!(next < out))
            return 0;
        in = until;
        if (x < y)
            i += eastwards;
        else
            j += northwards;
        if (i < 0 || j < 0 || i >= parts || j >= parts)
            return 0; /* rounded beyond the cell */
    }
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
            (sign > 0 && is_rutted(terrain, column, row)
                 ? meet_ruts(terrain, courses, lane, column, row, in, out)
                 : meet_cell(terrain, courses, lane, column, row, in, out)))
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
    double height = view.height + begin * view.rate;
    if (is_rutted(terrain, column, row)) {
        const double east = (x - column) * terrain->parts, up = (y - row) * terrain->parts;
        const int32_t i = within(east, terrain->parts), j = within(up, terrain->parts);
        double corners[4];
        pressed(terrain, column, row, i, j, corners);
        const double z = courses->start[2][lane] + begin * courses->way[2][lane];
        height = z - on_part(corners, east - i, up - j);
    }
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

int32_t groundlink_terrain_label(const struct terrain *terrain, int32_t triangle,
                                 const double point[3], double normal[3])
{
    const int32_t cell = triangle / 2, column = cell % terrain->cells[0],
                  row = cell / terrain->cells[0];
    const float *south = terrain->heights + (ptrdiff_t)row * (terrain->cells[0] + 1) + column;
    const float *north = south + terrain->cells[0] + 1;
    double a = south[0], b = south[1], c = north[0], d = north[1];
    double per_m[2] = {terrain->per_m[0], terrain->per_m[1]};
    int half = triangle & 1;
    if (is_rutted(terrain, column, row)) {
        const int32_t parts = terrain->parts;
        const double x = ((point[0] - terrain->origin[0]) * per_m[0] - column) * parts;
        const double y = ((point[1] - terrain->origin[1]) * per_m[1] - row) * parts;
        const int32_t i = within(x, parts), j = within(y, parts);
        double corners[4];
        pressed(terrain, column, row, i, j, corners);
        a = corners[0], b = corners[1], c = corners[2], d = corners[3];
        per_m[0] *= parts, per_m[1] *= parts;
        half = x - i + (y - j) > 1;
    }
    normal[0] = (half ? c - d : a - b) * per_m[0];
    normal[1] = (half ? b - d : a - c) * per_m[1];
    normal[2] = 1;
    const double inverse_length = 1 / sqrt(dot(normal, normal));
    for (int axis = 0; axis < 3; axis++)
        normal[axis] *= inverse_length;
    return terrain->first_label + terrain->surface[cell];
}
