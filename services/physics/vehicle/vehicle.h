// SPDX-License-Identifier: Apache-2.0
/* A vehicle on the engine's body. `vehicle.py` and `ground.py` fill these structures. All vectors are
 * in the base frame unless a comment says otherwise.
 */

#ifndef GROUNDLINK_VEHICLE_H
#define GROUNDLINK_VEHICLE_H

#include "../running_gear/running_gear.h"
#include "../soil/ruts.h"
#include "water.h"

struct link {
    double position[3], orientation[4];
};

struct vehicle {
    struct body *body;
    struct running_gear *gear;
    double com[3];
    double drag, linear_damping, angular_damping[3];
    double shake; /* force along z of this tick */
    int32_t keeps_contacts; /* those of the first tick are given */
    double rows[3][3]; /* of the base's orientation */
    double origin[3], velocity[3];              /* of the base's origin, in the world */
    const struct link *links; /* that servos move */
    size_t link_count;
    struct wading *wading; /* NULL: the world is dry */
    char *link_poses, *base_velocity, *joint_positions, *joint_velocities; /* of the state */
    char *servo_positions, *servo_velocities;
};

/* Coefficients of friction, roughness and soils of the ground; `ground.py` fills it. */
struct ground {
    const double *friction, *roughness, *soil; /* of static bodies by number; NaN for others */
    size_t count;
    const uint8_t *surface; /* materials of the terrain's cells; NULL without terrain */
    int64_t rows, columns;
    double x0, y0, cell;
    const double *material_friction, *material_roughness, *material_soil;
};

/* Add the forces of standing water to those on the base; `velocity` is that of its origin. */
void groundlink_wade(struct vehicle *vehicle, const double velocity[3], const double turn[3]);

#endif
