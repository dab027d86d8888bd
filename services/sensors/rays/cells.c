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

/* Rays of a packet on their way from cell to cell, each to its own next one. */
struct walk {
    double column[LANES], row[LANES];
    double in[LANES], out[LANES];            /* when it comes to its cell, and leaves it */
    double end[LANES];                       /* before `in` when it has ended */
    double south[2][LANES], north[2][LANES]; /* heights of its cell's corners */
    double x[LANES], y[LANES];               /* when the next column and row begin */
    double ahead_x[LANES], ahead_y[LANES];   /* 1 for rays that go east or north */
    double per_x[LANES], per_y[LANES];       /* inverse of the way */
    double never_x[LANES], never_y[LANES];   /* infinite where no other column or row comes */
    int base;                                /* number of the first ray */
};

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

/* Meet a part of a cell between two instants, as `meet_cells` does cells. */
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

/* The triangles of cells on the ways of rays, the second only where a ray crosses two. */
struct crossed {
    double half[2][LANES];      /* 1 in the north-east */
    double from[2][LANES], to[2][LANES];
    double second[LANES];       /* 1 where there is a second one */
    double meets[2][LANES], at[2][LANES];
};

/* Meet the triangles of cells that rays may meet, and let those end that do. All are above the cell
 * when they come to it. */
static INLINED void meet_cells(const struct terrain *terrain, struct courses *courses, int base,
                              const double may_meet[LANES], struct walk *walk)
{
    const double *start_x = courses->start[0] + base, *way_x = courses->way[0] + base;
    const double *start_y = courses->start[1] + base, *way_y = courses->way[1] + base;
    const double *start_z = courses->start[2] + base, *way_z = courses->way[2] + base;
    struct crossed crossed;
    EACH_LANE {
        const double in = walk->in[lane], out = walk->out[lane];
        const double x = start_x[lane] - walk->column[lane], y = start_y[lane] - walk->row[lane];
        const double start = x + y - 1;
        const double rate = way_x[lane] + way_y[lane];
        const double enters = start + in * rate, leaves = start + out * rate;
        const double middle = in + (out - in) * (enters / (enters - leaves));
        const double one = enters + leaves > 0, first = enters > 0;
        const int crosses = enters * leaves < 0;
        crossed.second[lane] = crosses;
        crossed.half[0][lane] = crosses ? first : one;
        crossed.half[1][lane] = leaves > 0;
        crossed.from[0][lane] = in;
        crossed.from[1][lane] = middle;
        crossed.to[0][lane] = crosses ? middle : out;
        crossed.to[1][lane] = out;
    }
    for (int i = 0; i < 2; i++)
        EACH_LANE {
            const double a = walk->south[0][lane], b = walk->south[1][lane];
            const double c = walk->north[0][lane], d = walk->north[1][lane];
            const double half = crossed.half[i][lane];
            const double corner = half > 0 ? d : a;
            const double east = half > 0 ? d - c : b - a, upwards = half > 0 ? d - b : c - a;
            const double x = start_x[lane] - walk->column[lane] - half;
            const double y = start_y[lane] - walk->row[lane] - half;
            const double height = start_z[lane] - corner - east * x - upwards * y;
            const double rate = way_z[lane] - east * way_x[lane] - upwards * way_y[lane];
            const double to = crossed.to[i][lane];
            crossed.meets[i][lane] = !(height + to * rate > 0);
            /* No number where the ray runs along the plane. */
            crossed.at[i][lane] = most(least(-height / rate, to), crossed.from[i][lane]);
        }
    for (int lane = 0; lane < LANES; lane++) {
        if (!(may_meet[lane] > 0))
            continue;
        const int32_t column = (int32_t)walk->column[lane], row = (int32_t)walk->row[lane];
        if (courses->sign[base + lane] > 0 && is_rutted(terrain, column, row)) {
            if (meet_ruts(terrain, courses, base + lane, column, row, walk->in[lane],
                          walk->out[lane]))
                walk->end[lane] = -INFINITY;
            continue;
        }
        const int first = crossed.meets[0][lane] > 0;
        const int second = crossed.second[lane] > 0 && crossed.meets[1][lane] > 0;
        if (first || second) {
            courses->end[base + lane] = crossed.at[!first][lane];
            courses->triangle[base + lane] = 2 * (row * terrain->cells[0] + column) +
                                             (crossed.half[!first][lane] > 0);
            walk->end[lane] = -INFINITY;
        }
    }
}

/* Find out when the next column and row begin. */
static INLINED void look_ahead(const struct courses *courses, struct walk *walk)
{
    const int base = walk->base;
    EACH_LANE {
        const double x = walk->column[lane] + walk->ahead_x[lane] - courses->start[0][base + lane];
        const double y = walk->row[lane] + walk->ahead_y[lane] - courses->start[1][base + lane];
        walk->x[lane] = x * walk->per_x[lane] + walk->never_x[lane];
        walk->y[lane] = y * walk->per_y[lane] + walk->never_y[lane];
    }
}

/* Begin the way of those of some lanes that have met nothing. */
static INLINED void set_out(const struct terrain *terrain, const struct courses *courses, int first,
                           int lanes, double from, double to, struct walk *walk)
{
    const int base = walk->base;
    const double *start_x = courses->start[0] + base, *start_y = courses->start[1] + base;
    for (int lane = 0; lane < LANES; lane++) {
        const double in = walk->in[lane] = most(courses->begin[base + lane], from);
        const double end = least(to, courses->end[base + lane]);
        const int walks = base + lane >= first && base + lane < first + lanes && in < end &&
                          courses->triangle[base + lane] < 0;
        walk->end[lane] = walks ? end : -INFINITY;
    }
    EACH_LANE {
        const double way_x = courses->way[0][base + lane], way_y = courses->way[1][base + lane];
        walk->ahead_x[lane] = way_x > 0;
        walk->ahead_y[lane] = way_y > 0;
        const double in = walk->in[lane];
        walk->column[lane] = within(start_x[lane] + in * way_x, terrain->cells[0]);
        walk->row[lane] = within(start_y[lane] + in * way_y, terrain->cells[1]);
        walk->never_x[lane] = way_x == 0 ? INFINITY : 0;
        walk->never_y[lane] = way_y == 0 ? INFINITY : 0;
        walk->per_x[lane] = way_x == 0 ? 0 : courses->inverse[0][base + lane];
        walk->per_y[lane] = way_y == 0 ? 0 : courses->inverse[1][base + lane];
    }
    look_ahead(courses, walk);
}

/* Cross a cell; return whether any ray goes on. */
static INLINED int64_t step(const struct terrain *terrain, struct courses *courses, double sign,
                           struct walk *walk)
{
    const double *start_z = courses->start[2] + walk->base, *way_z = courses->way[2] + walk->base;
    const int32_t width = terrain->cells[0] + 1;
    int32_t south[LANES];
    double may_meet[LANES], goes[LANES], beside[LANES];
    int64_t any = 0;
    EACH_LANE
        south[lane] = (int32_t)(walk->row[lane] * width + walk->column[lane]);
    EACH_LANE
        for (int i = 0; i < 2; i++) {
            walk->south[i][lane] = sign * terrain->heights[south[lane] + i];
            walk->north[i][lane] = sign * terrain->heights[south[lane] + width + i];
        }
    EACH_LANE {
        const double a = walk->south[0][lane], b = walk->south[1][lane];
        const double c = walk->north[0][lane], d = walk->north[1][lane];
        const double ab = a > b ? a : b, cd = c > d ? c : d, highest = ab > cd ? ab : cd;
        const double in = walk->in[lane], next = least(walk->x[lane], walk->y[lane]);
        const double out = most(least(next, walk->end[lane]), in);
        const double lowest = way_z[lane] < 0 ? out : in;
        walk->out[lane] = out;
        const double low = start_z[lane] - CLEARANCE + lowest * way_z[lane];
        const int is_there = walk->end[lane] >= in, is_low = low <= highest;
        may_meet[lane] = is_there & is_low;
        any |= -(int64_t)(is_there & is_low);
    }
    if (any)
        meet_cells(terrain, courses, walk->base, may_meet, walk);
    any = 0;
    EACH_LANE {
        const int goes_on = least(walk->x[lane], walk->y[lane]) < walk->end[lane];
        goes[lane] = goes_on;
        any |= -(int64_t)goes_on;
    }
    EACH_LANE
        beside[lane] = walk->x[lane] < walk->y[lane];
    EACH_LANE {
        const double aside = goes[lane] * beside[lane], along = goes[lane] - aside;
        const double last = (goes[lane] - 0.5) * INFINITY; /* at once, or never */
        walk->column[lane] += aside * (2 * walk->ahead_x[lane] - 1);
        walk->row[lane] += along * (2 * walk->ahead_y[lane] - 1);
        walk->in[lane] = walk->out[lane];
        walk->end[lane] = least(last, walk->end[lane]);
    }
    look_ahead(courses, walk);
    return any;
}

VECTORIZED void groundlink_cross_cells(const struct terrain *terrain, struct courses *courses,
                                       int first, int lanes, double from, double to)
{
    const double sign = courses->sign[first];
    struct walk walks[PACKETS];
    int left[PACKETS], count = 0;
    for (int base = first / LANES * LANES; base < first + lanes; base += LANES) {
        walks[count].base = base;
        set_out(terrain, courses, first, lanes, from, to, &walks[count]);
        left[count] = count;
        count++;
    }
    /* Packet after packet by a cell each: processors work on several at once. */
    while (count) {
        int still = 0;
        for (int i = 0; i < count; i++)
            if (step(terrain, courses, sign, &walks[left[i]]))
                left[still++] = left[i];
        count = still;
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
