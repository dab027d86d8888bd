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

#include "beam.h"

/* A ray that nearly lies in a triangle's plane meets the plane far from the triangle. The engine's
 * own range stands if the plane's is farther off than this, in meters. */
static const double MOST_MENDED = 0.01;

/* What the rays of a packet met: of each the triangle's first corner and unit normal in the world,
 * and what is reported. */
struct met {
    double corner[3][LANES], normal[3][LANES];
    float range[LANES], reported_normal[3][LANES];
    int32_t label[LANES], body[LANES];
};

/* Take what a lane met from its body's frame to the world. */
static INLINED void move(const struct ray_world *around, const struct rays *rays, int lane,
                        struct met *met)
{
    const double *after, share = rays->share[lane];
    const double *pose = poses(around, rays->body[lane], rays->before[lane], &after);
    double q[4], corner[3], normal[3];
    mix(pose, after, share, q);
    for (int axis = 0; axis < 3; axis++) {
        corner[axis] = met->corner[axis][lane];
        normal[axis] = met->normal[axis][lane];
    }
    turn(q, normal);
    turn(q, corner);
    for (int axis = 0; axis < 3; axis++) {
        met->normal[axis][lane] = normal[axis];
        met->corner[axis][lane] = corner[axis] + (pose[axis] + share * (after[axis] - pose[axis]));
    }
}

/* Find where exactly the lanes of a packet met their triangles, and of these label and normal. */
static INLINED void meet_exactly(const struct ray_world *around, const struct rays *rays,
                                float max_range, struct met *met)
{
    static const float nowhere[3] = {0};
    const struct packet *world = &rays->world;
    const double most = max_range;
    double sides[2][3][LANES];
    EACH_LANE {
        const int32_t triangle = rays->triangle[lane], body = rays->body[lane];
        const int meshed = triangle >= 0 && body != TERRAIN;
        const float *corners[3] = {nowhere, nowhere, nowhere};
        met->label[lane] = -1;
        if (meshed) {
            const struct face *face = &around->faces[triangle];
            for (int i = 0; i < 3; i++)
                corners[i] = around->vertices[face->corners[i]];
            met->label[lane] = around->first_label[body + 1] + face->label;
        }
        met->body[lane] = body < STATIC ? STATIC : body;
        for (int axis = 0; axis < 3; axis++) {
            met->corner[axis][lane] = corners[0][axis];
            sides[0][axis][lane] = corners[1][axis];
            sides[1][axis][lane] = corners[2][axis];
        }
    }
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < 2; i++)
            EACH_LANE
                sides[i][axis][lane] -= met->corner[axis][lane];
    EACH_LANE {
        const double a[3] = {sides[0][0][lane], sides[0][1][lane], sides[0][2][lane]};
        const double b[3] = {sides[1][0][lane], sides[1][1][lane], sides[1][2][lane]};
        double normal[3];
        cross(a, b, normal);
        const double inverse_length = 1 / sqrt(dot(normal, normal));
        met->normal[0][lane] = normal[0] * inverse_length;
        met->normal[1][lane] = normal[1] * inverse_length;
        met->normal[2][lane] = normal[2] * inverse_length;
    }
    EACH_LANE
        if (rays->body[lane] >= 0)
            move(around, rays, lane, met);
    EACH_LANE {
        const double normal[3] = {met->normal[0][lane], met->normal[1][lane], met->normal[2][lane]};
        const double corner[3] = {met->corner[0][lane] - world->origin[0][lane],
                                  met->corner[1][lane] - world->origin[1][lane],
                                  met->corner[2][lane] - world->origin[2][lane]};
        const double direction[3] = {world->direction[0][lane], world->direction[1][lane],
                                     world->direction[2][lane]};
        const double range = dot(normal, corner) / dot(normal, direction), far = world->far[lane];
        double mended = fabs(range - far) < MOST_MENDED ? range : far;
        mended = range >= 0 ? mended : far;
        mended = range <= most ? mended : far;
        met->range[lane] = (float)mended;
    }
    for (int axis = 0; axis < 3; axis++)
        EACH_LANE
            met->reported_normal[axis][lane] = (float)met->normal[axis][lane];
    EACH_LANE {
        if (met->label[lane] >= 0)
            continue;
        double normal[3] = {0, 0, 0};
        if (rays->triangle[lane] >= 0) {
            double point[3];
            for (int axis = 0; axis < 3; axis++)
                point[axis] = world->origin[axis][lane] +
                              (double)world->far[lane] * world->direction[axis][lane];
            met->label[lane] =
                groundlink_terrain_label(around->terrain, rays->triangle[lane], point, normal);
        }
        met->range[lane] = rays->triangle[lane] >= 0 ? world->far[lane] : INFINITY; /* is exact */
        for (int axis = 0; axis < 3; axis++)
            met->reported_normal[axis][lane] = (float)normal[axis];
    }
}

/* Let the lanes of a packet meet nothing. */
static INLINED void meet_nothing(struct met *met)
{
    EACH_LANE {
        met->range[lane] = INFINITY;
        met->label[lane] = -1;
        met->body[lane] = STATIC;
        for (int axis = 0; axis < 3; axis++)
            met->reported_normal[axis][lane] = 0;
    }
}

/* Read the values of some lanes; those beyond get the last one's. */
static INLINED void load(const float *from, size_t lanes, float to[LANES])
{
    if (lanes == LANES)
        memcpy(to, from, LANES * sizeof *to);
    else
        for (size_t lane = 0; lane < LANES; lane++)
            to[lane] = from[lane < lanes ? lane : lanes - 1];
}

/* Write the values of some lanes, of 4 bytes each. */
static INLINED void store(const void *from, size_t lanes, void *to)
{
    if (lanes == LANES)
        memcpy(to, from, LANES * 4);
    else
        memcpy(to, from, lanes * 4);
}

/* Find the pose before each ray's time, and how far to the next that is. */
static INLINED void set_steps(const struct ray_world *around, struct rays *rays)
{
    const float steps = (float)(around->steps - 1), rounded = 1.2e-7f * (float)around->steps;
    const int32_t last = around->steps - 2;
    EACH_LANE {
        float step = rays->share[lane] * steps;
        /* A pose's own instant may be rounded to just beside it, where the next pose would count,
         * which may not have come yet: what is that near to it (12 ns of 100 ms) is it. */
        const float nearest = (float)(int32_t)(step + 0.5f);
        step = fabsf(step - nearest) < rounded ? nearest : step;
        const int32_t before = (int32_t)step;
        rays->before[lane] = before < last ? before : last;
        rays->share[lane] = step - (float)rays->before[lane];
    }
    rays->together = 1;
    for (int lane = 1; lane < LANES; lane++)
        rays->together &= rays->before[lane] == rays->before[0];
}

/* Start 8 rays from `first` on, or as many as there are. */
static INLINED void start(const struct ray_world *around, size_t count, size_t first,
                          float max_range, const float *origins, const float *directions,
                          const float *times, struct rays *rays)
{
    struct packet *world = &rays->world;
    const size_t lanes = count - first < LANES ? count - first : LANES;
    for (int axis = 0; axis < 3; axis++) {
        load(origins + axis * count + first, lanes, world->origin[axis]);
        load(directions + axis * count + first, lanes, world->direction[axis]);
    }
    load(times + first, lanes, rays->share);
    for (size_t lane = 0; lane < LANES; lane++)
        world->far[lane] = lane < lanes ? max_range : -INFINITY; /* no ray, no work */
    set_steps(around, rays);
    EACH_LANE {
        rays->triangle[lane] = -1;
        rays->body[lane] = STATIC;
    }
}

/* Meet the triangles of the static world. */
static INLINED void meet_world(const struct ray_world *around, struct rays *rays)
{
    static const int32_t all[LANES] __attribute__((aligned(64))) = {-1, -1, -1, -1, -1, -1, -1, -1};
    struct packet *world = &rays->world;
    find(around, 0, all, world);
    EACH_LANE {
        const int hit = world->ids[GEOMETRY][lane] != -1;
        rays->triangle[lane] = hit ? world->ids[TRIANGLE][lane] : -1;
        world->ids[GEOMETRY][lane] = -1;
    }
    EACH_LANE
        if (rays->triangle[lane] >= 0) /* `fetch` needs it when bodies have been met */
            __builtin_prefetch(&around->faces[rays->triangle[lane]]);
}

/* Tell whether any ray of a packet met anything. */
static INLINED int is_met(const struct rays *rays)
{
    int32_t all = -1;
    EACH_LANE
        all &= rays->triangle[lane];
    return all >= 0;
}

/* Have the corners of the triangles that were met at hand when `meet_exactly` needs them. */
static INLINED void fetch(const struct ray_world *around, const struct rays *rays)
{
    EACH_LANE
        if (rays->triangle[lane] >= 0 && rays->body[lane] != TERRAIN)
            for (int corner = 0; corner < 3; corner++)
                __builtin_prefetch(
                    around->vertices[around->faces[rays->triangle[lane]].corners[corner]]);
}

/* Trace rays. */
VECTORIZED void groundlink_trace(const struct ray_world *around, size_t count, float max_range,
                                 const float *origins, const float *directions, const float *times,
                                 float *range, float *normals, int32_t *labels, int32_t *bodies)
{
    struct rays group[PACKETS] = {0};
    for (int packet = 0; packet < PACKETS; packet++) {
        memset(group[packet].world.mask, -1, sizeof group->world.mask);
        memset(group[packet].world.ids[GEOMETRY], -1, sizeof group->world.ids[GEOMETRY]);
        group[packet].own = group[packet].world;
    }
    for (size_t begin = 0; begin < count;) {
        int packets = 0;
        for (size_t first = begin; first < count && packets < PACKETS; first += LANES)
            start(around, count, first, max_range, origins, directions, times, &group[packets++]);
        struct beam beam = beam_of(group, packets);
        if (entered(&around->still[0], &beam))
            for (int packet = 0; packet < packets; packet++)
                meet_world(around, &group[packet]);
        if (around->terrain && entered(&around->still[1], &beam))
            groundlink_meet_terrain(around->terrain, group, packets);
        if (around->bodies) {
            beam.far = farthest(group, packets);
            groundlink_meet_bodies(around, &beam, group, packets);
        }
        for (int packet = 0; packet < packets; packet++)
            fetch(around, &group[packet]);
        for (int packet = 0; packet < packets; packet++) {
            const size_t lanes = count - begin < LANES ? count - begin : LANES;
            struct met met;
            if (is_met(&group[packet]))
                meet_exactly(around, &group[packet], max_range, &met);
            else
                meet_nothing(&met);
            store(met.range, lanes, range + begin);
            store(met.label, lanes, labels + begin);
            store(met.body, lanes, bodies + begin);
            for (size_t axis = 0; axis < 3; axis++)
                store(met.reported_normal[axis], lanes, normals + axis * count + begin);
            begin += lanes;
        }
    }
}
