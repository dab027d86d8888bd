// SPDX-License-Identifier: Apache-2.0
/* What the passes over hits share.
 *
 * Arrays of beams are lasers by firings, those of rays have the rays of a beam side by side, vectors
 * are component after component. Light is counted in percent of what a white diffuse surface at the
 * same place would send back, power is light over distance squared.
 */

#ifndef GROUNDLINK_RETURNS_H
#define GROUNDLINK_RETURNS_H

#include <stddef.h>
#include <stdint.h>

enum { STRONGEST, LAST, DUAL };

/* A box of dust. */
struct cloud {
    float low[3], high[3];
    float extinction, haze; /* as of `struct weather` */
};

/* Structures of the same names in `weather.py` and `returns.py` fill these. */
struct weather {
    float extinction; /* per meter, everywhere */
    float haze;       /* light that comes back from where a pulse enters the fog */
    float near;       /* where echoes of the air begin */
    float drops_per_mm;
    size_t steps, clouds;
    const float *ranges, *drops, *least_mm; /* of each step: how many drops up to there are seen,
                                               and how large the least of these are */
    const struct cloud *dust;
};

struct receiver {
    size_t lasers, firings, rays;
    int32_t mode, received;
    float range_share, range_resolution, min_range, max_range, dropout;
    float cell; /* meters between returns that can be told apart */
    float least_power;
    const float *stddev, *bias;    /* of each laser */
    const float *reflectance;      /* by label, up to 1 where diffuse */
    float retroreflection;         /* reflectance of the ideal retroreflector */
    const struct weather *weather; /* or NULL */
};

struct hits {
    size_t rays;
    const float *origins, *directions, *range, *normals;
    const int32_t *labels, *bodies;
};

struct returns {
    float *range;
    uint8_t *returned;
    float *intensity, *true_range;
    int32_t *labels, *bodies, *rays;
};

struct echo {
    float range, light, power;
    int32_t label, body, ray; /* of the ray that brings most of it, and its number in the beam */
};

/* Weaken the echoes of surfaces that a beam met, which begins with `ray`, and append those of the air
 * before the nearest; return how many there are then. `draws` are three random numbers in 0..1,
 * `stride` apart. There is room for two more than there are clouds of dust. */
size_t groundlink_through_weather(const struct receiver *receiver, const struct hits *hits,
                                  size_t ray, const float *draws, size_t stride,
                                  struct echo *echoes, size_t count);

#endif
