// SPDX-License-Identifier: Apache-2.0
/* What the passes over hits share.
 *
 * Arrays of beams are lasers by firings, those of rays have the rays of a beam side by side, vectors
 * are component after component. Light is counted in percent of what a white diffuse surface at the
 * same place would send back, power is light over distance squared.
 */

#ifndef GROUNDLINK_RETURNS_H
#define GROUNDLINK_RETURNS_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "../rays/vectorized.h"

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

/* Noise and loss by intensity and range, in even steps from 0; a structure of the same name in
 * `echo_bands.py` fills it. */
enum { BAND_CELLS = 128 };
struct band {
    float stddev, dropout;
};
struct echo_bands {
    float rows_per_intensity, columns_per_m;
    const struct band *cells; /* rows of one intensity */
};

/* Light beside the footprints of beams; a structure of the same name in `stray_light.py` fills it. */
struct blooming {
    float share;            /* of its light at the edge of a footprint, which falls */
    float per_rad;          /* by e in one over this, */
    float footprint, limit; /* radians from a beam's axis: from where on, and to where */
    int32_t firings;        /* at most so many to either side */
    const int32_t *first;   /* of each laser, in the next two, and their end */
    const int32_t *other, *shift; /* lasers that may be as near, and their firing beside one's own */
};

/* Light of the sun; a structure of the same name in `foreign_light.py` fills it. */
struct sunlight {
    float towards[3];
    float noise;       /* variance of the noise of a white surface in full sunlight, in the dark 1 */
    float glare;       /* light scattered by the optics over one over the chord to the sun squared, */
    float least_chord; /* which counts as no less than this, squared */
    float spread;      /* meters of noise of an echo at the threshold */
    float *lit, *scattered; /* room for a number of each ray */
};

/* A return of a beam that is none of its own light: a pulse of another LiDAR, whose power is `gain` times
 * that of the strongest echo of a surface, or 0 for noise at the threshold. `FALSE_RETURN` in
 * `foreign_light.py`. */
struct false_return {
    int32_t beam; /* number in the revolution */
    float range, gain;
};

struct receiver {
    size_t lasers, firings, rays;
    int32_t mode, received;
    float range_share, range_resolution, min_range, max_range, dropout;
    float cell; /* meters between returns that can be told apart */
    float least_power;
    const float *stddev, *bias;    /* of each laser */
    const float *reflectance;      /* by label, up to 1 where diffuse; at least one */
    float retroreflection;         /* reflectance of the ideal retroreflector */
    const struct weather *weather; /* or NULL */
    const struct echo_bands *bands; /* or NULL */
    float reach; /* of a footprint beyond its axis, in firings; 0: beams have no edges */
    const struct blooming *blooming; /* or NULL */
    const struct sunlight *sun; /* or NULL */
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

/* Percent that a surface sends back, as it is slanted; without a hit it has no meaning. */
static INLINED float light_of(const struct receiver *receiver, const struct hits *hits, size_t ray)
{
    const int32_t label = hits->labels[ray] & ~(hits->labels[ray] >> 31); /* -1 becomes 0 */
    const float cosine = hits->normals[ray] * hits->directions[ray] +
                         hits->normals[hits->rays + ray] * hits->directions[hits->rays + ray] +
                         hits->normals[2 * hits->rays + ray] * hits->directions[2 * hits->rays + ray];
    return 100 * receiver->reflectance[label] * fabsf(cosine);
}

/* Whether the range changes so much to the next hit of a laser that an edge may lie between them. */
#define EDGE_M 0.05f
static INLINED int leaps(float range, float next)
{
    return !(fabsf(range - next) < EDGE_M) && (range < INFINITY || next < INFINITY);
}

/* Echoes of a beam of one ray between two surfaces, from near to far; return how many, at most three.
 * `gaps` are where between a firing and the next an edge lies, 0..1. There are `firings` of a laser,
 * and `ray` is number `firing` of them. */
size_t groundlink_edge_echoes(const struct receiver *receiver, const struct hits *hits, size_t ray,
                              size_t firing, size_t firings, const float *gaps, struct echo *echoes);

/* Find for each ray the retroreflector of which it gets most light beside its footprint; `power` is 0
 * where there is none. Return whether any was hit; if not, nothing is written. */
int groundlink_bloom(const struct receiver *receiver, const struct hits *hits, size_t firings,
                     struct echo *stray);

/* Add that light to the echoes of a beam; return how many there are then, at most one more. */
size_t groundlink_add_stray(const struct receiver *receiver, const struct echo *stray,
                            struct echo *echoes, size_t count);

/* Weaken the echoes of surfaces that a beam met, which begins with `ray`, and append those of the air
 * before the nearest; return how many there are then. `draws` are three random numbers in 0..1,
 * `stride` apart. There is room for two more than there are clouds of dust. */
size_t groundlink_through_weather(const struct receiver *receiver, const struct hits *hits,
                                  size_t ray, const float *draws, size_t stride,
                                  struct echo *echoes, size_t count);

#endif
