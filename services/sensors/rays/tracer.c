// SPDX-License-Identifier: Apache-2.0
/* Rays against a world in which bodies move, 8 at once, and what their hits mean.
 *
 * Rule: the engine says which triangle is met; where exactly is computed here, in float64, so that
 * what an engine rounds shows at edges only. Knows nothing of Python, and needs no header of
 * Embree's: the function to call comes as a pointer. Arrays of vectors are component after component,
 * `count` values each.
 */

#include <math.h>
#include <string.h>

#include "rays.h"

/* For so many together it is found out which bodies they may meet. */
#define PACKETS 8

/* A ray that nearly lies in a triangle's plane meets the plane far from the triangle. The engine's
 * own range stands if the plane's is farther off than this, in meters. */
static const double MOST_MENDED = 0.01;

/* v + 2 q x (q x v + w v), q of any length. */
static inline void turn(const double q[4], double v[3])
{
    const double twice = 2 / (dot(q, q) + q[3] * q[3]);
    double inner[3], outer[3];
    cross(q, v, inner);
    for (int axis = 0; axis < 3; axis++)
        inner[axis] += q[3] * v[axis];
    cross(q, inner, outer);
    for (int axis = 0; axis < 3; axis++)
        v[axis] += twice * outer[axis];
}

/* Return where exactly a lane met its triangle of a mesh, and the triangle's unit normal in the world. */
static float met(const struct ray_world *around, const struct rays *rays, int lane,
                 float max_range, double normal[3])
{
    const uint32_t *face = around->faces[rays->triangle[lane]];
    const float *first = around->vertices[face[0]];
    double corner[3], sides[2][3], direction[3];
    for (int axis = 0; axis < 3; axis++) {
        corner[axis] = first[axis];
        direction[axis] = rays->world.direction[axis][lane];
        for (int i = 0; i < 2; i++)
            sides[i][axis] = around->vertices[face[i + 1]][axis] - corner[axis];
    }
    cross(sides[0], sides[1], normal);
    const double inverse_length = 1 / sqrt(dot(normal, normal));
    for (int axis = 0; axis < 3; axis++)
        normal[axis] *= inverse_length;
    if (rays->body[lane] >= 0) {
        const double *after, share = rays->share[lane];
        const double *pose = poses(around, rays->body[lane], rays->before[lane], &after);
        double q[4];
        mix(pose, after, share, q);
        turn(q, normal);
        turn(q, corner);
        for (int axis = 0; axis < 3; axis++)
            corner[axis] += pose[axis] + share * (after[axis] - pose[axis]);
    }
    for (int axis = 0; axis < 3; axis++)
        corner[axis] -= rays->world.origin[axis][lane];
    const double range = dot(normal, corner) / dot(normal, direction);
    const int near_by = fabs(range - rays->world.far[lane]) < MOST_MENDED;
    return near_by && range >= 0 && range <= max_range ? (float)range : rays->world.far[lane];
}

/* Start rays `first` to `end`, 8 at most, and meet the static world. */
static void meet_world(const struct ray_world *around, size_t count, size_t first, size_t end,
                       float max_range, const float *origins, const float *directions,
                       const float *times, struct rays *rays)
{
    struct packet *world = &rays->world;
    for (size_t lane = 0; lane < LANES; lane++) {
        const size_t ray = first + lane < end ? first + lane : end - 1;
        for (int axis = 0; axis < 3; axis++) {
            world->origin[axis][lane] = origins[axis * count + ray];
            world->direction[axis][lane] = directions[axis * count + ray];
        }
        world->far[lane] = first + lane < end ? max_range : -INFINITY; /* no ray, no work */
        float step = times[ray] * (float)(around->steps - 1);
        /* A pose's own instant may be rounded to just beside it, where the next pose would count,
         * which may not have come yet: what is that near to it (12 ns of 100 ms) is it. */
        const float nearest = (float)(int32_t)(step + 0.5f);
        if (fabsf(step - nearest) < 1.2e-7f * (float)around->steps)
            step = nearest;
        const int32_t before = (int32_t)step, last = around->steps - 2;
        rays->before[lane] = before < last ? before : last;
        rays->share[lane] = step - (float)rays->before[lane];
    }
    find(around, 0, world);
    for (int lane = 0; lane < LANES; lane++) {
        const int hit = world->ids[GEOMETRY][lane] != -1;
        rays->triangle[lane] = hit ? world->ids[TRIANGLE][lane] : -1;
        world->ids[GEOMETRY][lane] = -1;
        rays->body[lane] = STATIC;
        if (hit) /* `fetch` needs it when bodies have been met */
            __builtin_prefetch(around->faces[rays->triangle[lane]]);
    }
    if (around->terrain)
        groundlink_meet_terrain(around->terrain, rays);
}

/* Have the corners of the triangles that were met at hand when `met` needs them. */
static void fetch(const struct ray_world *around, const struct rays *rays)
{
    for (int lane = 0; lane < LANES; lane++)
        if (rays->triangle[lane] >= 0 && rays->body[lane] != TERRAIN)
            for (int corner = 0; corner < 3; corner++)
                __builtin_prefetch(
                    around->vertices[around->faces[rays->triangle[lane]][corner]]);
}

/* Trace rays `begin` to `end` of `count`. */
void groundlink_trace(const struct ray_world *around, size_t count, size_t begin, size_t end,
                      float max_range, const float *origins, const float *directions,
                      const float *times, float *range, float *normals, int32_t *labels,
                      int32_t *bodies)
{
    struct rays group[PACKETS] = {0};
    for (int packet = 0; packet < PACKETS; packet++) {
        memset(group[packet].world.mask, -1, sizeof group->world.mask);
        memset(group[packet].world.ids[GEOMETRY], -1, sizeof group->world.ids[GEOMETRY]);
        group[packet].own = group[packet].world;
    }
    while (begin < end) {
        int packets = 0;
        for (size_t first = begin; first < end && packets < PACKETS; first += LANES)
            meet_world(around, count, first, end, max_range, origins, directions, times,
                       &group[packets++]);
        if (around->bodies)
            groundlink_meet_bodies(around, group, packets);
        for (int packet = 0; packet < packets; packet++)
            fetch(around, &group[packet]);
        for (int i = 0; i < packets * LANES && begin < end; i++, begin++) {
            const struct rays *rays = &group[i / LANES];
            const int lane = i % LANES, triangle = rays->triangle[lane], body = rays->body[lane];
            double normal[3] = {0, 0, 0};
            if (triangle < 0) {
                range[begin] = INFINITY;
                labels[begin] = -1;
            } else if (body == TERRAIN) {
                range[begin] = rays->world.far[lane]; /* is exact */
                labels[begin] = groundlink_terrain_label(around->terrain, triangle, normal);
            } else {
                range[begin] = met(around, rays, lane, max_range, normal);
                labels[begin] = around->labels[triangle];
            }
            bodies[begin] = body < STATIC ? STATIC : body;
            for (size_t axis = 0; axis < 3; axis++)
                normals[axis * count + begin] = (float)normal[axis];
        }
    }
}
