// SPDX-License-Identifier: Apache-2.0
/* Tires; see `tire.py`. */

#include <math.h>

#include "running_gear.h"

/* Share of the limit below which force is linear in slip. */
#define SMALL 1e-3

void groundlink_tire_lift(struct tire *tire)
{
    tire->x = tire->y = tire->along = tire->aside = tire->limit = tire->resisting = 0.0;
}

/* Return the length of a vector, correctly rounded: Borges, "An improved algorithm for hypot(a, b)"
 * (2019), algorithm 4. Libraries of C differ in the last bit. */
static double length(double x, double y)
{
    double a = fmax(fabs(x), fabs(y)), b = fmin(fabs(x), fabs(y));
    if (a == 0.0)
        return 0.0;
    double h = sqrt(fma(a, a, b * b)), square = h * h, of_a = a * a;
    double error = fma(-b, b, square - of_a) + fma(h, h, -square) - fma(a, a, -of_a);
    return h - error / (2 * h);
}

/* Return force over slip at the force of the last tick, N. */
static double secant(const struct tire *tire, double load)
{
    double stiffness = tire->cornering_stiffness * sin(2 * atan(load / tire->slip_load));
    double used = fmin(tire->stiffness * length(tire->x, tire->y) / tire->limit, 1.0);
    return used < SMALL ? stiffness : stiffness * used / (3 * (1 - cbrt(1 - used)));
}

/* Meet ground that the tread does not leave. */
void groundlink_tire_stick(struct tire *tire, double forward, double left, double limit,
                           double resisting)
{
    /* In coordinates where the friction ellipse is a circle. */
    tire->firmness = tire->sticking;
    tire->along = -tire->stiffness * tire->x - tire->firmness * forward;
    tire->aside = -tire->stiffness * tire->y - tire->firmness * left * tire->axle_ratio;
    tire->limit = limit;
    tire->resisting = resisting;
}

void groundlink_tire_meet(struct tire *tire, double forward, double left, double limit,
                          double resisting, double load)
{
    groundlink_tire_stick(tire, forward, left, limit, resisting);
    if (tire->slip_load == 0.0 || limit <= 0.0 || tire->rolling == 0.0)
        return;
    /* The tread deflects by what is left of the slip after the creep that its force causes. */
    double creep = tire->sticking * tire->rolling / secant(tire, load);
    double along = 1 / (1 + creep);
    tire->along *= along;
    tire->aside *= 1 / (1 + creep * tire->axle_ratio_squared);
    tire->firmness *= along;
}

void groundlink_tire_along(const struct tire *tire, double tread, double force_and_slope[2])
{
    double forward = tire->along + tire->firmness * tread, aside = tire->aside, limit = tire->limit;
    double square = forward * forward + aside * aside;
    force_and_slope[0] = forward;
    force_and_slope[1] = tire->firmness;
    if (square <= limit * limit)
        return;
    double share = limit / sqrt(square);
    force_and_slope[0] = forward * share;
    force_and_slope[1] = tire->firmness * share * aside * aside / square;
}

void groundlink_tire_settle(struct tire *tire, double tread, double force[2])
{
    double limit = tire->limit, stiffness = tire->stiffness;
    force[0] = force[1] = 0.0;
    if (tire->slip_load != 0.0)
        tire->rolling = fabs(tread);
    if (limit <= 0.0) {
        groundlink_tire_lift(tire);
        return;
    }
    double forward = tire->along + tire->firmness * tread, aside = tire->aside;
    double size = sqrt(forward * forward + aside * aside);
    if (size > limit) {
        forward *= limit / size;
        aside *= limit / size;
        /* A slipping tread is deflected by the force that it carries. */
        tire->x = -forward / stiffness;
        tire->y = -aside / stiffness;
    } else {
        /* Deflection at the tick's start, and the slip since then. */
        tire->x += -(forward + stiffness * tire->x) / tire->sticking * TICK_SECONDS;
        tire->y += -(aside + stiffness * tire->y) / tire->sticking * TICK_SECONDS;
    }
    force[0] = forward;
    force[1] = aside * tire->axle_ratio;
}
