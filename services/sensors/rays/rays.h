// SPDX-License-Identifier: Apache-2.0
/* What the files of this folder share: packets of rays in Embree's own layout, trees of boxes, and
 * what the loops over rays know. */

#ifndef GROUNDLINK_RAYS_H
#define GROUNDLINK_RAYS_H

#include <stddef.h>
#include <stdint.h>

#include "../../../groundlink/world/ruts.h"
#include "vectorized.h"

/* As many as an AVX2 register holds. Packets of 16, which Embree cuts up on such processors, took
 * more than twice as long. */
#define LANES 8

/* Packets that are traced together: it is found out once for all of them what they may meet. */
#define PACKETS 8

/* A loop that compilers make one of vector instructions, before they unroll it. */
#define EACH_LANE _Pragma("GCC unroll 1") for (int lane = 0; lane < LANES; lane++)

enum { TRIANGLE, GEOMETRY, INSTANCE, INSTANCE_PRIMITIVE };

/* RTCRayHit8 of Embree 4.4; ids in the order of the enumeration above. */
struct packet {
    float origin[3][LANES], near[LANES], direction[3][LANES], time[LANES], far[LANES];
    int32_t mask[LANES], id[LANES], flags[LANES];
    float normal[3][LANES], u[LANES], v[LANES];
    int32_t ids[4][LANES];
} __attribute__((aligned(64)));

/* rtcIntersect8. For each lane with a `far` that is not negative it finds the nearest triangle of a
 * scene between 0 and `far`, and sets `far`, TRIANGLE, and GEOMETRY to 0; lanes that meet nothing
 * stay as they were. */
typedef void intersect8(const int32_t *valid, void *scene, struct packet *packet, void *arguments);

/* A tree is an array of nodes, the root first; the children of one lie side by side. */
struct box {
    float low[3], high[3];
};
struct node {
    struct box box;
    int32_t first; /* child, or in a leaf place in the order of items */
    int32_t items; /* of a leaf; 0 in others */
};

/* No tree is deeper than this. */
#define MOST_DEPTH 64

/* Heights on a square grid; a structure of the same name in `terrain.py` fills it. */
struct terrain {
    const float *heights;           /* one more in each direction than there are cells */
    const uint8_t *surface;         /* of each cell, what is added to the first label */
    const float *const *highest[2]; /* pyramids of the greatest heights, and upside down */
    double origin[3], per_m[3];     /* of the first height's x and y; cells in a meter, and 1 */
    double heights_within[2];       /* least and greatest */
    int32_t cells[2];               /* eastwards, northwards */
    int32_t first_label;
    int32_t parts;                  /* cells of ruts along the side of a cell */
    const struct rut_grid *ruts;    /* or NULL */
};

/* A triangle: numbers of its vertices, and its label less the first one of its scene. */
struct face {
    uint32_t corners[3];
    int32_t label;
};

/* What is in the scene; a structure of the same name in `scene.py` fills it. */
struct ray_world {
    intersect8 *intersect;
    void *const *scenes;           /* of the engine: the static world's, then each body's */
    const float (*vertices)[3];
    const struct face *faces;
    const int32_t *first_triangle; /* of each scene */
    const int32_t *first_label;
    const double (*poses)[7];      /* world_from_body: steps, bodies */
    const struct box *boxes;       /* of each body's mesh, in the body's frame */
    const struct node *nodes;      /* of the tree of boxes that hold a body on its whole way */
    const int32_t *order;
    const struct terrain *terrain; /* or NULL */
    const struct box *still;       /* around the static world's triangles, and the terrain */
    int32_t steps, bodies;
};

/* Of what does not move, in place of a body's number. */
enum { TERRAIN = -2, STATIC };

/* The rays under way, and of each the nearest triangle so far, -1 for none, and its body; the
 * terrain has triangles of its own. */
struct rays {
    struct packet world; /* `far` is that triangle's */
    struct packet own;   /* the same rays in a body's frame */
    int32_t before[LANES]; /* the pose before each ray's time, and how far to the next that is */
    float share[LANES];
    int together;                       /* whether all are between the same two poses */
    int32_t triangle[LANES], body[LANES];
};

static inline double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross(const double a[3], const double b[3], double result[3])
{
    result[0] = a[1] * b[2] - a[2] * b[1];
    result[1] = a[2] * b[0] - a[0] * b[2];
    result[2] = a[0] * b[1] - a[1] * b[0];
}

/* A body's poses before and after a time. */
static inline const double *poses(const struct ray_world *around, int32_t body, int32_t before,
                                  const double **after)
{
    const double *pose = around->poses[(ptrdiff_t)before * around->bodies + body];
    *after = pose + 7 * (ptrdiff_t)around->bodies;
    return pose;
}

/* Orientation between two, times any factor: by nlerp as in groundlink.core.frames. */
static inline void mix(const double *first, const double *second, double share, double q[4])
{
    double cosine = 0;
    for (int i = 3; i < 7; i++)
        cosine += first[i] * second[i];
    const double sign = cosine < 0 ? -1 : 1;
    for (int i = 0; i < 4; i++)
        q[i] = first[3 + i] + share * (sign * second[3 + i] - first[3 + i]);
}

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

/* Let the engine find what the valid lanes (-1) of a packet meet in one of its scenes. */
static inline void find(const struct ray_world *around, ptrdiff_t scene,
                        const int32_t valid[LANES], struct packet *packet)
{
    /* RTCIntersectArguments: of neighboring rays, for geometry of every kind. */
    static struct {
        int32_t flags;
        uint32_t feature_mask;
        void *context, *filter, *intersect;
    } coherent = {1 << 16, 0xFFFFFFFF, NULL, NULL, NULL};
    around->intersect(valid, around->scenes[scene], packet, &coherent);
}

/* Meet the terrain with some packets, before any body; in `terrain.c`. What was met there, its label and normal, is in
 * `cells.c`. */
void groundlink_meet_terrain(const struct terrain *terrain, struct rays *rays, int packets);
int32_t groundlink_terrain_label(const struct terrain *terrain, int32_t triangle,
                                 const double point[3], double normal[3]);

/* Meet all bodies that some packets, which are within a beam, may meet; in `bodies.c`. */
struct beam;
void groundlink_meet_bodies(const struct ray_world *around, const struct beam *beam,
                            struct rays *rays, int packets);

#endif
