// SPDX-License-Identifier: Apache-2.0
/* The running gear; see `running_gear.py`. */

#include <math.h>

#include "running_gear.h"

/* Sine of the angle between axle and ground's normal below which a wheel lies on its side. */
#define UPRIGHT 0.2

static double clamped(double value, double most)
{
    value = value < most ? value : most;
    return value > -most ? value : -most;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double product[3])
{
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

void groundlink_steering_joint_turn(struct steering_joint *joint, double grip, double rolling)
{
    double speed = (clamped(joint->asked, joint->range) - joint->angle) / TICK_SECONDS;
    speed = clamped(speed, joint->most_speed);
    if (speed == 0.0 && joint->speed == 0.0)
        return;
    double scrub = joint->lever * fmax(fabs(joint->speed), fabs(speed));
    double resisting = grip * joint->lever * scrub / (scrub + fabs(rolling));
    double lost = resisting * TICK_SECONDS / joint->inertia;
    /* Change of speed to reach the target against the footprint's resistance. */
    double change = speed - joint->speed + (speed > 0.0 ? lost : speed < 0.0 ? -lost : 0.0);
    double reached =
        joint->speed + clamped(change, joint->most_torque * TICK_SECONDS / joint->inertia);
    reached -= clamped(reached, lost);
    joint->speed = reached;
    joint->angle = clamped(joint->angle + reached * TICK_SECONDS, joint->range);
}

/* Turn the direction of the tread's grip across that in which the rollers at the ground roll. */
static void grip_across_rollers(struct wheel *wheel)
{
    double c = wheel->rollers[0], s = wheel->rollers[1];
    for (int k = 0; k < 3; k++) {
        double forward = wheel->forward[k], left = wheel->left[k];
        wheel->forward[k] = c * forward + s * left;
        wheel->left[k] = c * left - s * forward;
    }
}

/* Find out how the ground moves under a wheel, and where. */
static void meet(struct wheel *wheel, const double velocity[3], const double turn[3],
                 const struct joint *spring)
{
    struct steering_joint *steering = wheel->steering;
    if (!wheel->touches) {
        groundlink_tire_lift(wheel->tire);
        if (wheel->soil)
            groundlink_soil_wheel_leave(wheel->soil);
        if (steering)
            groundlink_steering_joint_turn(steering, 0.0, 0.0);
        return;
    }
    double load = sqrt(dot(wheel->normal, wheel->normal));
    if (load == 0.0)
        load = 1.0; /* forces on a wedged wheel cancel */
    const double n[3] = {wheel->normal[0] / load, wheel->normal[1] / load, wheel->normal[2] / load};
    double grip = wheel->grip * wheel->friction;
    double ax = wheel->axle[0], ay = wheel->axle[1];
    if (steering) {
        groundlink_steering_joint_turn(steering, grip, velocity[0]);
        ax = -sin(steering->angle);
        ay = cos(steering->angle);
    }
    /* Forward and left along the ground; the axle is (ax, ay, 0). */
    double f[3] = {ay * n[2], -ax * n[2], ax * n[1] - ay * n[0]};
    double size = sqrt(dot(f, f));
    if (size < UPRIGHT) {
        grip = 0.0;
        size = 1.0;
    }
    double position = spring->position - sinkage(wheel);
    double hub[3] = {wheel->center[0], wheel->center[1], wheel->center[2] + position};
    if (wheel->arm)
        groundlink_arm_carries(wheel->arm, wheel->center, position, hub);
    for (int k = 0; k < 3; k++) {
        wheel->forward[k] = f[k] / size;
        wheel->foot[k] = hub[k] - wheel->radius * n[k];
    }
    cross(n, wheel->forward, wheel->left);
    if (wheel->rollers[1] != 0.0)
        grip_across_rollers(wheel);
    const double *r = wheel->foot;
    double moves[3] = {
        velocity[0] + turn[1] * r[2] - turn[2] * r[1],
        velocity[1] + turn[2] * r[0] - turn[0] * r[2],
        velocity[2] + turn[0] * r[1] - turn[1] * r[0] + spring->velocity,
    };
    if (wheel->arm) {
        double swung[2];
        groundlink_arm_moves(wheel->arm, r, swung);
        moves[0] += swung[0] + wheel->arm->sine * spring->velocity;
        moves[2] += swung[1] + (wheel->arm->cosine - 1.0) * spring->velocity;
    }
    double forward = dot(wheel->forward, moves), left = dot(wheel->left, moves);
    double resisting = wheel->resistance * load;
    if (wheel->soil)
        groundlink_soil_wheel_meet(wheel->soil, wheel->tire, forward, left, grip, resisting, load);
    else
        groundlink_tire_meet(wheel->tire, forward, left, grip, resisting, load);
}

/* Turn all shafts for a tick; return the rate of their angular momentum about y, N m. */
static double turn_shafts(struct running_gear *gear)
{
    double drawn = 0.0, rate = 0.0;
    gear->driving = gear->braking = 0.0;
    for (size_t i = 0; i < gear->shaft_count; i++) {
        struct shaft *shaft = gear->shafts[i];
        double before = shaft->speed, limits[2] = {0.0, 0.0};
        if (i < gear->driven_count) {
            groundlink_motors_limits(&gear->motors, before, gear->voltage_share, limits);
            /* Toward the target speed at most the commanded torque; a brake at that speed. */
            double torque = shaft->asked_torque;
            if (shaft->asked < 0.0 && torque > limits[0])
                limits[0] = torque;
            else if (shaft->asked >= 0.0 && torque < limits[1])
                limits[1] = torque;
        }
        groundlink_shaft_turn(shaft, limits[0], limits[1]);
        shaft->taken = shaft->inertia * (shaft->speed - before) / TICK_SECONDS;
        rate += shaft->inertia * (shaft->speed - before);
        if (i < gear->driven_count) {
            double speed = (before + shaft->speed) / 2, power = shaft->torque * speed;
            drawn += groundlink_motors_power(&gear->motors, shaft->torque, speed);
            if (power > 0.0)
                gear->driving += power;
            else
                gear->braking -= power;
        }
    }
    gear->voltage_share = gear->battery ? groundlink_battery_draw(gear->battery, drawn) : 1.0;
    gear->drove += gear->driving;
    gear->braked += gear->braking;
    return rate / TICK_SECONDS;
}

static const double no_force[3];

void groundlink_running_gear_go(struct running_gear *gear, const double velocity[3],
                                const double turn[3], const struct joint *springs,
                                const double com[3], double force[3], double torque[3])
{
    for (size_t i = 0; i < gear->wheel_count; i++)
        meet(gear->wheels[i], velocity, turn, &springs[i]);
    for (int k = 0; k < 3; k++)
        force[k] = torque[k] = 0.0;
    /* Shafts turn the base the other way. */
    torque[1] = -turn_shafts(gear);
    for (size_t i = 0; i < gear->linkage.count; i++)
        gear->linkage.arms[i]->torque = 0.0;
    for (size_t i = 0; i < gear->wheel_count; i++) {
        struct wheel *wheel = gear->wheels[i];
        wheel->along_spring = 0.0;
        if (!wheel->touches) {
            if (wheel->arm && wheel->shaft)
                groundlink_arm_push(wheel->arm, wheel->arm->at, no_force, wheel->shaft->taken);
            continue;
        }
        double grip[2], pull[3], arm[3], moment[3];
        double tread = wheel->shaft ? wheel->shaft->tread : 0.0;
        groundlink_tire_settle(wheel->tire, tread, grip);
        if (wheel->soil) {
            wheel->soil->tread = tread;
            grip[0] += wheel->soil->drag_force;
        }
        for (int k = 0; k < 3; k++) {
            pull[k] = grip[0] * wheel->forward[k] + grip[1] * wheel->left[k];
            arm[k] = wheel->foot[k] - com[k];
        }
        cross(arm, pull, moment);
        for (int k = 0; k < 3; k++) {
            force[k] += pull[k];
            torque[k] += moment[k];
        }
        wheel->along_spring = pull[2];
        if (wheel->arm) {
            wheel->along_spring = wheel->arm->sine * pull[0] + wheel->arm->cosine * pull[2];
            groundlink_arm_push(wheel->arm, wheel->foot, pull,
                                wheel->shaft ? wheel->shaft->taken : 0.0);
        }
    }
}
