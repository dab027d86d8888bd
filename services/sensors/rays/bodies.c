// SPDX-License-Identifier: Apache-2.0
/* Rays against bodies that move.
 *
 * Rule: an engine knows meshes at rest. Which bodies rays may meet, and where these are at each ray's
 * instant, is known here: rays are taken into the body's frame, where its mesh is at rest.
 */

#include <math.h>
#include <string.h>

#include "rays.h"

/* What all rays of a packet are within. On an axis along which their signs differ they go anywhere;
 * where all are negative, everything is mirrored. */
struct beam {
    float origin[3][2], inverse[3][2], far; /* least and most */
    int mixed[3], mirrored[3];
};

/* Take lanes `of` vectors into a body's frame: v + 2 q x (q x v - w v), q of any length. */
static inline void turn_back(const float q[4][LANES], const float twice[LANES],
                             const float of[3][LANES], float to[3][LANES])
{
    for (int lane = 0; lane < LANES; lane++) {
        const float x = q[0][lane], y = q[1][lane], z = q[2][lane], w = q[3][lane];
        const float a = of[0][lane], b = of[1][lane], c = of[2][lane];
        const float d = y * c - z * b - w * a, e = z * a - x * c - w * b, f = x * b - y * a - w * c;
        to[0][lane] = a + twice[lane] * (y * f - z * e);
        to[1][lane] = b + twice[lane] * (z * d - x * f);
        to[2][lane] = c + twice[lane] * (x * e - y * d);
    }
}

/* Tell whether a ray may enter a box; boxes are wide enough for what is rounded here. */
static inline int entered(const struct box *box, const struct beam *beam)
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

static inline void widen(float bounds[2], float value)
{
    bounds[0] = value < bounds[0] ? value : bounds[0];
    bounds[1] = value > bounds[1] ? value : bounds[1];
}

/* Return what holds the rays of some packets. */
static struct beam beam_of(const struct rays *rays, int packets)
{
    struct beam beam = {.far = 0};
    float bounds[2][3][2]; /* of origins and directions */
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < 2; i++) {
            bounds[0][axis][i] = rays->world.origin[axis][0];
            bounds[1][axis][i] = rays->world.direction[axis][0];
        }
    for (int number = 0; number < packets; number++) {
        const struct packet *packet = &rays[number].world;
        for (int axis = 0; axis < 3; axis++)
            for (int lane = 0; lane < LANES; lane++) {
                widen(bounds[0][axis], packet->origin[axis][lane]);
                widen(bounds[1][axis], packet->direction[axis][lane]);
            }
        for (int lane = 0; lane < LANES; lane++)
            beam.far = packet->far[lane] > beam.far ? packet->far[lane] : beam.far;
    }
    for (int axis = 0; axis < 3; axis++) {
        const float *origin = bounds[0][axis], *direction = bounds[1][axis];
        const int mirrored = beam.mirrored[axis] = direction[1] < 0;
        beam.mixed[axis] = direction[0] <= 1e-30f && direction[1] >= -1e-30f;
        beam.origin[axis][0] = mirrored ? -origin[1] : origin[0];
        beam.origin[axis][1] = mirrored ? -origin[0] : origin[1];
        beam.inverse[axis][0] = 1 / (mirrored ? -direction[0] : direction[1]);
        beam.inverse[axis][1] = 1 / (mirrored ? -direction[1] : direction[0]);
    }
    return beam;
}

/* Meet a body, if any ray passes its ball at its own instant. */
static void meet_body(const struct ray_world *around, int32_t body, struct rays *rays)
{
    const struct packet *world = &rays->world;
    const double *first[LANES], *second[LANES];
    float offset[3][LANES], q[4][LANES], twice[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        first[lane] = poses(around, body, rays->before[lane], &second[lane]);
        for (int axis = 0; axis < 3; axis++) {
            const double from = first[lane][axis], to = second[lane][axis];
            offset[axis][lane] =
                (float)(world->origin[axis][lane] - (from + rays->share[lane] * (to - from)));
        }
    }
    const float radius = (float)around->radii[body];
    int passing = 0;
    for (int lane = 0; lane < LANES; lane++) {
        const float a = offset[0][lane], b = offset[1][lane], c = offset[2][lane];
        const float x = world->direction[0][lane], y = world->direction[1][lane],
                    z = world->direction[2][lane];
        const float along = (a * x + b * y + c * z) / (x * x + y * y + z * z);
        const float d = a - along * x, e = b - along * y, f = c - along * z;
        const float reach = radius + 1e-6f * (fabsf(a) + fabsf(b) + fabsf(c)); /* what is rounded */
        passing |= d * d + e * e + f * f <= reach * reach;
    }
    if (!passing)
        return;
    for (int lane = 0; lane < LANES; lane++) {
        double mixed[4];
        mix(first[lane], second[lane], rays->share[lane], mixed);
        for (int i = 0; i < 4; i++)
            q[i][lane] = (float)mixed[i];
    }
    for (int lane = 0; lane < LANES; lane++)
        twice[lane] = 2 / (q[0][lane] * q[0][lane] + q[1][lane] * q[1][lane] +
                           q[2][lane] * q[2][lane] + q[3][lane] * q[3][lane]);
    struct packet *own = &rays->own;
    turn_back(q, twice, offset, own->origin);
    turn_back(q, twice, world->direction, own->direction);
    memcpy(own->far, world->far, sizeof own->far);
    find(around, body + 1, own);
    for (int lane = 0; lane < LANES; lane++)
        if (own->ids[GEOMETRY][lane] != -1) {
            own->ids[GEOMETRY][lane] = -1;
            rays->world.far[lane] = own->far[lane];
            rays->triangle[lane] = around->first_triangle[body + 1] + own->ids[TRIANGLE][lane];
            rays->body[lane] = body;
        }
}

void groundlink_meet_bodies(const struct ray_world *around, struct rays *rays, int packets)
{
    const struct node *waiting[MOST_DEPTH + 1] = {around->nodes};
    const struct beam beam = beam_of(rays, packets);
    for (int count = 1; count;) {
        const struct node *node = waiting[--count];
        if (!entered(&node->box, &beam))
            continue;
        for (int32_t i = 0; i < node->items; i++)
            for (int packet = 0; packet < packets; packet++)
                meet_body(around, around->order[node->first + i], &rays[packet]);
        if (!node->items) {
            waiting[count++] = around->nodes + node->first;
            waiting[count++] = around->nodes + node->first + 1;
        }
    }
}
