// SPDX-License-Identifier: Apache-2.0
/* Rays through Embree, 8 at once, and what their hits mean.
 *
 * Rule: the loop of `scene.py` that would cost more in the interpreter than in Embree. It is loaded
 * by ctypes, knows nothing of Python, and needs no header of Embree's: the function to call comes as
 * a pointer. Arrays of vectors are component after component, `count` values each.
 */

#include <math.h>
#include <stddef.h>
#include <stdint.h>

/* As many as an AVX2 register holds. Packets of 16, which Embree cuts up on such processors, took
 * more than twice as long. */
#define LANES 8

enum { TRIANGLE, GEOMETRY, INSTANCE, BODY };

typedef void (*intersect8)(const int32_t *valid, void *scene, void *packet, void *arguments);

/* RTCRayHit8 of Embree 4.4; ids in the order of the enumeration above. */
struct packet {
    float origin[3][LANES], near[LANES], direction[3][LANES], time[LANES], far[LANES];
    int32_t mask[LANES], id[LANES], flags[LANES];
    float normal[3][LANES], u[LANES], v[LANES];
    int32_t ids[4][LANES];
} __attribute__((aligned(64)));

/* RTCIntersectArguments: of neighbouring rays, for geometry of every kind. */
static struct {
    int32_t flags;
    uint32_t feature_mask;
    void *context, *filter, *intersect;
} coherent = {1 << 16, 0xFFFFFFFF, NULL, NULL, NULL};

/* What is in the scene; a structure of the same name in `scene.py` fills it. */
struct surroundings {
    void *scene;
    const int32_t *labels;         /* of all triangles: the static world's, then each body's */
    const int32_t *first_triangle; /* of the static world, then of each body */
    const float *matrices;         /* world_from_body: steps, bodies, 4 columns of 4 */
    int32_t steps, bodies;
};

/* Turn a vector of a body's frame into the world's, as the body stands at a time in 0..1. */
static void rotate(float vector[3], const struct surroundings *around, int32_t body, float time)
{
    float step = time * (float)(around->steps - 1);
    int32_t before = (int32_t)step;
    if (before > around->steps - 2)
        before = around->steps - 2;
    float fraction = step - (float)before;
    const float *first = around->matrices + 16 * ((ptrdiff_t)before * around->bodies + body);
    const float *second = first + 16 * (ptrdiff_t)around->bodies;
    float rotated[3] = {0, 0, 0};
    for (int column = 0; column < 3; column++)
        for (int row = 0; row < 3; row++) {
            float from = first[4 * column + row], to = second[4 * column + row];
            rotated[row] += (from + fraction * (to - from)) * vector[column];
        }
    for (int row = 0; row < 3; row++)
        vector[row] = rotated[row];
}

/* Trace rays `begin` to `end` of `count`. */
void groundlink_trace(intersect8 intersect, const struct surroundings *around, size_t count,
                      size_t begin, size_t end, float max_range, const float *origins, const float *directions,
                      const float *times, float *range, float *normals, int32_t *labels,
                      int32_t *bodies)
{
    static const int32_t valid[LANES] __attribute__((aligned(64))) = {-1, -1, -1, -1, -1, -1, -1, -1};
    struct packet packet = {0};

    for (size_t lane = 0; lane < LANES; lane++)
        packet.mask[lane] = -1;
    for (size_t first = begin; first < end; first += LANES) {
        size_t lanes = end - first < LANES ? end - first : LANES;
        for (size_t lane = 0; lane < LANES; lane++) {
            packet.ids[GEOMETRY][lane] = -1;
            packet.far[lane] = lane < lanes ? max_range : -INFINITY; /* no ray, no work */
        }
        for (size_t axis = 0; axis < 3; axis++)
            for (size_t lane = 0; lane < lanes; lane++) {
                packet.origin[axis][lane] = origins[axis * count + first + lane];
                packet.direction[axis][lane] = directions[axis * count + first + lane];
            }
        for (size_t lane = 0; lane < lanes; lane++)
            packet.time[lane] = times[first + lane];

        intersect(valid, around->scene, &packet, &coherent);

        for (size_t lane = 0; lane < lanes; lane++) {
            size_t ray = first + lane;
            float normal[3] = {0, 0, 0}, inverse_length = 0;
            range[ray] = INFINITY;
            labels[ray] = bodies[ray] = -1;
            if (packet.ids[GEOMETRY][lane] != -1) {
                int32_t body = packet.ids[INSTANCE][lane] == 1 ? packet.ids[BODY][lane] : -1;
                int32_t triangle = packet.ids[TRIANGLE][lane];
                for (size_t axis = 0; axis < 3; axis++)
                    normal[axis] = packet.normal[axis][lane];
                /* Embree's normals are in the body's frame and as long as the triangle is large. */
                if (body >= 0)
                    rotate(normal, around, body, times[ray]);
                inverse_length = 1 / sqrtf(normal[0] * normal[0] + normal[1] * normal[1] +
                                           normal[2] * normal[2]);
                range[ray] = packet.far[lane];
                bodies[ray] = body;
                labels[ray] = around->labels[around->first_triangle[body + 1] + triangle];
            }
            for (size_t axis = 0; axis < 3; axis++)
                normals[axis * count + ray] = normal[axis] * inverse_length;
        }
    }
}
