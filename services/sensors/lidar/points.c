// SPDX-License-Identifier: Apache-2.0
/* The points of a block.
 *
 * Rule: arithmetic of `model.py`, in one pass where numpy would need ten. Arrays of rays are lasers
 * by firings, those of returns have the first returns of all rays before the second ones, vectors
 * are component after component.
 */

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* groundlink.messages.base.POINT */
struct __attribute__((packed)) point {
    float x, y, z, intensity;
    uint16_t ring;
    float time;
};

/* groundlink.messages.ground_truth.TRUE_POINT */
struct __attribute__((packed)) true_point {
    struct point point;
    uint32_t body;
};

/* Write the points of all rays that `returned` of firings `first` to `end`, firing after firing. Of
 * range, returned and intensity there are only these firings, each laser's `stride` after those of
 * the one before, and each ray's second return after all first ones. Unless `true_points` is NULL,
 * write there where each point truly is; of the truth there are only these firings, without gaps. */
void groundlink_points(size_t lasers, size_t firings, size_t first, size_t end, size_t returns,
                       size_t stride,
                       const float *directions_in_sensor, const float *heights,
                       const uint16_t *rings, const float *seconds, const float *range,
                       const uint8_t *returned, const float *intensity, struct point *points,
                       const float *true_in_sensor, const uint32_t *bodies,
                       struct true_point *true_points)
{
    const size_t rays = lasers * firings, true_hits = returns * lasers * (end - first);
    for (size_t firing = first; firing < end; firing++)
        for (size_t laser = 0; laser < lasers; laser++) {
            const size_t ray = laser * firings + firing;
            const float *direction = directions_in_sensor + ray;
            for (size_t which = 0; which < returns; which++) {
                const size_t hit = (which * lasers + laser) * stride + firing - first;
                if (!returned[hit])
                    continue;
                const struct point point = {
                    .x = direction[0] * range[hit],
                    .y = direction[rays] * range[hit],
                    .z = direction[2 * rays] * range[hit] + heights[laser],
                    .intensity = intensity[hit],
                    .ring = rings[laser],
                    .time = seconds[ray],
                };
                memcpy(points++, &point, sizeof point);
                if (!true_points)
                    continue;
                const size_t at = (which * lasers + laser) * (end - first) + firing - first;
                struct true_point true_point = {.point = point, .body = bodies[at]};
                true_point.point.x = true_in_sensor[at];
                true_point.point.y = true_in_sensor[true_hits + at];
                true_point.point.z = true_in_sensor[2 * true_hits + at];
                memcpy(true_points++, &true_point, sizeof true_point);
            }
        }
}
