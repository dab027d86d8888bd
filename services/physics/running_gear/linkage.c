// SPDX-License-Identifier: Apache-2.0
/* Arms between body and wheels; see `linkage.py`. */

#include <math.h>
#include <string.h>

#include "running_gear.h"

/* Move a place at rest with an arm; along x and z. */
static void carry(const struct arm *arm, const double place[3], double at[3])
{
    double x = place[0] - arm->pivot[0], z = place[2] - arm->pivot[2];
    at[0] = arm->at[0] + arm->cosine * x + arm->sine * z;
    at[1] = place[1];
    at[2] = arm->at[2] - arm->sine * x + arm->cosine * z;
}

/* Find where the arms are, by the angles of their joints. */
void groundlink_linkage_place(struct linkage *linkage, const struct joint *joints)
{
    for (size_t i = 0; i < linkage->count; i++) {
        struct arm *arm = linkage->arms[i];
        const struct arm *parent = arm->parent;
        arm->angle = joints[i].position;
        arm->rate = joints[i].velocity;
        memcpy(arm->at, arm->pivot, sizeof arm->at);
        arm->moves[0] = arm->moves[1] = 0.0;
        if (parent) {
            arm->angle += parent->angle;
            arm->rate += parent->rate;
            carry(parent, arm->pivot, arm->at);
            groundlink_arm_moves(parent, arm->at, arm->moves);
        }
        arm->sine = sin(arm->angle);
        arm->cosine = cos(arm->angle);
    }
}

/* Find the velocity, along x and z of the base, of a point that an arm carries. */
void groundlink_arm_moves(const struct arm *arm, const double at[3], double moves[2])
{
    moves[0] = arm->moves[0] + arm->rate * (at[2] - arm->at[2]);
    moves[1] = arm->moves[1] - arm->rate * (at[0] - arm->at[0]);
}

/* Find where a wheel is that an arm carries, with its spring at a position. */
void groundlink_arm_carries(const struct arm *arm, const double center[3], double position,
                            double at[3])
{
    carry(arm, center, at);
    at[0] += arm->sine * position;
    at[2] += arm->cosine * position;
}

/* Have a force at a point turn an arm and those that carry it, with what its shaft takes up. */
void groundlink_arm_push(struct arm *arm, const double at[3], const double force[3], double taken)
{
    for (; arm; arm = arm->parent)
        arm->torque += (at[2] - arm->at[2]) * force[0] - (at[0] - arm->at[0]) * force[2] - taken;
}

/* Set the torques of the arms' joints, with that of the bar that couples two of them. */
void groundlink_linkage_turn(struct linkage *linkage, struct joint *joints)
{
    for (size_t i = 0; i < linkage->count; i++)
        joints[i].force = linkage->arms[i]->torque;
    if (linkage->coupled[0] < 0)
        return;
    struct joint *one = &joints[linkage->coupled[0]], *other = &joints[linkage->coupled[1]];
    double bar = linkage->stiffness * (one->position + other->position) +
                 linkage->damping * (one->velocity + other->velocity);
    one->force -= bar;
    other->force -= bar;
}
