// SPDX-License-Identifier: Apache-2.0
/* The parts of a running gear. Structures of the same names in Python fill these and document units
 * and frames. All vectors are in the base frame.
 */

#ifndef GROUNDLINK_RUNNING_GEAR_H
#define GROUNDLINK_RUNNING_GEAR_H

#include "../dynamics/bodies.h"
#include "../soil/table.h"

/* Number of ground that is no soil. */
#define FIRM -1.0

struct tire {
    double axle_ratio, axle_ratio_squared, stiffness, sticking;
    double cornering_stiffness, slip_load; /* of a tire that creeps; else 0 */
    double along, aside, x, y;
    double firmness, limit, resisting, rolling;
};

struct soil_wheel {
    const struct soil_table *const *tables; /* of each soil, forward and backward */
    const struct soil_wheel *leaders[2];    /* that press the soil before it, likewise; or NULL */
    double apart[2];
    double width, digging, deepest, spring, firm_ratio;
    double travel, stop; /* of its spring: beyond the first it is as stiff as the second */
    int32_t swivels;
    double tread, rut, slip, sinkage;
    double drag, drag_force;
    double soil, under; /* number of the soil in the last tick and in this one, or FIRM */
    double mapped;      /* whether that is terrain, whose ruts stay */
    /* Of ruts in the terrain before it: their depth, and how far before it that is. */
    double ahead, ahead_m;
};

struct shaft {
    double radius, inertia, damping;
    struct tire **tires;
    size_t tire_count;
    double asked, asked_torque; /* NaN: that of the motor */
    double angle, speed, tread, torque;
    double taken; /* rate of its angular momentum */
};

struct motors {
    double most;
    double stall, no_load_speed; /* 0 without a model of the motor */
};

struct battery {
    double capacity_ah, full, empty, resistance, idle_power;
    double share, current, voltage;
};

struct steering_joint {
    double range, most_speed, most_torque, inertia, lever;
    double asked;
    double angle, speed;
};

struct arm {
    struct arm *parent; /* NULL: the base carries it */
    double pivot[3];    /* at rest */
    /* By the joints up to the base, about y: */
    double angle, sine, cosine, rate;
    double at[3], moves[2]; /* of the pivot; its velocity in the base along x and z */
    double torque;
};

struct linkage {
    struct arm **arms; /* parents first; their joints are in this order */
    size_t count;
    int32_t coupled[2]; /* by the differential bar, or -1 */
    double stiffness, damping;
};

struct wheel {
    double center[3], radius, friction, resistance, ratio;
    double yaw, axle[2]; /* direction of an axle that is not steered */
    double rollers[2];   /* cosine and sine from that of rolling to that of grip */
    double preload, stiffness, damping;
    struct tire *tire;
    struct shaft *shaft;            /* NULL: it does not turn */
    struct steering_joint *steering; /* NULL: it is not steered */
    struct soil_wheel *soil;         /* NULL: all ground is firm */
    struct arm *arm;                 /* NULL: on the base */
    /* Contact with the ground in the last step. */
    int32_t touches;
    double grip, normal[3];
    double under; /* roughness */
    /* By roughness and tread. */
    double raised, raised_speed;
    /* Directions of rolling and of the axle on the ground, and the footprint. */
    double forward[3], left[3], foot[3];
    double along_spring; /* force of the ground on the wheel along its spring */
};

struct running_gear {
    struct wheel **wheels;
    struct shaft **shafts; /* driven ones first */
    size_t wheel_count, driven_count, shaft_count;
    struct motors motors;
    struct battery *battery; /* NULL: never empty */
    double voltage_share, driving, braking;
    double drove, braked; /* sums of the last two over all ticks */
    struct linkage linkage;
};

/* Depth of a wheel below the surface of the ground, on which it stands in the engine. */
static inline double sinkage(const struct wheel *wheel)
{
    return wheel->soil ? wheel->soil->sinkage : 0.0;
}

void groundlink_tire_lift(struct tire *);
void groundlink_tire_stick(struct tire *, double, double, double, double);
void groundlink_tire_meet(struct tire *, double, double, double, double, double);
void groundlink_tire_along(const struct tire *, double, double[2]);
void groundlink_tire_settle(struct tire *, double, double[2]);
void groundlink_shaft_turn(struct shaft *, double, double);
void groundlink_soil_wheel_leave(struct soil_wheel *);
void groundlink_soil_wheel_meet(struct soil_wheel *, struct tire *, double, double, double, double,
                                double);
void groundlink_motors_limits(const struct motors *, double, double, double[2]);
double groundlink_motors_power(const struct motors *, double, double);
double groundlink_battery_draw(struct battery *, double);
void groundlink_steering_joint_turn(struct steering_joint *, double, double);
void groundlink_linkage_place(struct linkage *, const struct joint *);
void groundlink_arm_moves(const struct arm *, const double[3], double[2]);
void groundlink_arm_carries(const struct arm *, const double[3], double, double[3]);
void groundlink_arm_push(struct arm *, const double[3], const double[3], double);
void groundlink_linkage_turn(struct linkage *, struct joint *);
void groundlink_running_gear_go(struct running_gear *, const double[3], const double[3],
                                const struct joint *, const double[3], double[3], double[3]);

#endif
