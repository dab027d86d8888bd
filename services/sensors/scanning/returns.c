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

/* So many beams of a laser are measured together that what is known of them stays in the nearest
 * cache. */
enum { CHUNK = 256 };

/* What of these beams is reported: an echo, or none, whose range is infinite, to the negative where
 * something was too near. */
struct reported {
    float range[CHUNK], light[CHUNK], power[CHUNK];
    float sunlit[CHUNK]; /* variance of the noise of sunlight */
};

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
static INLINED float intensity_of(const struct receiver *receiver, float light, float power)
{
    if (receiver->received)
        return power * (WHITE_AT_M * WHITE_AT_M);
    const float share = light / (100 * receiver->retroreflection);
    const float retroreflected = rintf(101 + 154 * (share < 1 ? share : 1));
    return light <= 100 ? rintf(light) : retroreflected;
}

/* The cell of a table at an intensity and a range. */
static INLINED const struct band *band_at(const struct echo_bands *bands, float intensity, float range)
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
static INLINED float sunlit_noise(const struct receiver *receiver, const struct hits *hits, size_t first)
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
static INLINED int is_seen(const struct receiver *receiver, float power, float sunlit)
{
    const float least = receiver->least_power;
    return sunlit > 0 ? power * power >= least * least * (1 + sunlit) : !(power < least);
}

/* Set an echo, or none, to be reported; `to` is the return's place. */
static INLINED void set(struct reported *reported, size_t place, const struct echo *echo, int near,
                        float sunlit, const struct returns *returns, size_t to)
{
    static const struct echo none = {.range = INFINITY, .label = -1, .body = -1};
    const struct echo *of = echo ? echo : &none;
    reported->range[place] = echo || !near ? of->range : -INFINITY;
    reported->light[place] = of->light;
    reported->power[place] = of->power;
    reported->sunlit[place] = sunlit;
    returns->true_range[to] = of->range;
    returns->labels[to] = of->label;
    returns->bodies[to] = of->body;
    returns->rays[to] = of->ray;
}

/* Set the echoes of beams of one ray in clear air, which begin with `first`. */
static INLINED void set_axes(const struct receiver *receiver, const struct hits *hits, size_t first,
                             size_t count, const struct returns *returns,
                             struct reported *reported)
{
    const float least = receiver->least_power;
#pragma GCC ivdep
    for (size_t i = 0; i < count; i++) {
        const size_t ray = first + i;
        const int32_t label = hits->labels[ray];
        const float range = hits->range[ray], light = light_of(receiver, hits, ray);
        const float power = light / (range * range);
        const int seen = (label >= 0) & !(power < least);
        reported->range[i] = seen ? range : INFINITY;
        reported->light[i] = light;
        reported->power[i] = power;
        reported->sunlit[i] = 0;
    }
    for (size_t i = 0; receiver->sun && i < count; i++)
        if (hits->labels[first + i] >= 0) {
            const float sunlit = sunlit_noise(receiver, hits, first + i);
            const int seen = is_seen(receiver, reported->power[i], sunlit);
            reported->range[i] = seen ? hits->range[first + i] : INFINITY;
            reported->sunlit[i] = sunlit;
        }
#pragma GCC ivdep
    for (size_t i = 0; i < count; i++) {
        const int32_t label = hits->labels[first + i], body = hits->bodies[first + i];
        const float range = reported->range[i];
        returns->true_range[first + i] = range;
        returns->labels[first + i] = range < INFINITY ? label : -1;
        returns->bodies[first + i] = range < INFINITY ? body : -1;
        returns->rays[first + i] = 0;
    }
}

/* Report echoes: noise, the laser's own error, rounding, limits, loss. Random numbers and returns
 * begin with those of the first one. */
static INLINED void report(const struct receiver *receiver, const struct reported *reported,
                           size_t count, size_t laser, const float *white, const float *lost,
                           float *range, uint8_t *returned, float *intensity)
{
    const float step = receiver->range_resolution, bias = receiver->bias[laser];
    const float of_laser = receiver->stddev[laser], range_share = receiver->range_share;
    float stddev[CHUNK], dropout[CHUNK];
    for (size_t i = 0; i < count; i++) {
        intensity[i] = intensity_of(receiver, reported->light[i], reported->power[i]);
        stddev[i] = of_laser;
        dropout[i] = receiver->dropout;
    }
    for (size_t i = 0; range_share > 0 && i < count; i++) {
        const float share = range_share * reported->range[i];
        stddev[i] = sqrtf(stddev[i] * stddev[i] + share * share);
    }
    for (size_t i = 0; receiver->bands && i < count; i++) {
        if (!(fabsf(reported->range[i]) < INFINITY))
            continue;
        const struct band *band = band_at(receiver->bands, intensity[i], reported->range[i]);
        dropout[i] += (1 - dropout[i]) * band->dropout;
        if (band->stddev > 0)
            stddev[i] = stddev[i] > 0 ? sqrtf(stddev[i] * stddev[i] + band->stddev * band->stddev)
                                      : band->stddev;
    }
    for (size_t i = 0; receiver->sun && i < count; i++) {
        const float power = reported->power[i];
        const float spread = receiver->sun->spread * receiver->least_power;
        const float square = stddev[i] * stddev[i] * power * power;
        const float added = reported->sunlit[i] * spread * spread;
        stddev[i] = added > FAINT * square ? sqrtf(square + added) / power : stddev[i];
    }
#pragma GCC ivdep
    for (size_t i = 0; i < count; i++)
        range[i] = white ? reported->range[i] + stddev[i] * white[i] : reported->range[i];
#pragma GCC ivdep
    for (size_t i = 0; i < count; i++) {
        float measured = range[i] + bias;
        measured = step > 0 ? rintf(measured / step) * step : measured;
        range[i] = measured;
    }
#pragma GCC ivdep
    for (size_t i = 0; i < count; i++) {
        const int is_echo = fabsf(reported->range[i]) < INFINITY;
        range[i] = is_echo ? range[i] : reported->range[i];
        intensity[i] = is_echo ? intensity[i] : 0;
        returned[i] = is_echo & (range[i] >= receiver->min_range) &
                      (range[i] <= receiver->max_range) & !(lost && lost[i] < dropout[i]);
    }
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
VECTORIZED void groundlink_returns(const struct receiver *receiver, const struct hits *hits,
                        const struct returns *returns, size_t first, size_t end,
                        const float *white, const float *lost, const float *air,
                        const float *gaps, const struct false_return *foreign,
                        struct echo *stray)
{
    const size_t beams = receiver->lasers * receiver->firings, cast = receiver->lasers * (end - first);
    const size_t clouds = receiver->weather ? receiver->weather->clouds : 0;
    struct echo echoes[MOST_RAYS + 4 + clouds];
    struct reported reported[2];
    const int dual = receiver->mode == DUAL, plain = receiver->rays == 1 && !receiver->weather && !dual;
    const int blooms = receiver->blooming && groundlink_bloom(receiver, hits, end - first, stray);
    if (receiver->sun)
        find_sunlight(receiver->sun, hits->rays, hits->normals, hits->directions,
                      receiver->sun->lit, receiver->sun->scattered);

    for (size_t laser = 0; laser < receiver->lasers; laser++)
        for (size_t begin = first; begin < end; begin += CHUNK) {
            const size_t count = end - begin < CHUNK ? end - begin : CHUNK;
            const size_t begin_beam = laser * receiver->firings + begin;
            const size_t begin_to = laser * (end - first) + begin - first;
            while ((size_t)foreign->beam < begin_beam)
                foreign++;
            if (plain)
                set_axes(receiver, hits, begin_to, count, returns, reported);
            /* Whether there may be a beam with more than the echo of its axis. */
            const int more = !plain || receiver->reach > 0 || blooms ||
                             (size_t)foreign->beam < begin_beam + count;
            for (size_t i = 0; more && i < count; i++) {
                const size_t beam = begin_beam + i, to = begin_to + i, firing = begin + i;
                const int edge =
                    receiver->reach > 0 &&
                    ((firing > first && leaps(hits->range[to], hits->range[to - 1])) ||
                     (firing + 1 < end && leaps(hits->range[to], hits->range[to + 1])));
                const int bloomed = blooms && stray[to].power > 0;
                while ((size_t)foreign->beam < beam)
                    foreign++;
                const int is_false = (size_t)foreign->beam == beam;
                if (plain && !edge && !bloomed && !is_false)
                    continue;
                const size_t ray = to * receiver->rays;
                const float sunlit = receiver->sun ? sunlit_noise(receiver, hits, ray) : 0;
                const struct echo *chosen[2];
                int near = 0;
                size_t found = edge ? groundlink_edge_echoes(receiver, hits, to, firing - first,
                                                             end - first, gaps + beam, echoes)
                                    : beam_echoes(receiver, hits, ray, echoes, &near);
                if (bloomed)
                    found = groundlink_add_stray(receiver, &stray[to], echoes, found);
                if (receiver->weather)
                    found = groundlink_through_weather(receiver, hits, ray, air + beam, beams,
                                                       echoes, found);
                if (is_false)
                    found = add_false(receiver, foreign, sunlit, echoes, found);
                choose(receiver, echoes, found, sunlit, chosen);
                set(&reported[0], i, chosen[0], near, sunlit, returns, to);
                if (dual)
                    set(&reported[1], i, chosen[1], near, sunlit, returns, cast + to);
            }
            for (size_t which = 0; which <= (size_t)dual; which++) {
                const size_t draw = which * beams + begin_beam, to = which * cast + begin_to;
                report(receiver, &reported[which], count, laser, white ? white + draw : NULL,
                       lost ? lost + draw : NULL, returns->range + to, returns->returned + to,
                       returns->intensity + to);
            }
        }
}
