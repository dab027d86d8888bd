// SPDX-License-Identifier: Apache-2.0
/* The passes over a revolution that are the LiDAR's own: where its rays start, and its points.
 *
 * Rule: arithmetic of `sweep.py` and `model.py`, in one pass each where numpy would need fifty; what
 * it means stands there. Arrays of rays are lasers by firings, vectors component after component.
 */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* The head of a LiDAR; a structure of the same name in `sweep.py` fills it. */
struct head {
    size_t lasers, firings;
    double base_from_sensor[9], position_in_base[3];
    double ticks_per_firing, seconds_per_firing;
    const float *late_seconds;         /* of each laser, after its firing */
    const float *heights;              /* of each laser above the sensor's origin */
    const float *directions_in_sensor;
};

/* Rotation world_from_sensor row by row, then the sensor's position, `ticks` after the first of
 * some states of the base (position, quaternion xyzw): linear, and nlerp as in groundlink.frames. */
static void pose(const struct head *head, const double (*states)[7], size_t count, double ticks,
                 double values[12])
{
    size_t before = (size_t)ticks;
    if (before > count - 2)
        before = count - 2;
    const double *first = states[before], *second = states[before + 1];
    double fraction = ticks - (double)before, mixed[7], dot = 0, square = 0;
    if (fraction < 1e-9) /* rounding: the state after `ticks` may not have come yet */
        fraction = 0;
    for (int i = 3; i < 7; i++)
        dot += first[i] * second[i];
    for (int i = 0; i < 7; i++)
        mixed[i] = first[i] + fraction * ((i > 2 && dot < 0 ? -second[i] : second[i]) - first[i]);
    for (int i = 3; i < 7; i++)
        square += mixed[i] * mixed[i];
    const double length = sqrt(square);
    const double x = mixed[3] / length, y = mixed[4] / length, z = mixed[5] / length,
                 w = mixed[6] / length;
    const double world_from_base[9] = {
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
        2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y),
    };
    for (int row = 0; row < 3; row++) {
        const double *of = world_from_base + 3 * row, *at = head->position_in_base;
        for (int column = 0; column < 3; column++) {
            const double *by = head->base_from_sensor + column;
            values[3 * row + column] = of[0] * by[0] + of[1] * by[3] + of[2] * by[6];
        }
        values[9 + row] = mixed[row] + (of[0] * at[0] + of[1] * at[1] + of[2] * at[2]);
    }
}

/* A value of the pose at an instant `late` seconds after a firing. */
#define AT(row) (start[(row) * firings + firing] + late * rate[(row) * firings + firing])

/* Start the rays of firings `first` to `end` of a revolution. `start` and `rate` are scratch: the 12
 * values of the pose at each firing, and their change a second until the next. */
void groundlink_sweep(const struct head *head, const double (*states)[7], size_t count,
                      double start_ticks, size_t first, size_t end, float *start, float *rate,
                      float *origins, float *directions)
{
    const size_t firings = head->firings, rays = head->lasers * firings;
    double values[2][12];

    pose(head, states, count, start_ticks + (double)first * head->ticks_per_firing,
         values[first % 2]);
    for (size_t firing = first; firing < end; firing++) {
        const double *now = values[firing % 2];
        double *next = values[(firing + 1) % 2];
        pose(head, states, count, start_ticks + (double)(firing + 1) * head->ticks_per_firing, next);
        for (size_t row = 0; row < 12; row++) {
            start[row * firings + firing] = (float)now[row];
            rate[row * firings + firing] = (float)((next[row] - now[row]) / head->seconds_per_firing);
        }
    }
    for (size_t laser = 0; laser < head->lasers; laser++) {
        const float late = head->late_seconds[laser], height = head->heights[laser];
        const float *x = head->directions_in_sensor + laser * firings, *y = x + rays, *z = y + rays;
        for (size_t axis = 0; axis < 3; axis++) {
            float *restrict direction = directions + axis * rays + laser * firings;
            float *restrict origin = origins + axis * rays + laser * firings;
            for (size_t firing = first; firing < end; firing++) {
                float up = AT(3 * axis + 2);
                direction[firing] =
                    AT(3 * axis) * x[firing] + AT(3 * axis + 1) * y[firing] + up * z[firing];
                origin[firing] = AT(9 + axis) + up * height;
            }
        }
    }
}

/* groundlink.messages.POINT */
struct __attribute__((packed)) point {
    float x, y, z, intensity;
    uint16_t ring;
    float time;
};

/* Write the points of all rays that `returned` of firings `first` to `end`, firing after firing;
 * return how many. Of range to labels there are only these firings. */
size_t groundlink_points(const struct head *head, size_t first, size_t end,
                         const uint16_t *rings, const float *seconds, const float *directions,
                         const float *range, const uint8_t *returned, const float *normals,
                         const int32_t *labels, const float *reflectivity, struct point *points)
{
    const size_t firings = head->firings, rays = head->lasers * firings;
    const size_t cast = head->lasers * (end - first);
    const float *in_sensor = head->directions_in_sensor;
    size_t written = 0;
    for (size_t firing = first; firing < end; firing++)
        for (size_t laser = 0; laser < head->lasers; laser++) {
            const size_t ray = laser * firings + firing;
            const size_t hit = laser * (end - first) + firing - first;
            if (!returned[hit])
                continue;
            const float cosine = normals[hit] * directions[ray] +
                                 normals[cast + hit] * directions[rays + ray] +
                                 normals[2 * cast + hit] * directions[2 * rays + ray];
            const struct point point = {
                .x = in_sensor[ray] * range[hit],
                .y = in_sensor[rays + ray] * range[hit],
                .z = in_sensor[2 * rays + ray] * range[hit] + head->heights[laser],
                .intensity = rintf(100 * reflectivity[labels[hit]] * fabsf(cosine)),
                .ring = rings[laser],
                .time = seconds[ray],
            };
            memcpy(&points[written++], &point, sizeof point);
        }
    return written;
}
