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

/* Return a height that nothing exceeds below a beam between two instants. */
static INLINED double highest_below(const struct terrain *terrain, const struct beam *beam,
                                   double from, double to)
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
    return (ab > cd ? ab : cd) + CLEARANCE;
}

/* Return up to when a beam is surely above the terrain between two instants; the first, if not even
 * then. */
static INLINED double clear_until(const struct terrain *terrain, const struct beam *beam,
                                 double from, double to)
{
    const double highest = highest_below(terrain, beam, from, to), way = beam->way[2][0];
    const double above = beam->start[2][0] + from * way - highest;
    const double falls = (to - from) * -way;
    return !(above > 0) ? from : above > falls ? to : from + above / -way;
}

/* Return the least and the greatest of some values. */
static INLINED void bounds_of(const double *values, int count, double bounds[2])
{
    double low[LANES], high[LANES];
    for (int lane = 0; lane < LANES; lane++)
        low[lane] = high[lane] = values[lane < count ? lane : 0];
    for (int end = LANES + 1; end <= count; end += LANES) {
        const int first = (end + LANES - 1 < count ? end + LANES - 1 : count) - LANES;
        EACH_LANE {
            low[lane] = least(values[first + lane], low[lane]);
            high[lane] = most(values[first + lane], high[lane]);
        }
    }
    for (int half = LANES / 2; half; half /= 2)
        for (int lane = 0; lane < half; lane++) {
            low[lane] = least(low[lane + half], low[lane]);
            high[lane] = most(high[lane + half], high[lane]);
        }
    bounds[0] = low[0];
    bounds[1] = high[0];
}

static INLINED struct beam beam_of(const struct courses *courses, int first, int lanes)
{
    struct beam beam = {.first = first, .lanes = lanes};
    for (int axis = 0; axis < 3; axis++) {
        bounds_of(courses->start[axis] + first, lanes, beam.start[axis]);
        bounds_of(courses->way[axis] + first, lanes, beam.way[axis]);
    }
    return beam;
}

/* Make two of a beam. */
static INLINED void split(const struct courses *courses, struct beam *beam, struct beam *other)
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
static INLINED double end_of(const struct courses *courses, const struct beam *beam)
{
    double end = -1;
    for (int lane = beam->first; lane < beam->first + beam->lanes; lane++)
        end = courses->triangle[lane] < 0 ? most(courses->end[lane], end) : end;
    return end;
}

/* Follow the rays of a beam: all at once where they are surely above the terrain, and from cell to
 * cell where they may not be. `last` is the last of the beams, to which others are added. */
static INLINED void follow(const struct terrain *terrain, struct courses *courses,
                          struct beam *beam, struct beam **last)
{
    double end = end_of(courses, beam);
    while (beam->from < end) {
        const double from = beam->from, to = least(from + beam->step, end);
        const double clear = beam->from = clear_until(terrain, beam, from, to);
        if (clear == to || clear - from > beam->step / 4) {
            beam->step *= clear == to ? 2 : 0.5;
            continue;
        }
        double wide = 0, speed = 0;
        for (int axis = 0; axis < 2; axis++) {
            const double *start = beam->start[axis], *way = beam->way[axis];
            wide = most(start[1] - start[0] + clear * (way[1] - way[0]), wide);
            speed = most(most(-way[0], way[1]), speed);
        }
        if (beam->lanes > 1 && wide > WIDE && wide > speed * beam->step) {
            split(courses, beam, ++*last);
            end = end_of(courses, beam);
        } else if (speed * beam->step > SHORT) {
            beam->step /= 2;
        } else {
            groundlink_cross_cells(terrain, courses, beam->first, beam->lanes, clear, to);
            beam->from = to;
            end = end_of(courses, beam);
        }
    }
}

/* Bring rays of some packets to the map. */
static INLINED void begin(const struct terrain *terrain, const struct rays *rays, int packets,
                         struct courses *courses)
{
    for (int packet = 0; packet < packets; packet++) {
        const struct packet *world = &rays[packet].world;
        const int first = packet * LANES;
        EACH_LANE {
            courses->begin[first + lane] = 0;
            courses->end[first + lane] = world->far[lane];
            courses->sign[first + lane] = 1;
            courses->triangle[first + lane] = -1;
        }
        for (int axis = 0; axis < 3; axis++) {
            const double per_m = terrain->per_m[axis], origin = terrain->origin[axis];
            EACH_LANE {
                const double way = world->direction[axis][lane] * per_m;
                courses->start[axis][first + lane] = (world->origin[axis][lane] - origin) * per_m;
                courses->way[axis][first + lane] = way;
                courses->inverse[axis][first + lane] = 1 / way;
            }
        }
    }
    for (int axis = 0; axis < 2; axis++)
        for (int lane = 0; lane < packets * LANES; lane++) {
            const double back = -courses->start[axis][lane] * courses->inverse[axis][lane];
            const double ahead = (terrain->cells[axis] - courses->start[axis][lane]) *
                                 courses->inverse[axis][lane];
            const int forward = courses->inverse[axis][lane] > 0;
            courses->begin[lane] = most(forward ? back : ahead, courses->begin[lane]);
            courses->end[lane] = least(forward ? ahead : back, courses->end[lane]);
        }
}

/* Let rays end where they leave the heights that there are. Those without a direction, and those that
 * pass the map, go nowhere. */
static INLINED void end_at_heights(const struct terrain *terrain, int lanes,
                                  struct courses *courses)
{
    for (int lane = 0; lane < lanes; lane++) {
        const double up = courses->way[2][lane], sign = courses->sign[lane];
        const double top = sign * terrain->heights_within[sign > 0];
        const double bottom = sign * terrain->heights_within[sign < 0];
        const double last = up > 0 ? top + CLEARANCE : bottom - CLEARANCE;
        const double end = (last - courses->start[2][lane]) * courses->inverse[2][lane];
        const double sooner = least(up == 0 ? INFINITY : end, courses->end[lane]);
        const int comes = (sooner < INFINITY) & (courses->begin[lane] <= sooner);
        courses->end[lane] = comes ? sooner : -1;
    }
}

VECTORIZED void groundlink_meet_terrain(const struct terrain *terrain, struct rays *rays,
                                        int packets)
{
    const int lanes = packets * LANES;
    struct courses courses;
    struct beam beams[COURSES], *last = beams;
    double begins[2], signs[2];
    begin(terrain, rays, packets, &courses);
    bounds_of(courses.begin, lanes, begins);
    beams[0] = beam_of(&courses, 0, lanes);
    if (begins[1] > 0 || !(beams->start[2][0] > highest_below(terrain, beams, 0, 0))) {
        for (int lane = 0; lane < lanes; lane++)
            if (courses.begin[lane] <= courses.end[lane])
                groundlink_choose_side(terrain, &courses, lane);
        beams[0] = beam_of(&courses, 0, lanes);
    }
    end_at_heights(terrain, lanes, &courses);
    bounds_of(courses.sign, lanes, signs);
    if (signs[0] < signs[1])
        for (int lane = 0; lane < lanes; lane++)
            *(last = &beams[lane]) = beam_of(&courses, lane, 1);
    for (struct beam *beam = beams; beam <= last; beam++) {
        beam->from = begins[0];
        beam->step = end_of(&courses, beam) - beam->from;
        beam->upside_down = courses.sign[beam->first] < 0;
    }
    for (struct beam *beam = beams; beam <= last; beam++)
        follow(terrain, &courses, beam, &last);
    for (int lane = 0; lane < lanes; lane++)
        if (courses.triangle[lane] >= 0) {
            struct rays *of = &rays[lane / LANES];
            of->world.far[lane % LANES] = (float)courses.end[lane];
            of->triangle[lane % LANES] = courses.triangle[lane];
            of->body[lane % LANES] = TERRAIN;
        }
}
