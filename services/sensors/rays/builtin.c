// SPDX-License-Identifier: Apache-2.0
/* An engine of our own, for machines without Embree: plain C, one ray after the other, in float64.
 *
 * Rule: it answers as rtcIntersect8 does. A ray that meets the edge between two triangles meets one
 * of them: seen from its other side the sign of an edge function is exactly the opposite, however it
 * was rounded, as long as products and sums are not contracted.
 */

#include <math.h>

#include "rays.h"

/* A scene; a structure of the same name in `builtin.py` fills it. */
struct mesh {
    const float (*vertices)[3];
    const struct face *faces;
    const struct node *nodes; /* NULL if there are no triangles */
    const int32_t *order;
};

struct ray {
    double origin[3], direction[3], inverse[3], far;
    int32_t triangle;
};

/* Return where a ray enters a box, INFINITY when it misses it. */
static inline double entered(const struct box *box, const struct ray *ray)
{
    double near = 0, far = ray->far;
    for (int axis = 0; axis < 3; axis++) {
        const double a = (box->low[axis] - ray->origin[axis]) * ray->inverse[axis];
        const double b = (box->high[axis] - ray->origin[axis]) * ray->inverse[axis];
        const double in = a < b ? a : b, out = a < b ? b : a;
        near = in > near ? in : near;
        far = out < far ? out : far;
    }
    return near <= far * (1 + 1e-12) ? near : INFINITY; /* more than what was rounded */
}

static inline void meet(const struct mesh *mesh, int32_t triangle, struct ray *ray)
{
    double corner[3][3], side[3], normal[3], edge[2][3];
    int negative = 0, positive = 0;
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++)
            corner[k][axis] = mesh->vertices[mesh->faces[triangle].corners[k]][axis] - ray->origin[axis];
    for (int k = 0; k < 3; k++) {
        cross(corner[(k + 1) % 3], corner[k], side);
        const double sign = dot(ray->direction, side);
        negative |= sign < 0;
        positive |= sign > 0;
    }
    if (negative && positive)
        return;
    for (int axis = 0; axis < 3; axis++) {
        edge[0][axis] = corner[1][axis] - corner[0][axis];
        edge[1][axis] = corner[2][axis] - corner[0][axis];
    }
    cross(edge[0], edge[1], normal);
    const double along = dot(normal, corner[0]) / dot(normal, ray->direction);
    if (along >= 0 && along <= ray->far) { /* no number where the triangle is seen edge-on */
        ray->far = along;
        ray->triangle = triangle;
    }
}

/* Meet all triangles whose boxes the ray enters, near boxes first. */
static void walk(const struct mesh *mesh, struct ray *ray)
{
    struct {
        const struct node *node;
        double entry;
    } waiting[MOST_DEPTH], other, now = {mesh->nodes, entered(&mesh->nodes->box, ray)};
    for (int count = 0;;) {
        while (now.entry <= ray->far && !now.node->items) {
            now.node = mesh->nodes + now.node->first;
            now.entry = entered(&now.node->box, ray);
            other.node = now.node + 1;
            other.entry = entered(&other.node->box, ray);
            if (other.entry < now.entry) {
                waiting[count] = now;
                now = other;
            } else {
                waiting[count] = other;
            }
            count += waiting[count].entry < INFINITY;
        }
        if (now.entry <= ray->far)
            for (int32_t i = 0; i < now.node->items; i++)
                meet(mesh, mesh->order[now.node->first + i], ray);
        if (!count)
            return;
        now = waiting[--count];
    }
}

/* Answer as rtcIntersect8, but for normals and barycentric coordinates. */
void groundlink_intersect8(const int32_t *valid, void *scene, struct packet *packet, void *arguments)
{
    const struct mesh *mesh = scene;
    (void)arguments;
    for (int lane = 0; lane < LANES; lane++) {
        struct ray ray = {.far = packet->far[lane], .triangle = -1};
        if (!valid[lane] || ray.far < 0 || !mesh->nodes)
            continue;
        for (int axis = 0; axis < 3; axis++) {
            const double direction = packet->direction[axis][lane];
            ray.origin[axis] = packet->origin[axis][lane];
            ray.direction[axis] = direction;
            /* Never infinite: infinity times 0 would lose a box that the ray runs along. */
            ray.inverse[axis] =
                1 / (fabs(direction) > 1e-30 ? direction : copysign(1e-30, direction));
        }
        walk(mesh, &ray);
        if (ray.triangle >= 0) {
            packet->far[lane] = (float)ray.far;
            packet->ids[TRIANGLE][lane] = ray.triangle;
            packet->ids[GEOMETRY][lane] = 0;
        }
    }
}
