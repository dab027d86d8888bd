// SPDX-License-Identifier: Apache-2.0
/* What rays meet in grass and on water.
 *
 * Rule: arithmetic of `ground_cover.py`, ray after ray; what it means stands there.
 */

#include "cover.h"

#include "../rays/vectorized.h"

#include <math.h>

enum { BLOCK = 16 }; /* cells of a block's side */
#define STEP_M 0.1f
#define TUFT_M 0.25f
#define BENT_M 0.02f /* height of grass in a rut */
#define LEAST_GLINT 1e-3f
#define FRESNEL 0.02f

struct ray {
    float origin[3], direction[3];
};

static INLINED int32_t within(float value, int32_t last)
{
    return value > 0 ? (value < last ? (int32_t)value : last) : 0;
}

/* Height of the terrain in a cell at a place in it, as `Ground.height_at`. */
static INLINED float height_at(const struct cover *cover, int32_t row, int32_t column, float u, float v)
{
    const float *south = cover->heights + (ptrdiff_t)row * (cover->columns + 1) + column;
    const float *north = south + cover->columns + 1;
    if (u + v <= 1)
        return south[0] + u * (south[1] - south[0]) + v * (north[0] - south[0]);
    return north[1] + (1 - v) * (south[1] - north[1]) + (1 - u) * (north[0] - north[1]);
}

/* A number of the tuft at a place, 0..1, the same for all sensors. */
static INLINED float tuft(float x, float y)
{
    uint32_t hash = (uint32_t)(int32_t)floorf(x / TUFT_M) * 0x9E3779B1u ^
                    (uint32_t)(int32_t)floorf(y / TUFT_M) * 0x85EBCA77u;
    hash ^= hash >> 15;
    hash *= 0x2C1B3C6Du;
    hash ^= hash >> 12;
    hash *= 0x297A2D39u;
    hash ^= hash >> 15;
    return (float)(hash >> 8) * 0x1p-24f;
}

/* Whether a wheel has pressed the ground at a place. */
static INLINED int is_rut(const struct rut_grid *ruts, float x, float y)
{
    const int64_t row = (int64_t)floor((y - ruts->y0) / ruts->cell + 0.5);
    return rut_depth(ruts, row, (int64_t)floor((x - ruts->x0) / ruts->cell + 0.5)) > 0;
}

/* Height that vehicles leave to grass at a place. */
static INLINED float left_standing(const struct cover *cover, const float *places, float x, float y,
                           float height)
{
    if (cover->ruts && cover->ruts->count && is_rut(cover->ruts, x, y))
        return fminf(height, BENT_M);
    for (size_t i = 0; i < cover->pressed_count; i++) {
        const struct pressed *pressed = &cover->pressed[i];
        const float *at = places + 4 * i, dx = x - at[0], dy = y - at[1];
        const float along = dx * at[2] + dy * at[3], across = dy * at[2] - dx * at[3];
        if (along >= pressed->low[0] && along <= pressed->high[0] && across >= pressed->low[1] &&
            across <= pressed->high[1])
            height = fminf(height, pressed->clearance);
    }
    return height;
}

/* Distance at which a ray leaves a cell. */
static INLINED float cell_end(const struct cover *cover, const float from[2], const float d[3],
                      int32_t column, int32_t row)
{
    const float cell = (float)cover->cell;
    float end = INFINITY;
    if (d[0] != 0)
        end = fminf(end, ((float)(column + (d[0] > 0)) * cell - from[0]) / d[0]);
    if (d[1] != 0)
        end = fminf(end, ((float)(row + (d[1] > 0)) * cell - from[1]) / d[1]);
    return end;
}

/* Find the grass that a ray meets before `end`, behind so much optical depth; return its distance,
 * or infinity, and its kind. */
static INLINED float meet_grass(const struct cover *cover, const struct ray *ray, const float *places,
                        float end, float depth, int32_t *kind)
{
    const float sides[2] = {(float)(cover->columns * cover->cell), (float)(cover->rows * cover->cell)};
    const float from[2] = {(float)(ray->origin[0] - cover->x0), (float)(ray->origin[1] - cover->y0)};
    const float block = (float)(BLOCK * cover->cell), *d = ray->direction;
    const float per_cell = (float)(1 / cover->cell), per_block = 1 / block;
    float at = 0;
    for (int axis = 0; axis < 2; axis++) {
        const float low = -from[axis] / d[axis], high = (sides[axis] - from[axis]) / d[axis];
        at = fmaxf(at, fminf(low, high)); /* fmax and fmin pass over NaN */
        end = fminf(end, fmaxf(low, high));
    }
    while (at < end) {
        /* A little farther, so that it is the block ahead. */
        const float x = from[0] + (at + 1e-3f) * d[0], y = from[1] + (at + 1e-3f) * d[1];
        const int32_t column = within(x * per_block, (cover->columns - 1) / BLOCK);
        const int32_t row = within(y * per_block, (cover->rows - 1) / BLOCK);
        float leaves = end;
        if (d[0] != 0)
            leaves = fminf(leaves, ((float)(column + (d[0] > 0)) * block - from[0]) / d[0]);
        if (d[1] != 0)
            leaves = fminf(leaves, ((float)(row + (d[1] > 0)) * block - from[1]) / d[1]);
        leaves = fmaxf(leaves, at + 1e-3f);
        const struct block *ahead =
            &cover->blocks[(ptrdiff_t)row * cover->block_columns + column];
        const float lowest = ray->origin[2] + fminf(at * d[2], leaves * d[2]);
        if (lowest > ahead->top) {
            at = leaves;
            continue;
        }
        leaves = fminf(leaves, end);
        const float closing = ahead->steepness + fmaxf(0, -d[2]) + 1e-3f;
        while (at < leaves) {
            const float middle = at + STEP_M / 2;
            const float px = from[0] + middle * d[0], py = from[1] + middle * d[1];
            const float u = px * per_cell, v = py * per_cell;
            const int32_t c = within(u, cover->columns - 1), r = within(v, cover->rows - 1);
            const float ground = height_at(cover, r, c, u - (float)c, v - (float)r);
            const float above = ray->origin[2] + middle * d[2] - ground;
            const int32_t number = cover->kinds[(ptrdiff_t)r * cover->columns + c];
            float step = STEP_M;
            if (number) {
                const struct grass *grass = &cover->grass[number - 1];
                const float wx = ray->origin[0] + middle * d[0];
                const float wy = ray->origin[1] + middle * d[1];
                if (above > grass->lowest + grass->span) {
                    step = fmaxf(step, (above - grass->lowest - grass->span) / closing);
                } else if (above < left_standing(cover, places, wx, wy,
                                                 grass->lowest + grass->span * tuft(wx, wy))) {
                    const float met = depth / grass->extinction;
                    if (met < STEP_M) {
                        *kind = number - 1;
                        return at + met < end ? at + met : INFINITY;
                    }
                    depth -= STEP_M * grass->extinction;
                }
            } else {
                step = fmaxf(step, cell_end(cover, from, d, c, r) - at);
            }
            at = fminf(at + step, leaves);
        }
    }
    return INFINITY;
}

/* Give what a ray met the normal of a leaf. */
static INLINED void find_leaf(const struct ray *ray, float draw, float normal[3])
{
    const float cosine = sqrtf(draw), sine = sqrtf(1 - draw), *d = ray->direction;
    const float level = sqrtf(d[0] * d[0] + d[1] * d[1]);
    const float side[2] = {level > 0 ? -d[1] / level : 1, level > 0 ? d[0] / level : 0};
    normal[0] = sine * side[0] - cosine * d[0];
    normal[1] = sine * side[1] - cosine * d[1];
    normal[2] = -cosine * d[2];
}

VECTORIZED void groundlink_cover(const struct cover *cover, const struct covered_rays *rays)
{
    const size_t count = rays->count;
    for (size_t i = 0; i < count; i++) {
        struct ray ray;
        for (int axis = 0; axis < 3; axis++) {
            ray.origin[axis] = rays->origins[axis * count + i];
            ray.direction[axis] = rays->directions[axis * count + i];
        }
        const int32_t water = rays->labels[i] - cover->first_water;
        if (water >= 0 && water < cover->waters) {
            const float cosine = fabsf(rays->normals[2 * count + i] * ray.direction[2]);
            const float square = cosine * cosine, slopes = cover->slopes[water];
            const float glint = FRESNEL / (4 * slopes * square * square * cosine) *
                                expf(-(1 / square - 1) / slopes);
            if (glint >= LEAST_GLINT) {
                rays->normals[2 * count + i] *= fminf(glint, 1) / cosine;
            } else {
                rays->normals[2 * count + i] = 0;
                rays->labels[i] = -1;
            }
        }
        if (!cover->grass)
            continue;
        const float *places = rays->places;
        if (cover->pressed_count)
            places += 4 * cover->pressed_count *
                      (size_t)(rays->times[i] * (float)(rays->steps - 1) + 0.5f);
        int32_t kind;
        const float range = meet_grass(cover, &ray, places, fminf(rays->range[i], rays->max_range),
                                       -logf(1 - rays->draws[i]), &kind);
        if (range < INFINITY) {
            float normal[3];
            find_leaf(&ray, rays->draws[count + i], normal);
            for (int axis = 0; axis < 3; axis++)
                rays->normals[axis * count + i] = normal[axis];
            rays->range[i] = range;
            rays->labels[i] = cover->grass[kind].label;
            rays->bodies[i] = -1;
        }
    }
    /* Water without a glint hides what is behind it. */
    for (size_t i = 0; i < count; i++)
        if (rays->labels[i] < 0)
            rays->range[i] = INFINITY;
}
