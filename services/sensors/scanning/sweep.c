// SPDX-License-Identifier: Apache-2.0
/* Where the rays of a revolution start.
 *
 * Rule: arithmetic of `sweep.py`, in one pass where numpy would need fifty; what it means stands
 * there. Arrays of rays are lasers by firings, vectors component after component.
 */

#include <math.h>
#include <stddef.h>

#include "../rays/vectorized.h"

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
 * some states of the base (position, quaternion xyzw): linear, and nlerp as in groundlink.core.frames. */
static INLINED void pose(const struct head *head, const double (*states)[7], size_t count, double ticks,
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

/* So many firings are swept together that their poses stay in the nearest cache. */
enum { CHUNK = 128 };

/* Start the rays of firings `first` to `end` of a revolution. `start` and `rate` are scratch: the 12
 * values of the pose at each firing, and their change a second until the next. */
VECTORIZED void groundlink_sweep(const struct head *head, const double (*states)[7], size_t count,
                                 double start_ticks, size_t first, size_t end, float *start,
                                 float *rate, float *origins, float *directions)
{
    const size_t firings = head->firings, rays = head->lasers * firings;
    double values[2][12];

    pose(head, states, count, start_ticks + (double)first * head->ticks_per_firing,
         values[first % 2]);
    for (size_t begin = first; begin < end; begin += CHUNK) {
        const size_t stop = end - begin < CHUNK ? end : begin + CHUNK;
        for (size_t firing = begin; firing < stop; firing++) {
            const double *now = values[firing % 2];
            double *next = values[(firing + 1) % 2];
            pose(head, states, count, start_ticks + (double)(firing + 1) * head->ticks_per_firing,
                 next);
            for (size_t row = 0; row < 12; row++) {
                start[row * firings + firing] = (float)now[row];
                rate[row * firings + firing] =
                    (float)((next[row] - now[row]) / head->seconds_per_firing);
            }
        }
        for (size_t laser = 0; laser < head->lasers; laser++) {
            const float late = head->late_seconds[laser], height = head->heights[laser];
            const float *x = head->directions_in_sensor + laser * firings, *y = x + rays,
                        *z = y + rays;
            for (size_t axis = 0; axis < 3; axis++) {
                float *direction = directions + axis * rays + laser * firings;
                float *origin = origins + axis * rays + laser * firings;
#pragma GCC ivdep
                for (size_t firing = begin; firing < stop; firing++) {
                    float up = AT(3 * axis + 2);
                    direction[firing] =
                        AT(3 * axis) * x[firing] + AT(3 * axis + 1) * y[firing] + up * z[firing];
                    origin[firing] = AT(9 + axis) + up * height;
                }
            }
        }
    }
}

/* Start the rays of firings `first` to `end` that fill beams, or leave beside their axes. Each of
 * `rays` in a beam leaves by `within`, tangents to the side and up, from its true axis; that differs
 * by `jitter`, radians of azimuth and of elevation of the revolution's beams, from the nominal one.
 * Axes and poses are those that groundlink_sweep wrote; of what is written there are only these
 * firings, the rays of a beam side by side. */
void groundlink_spread(const struct head *head, size_t first, size_t end, const float *start,
                       const float *rate, const float *axis_origins, const float *axis_directions,
                       const float *axis_times, size_t rays, const float *within,
                       const float *jitter, float *origins, float *directions, float *times)
{
    const size_t firings = head->firings, beams = head->lasers * firings;
    const size_t cast = head->lasers * (end - first) * rays;
    float shares[3][rays]; /* of the axis, to the side and up, in each ray's direction */
    size_t ray = 0;
    for (size_t laser = 0; laser < head->lasers; laser++) {
        const float late = head->late_seconds[laser];
        for (size_t firing = first; firing < end; firing++) {
            const size_t beam = laser * firings + firing;
            const float x = head->directions_in_sensor[beam],
                        y = head->directions_in_sensor[beams + beam],
                        z = head->directions_in_sensor[2 * beams + beam];
            const float level = fmaxf(sqrtf(x * x + y * y), 1e-6f);
            const float side_in_sensor[3] = {-y / level, x / level, 0};
            const float up_in_sensor[3] = {-z * x / level, -z * y / level, level};
            const float azimuth = jitter ? level * jitter[beam] : 0;
            const float elevation = jitter ? jitter[beams + beam] : 0;
            for (size_t i = 0; i < rays; i++) {
                const float across = azimuth + within[i], upward = elevation + within[rays + i];
                const float length = sqrtf(1 + across * across + upward * upward);
                shares[0][i] = 1 / length;
                shares[1][i] = across / length;
                shares[2][i] = upward / length;
                times[ray + i] = axis_times[beam];
            }
            for (size_t axis = 0; axis < 3; axis++) {
                float side = 0, up = 0;
                for (size_t of = 0; of < 3; of++) {
                    const float value = AT(3 * axis + of);
                    side += value * side_in_sensor[of];
                    up += value * up_in_sensor[of];
                }
                const float along = axis_directions[axis * beams + beam];
                const float origin = axis_origins[axis * beams + beam];
                for (size_t i = 0; i < rays; i++) {
                    directions[axis * cast + ray + i] =
                        shares[0][i] * along + shares[1][i] * side + shares[2][i] * up;
                    origins[axis * cast + ray + i] = origin;
                }
            }
            ray += rays;
        }
    }
}
