// SPDX-License-Identifier: Apache-2.0
/* What the files about terrain share: rays on their way over a map.
 *
 * A ray starts on one side of the terrain and meets it where it is first not on that side. All is
 * float64, in cells and meters. Rays that start below see everything upside down.
 */

#ifndef GROUNDLINK_TERRAIN_H
#define GROUNDLINK_TERRAIN_H

#include "rays.h"

/* What a ray has to be above everything to pass unseen, in meters: more than what is rounded. */
static const double CLEARANCE = 1e-6;

/* Of all packets that are traced together. */
#define COURSES (LANES * PACKETS)

/* Rays on their way over the map. */
struct courses {
    double start[3][COURSES], way[3][COURSES]; /* in cells east and north, and meters upwards */
    double inverse[3][COURSES];
    double begin[COURSES], end[COURSES]; /* where a ray comes to the map, and leaves or meets something */
    double sign[COURSES];              /* -1 when upside down */
    int32_t triangle[COURSES];         /* 2 cell + (0 in the south-west, 1 in the north-east), or -1 */
};

/* Where new is no number, old is kept. */
static inline double least(double new, double old)
{
    return new < old ? new : old;
}

static inline double most(double new, double old)
{
    return new > old ? new : old;
}

static inline int32_t within(double place, int32_t cells)
{
    return (int32_t)least(most(place, 0), cells - 1);
}

/* These are in `cells.c`. Find out on which side of the terrain a ray begins. */
void groundlink_choose_side(const struct terrain *terrain, struct courses *courses, int lane);

/* Follow those of some lanes of a packet that have met nothing from cell to cell between two instants. */
void groundlink_cross_cells(const struct terrain *terrain, struct courses *courses, int first,
                            int lanes, double from, double to);

#endif
