// SPDX-License-Identifier: Apache-2.0
/* What a receiver makes of hits.
 *
 * Rule: arithmetic of `returns.py`, beam after beam in one pass; what it means stands there.
 */

#include "returns.h"

enum { WHITE_AT_M = 10, MOST_RAYS = 64 };

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
    const float row = fminf(intensity * bands->rows_per_intensity + 0.5f, BAND_CELLS - 1);
    const float column = fminf(range * bands->columns_per_m + 0.5f, BAND_CELLS - 1);
    return bands->cells + (size_t)(int32_t)row * BAND_CELLS + (int32_t)column;
}

/* Report an echo: noise, the laser's own error, rounding, limits, loss. Or none, which is infinite,
 * to the negative where something was too `near`. */
static inline void report(const struct receiver *receiver, const struct echo *echo, int near,
                          size_t laser, const float *white, const float *lost, size_t draw,
                          const struct returns *returns, size_t to)
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
                   const struct echo *chosen[2])
{
    const struct echo *last = NULL, *strongest = NULL, *second = NULL;
    for (const struct echo *echo = echoes; echo < echoes + count; echo++) {
        if (echo->power < receiver->least_power)
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

/* Measure firings `first` to `end`. Of hits and returns there are only these firings; random numbers
 * are of the whole revolution, or NULL where none are needed. `stray` has room for an echo of each
 * beam where there is blooming. */
void groundlink_returns(const struct receiver *receiver, const struct hits *hits,
                        const struct returns *returns, size_t first, size_t end,
                        const float *white, const float *lost, const float *air,
                        const float *gaps, struct echo *stray)
{
    const size_t beams = receiver->lasers * receiver->firings, cast = receiver->lasers * (end - first);
    const size_t clouds = receiver->weather ? receiver->weather->clouds : 0;
    struct echo echoes[MOST_RAYS + 3 + clouds];
    const struct echo *chosen[2];
    const int dual = receiver->mode == DUAL, plain = receiver->rays == 1 && !receiver->weather && !dual;
    const int blooms = receiver->blooming && groundlink_bloom(receiver, hits, end - first, stray);

    for (size_t laser = 0; laser < receiver->lasers; laser++)
        for (size_t firing = first; firing < end; firing++) {
            const size_t beam = laser * receiver->firings + firing;
            const size_t to = laser * (end - first) + firing - first;
            const int edge = receiver->reach > 0 &&
                             ((firing > first && leaps(hits->range[to], hits->range[to - 1])) ||
                              (firing + 1 < end && leaps(hits->range[to], hits->range[to + 1])));
            const int bloomed = blooms && stray[to].power > 0;
            if (plain && !edge && !bloomed) {
                const size_t count = axis_echo(receiver, hits, to, echoes);
                const int seen = count && !(echoes->power < receiver->least_power);
                report(receiver, seen ? echoes : NULL, 0, laser, white, lost, beam, returns, to);
                continue;
            }
            const size_t ray = to * receiver->rays;
            int near = 0;
            size_t count = edge ? groundlink_edge_echoes(receiver, hits, to, firing - first,
                                                         end - first, gaps + beam, echoes)
                                : beam_echoes(receiver, hits, ray, echoes, &near);
            if (bloomed)
                count = groundlink_add_stray(receiver, &stray[to], echoes, count);
            if (receiver->weather)
                count = groundlink_through_weather(receiver, hits, ray, air + beam, beams, echoes,
                                                   count);
            choose(receiver, echoes, count, chosen);
            report(receiver, chosen[0], near, laser, white, lost, beam, returns, to);
            if (dual)
                report(receiver, chosen[1], near, laser, white, lost, beams + beam, returns,
                       cast + to);
        }
}
