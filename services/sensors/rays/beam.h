// SPDX-License-Identifier: Apache-2.0
/* What some packets may meet is found out for all of their rays at once. */

#ifndef GROUNDLINK_BEAM_H
#define GROUNDLINK_BEAM_H

#include <string.h>

#include "rays.h"

/* What holds the rays of some packets. On an axis along which their signs differ they go anywhere;
 * where all are negative, everything is mirrored. */
struct beam {
    float origin[3][2], inverse[3][2], far; /* least and most */
    int mixed[3], mirrored[3];
};

static inline float lower(float a, float b)
{
    return a < b ? a : b;
}

static inline float higher(float a, float b)
{
    return a > b ? a : b;
}

/* Tell whether a ray may enter a box; boxes are wide enough for what is rounded here. */
static INLINED int entered(const struct box *box, const struct beam *beam)
{
    float near = 0, far = beam->far;
    for (int axis = 0; axis < 3; axis++) {
        if (beam->mixed[axis])
            continue;
        const int mirrored = beam->mirrored[axis];
        const float *origin = beam->origin[axis], *inverse = beam->inverse[axis];
        const float in = (mirrored ? -box->high[axis] : box->low[axis]) - origin[1];
        const float out = (mirrored ? -box->low[axis] : box->high[axis]) - origin[0];
        const float entry = in * inverse[in < 0], exit = out * inverse[out > 0];
        near = entry > near ? entry : near;
        far = exit < far ? exit : far;
    }
    return near <= far;
}

/* Return how far some packets go at most. */
static INLINED float farthest(const struct rays *rays, int packets)
{
    float far[LANES], most = 0;
    memcpy(far, rays->world.far, sizeof far);
    for (int packet = 1; packet < packets; packet++)
        EACH_LANE
            far[lane] = higher(rays[packet].world.far[lane], far[lane]);
    for (int lane = 0; lane < LANES; lane++)
        most = higher(far[lane], most);
    return most;
}

/* Return what holds the rays of some packets. */
static INLINED struct beam beam_of(const struct rays *rays, int packets)
{
    struct beam beam = {.far = farthest(rays, packets)};
    float low[2][3][LANES], high[2][3][LANES]; /* of origins and directions, by lane */
    memcpy(low[0], rays->world.origin, sizeof low[0]);
    memcpy(low[1], rays->world.direction, sizeof low[1]);
    memcpy(high, low, sizeof high);
    for (int number = 1; number < packets; number++) {
        const struct packet *packet = &rays[number].world;
        for (int axis = 0; axis < 3; axis++)
            EACH_LANE {
                const float origin = packet->origin[axis][lane];
                const float direction = packet->direction[axis][lane];
                low[0][axis][lane] = lower(origin, low[0][axis][lane]);
                high[0][axis][lane] = higher(origin, high[0][axis][lane]);
                low[1][axis][lane] = lower(direction, low[1][axis][lane]);
                high[1][axis][lane] = higher(direction, high[1][axis][lane]);
            }
    }
    for (int axis = 0; axis < 3; axis++) {
        float bounds[2][2];
        for (int i = 0; i < 2; i++) {
            bounds[i][0] = low[i][axis][0];
            bounds[i][1] = high[i][axis][0];
            for (int lane = 1; lane < LANES; lane++) {
                bounds[i][0] = lower(low[i][axis][lane], bounds[i][0]);
                bounds[i][1] = higher(high[i][axis][lane], bounds[i][1]);
            }
        }
        const float *origin = bounds[0], *direction = bounds[1];
        const int mirrored = beam.mirrored[axis] = direction[1] < 0;
        beam.mixed[axis] = direction[0] <= 1e-30f && direction[1] >= -1e-30f;
        beam.origin[axis][0] = mirrored ? -origin[1] : origin[0];
        beam.origin[axis][1] = mirrored ? -origin[0] : origin[1];
        beam.inverse[axis][0] = 1 / (mirrored ? -direction[0] : direction[1]);
        beam.inverse[axis][1] = 1 / (mirrored ? -direction[1] : direction[0]);
    }
    return beam;
}

#endif
