// SPDX-License-Identifier: Apache-2.0
/* Shafts; see `shaft.py`. */

#include <math.h>

#include "running_gear.h"

/* Most iterations of Newton's method; it usually takes three. */
enum { STEPS = 40 };

/* Speed below which rolling resistance fades, so that it does not hold the shaft. */
#define SLOW_RADPS 0.05

/* Return the speed after a tick with a torque of the motor. */
static double driven_by(const struct shaft *shaft, double torque, double inertia, double damping)
{
    double before = shaft->speed, radius = shaft->radius, most = 0.0, rolling = 0.0;
    size_t gripping = 0;
    for (size_t i = 0; i < shaft->tire_count; i++) {
        const struct tire *tire = shaft->tires[i];
        if (tire->limit > 0.0) {
            gripping++;
            most += tire->limit;
            rolling += -tire->along / tire->firmness;
        }
    }
    most = radius * most;
    /* The treads push or brake with at most their grip. */
    double low = (inertia * before + torque - most) / (inertia + damping);
    double high = low + 2 * most / (inertia + damping);
    double speed = (low + high) / 2;
    if (gripping) {
        /* Start where the treads neither push nor brake: from there their force rises ever less. */
        rolling /= radius * gripping;
        speed = rolling < low ? low : rolling;
        speed = speed > high ? high : speed;
    }
    for (int step = 0; step < STEPS; step++) {
        double excess = inertia * (speed - before) + damping * speed - torque;
        double slope = inertia + damping;
        for (size_t i = 0; i < shaft->tire_count; i++) {
            double force[2];
            if (shaft->tires[i]->limit <= 0.0)
                continue;
            groundlink_tire_along(shaft->tires[i], speed * radius, force);
            excess += radius * force[0];
            slope += radius * radius * force[1];
        }
        if (fabs(excess) < 1e-9 * slope)
            break;
        if (excess > 0.0)
            high = speed;
        else
            low = speed;
        speed -= excess / slope;
        if (!(low <= speed && speed <= high))
            speed = (low + high) / 2;
    }
    return speed;
}

void groundlink_shaft_turn(struct shaft *shaft, double least, double most)
{
    double before = shaft->speed, radius = shaft->radius, damping = shaft->damping;
    double resisting = 0.0, grip = 0.0, speed = shaft->asked;
    for (size_t i = 0; i < shaft->tire_count; i++)
        resisting += shaft->tires[i]->resisting;
    if (resisting != 0.0)
        damping += resisting * radius / fmax(fabs(before), SLOW_RADPS);
    double inertia = shaft->inertia / TICK_SECONDS;
    for (size_t i = 0; i < shaft->tire_count; i++) {
        double force[2];
        groundlink_tire_along(shaft->tires[i], speed * radius, force);
        grip += force[0];
    }
    double torque = inertia * (speed - before) + damping * speed + radius * grip;
    if (!(least <= torque && torque <= most)) {
        torque = torque < least ? least : torque;
        torque = torque > most ? most : torque;
        speed = driven_by(shaft, torque, inertia, damping);
    }
    shaft->torque = torque;
    shaft->speed = speed;
    shaft->angle += speed * TICK_SECONDS;
    shaft->tread = speed * radius;
}
