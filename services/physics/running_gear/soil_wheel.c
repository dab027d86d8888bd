// SPDX-License-Identifier: Apache-2.0
/* Wheels on soil; see `soil_wheel.py`. */

#include <math.h>

#include "running_gear.h"

/* Share of the way to its steady sinkage that a wheel sinks in a tick. */
#define SETTLING 0.1

/* Depth below which a wheel that leaves soil is on the surface. */
#define SHALLOW_M 1e-6

/* Slip below which thrust is linear in slip. */
#define LEAST_SLIP 2e-3

/* Slower wheels have the slip that they would have at this speed. */
#define SLOW_MPS 0.02

/* Largest limit of the force along the axle over that in the rolling direction. */
#define MOST_ASIDE 2.0

static void set_axle_ratio(struct tire *tire, double ratio)
{
    tire->axle_ratio = ratio;
    tire->axle_ratio_squared = ratio * ratio;
}

void groundlink_soil_wheel_leave(struct soil_wheel *wheel)
{
    wheel->soil = FIRM;
    wheel->slip = wheel->rut = wheel->drag = wheel->drag_force = wheel->mapped = 0.0;
    wheel->sinkage = wheel->sinkage < SHALLOW_M ? 0.0 : wheel->sinkage * (1.0 - SETTLING);
}

/* Let the rut before this wheel become that of the wheel before it or of the terrain, whichever is
 * deeper, over the way to there; a rut is a share of the wheel's own sinkage in untouched soil. */
static void follow(struct soil_wheel *wheel, double fresh, double forward, double left)
{
    int back = forward < 0.0;
    const struct soil_wheel *leader = wheel->leaders[back];
    double way = fabs(forward) * TICK_SECONDS, apart = wheel->apart[back], share = 0.0;
    if (!(leader || wheel->mapped) || way == 0.0)
        return;
    if (leader && leader->soil == wheel->soil) {
        double beside = fmax(1.0 - apart * fabs(left / forward) / wheel->width, 0.0);
        if (fresh > 0.0)
            share = beside * fmin(leader->sinkage / fresh, 1.0);
    }
    if (wheel->mapped && (!leader || wheel->ahead >= share * fresh)) {
        apart = wheel->ahead_m;
        share = fresh > 0.0 ? wheel->ahead / fresh : 0.0;
    }
    wheel->rut += (share - wheel->rut) * fmin(way / apart, 1.0);
}

/* Set the soil's resistance against the hub: a spring and damper up to a limit. */
static void resist(struct soil_wheel *wheel, const struct tire *tire, double forward, double limit)
{
    double force = -tire->stiffness * wheel->drag - tire->sticking * forward;
    if (fabs(force) <= limit) {
        wheel->drag += forward * TICK_SECONDS;
    } else {
        force = copysign(limit, force);
        wheel->drag = -force / tire->stiffness;
    }
    wheel->drag_force = force;
}

/* Let the tread leave the ground with the slip that goes with its force, which without slip is
 * `free`. */
static void creep(struct tire *tire, double stiffness, double free, double rolling)
{
    if (stiffness <= 0.0)
        return;
    double leaves = tire->sticking * fabs(rolling) / stiffness;
    tire->along = (tire->along + leaves * copysign(free, rolling)) / (1.0 + leaves);
    tire->aside /= 1.0 + leaves * tire->axle_ratio_squared;
    tire->firmness /= 1.0 + leaves;
}

void groundlink_soil_wheel_meet(struct soil_wheel *wheel, struct tire *tire, double forward,
                                double left, double limit, double resisting, double load)
{
    if (wheel->under == FIRM) {
        groundlink_soil_wheel_leave(wheel);
        set_axle_ratio(tire, wheel->firm_ratio);
        groundlink_tire_meet(tire, forward, left, limit, resisting, load);
        return;
    }
    if (wheel->soil != wheel->under) {
        /* A vehicle is taken to have come here forward, in the ruts of its own first wheels. */
        wheel->soil = wheel->under;
        wheel->rut = wheel->leaders[0] && wheel->leaders[0]->soil == wheel->soil;
    }
    double tread = wheel->swivels ? forward : wheel->tread;
    int driven = fabs(tread) >= fabs(forward);
    double rolling = driven ? tread : forward, slipping = tread - forward;
    double slip = sqrt(slipping * slipping + left * left) / fmax(fabs(rolling), SLOW_MPS);
    slip = driven ? fmin(slip, 1.0) : -fmin(slip, 1.0);
    /* Slip digs while the tread moves on, not at once. */
    wheel->slip += (slip - wheel->slip) * fmin(fabs(rolling) * TICK_SECONDS / wheel->digging, 1.0);
    slip = copysign(fmax(fabs(wheel->slip), LEAST_SLIP), wheel->slip);

    const struct soil_table *table = wheel->tables[2 * (size_t)wheel->soil + (rolling < 0.0)];
    struct soil_response response;
    groundlink_soil_table_at(table, load, slip, 0.0, &response);
    double fresh = response.now.sinkage;
    follow(wheel, fresh, forward, left);
    groundlink_soil_table_at(table, load, slip, fmin(wheel->rut, table->deepest_rut), &response);
    const struct soil_row *row = &response.now;
    /* In a rut that is deeper than those of the table it rolls as in the deepest of these. */
    double deeper = fmax(wheel->rut - table->deepest_rut, 0.0) * fresh;
    double depth = fmin(row->sinkage + deeper, fmax(row->sinkage, wheel->deepest));
    /* The spring gives way while the wheel sinks, which is counted implicitly. */
    double gives_way = wheel->spring * row->sinkage / load;
    wheel->sinkage += (depth - wheel->sinkage) * SETTLING / (1.0 + SETTLING * gives_way);
    resist(wheel, tire, forward, row->resistance);

    /* On firm soil the tread slides before the soil shears. */
    double most = fmin(wheel->swivels ? row->resistance : response.most, limit);
    set_axle_ratio(tire, most > 0.0 ? fmin(1.0 + row->side / most, MOST_ASIDE) : 1.0);
    groundlink_tire_stick(tire, forward, left, most, resisting);
    if (!wheel->swivels)
        creep(tire, (row->thrust - response.free) / slip, response.free, rolling);
}
