// SPDX-License-Identifier: Apache-2.0
/* What an engine and the models of vehicles share: motion and contacts go to the models, forces come
 * back. `bodies.py` has the same structures and documents units and frames.
 */

#ifndef GROUNDLINK_BODIES_H
#define GROUNDLINK_BODIES_H

#include <stddef.h>
#include <stdint.h>

#define TICK_SECONDS 0.0025

enum { BASE = -1 };

struct joint {
    double position, velocity;
    double force;
    int32_t link;
    int32_t q, u; /* places of its position and velocity in the engine's vectors */
};

struct body {
    int32_t number;
    int32_t joint_count;
    struct joint *joints;
    double center[3], orientation[4]; /* of its center of mass in the world */
    double velocity[3], turn[3];
    double force[3], torque[3]; /* in the base's frame */
};

struct contact {
    int32_t body, link;
    int32_t other;
    double point[3];  /* on the other body */
    double normal[3]; /* toward this body */
    double force;
};

struct contacts {
    struct contact *points;
    size_t count, room;
};

#endif
