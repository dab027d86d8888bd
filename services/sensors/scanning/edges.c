// SPDX-License-Identifier: Apache-2.0
/* Light of other surfaces in a beam of one ray: across an edge, and from retroreflectors nearby.
 *
 * Rule: arithmetic of `stray_light.py`, beam after beam; what it means stands there.
 */

#include "returns.h"

/* Reflectance of the whitest diffuse surface. */
#define DIFFUSE 1.0f

/* Whether two hits of a laser are on surfaces that do not go on from one to the other. */
static int apart(const struct hits *hits, size_t ray, size_t next)
{
    if (hits->labels[ray] < 0 || hits->labels[next] < 0)
        return hits->labels[ray] != hits->labels[next];
    float off_own = 0, off_next = 0;
    for (size_t axis = 0; axis < 3; axis++) {
        const size_t own = axis * hits->rays + ray, other = axis * hits->rays + next;
        const float between = hits->origins[other] + hits->range[next] * hits->directions[other] -
                              hits->origins[own] - hits->range[ray] * hits->directions[own];
        off_own += hits->normals[own] * between;
        off_next += hits->normals[other] * between;
    }
    return fabsf(off_own) > EDGE_M && fabsf(off_next) > EDGE_M;
}

/* Insert a share of what a ray hit among the parts of a beam, which are sorted by range. */
static size_t insert(const struct receiver *receiver, const struct hits *hits, size_t ray,
                     int32_t offset, float share, struct echo *parts, size_t count)
{
    if (hits->labels[ray] < 0 || share <= 0)
        return count;
    const float range = hits->range[ray], light = share * light_of(receiver, hits, ray);
    size_t place = count;
    for (; place && parts[place - 1].range > range; place--)
        parts[place] = parts[place - 1];
    parts[place] = (struct echo){range, light, light / (range * range) + 1e-30f,
                                 hits->labels[ray], hits->bodies[ray], offset};
    return count + 1;
}

/* Add the light of a part to an echo. */
static void join(struct echo *echo, const struct echo *part)
{
    const float power = echo->power + part->power;
    echo->range += (part->range - echo->range) * (part->power / power);
    echo->light += part->light;
    if (part->power > echo->power - part->power) {
        echo->label = part->label;
        echo->body = part->body;
        echo->ray = part->ray;
    }
    echo->power = power;
}

size_t groundlink_edge_echoes(const struct receiver *receiver, const struct hits *hits, size_t ray,
                              size_t firing, size_t firings, const float *gaps, struct echo *echoes)
{
    const float reach = receiver->reach;
    float before = 0, after = 0;
    if (firing && leaps(hits->range[ray], hits->range[ray - 1]) && apart(hits, ray, ray - 1))
        before = fmaxf(0, reach - (1 - gaps[-1])) / (2 * reach);
    if (firing + 1 < firings && leaps(hits->range[ray], hits->range[ray + 1]) &&
        apart(hits, ray, ray + 1))
        after = fmaxf(0, reach - gaps[0]) / (2 * reach);
    struct echo parts[3];
    size_t count = insert(receiver, hits, ray, 0, 1 - before - after, parts, 0), made = 0;
    if (before > 0)
        count = insert(receiver, hits, ray - 1, -1, before, parts, count);
    if (after > 0)
        count = insert(receiver, hits, ray + 1, 1, after, parts, count);
    float last = 0;
    for (size_t i = 0; i < count; i++) {
        if (made && parts[i].range - last <= receiver->cell)
            join(&echoes[made - 1], &parts[i]);
        else
            echoes[made++] = parts[i];
        last = parts[i].range;
    }
    return made;
}

int groundlink_bloom(const struct receiver *receiver, const struct hits *hits, size_t firings,
                     struct echo *stray)
{
    const struct blooming *blooming = receiver->blooming;
    const float limit = blooming->limit * blooming->limit;
    int found = 0;
    for (size_t ray = 0; ray < hits->rays; ray++) {
        if (hits->labels[ray] < 0 || receiver->reflectance[hits->labels[ray]] <= DIFFUSE)
            continue;
        if (!found)
            for (size_t any = 0; any < hits->rays; any++)
                stray[any].power = 0;
        found = 1;
        const int32_t laser = (int32_t)(ray / firings), firing = (int32_t)(ray % firings);
        const float range = hits->range[ray];
        const float most = blooming->share * light_of(receiver, hits, ray);
        for (int32_t pair = blooming->first[laser]; pair < blooming->first[laser + 1]; pair++) {
            const int32_t beside = firing + blooming->shift[pair];
            const int32_t begin = beside > blooming->firings ? beside - blooming->firings : 0;
            int32_t end = beside + blooming->firings + 1;
            if (end > (int32_t)firings)
                end = (int32_t)firings;
            for (int32_t at = begin; at < end; at++) {
                const size_t other = (size_t)blooming->other[pair] * firings + (size_t)at;
                if (hits->labels[other] >= 0 &&
                    receiver->reflectance[hits->labels[other]] > DIFFUSE)
                    continue;
                float distance = 0;
                for (size_t axis = 0; axis < 3; axis++) {
                    const float along = hits->directions[axis * hits->rays + other] -
                                        hits->directions[axis * hits->rays + ray];
                    distance += along * along;
                }
                if (distance > limit)
                    continue;
                const float beyond = fmaxf(0, sqrtf(distance) - blooming->footprint);
                const float light = most * expf(-beyond * blooming->per_rad);
                const float power = light / (range * range);
                if (power > stray[other].power)
                    stray[other] = (struct echo){range, light, power, hits->labels[ray],
                                                 hits->bodies[ray],
                                                 (int32_t)((ptrdiff_t)ray - (ptrdiff_t)other)};
            }
        }
    }
    return found;
}

size_t groundlink_add_stray(const struct receiver *receiver, const struct echo *stray,
                            struct echo *echoes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (fabsf(echoes[i].range - stray->range) <= receiver->cell) {
            join(&echoes[i], stray);
            return count;
        }
    echoes[count] = *stray;
    return count + 1;
}
