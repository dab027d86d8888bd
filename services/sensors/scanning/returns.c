// SPDX-License-Identifier: Apache-2.0
/* What a receiver makes of hits.
 *
 * Rule: arithmetic of `returns.py`, beam after beam in one pass; what it means stands there.
 */

#include "returns.h"

enum { WHITE_AT_M = 10, MOST_RAYS = 64 };

/* Noise of sunlight that is left out, as a variance in units of the other noise. */
#define FAINT 0.01f

/* Rounding does not take noise below the threshold. */
#define ABOVE 1.00001f

/* The one echo of a beam of one ray; return whether there is one. */
static inline size_t axis_echo(const struct receiver *receiver, const struct hits *hits, size_t ray,
                               struct echo *echo)
{
    if (hits->labels[ray] < 0)
        return 0;
    const float range = hits->range[ray], light = light_of(receiver, hits, ray);
    *echo = (struct echo){range, light, light / (range * range), hits->labels[ray],
                          hits->bodies[ray], 0};
    return 1;
}

/* Echoes of what the rays of a beam hit, from near to far; return how many. What is too near sends
 * none, and sets `near`. */
static size_t beam_echoes(const struct receiver *receiver, const struct hits *hits, size_t first,
                          struct echo *echoes, int *near)
{
    size_t order[MOST_RAYS], hit = 0, count = 0;
    for (size_t ray = first; ray < first + receiver->rays; ray++) {
        if (hits->labels[ray] < 0)
            continue;
        size_t place = hit++;
        for (; place && hits->range[order[place - 1]] > hits->range[ray]; place--)
            order[place] = order[place - 1];
        order[place] = ray;
    }
    for (size_t i = 0; i < hit;) {
        const float nearest = hits->range[order[i]];
        float before = nearest, brightest = -1, light = 0, power = 0, beyond = 0;
        struct echo echo = {0};
        for (; i < hit && hits->range[order[i]] - before <= receiver->cell; i++) {
            const size_t ray = order[i];
            const float its = light_of(receiver, hits, ray);
            /* What reflects nothing has a place, too, where there is no threshold. */
            const float its_power = its / (hits->range[ray] * hits->range[ray]) + 1e-30f;
            before = hits->range[ray];
            light += its;
            power += its_power;
            beyond += its_power * (before - nearest);
            if (its_power > brightest) {
                brightest = its_power;
                echo.label = hits->labels[ray];
                echo.body = hits->bodies[ray];
                echo.ray = (int32_t)(ray - first);
            }
        }
        echo.range = nearest + beyond / power;
        echo.light = light / (float)receiver->rays;
        echo.power = power / (float)receiver->rays;
        if (echo.range >= receiver->min_range)
            echoes[count++] = echo;
        else
            *near = 1;
    }
    return count;
}

/* Intensity as the device reports it. */
static inline float intensity_of(const struct receiver *receiver, const struct echo *echo)
{
    if (receiver->received)
        return echo->power * (WHITE_AT_M * WHITE_AT_M);
    if (echo->light <= 100)
        return rintf(echo->light);
    return rintf(101 + 154 * fminf(1, echo->light / (100 * receiver->retroreflection)));
}

/* The cell of a table at an intensity and a range. */
static inline const struct band *band_at(const struct echo_bands *bands, float intensity, float range)
{
    const float row = intensity * bands->rows_per_intensity + 0.5f;
    const float column = range * bands->columns_per_m + 0.5f;
    /* Not fminf, which is a call. */
    return bands->cells + (int32_t)(row < BAND_CELLS - 1 ? row : BAND_CELLS - 1) * BAND_CELLS +
           (int32_t)(column < BAND_CELLS - 1 ? column : BAND_CELLS - 1);
}

/* Find for each ray how much sunlight falls on the side of the surface that it sees, and how much the
 * optics scatter, both in units of a white surface in full sunlight; without a hit the first has no
 * meaning. A pass of its own, which compilers turn into one over four rays at a time. */
static void find_sunlight(const struct sunlight *sun, size_t rays, const float *restrict normals,
                          const float *restrict directions, float *restrict lit,
                          float *restrict scattered)
{
    const float x = sun->towards[0], y = sun->towards[1], z = sun->towards[2];
    const float glare = sun->glare, least_chord = sun->least_chord;
    for (size_t ray = 0; ray < rays; ray++) {
        const float nx = normals[ray], ny = normals[rays + ray], nz = normals[2 * rays + ray];
        const float dx = directions[ray], dy = directions[rays + ray], dz = directions[2 * rays + ray];
        const float seen = nx * dx + ny * dy + nz * dz, sunny = nx * x + ny * y + nz * z;
        /* Positive where both are on the same side of the surface. */
        const float towards = copysignf(1, -seen) * sunny;
        lit[ray] = (fabsf(towards) + towards) / 2;
        const float beyond = 2 - 2 * (dx * x + dy * y + dz * z) - least_chord;
        scattered[ray] = glare / (least_chord + (fabsf(beyond) + beyond) / 2);
    }
}

/* Variance of the noise that sunlight adds to a beam, which begins with `first`; in the dark it is 1. */
static inline float sunlit_noise(const struct receiver *receiver, const struct hits *hits, size_t first)
{
    const struct sunlight *sun = receiver->sun;
    float light = 0;
    for (size_t ray = first; ray < first + receiver->rays; ray++) {
        light += sun->scattered[ray];
        if (hits->labels[ray] >= 0) {
            const float reflectance = receiver->reflectance[hits->labels[ray]];
            light += (reflectance < 1 ? reflectance : 1) * sun->lit[ray];
        }
    }
    return sun->noise * light / (float)receiver->rays;
}

/* Whether an echo is above the threshold, which follows the noise. */
static inline int is_seen(const struct receiver *receiver, float power, float sunlit)
{
    const float least = receiver->least_power;
    return sunlit > 0 ? power * power >= least * least * (1 + sunlit) : !(power < least);
}

/* Report an echo: noise, the laser's own error, rounding, limits, loss. Or none, which is infinite,
 * to the negative where something was too `near`. */
static inline void report(const struct receiver *receiver, const struct echo *echo, int near,
                          float sunlit, size_t laser, const float *white, const float *lost,
                          size_t draw, const struct returns *returns, size_t to)
{
    if (!echo) {
        returns->range[to] = near ? -INFINITY : INFINITY;
        returns->true_range[to] = INFINITY;
        returns->returned[to] = 0;
        returns->intensity[to] = 0;
        returns->labels[to] = returns->bodies[to] = -1;
        returns->rays[to] = 0;
        return;
    }
    const float step = receiver->range_resolution;
    const float intensity = intensity_of(receiver, echo);
    float measured = echo->range, banded = 0, dropout = receiver->dropout;
    if (receiver->bands) {
        const struct band *band = band_at(receiver->bands, intensity, echo->range);
        banded = band->stddev;
        dropout += (1 - dropout) * band->dropout;
    }
    if (white) {
        float stddev = receiver->stddev[laser];
        if (receiver->range_share > 0) {
            const float share = receiver->range_share * echo->range;
            stddev = sqrtf(stddev * stddev + share * share);
        }
        if (banded > 0)
            stddev = stddev > 0 ? sqrtf(stddev * stddev + banded * banded) : banded;
        if (sunlit > 0) {
            const float spread = receiver->sun->spread * receiver->least_power;
            const float square = stddev * stddev * echo->power * echo->power;
            const float added = sunlit * spread * spread;
            if (added > FAINT * square)
                stddev = sqrtf(square + added) / echo->power;
        }
        measured += stddev * white[draw];
    }
    measured += receiver->bias[laser];
    if (step > 0)
        measured = rintf(measured / step) * step;
    returns->range[to] = measured;
    returns->returned[to] = measured >= receiver->min_range && measured <= receiver->max_range &&
                            !(lost && lost[draw] < dropout);
    returns->intensity[to] = intensity;
    returns->true_range[to] = echo->range;
    returns->labels[to] = echo->label;
    returns->bodies[to] = echo->body;
    returns->rays[to] = echo->ray;
}

/* Choose those echoes that are reported, first and second; NULL where there is none. */
static void choose(const struct receiver *receiver, const struct echo *echoes, size_t count,
                   float sunlit, const struct echo *chosen[2])
{
    const struct echo *last = NULL, *strongest = NULL, *second = NULL;
    for (const struct echo *echo = echoes; echo < echoes + count; echo++) {
        if (!is_seen(receiver, echo->power, sunlit))
            continue;
        if (!last || echo->range > last->range)
            last = echo;
        if (!strongest || echo->power > strongest->power) {
            second = strongest;
            strongest = echo;
        } else if (!second || echo->power > second->power) {
            second = echo;
        }
    }
    chosen[0] = receiver->mode == STRONGEST ? strongest : last;
    chosen[1] = strongest == last ? second : strongest;
}

/* Append a false return to the echoes of a beam; return how many there are then. */
static size_t add_false(const struct receiver *receiver, const struct false_return *foreign,
                        float sunlit, struct echo *echoes, size_t count)
{
    const float range = foreign->range, gain = foreign->gain;
    float power = gain > 0 ? 0 : receiver->least_power * sqrtf(1 + sunlit) * ABOVE;
    for (size_t i = 0; gain > 0 && i < count; i++)
        if (echoes[i].label >= 0)
            power = fmaxf(power, gain * echoes[i].power);
    if (!(power > 0))
        return count;
    echoes[count] = (struct echo){range, power * range * range, power, -1, -1, 0};
    return count + 1;
}

/* Measure firings `first` to `end`. Of hits and returns there are only these firings; random numbers
 * are of the whole revolution, or NULL where none are needed. `stray` has room for an echo of each
 * beam where there is blooming. `foreign` has the false returns of the revolution in the order of beams; the
 * last one is of a beam after all. */
void groundlink_returns(const struct receiver *receiver, const struct hits *hits,
                        const struct returns *returns, size_t first, size_t end,
                        const float *white, const float *lost, const float *air,
                        const float *gaps, const struct false_return *foreign,
                        struct echo *stray)
{
    const size_t beams = receiver->lasers * receiver->firings, cast = receiver->lasers * (end - first);
    const size_t clouds = receiver->weather ? receiver->weather->clouds : 0;
    struct echo echoes[MOST_RAYS + 4 + clouds];
    const struct echo *chosen[2];
    const int dual = receiver->mode == DUAL, plain = receiver->rays == 1 && !receiver->weather && !dual;
    const int blooms = receiver->blooming && groundlink_bloom(receiver, hits, end - first, stray);
    if (receiver->sun)
        find_sunlight(receiver->sun, hits->rays, hits->normals, hits->directions,
                      receiver->sun->lit, receiver->sun->scattered);

    for (size_t laser = 0; laser < receiver->lasers; laser++)
        for (size_t firing = first; firing < end; firing++) {
            const size_t beam = laser * receiver->firings + firing;
            const size_t to = laser * (end - first) + firing - first;
            const int edge = receiver->reach > 0 &&
                             ((firing > first && leaps(hits->range[to], hits->range[to - 1])) ||
                              (firing + 1 < end && leaps(hits->range[to], hits->range[to + 1])));
            const int bloomed = blooms && stray[to].power > 0;
            while ((size_t)foreign->beam < beam)
                foreign++;
            const int is_false = (size_t)foreign->beam == beam;
            if (plain && !edge && !bloomed && !is_false) {
                const size_t count = axis_echo(receiver, hits, to, echoes);
                const float sunlit = count && receiver->sun ? sunlit_noise(receiver, hits, to) : 0;
                const int seen = count && is_seen(receiver, echoes->power, sunlit);
                report(receiver, seen ? echoes : NULL, 0, sunlit, laser, white, lost, beam, returns,
                       to);
                continue;
            }
            const size_t ray = to * receiver->rays;
            const float sunlit = receiver->sun ? sunlit_noise(receiver, hits, ray) : 0;
            int near = 0;
            size_t count = edge ? groundlink_edge_echoes(receiver, hits, to, firing - first,
                                                         end - first, gaps + beam, echoes)
                                : beam_echoes(receiver, hits, ray, echoes, &near);
            if (bloomed)
                count = groundlink_add_stray(receiver, &stray[to], echoes, count);
            if (receiver->weather)
                count = groundlink_through_weather(receiver, hits, ray, air + beam, beams, echoes,
                                                   count);
            if (is_false)
                count = add_false(receiver, foreign, sunlit, echoes, count);
            choose(receiver, echoes, count, sunlit, chosen);
            report(receiver, chosen[0], near, sunlit, laser, white, lost, beam, returns, to);
            if (dual)
                report(receiver, chosen[1], near, sunlit, laser, white, lost, beams + beam, returns,
                       cast + to);
        }
}
