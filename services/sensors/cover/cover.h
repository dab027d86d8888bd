// SPDX-License-Identifier: Apache-2.0
/* Water and grass on the terrain; `ground_cover.py` fills these structures and documents them. */

#ifndef GROUNDLINK_COVER_H
#define GROUNDLINK_COVER_H

#include "../../../groundlink/world/ruts.h"

struct grass {
    float lowest, span; /* heights of tufts */
    float extinction;   /* per meter, of a beam */
    int32_t label;
};

/* Of a square of cells. */
struct block {
    float top;       /* highest top of grass, or negative infinity */
    float steepness; /* rise of the ground along its steepest way */
};

/* A rectangle of grass under a vehicle, in the frame of its base as seen from above. */
struct pressed {
    float low[2], high[2];
    float clearance;
};

struct cover {
    const float *heights; /* of vertices, one more in each direction than there are cells */
    const uint8_t *kinds; /* of cells: 1 + number of the grass, or 0 */
    const struct block *blocks;
    double x0, y0, cell;
    int32_t rows, columns, block_columns; /* of cells, and of blocks */
    const struct grass *grass;
    const struct pressed *pressed;
    size_t pressed_count;
    int32_t first_water, waters;
    const struct rut_grid *ruts; /* or NULL */
    const float *slopes; /* of each area of water: mean square slope of its waves */
};

/* Rays and what they hit, component after component. */
struct covered_rays {
    size_t count, steps;
    const float *origins, *directions, *times;
    const float *places; /* x, y and heading of each pressing vehicle at each step */
    const float *draws;  /* two numbers of each ray, 0..1 */
    float max_range;
    float *range, *normals;
    int32_t *labels, *bodies;
};

#endif
