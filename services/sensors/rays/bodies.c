// SPDX-License-Identifier: Apache-2.0
/* Rays against bodies that move.
 *
 * Rule: an engine knows meshes at rest. Which bodies rays may meet, and where these are at each ray's
 * instant, is known here: rays are taken into the body's frame, where its mesh is at rest.
 */

#include <math.h>
#include <string.h>

#include "beam.h"

/* Take lanes `of` vectors into a body's frame: v + 2 q x (q x v - w v), q of any length. */
static INLINED void turn_back(const float q[4][LANES], const float twice[LANES],
                             const float of[3][LANES], float to[3][LANES])
{
    EACH_LANE {
        const float x = q[0][lane], y = q[1][lane], z = q[2][lane], w = q[3][lane];
        const float a = of[0][lane], b = of[1][lane], c = of[2][lane];
        const float d = y * c - z * b - w * a, e = z * a - x * c - w * b, f = x * b - y * a - w * c;
        to[0][lane] = a + twice[lane] * (y * f - z * e);
        to[1][lane] = b + twice[lane] * (z * d - x * f);
        to[2][lane] = c + twice[lane] * (x * e - y * d);
    }
}

/* Poses of a body before and after each ray's time. */
struct motion {
    double first[7][LANES], second[7][LANES];
};

/* Read these poses. */
static INLINED void read_motion(const struct ray_world *around, int32_t body,
                                const struct rays *rays, struct motion *motion)
{
    const double *first, *second;
    if (rays->together) {
        first = poses(around, body, rays->before[0], &second);
        for (int i = 0; i < 7; i++)
            EACH_LANE {
                motion->first[i][lane] = first[i];
                motion->second[i][lane] = second[i];
            }
        return;
    }
    for (int lane = 0; lane < LANES; lane++) {
        first = poses(around, body, rays->before[lane], &second);
        for (int i = 0; i < 7; i++) {
            motion->first[i][lane] = first[i];
            motion->second[i][lane] = second[i];
        }
    }
}

/* Find the rays' orientations of a body, times any factor, as `mix` does. */
static INLINED void mix_lanes(const struct motion *motion, const float share[LANES],
                              float q[4][LANES])
{
    double sign[LANES];
    EACH_LANE {
        double cosine = 0;
        cosine += motion->first[3][lane] * motion->second[3][lane];
        cosine += motion->first[4][lane] * motion->second[4][lane];
        cosine += motion->first[5][lane] * motion->second[5][lane];
        cosine += motion->first[6][lane] * motion->second[6][lane];
        sign[lane] = cosine < 0 ? -1 : 1;
    }
    for (int i = 0; i < 4; i++)
        EACH_LANE {
            const double from = motion->first[3 + i][lane], to = motion->second[3 + i][lane];
            q[i][lane] = (float)(from + share[lane] * (sign[lane] * to - from));
        }
}

/* Leave only those lanes valid that enter a box; `far` is where they end. */
static INLINED void pass_box(const struct box *box, const struct packet *own,
                             const float far[LANES], int32_t valid[LANES])
{
    float entry[LANES], exit[LANES], rounded[LANES];
    EACH_LANE {
        entry[lane] = 0;
        exit[lane] = far[lane];
        rounded[lane] = 1e-6f * (fabsf(own->origin[0][lane]) + fabsf(own->origin[1][lane]) +
                                 fabsf(own->origin[2][lane]));
    }
    for (int axis = 0; axis < 3; axis++) {
        const float low = box->low[axis], high = box->high[axis];
        EACH_LANE {
            const float origin = own->origin[axis][lane], direction = own->direction[axis][lane];
            /* Never infinite: infinity times 0 is no number. */
            const float inverse = copysignf(1 / higher(fabsf(direction), 1e-30f), direction);
            const float a = (low - rounded[lane] - origin) * inverse;
            const float b = (high + rounded[lane] - origin) * inverse;
            entry[lane] = higher(lower(a, b), entry[lane]);
            exit[lane] = lower(higher(a, b), exit[lane]);
        }
    }
    EACH_LANE
        valid[lane] = entry[lane] <= exit[lane] * 1.00001f ? valid[lane] : 0;
}

static INLINED int any(const int32_t valid[LANES])
{
    int32_t found = 0;
    for (int lane = 0; lane < LANES; lane++)
        found |= valid[lane];
    return found;
}

/* Meet a body, which is within the box `way` at all times, if any ray enters the box of its mesh at
 * its own instant before what it met so far. */
static INLINED void meet_body(const struct ray_world *around, int32_t body, const struct box *way,
                              struct rays *rays)
{
    const struct packet *world = &rays->world;
    struct packet *own = &rays->own;
    struct motion motion;
    float offset[3][LANES], q[4][LANES], twice[LANES];
    int32_t valid[LANES] __attribute__((aligned(64)));
    EACH_LANE
        valid[lane] = -1;
    pass_box(way, world, world->far, valid);
    if (!any(valid))
        return;
    read_motion(around, body, rays, &motion);
    for (int axis = 0; axis < 3; axis++)
        EACH_LANE {
            const double from = motion.first[axis][lane], to = motion.second[axis][lane];
            offset[axis][lane] =
                (float)(world->origin[axis][lane] - (from + rays->share[lane] * (to - from)));
        }
    mix_lanes(&motion, rays->share, q);
    EACH_LANE
        twice[lane] = 2 / (q[0][lane] * q[0][lane] + q[1][lane] * q[1][lane] +
                           q[2][lane] * q[2][lane] + q[3][lane] * q[3][lane]);
    turn_back(q, twice, offset, own->origin);
    turn_back(q, twice, world->direction, own->direction);
    pass_box(&around->boxes[body], own, world->far, valid);
    if (!any(valid))
        return;
    memcpy(own->far, world->far, sizeof own->far);
    find(around, body + 1, valid, own);
    EACH_LANE {
        const int hit = own->ids[GEOMETRY][lane] != -1;
        own->ids[GEOMETRY][lane] = -1;
        rays->world.far[lane] = hit ? own->far[lane] : rays->world.far[lane];
        rays->triangle[lane] = hit ? around->first_triangle[body + 1] + own->ids[TRIANGLE][lane]
                                   : rays->triangle[lane];
        rays->body[lane] = hit ? body : rays->body[lane];
    }
}

VECTORIZED void groundlink_meet_bodies(const struct ray_world *around, const struct beam *beam,
                                       struct rays *rays, int packets)
{
    const struct node *waiting[MOST_DEPTH + 1] = {around->nodes};
    for (int count = 1; count;) {
        const struct node *node = waiting[--count];
        if (!entered(&node->box, beam))
            continue;
        for (int32_t i = 0; i < node->items; i++)
            for (int packet = 0; packet < packets; packet++)
                meet_body(around, around->order[node->first + i], &node->box, &rays[packet]);
        if (!node->items) {
            waiting[count++] = around->nodes + node->first;
            waiting[count++] = around->nodes + node->first + 1;
        }
    }
}

/* Find the box that holds each body on its whole way. A body is within its ball, and within its box
 * as it is turned halfway, widened by how far a point of the ball is ever turned from there. */
void groundlink_ways(const double (*poses)[7], int32_t steps, int32_t bodies, const double *radii,
                     const struct box *boxes, struct box *ways)
{
    for (int32_t body = 0; body < bodies; body++) {
        const struct box *box = &boxes[body];
        const double *middle = poses[(ptrdiff_t)(steps / 2) * bodies + body], radius = radii[body];
        const double back[4] = {-middle[3], -middle[4], -middle[5], middle[6]};
        double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        double least = 1; /* cosine of half an angle turned */
        for (int32_t step = 0; step < steps; step++) {
            const double *pose = poses[(ptrdiff_t)step * bodies + body];
            double cosine = 0;
            for (int axis = 0; axis < 3; axis++) {
                low[axis] = pose[axis] < low[axis] ? pose[axis] : low[axis];
                high[axis] = pose[axis] > high[axis] ? pose[axis] : high[axis];
            }
            for (int i = 3; i < 7; i++)
                cosine += pose[i] * middle[i];
            least = fabs(cosine) < least ? fabs(cosine) : least;
        }
        const double turned = least > 0.8 ? 2 * radius * sqrt(1 - least * least) : radius;
        for (int axis = 0; axis < 3; axis++) {
            double along[3] = {0, 0, 0}, center = 0, reach = turned + 1e-6 * radius;
            along[axis] = 1;
            turn(back, along);
            for (int of = 0; of < 3; of++) {
                center += along[of] * (box->low[of] + (double)box->high[of]) / 2;
                reach += fabs(along[of]) * (box->high[of] - (double)box->low[of]) / 2;
            }
            const double below = fmin(reach - center, radius), above = fmin(reach + center, radius);
            const double rounded = 1e-6 * (fabs(low[axis]) + fabs(high[axis]) + radius);
            ways[body].low[axis] = (float)(low[axis] - below - rounded);
            ways[body].high[axis] = (float)(high[axis] + above + rounded);
        }
    }
}
