// SPDX-License-Identifier: Apache-2.0
/* What the air does to echoes.
 *
 * Rule: arithmetic of `weather.py`, beam after beam; what it means stands there. A beam takes the way
 * of its first ray.
 */

#include "returns.h"

#include <math.h>

/* Where a ray enters and leaves a box; return whether it does. */
static int crosses(const struct cloud *cloud, const float origin[3], const float direction[3],
                   float *enters, float *leaves)
{
    *enters = 0;
    *leaves = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        const float low = (cloud->low[axis] - origin[axis]) / direction[axis];
        const float high = (cloud->high[axis] - origin[axis]) / direction[axis];
        *enters = fmaxf(*enters, fminf(low, high)); /* fmax and fmin pass over NaN */
        *leaves = fminf(*leaves, fmaxf(low, high));
    }
    return *enters < *leaves;
}

/* Share of light that is left after the way to a range and back. */
static float left(const struct weather *weather, const float origin[3], const float direction[3],
                  float range)
{
    float depth = weather->extinction * range, enters, leaves;
    for (size_t i = 0; i < weather->clouds; i++)
        if (crosses(weather->dust + i, origin, direction, &enters, &leaves) && enters < range)
            depth += weather->dust[i].extinction * (fminf(leaves, range) - enters);
    return expf(-2 * depth);
}

/* Append an echo of the air. */
static size_t append(struct echo *echoes, size_t count, float range, float light, float power)
{
    echoes[count] = (struct echo){range, light, power, -1, -1, 0};
    return count + 1;
}

size_t groundlink_through_weather(const struct receiver *receiver, const struct hits *hits,
                                  size_t ray, const float *draws, size_t stride,
                                  struct echo *echoes, size_t count)
{
    const struct weather *weather = receiver->weather;
    const float origin[3] = {hits->origins[ray], hits->origins[hits->rays + ray],
                             hits->origins[2 * hits->rays + ray]};
    const float direction[3] = {hits->directions[ray], hits->directions[hits->rays + ray],
                                hits->directions[2 * hits->rays + ray]};
    float end = receiver->max_range;
    for (size_t i = 0; i < receiver->rays; i++)
        end = fminf(end, hits->range[ray + i]);
    for (size_t i = 0; i < count; i++) {
        const float share = left(weather, origin, direction, echoes[i].range);
        echoes[i].light *= share;
        echoes[i].power *= share;
    }

    const float deep = draws[0] * receiver->cell;
    if (weather->haze > 0 && weather->near + deep < end) {
        const float light = weather->haze * left(weather, origin, direction, weather->near);
        count = append(echoes, count, weather->near + deep, light,
                       light / (weather->near * weather->near));
    }
    for (size_t i = 0; i < weather->clouds; i++) {
        float enters, leaves;
        if (!crosses(weather->dust + i, origin, direction, &enters, &leaves))
            continue;
        enters = fmaxf(enters, weather->near);
        if (enters + deep >= fminf(leaves, end))
            continue;
        const float light = weather->dust[i].haze * left(weather, origin, direction, enters);
        count = append(echoes, count, enters + deep, light, light / (enters * enters));
    }

    const float met = -logf(1 - draws[stride]); /* how many drops are passed before the first */
    if (weather->steps && met < weather->drops[weather->steps - 1]) {
        size_t low = 0, high = weather->steps - 1;
        while (high - low > 1) {
            const size_t middle = (low + high) / 2;
            if (weather->drops[middle] <= met)
                low = middle;
            else
                high = middle;
        }
        const float between =
            (met - weather->drops[low]) / (weather->drops[high] - weather->drops[low]);
        const float range =
            weather->ranges[low] + between * (weather->ranges[high] - weather->ranges[low]);
        const float least =
            weather->least_mm[low] + between * (weather->least_mm[high] - weather->least_mm[low]);
        const float larger = 1 - logf(1 - draws[2 * stride]) / (weather->drops_per_mm * least);
        const float power = receiver->least_power * larger * larger;
        if (range < end)
            count = append(echoes, count, range, power * range * range, power);
    }
    return count;
}
