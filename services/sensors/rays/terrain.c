// SPDX-License-Identifier: Apache-2.0
/* Rays against terrain: heights on a square grid.
 *
 * Rule: here rays pass over what is surely below them, as many at once as go the same way, by a
 * pyramid of the greatest heights in blocks of cells. What may be met is looked at in `cells.c`.
 */

#include <math.h>
#include <string.h>

#include "terrain.h"

/* Blocks of the least level of the pyramid have a side of 2^FINEST cells. */
#define FINEST 1

/* Ways of less than this, in cells, are followed from cell to cell; beams wider than that are split,
 * where they are wider than long. */
static const double SHORT = 4, WIDE = 2;

/* What holds some rays, and what of their way is still to be looked at. */
struct beam {
    double start[3][2], way[3][2]; /* least and most */
    double from, step;             /* up to where all is clear, and how far to look next */
    int first, lanes, upside_down;
};

/* Tell whether a beam is surely above the terrain between two instants. */
static int is_clear(const struct terrain *terrain, const struct beam *beam, double from, double to)
{
    int32_t first[2], last[2], side = 0;
    for (int axis = 0; axis < 2; axis++) {
        const double *start = beam->start[axis], *way = beam->way[axis];
        const double low = start[0] + (way[0] < 0 ? to : from) * way[0];
        const double high = start[1] + (way[1] > 0 ? to : from) * way[1];
        first[axis] = within(low, terrain->cells[axis]);
        last[axis] = within(high, terrain->cells[axis]);
        const int32_t cells = last[axis] - first[axis];
        side = cells > side ? cells : side;
    }
    /* Blocks so large that there are two of them in a row at most. */
    const int shift = side > 1 << FINEST ? 32 - __builtin_clz((unsigned)(side - 1)) : FINEST;
    const ptrdiff_t width = ((terrain->cells[0] - 1) >> shift) + 1;
    const float *south = terrain->highest[beam->upside_down][shift - FINEST] +
                         (first[1] >> shift) * width;
    const float *north = south + ((last[1] >> shift) - (first[1] >> shift)) * width;
    const int32_t west = first[0] >> shift, east = last[0] >> shift;
    const float a = south[west], b = south[east], c = north[west], d = north[east];
    const float ab = a > b ? a : b, cd = c > d ? c : d;
    const double way = beam->way[2][0];
    const double low = beam->start[2][0] + (way < 0 ? to : from) * way - CLEARANCE;
    return low > (ab > cd ? ab : cd);
}

static struct beam beam_of(const struct courses *courses, int first, int lanes)
{
    struct beam beam = {.first = first, .lanes = lanes};
    for (int axis = 0; axis < 3; axis++) {
        const double *start = courses->start[axis] + first, *way = courses->way[axis] + first;
        double bounds[4] = {start[0], start[0], way[0], way[0]};
        for (int lane = 1; lane < lanes; lane++) {
            bounds[0] = least(start[lane], bounds[0]);
            bounds[1] = most(start[lane], bounds[1]);
            bounds[2] = least(way[lane], bounds[2]);
            bounds[3] = most(way[lane], bounds[3]);
        }
        memcpy(beam.start[axis], bounds, sizeof beam.start[axis]);
        memcpy(beam.way[axis], bounds + 2, sizeof beam.way[axis]);
    }
    return beam;
}

/* Make two of a beam. */
static void split(const struct courses *courses, struct beam *beam, struct beam *other)
{
    const struct beam whole = *beam;
    const int half = whole.lanes / 2;
    *beam = beam_of(courses, whole.first, half);
    *other = beam_of(courses, whole.first + half, whole.lanes - half);
    beam->from = other->from = whole.from;
    beam->step = other->step = whole.step;
    beam->upside_down = other->upside_down = whole.upside_down;
}

/* Return how far to go at most with the rays of a beam that have met nothing. */
static double end_of(const struct courses *courses, const struct beam *beam)
{
    double end = -1;
    for (int lane = beam->first; lane < beam->first + beam->lanes; lane++)
        end = courses->triangle[lane] < 0 ? most(courses->end[lane], end) : end;
    return end;
}

/* Follow the rays of a beam: all at once where they are surely above the terrain, and each from cell
 * to cell where they may not be. `last` is the last of the beams, to which others are added. */
static void follow(const struct terrain *terrain, struct courses *courses, struct beam *beam,
                   struct beam **last)
{
    double end = end_of(courses, beam);
    while (beam->from < end) {
        const double from = beam->from, to = least(from + beam->step, end);
        if (is_clear(terrain, beam, from, to)) {
            beam->from = to;
            beam->step *= 2;
            continue;
        }
        double wide = 0, speed = 0;
        for (int axis = 0; axis < 2; axis++) {
            const double *start = beam->start[axis], *way = beam->way[axis];
            wide = most(start[1] - start[0] + from * (way[1] - way[0]), wide);
            speed = most(most(-way[0], way[1]), speed);
        }
        if (beam->lanes > 1 && wide > WIDE && wide > speed * beam->step) {
            split(courses, beam, ++*last);
            end = end_of(courses, beam);
        } else if (speed * beam->step > SHORT) {
            beam->step /= 2;
        } else {
            for (int lane = beam->first; lane < beam->first + beam->lanes; lane++)
                if (courses->triangle[lane] < 0 && courses->end[lane] > from)
                    groundlink_cross_cells(terrain, courses, lane, from,
                                           least(to, courses->end[lane]));
            beam->from = to;
            end = end_of(courses, beam);
        }
    }
}

/* Bring rays to the map. */
static void begin(const struct terrain *terrain, const struct packet *world, struct courses *courses)
{
    for (int lane = 0; lane < LANES; lane++) {
        courses->begin[lane] = 0;
        courses->end[lane] = world->far[lane];
        courses->sign[lane] = 1;
        courses->triangle[lane] = -1;
    }
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < LANES; lane++) {
            const double per_m = terrain->per_m[axis], way = world->direction[axis][lane] * per_m;
            courses->start[axis][lane] =
                (world->origin[axis][lane] - terrain->origin[axis]) * per_m;
            courses->way[axis][lane] = way;
            courses->inverse[axis][lane] = 1 / way;
        }
    for (int axis = 0; axis < 2; axis++)
        for (int lane = 0; lane < LANES; lane++) {
            const double back = -courses->start[axis][lane] * courses->inverse[axis][lane];
            const double ahead = (terrain->cells[axis] - courses->start[axis][lane]) *
                                 courses->inverse[axis][lane];
            const int forward = courses->inverse[axis][lane] > 0;
            courses->begin[lane] = most(forward ? back : ahead, courses->begin[lane]);
            courses->end[lane] = least(forward ? ahead : back, courses->end[lane]);
        }
}

/* Let rays end where they leave the heights that there are; one without a direction goes nowhere. */
static void end_at_heights(const struct terrain *terrain, struct courses *courses)
{
    for (int lane = 0; lane < LANES; lane++) {
        const double up = courses->way[2][lane], sign = courses->sign[lane];
        const double top = sign * terrain->heights_within[sign > 0];
        const double bottom = sign * terrain->heights_within[sign < 0];
        const double last = up > 0 ? top + CLEARANCE : bottom - CLEARANCE;
        const double end = (last - courses->start[2][lane]) * courses->inverse[2][lane];
        courses->end[lane] = up == 0 ? courses->end[lane] : least(end, courses->end[lane]);
        courses->end[lane] = courses->end[lane] < INFINITY ? courses->end[lane] : -1;
    }
}

/* Tell whether all rays begin at once, on the same side. */
static int together(const struct courses *courses)
{
    double latest = 0, signs = 0;
    for (int lane = 0; lane < LANES; lane++) {
        latest = most(courses->begin[lane], latest);
        signs += courses->sign[lane];
    }
    return latest == 0 && fabs(signs) == LANES;
}

void groundlink_meet_terrain(const struct terrain *terrain, struct rays *rays)
{
    struct packet *world = &rays->world;
    struct courses courses;
    struct beam beams[LANES], *last = beams;
    begin(terrain, world, &courses);
    beams[0] = beam_of(&courses, 0, LANES);
    if (!together(&courses) || !is_clear(terrain, beams, 0, 0)) {
        for (int lane = 0; lane < LANES; lane++)
            if (courses.begin[lane] <= courses.end[lane])
                groundlink_choose_side(terrain, &courses, lane);
        beams[0] = beam_of(&courses, 0, LANES);
    }
    end_at_heights(terrain, &courses);
    if (!together(&courses))
        for (int lane = 0; lane < LANES; lane++)
            *(last = &beams[lane]) = beam_of(&courses, lane, 1);
    for (struct beam *beam = beams; beam <= last; beam++) {
        beam->from = courses.begin[beam->first];
        beam->step = end_of(&courses, beam) - beam->from;
        beam->upside_down = courses.sign[beam->first] < 0;
    }
    for (struct beam *beam = beams; beam <= last; beam++)
        follow(terrain, &courses, beam, &last);
    for (int lane = 0; lane < LANES; lane++)
        if (courses.triangle[lane] >= 0) {
            world->far[lane] = (float)courses.end[lane];
            rays->triangle[lane] = courses.triangle[lane];
            rays->body[lane] = TERRAIN;
        }
}

