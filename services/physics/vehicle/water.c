// SPDX-License-Identifier: Apache-2.0
/* Forces of standing water on a vehicle; see `water.py`. */

#include <math.h>

#include "vehicle.h"

#define DENSITY 1000.0
#define GRAVITY 9.80665
#define WHEEL_DRAG 0.75
#define HULL_DRAG 1.05

/* The hull is cut into so many columns along x and y. */
enum { ALONG = 4, ACROSS = 2 };

static double within(double value, double most)
{
    value = value > 0.0 ? value : 0.0;
    return value < most ? value : most;
}

/* Height of the surface at the base's origin; negative infinity without water. */
static double level_at(const struct wading *wading, const double origin[3])
{
    double level = -INFINITY;
    for (size_t i = 0; i < wading->area_count; i++) {
        const struct water_area *area = &wading->areas[i];
        if (area->low[0] <= origin[0] && origin[0] <= area->high[0] &&
            area->low[1] <= origin[1] && origin[1] <= area->high[1] && area->level > level)
            level = area->level;
    }
    return level;
}

/* Add the force of water on a part at a point: it is lifted by the volume that it displaces and
 * dragged along each axis by its area across it. */
static void push(struct vehicle *vehicle, const double velocity[3], const double turn[3],
                 const double at[3], double volume, double drag, const double areas[3])
{
    const double moves[3] = {
        velocity[0] + turn[1] * at[2] - turn[2] * at[1],
        velocity[1] + turn[2] * at[0] - turn[0] * at[2],
        velocity[2] + turn[0] * at[1] - turn[1] * at[0],
    };
    double force[3], arm[3];
    for (int k = 0; k < 3; k++) {
        force[k] = DENSITY * GRAVITY * volume * vehicle->rows[2][k] -
                   DENSITY / 2 * drag * areas[k] * fabs(moves[k]) * moves[k];
        arm[k] = at[k] - vehicle->com[k];
        vehicle->body->force[k] += force[k];
    }
    vehicle->body->torque[0] += arm[1] * force[2] - arm[2] * force[1];
    vehicle->body->torque[1] += arm[2] * force[0] - arm[0] * force[2];
    vehicle->body->torque[2] += arm[0] * force[1] - arm[1] * force[0];
}

/* Area of a disc below a horizontal line, so high above its lowest point. */
static double segment(double radius, double height)
{
    double up = radius - height;
    return radius * radius * acos(up / radius) - up * sqrt(fmax(0.0, height * (2 * radius - height)));
}

void groundlink_wade(struct vehicle *vehicle, const double velocity[3], const double turn[3])
{
    struct wading *wading = vehicle->wading;
    const struct running_gear *gear = vehicle->gear;
    const double *up = vehicle->rows[2];
    const double level = level_at(wading, vehicle->origin) - vehicle->origin[2];
    wading->depth = 0.0;
    for (size_t i = 0; i < gear->wheel_count; i++) {
        const struct wheel *wheel = gear->wheels[i];
        const struct wading_wheel *wet = &wading->wheels[i];
        const double at[3] = {wheel->center[0], wheel->center[1],
                              wheel->center[2] + vehicle->body->joints[i].position -
                                  sinkage(wheel)};
        const double depth =
            level - (up[0] * at[0] + up[1] * at[1] + up[2] * at[2]) + wheel->radius;
        if (!(depth > 0.0))
            continue;
        if (depth > wading->depth)
            wading->depth = depth;
        const double under = within(depth, 2 * wheel->radius);
        const double side = segment(wheel->radius, under);
        const double areas[3] = {wet->drag_share * wet->width * under, wet->drag_share * side, 0.0};
        push(vehicle, velocity, turn, at, wet->tightness * wet->width * side, WHEEL_DRAG, areas);
    }
    const double size[3] = {wading->high[0] - wading->low[0], wading->high[1] - wading->low[1],
                            wading->high[2] - wading->low[2]};
    const double length = size[0] / ALONG, width = size[1] / ACROSS;
    const double upright = fmax(0.1, fabs(up[2]));
    for (int i = 0; i < ALONG; i++)
        for (int j = 0; j < ACROSS; j++) {
            double at[3] = {wading->low[0] + (i + 0.5) * length,
                            wading->low[1] + (j + 0.5) * width, wading->low[2]};
            const double depth = level - (up[0] * at[0] + up[1] * at[1] + up[2] * at[2]);
            const double under = within(depth / upright, size[2]);
            if (!(under > 0.0))
                continue;
            at[2] += under / 2;
            const double areas[3] = {width * under / ALONG, length * under / ACROSS,
                                     length * width};
            push(vehicle, velocity, turn, at, wading->tightness * length * width * under,
                 HULL_DRAG, areas);
        }
    if (wading->depth > wading->limit)
        wading->drowned = 1.0;
    if (wading->drowned != 0.0)
        vehicle->gear->voltage_share = 0.0; /* as with an empty battery, from the next tick on */
}
