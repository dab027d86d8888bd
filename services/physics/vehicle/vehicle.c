// SPDX-License-Identifier: Apache-2.0
/* A tick of all vehicles of a run; see `fleet.py`. The stages of a tick are called in this order. */

#include <math.h>
#include <string.h>

#include "vehicle.h"

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Turn a vector in the world into the base frame. */
static void into_base(const struct vehicle *vehicle, const double world[3], double base[3])
{
    const double(*r)[3] = vehicle->rows;
    for (int k = 0; k < 3; k++)
        base[k] = r[0][k] * world[0] + r[1][k] * world[1] + r[2][k] * world[2];
}

static int64_t within(int64_t value, int64_t last)
{
    value = value > 0 ? value : 0;
    return value < last ? value : last;
}

/* Find friction, roughness and soil of the ground at a point of a body; return 1 on terrain. */
static int find_ground(const struct ground *ground, int32_t body, const double point[3],
                       double *friction, double *roughness, double *soil)
{
    *friction = *roughness = 0.0;
    *soil = FIRM;
    if (body >= 0 && (size_t)body < ground->count && !isnan(ground->friction[body])) {
        *friction = ground->friction[body];
        *roughness = ground->roughness[body];
        *soil = ground->soil[body];
    } else if (ground->surface) {
        int64_t row = (int64_t)((point[1] - ground->y0) / ground->cell);
        int64_t column = (int64_t)((point[0] - ground->x0) / ground->cell);
        row = within(row, ground->rows - 1);
        column = within(column, ground->columns - 1);
        uint8_t material = ground->surface[row * ground->columns + column];
        *friction = ground->material_friction[material];
        *roughness = ground->material_roughness[material];
        *soil = ground->material_soil[material];
        return 1;
    }
    return 0;
}

/* Add a contact point to those of its wheel; return 0 if it is one of the chassis. */
static int touch_wheel(struct vehicle *vehicle, const struct contact *contact,
                       const struct ground *ground)
{
    const struct running_gear *gear = vehicle->gear;
    for (size_t i = 0; i < gear->wheel_count; i++) {
        if (vehicle->body->joints[i].link != contact->link)
            continue;
        struct wheel *wheel = gear->wheels[i];
        double friction, soil, normal[3], world[3];
        int mapped = find_ground(ground, contact->other, contact->point, &friction, &wheel->under,
                                 &soil);
        if (wheel->soil) {
            wheel->soil->under = soil;
            wheel->soil->mapped = mapped;
        }
        for (int k = 0; k < 3; k++)
            world[k] = contact->normal[k] * contact->force;
        into_base(vehicle, world, normal);
        wheel->touches = 1;
        wheel->grip += friction * contact->force;
        for (int k = 0; k < 3; k++)
            wheel->normal[k] += normal[k];
        return 1;
    }
    return 0;
}

/* Give wheels their contacts of the last step; move those of chassis to the front and return their
 * number. */
size_t groundlink_vehicles_touch(struct vehicle **vehicles, size_t count,
                                 struct contacts *contacts, const struct ground *ground)
{
    for (size_t i = 0; i < count; i++) {
        const struct running_gear *gear = vehicles[i]->gear;
        for (size_t k = 0; k < gear->wheel_count && !vehicles[i]->keeps_contacts; k++) {
            struct wheel *wheel = gear->wheels[k];
            wheel->touches = 0;
            if (wheel->soil)
                wheel->soil->under = FIRM;
            wheel->grip = wheel->normal[0] = wheel->normal[1] = wheel->normal[2] = 0.0;
        }
    }
    size_t of_chassis = 0;
    for (size_t i = 0; i < contacts->count; i++) {
        const struct contact contact = contacts->points[i];
        for (size_t k = 0; k < count; k++) {
            struct vehicle *vehicle = vehicles[k];
            if (vehicle->body->number != contact.body)
                continue;
            if (!vehicle->keeps_contacts && !touch_wheel(vehicle, &contact, ground))
                contacts->points[of_chassis++] = contact;
            break;
        }
    }
    for (size_t i = 0; i < count; i++)
        vehicles[i]->keeps_contacts = 0;
    return of_chassis;
}

/* A wheel on soft terrain: its lowest point on the map, its heading, and its way in a tick. */
struct track {
    double at[2], heading[2], way;
};

static int track_of(const struct vehicle *vehicle, const struct wheel *wheel,
                    const struct joint *spring, struct track *track)
{
    double load = sqrt(dot(wheel->normal, wheel->normal));
    if (!wheel->touches || !wheel->soil || !wheel->soil->mapped || wheel->soil->under == FIRM ||
        load == 0.0)
        return 0;
    double angle = wheel->steering ? wheel->steering->angle : 0.0;
    double forward[2] = {cos(angle), sin(angle)}, low[3];
    for (int k = 0; k < 3; k++)
        low[k] = wheel->center[k] + (k == 2 ? spring->position - sinkage(wheel) : 0.0) -
                 wheel->radius * wheel->normal[k] / load;
    for (int k = 0; k < 2; k++) {
        const double *r = vehicle->rows[k];
        track->at[k] = vehicle->origin[k] + dot(r, low);
        track->heading[k] = r[0] * forward[0] + r[1] * forward[1];
    }
    double size = hypot(track->heading[0], track->heading[1]);
    if (size == 0.0)
        return 0; /* it stands on its end */
    for (int k = 0; k < 2; k++)
        track->heading[k] /= size;
    track->way = (vehicle->velocity[0] * track->heading[0] +
                  vehicle->velocity[1] * track->heading[1]) * TICK_SECONDS;
    return 1;
}

/* Let wheels press soft terrain, and find the ruts that they come to. */
void groundlink_vehicles_press(struct vehicle **vehicles, size_t count, struct ruts *ruts)
{
    struct track track;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < vehicles[i]->gear->wheel_count; k++) {
            const struct wheel *wheel = vehicles[i]->gear->wheels[k];
            if (track_of(vehicles[i], wheel, &vehicles[i]->body->joints[k], &track))
                groundlink_ruts_press(ruts, track.at, track.heading, wheel->soil->width,
                                      wheel->radius, wheel->soil->sinkage, fabs(track.way));
        }
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < vehicles[i]->gear->wheel_count; k++) {
            const struct wheel *wheel = vehicles[i]->gear->wheels[k];
            struct soil_wheel *soil = wheel->soil;
            if (!track_of(vehicles[i], wheel, &vehicles[i]->body->joints[k], &track))
                continue;
            /* Beyond what the wheel itself has pressed. */
            soil->ahead_m = groundlink_ruts_contact(wheel->radius, soil->sinkage) +
                            fabs(track.way) + 2.0 * ruts->grid.cell;
            double ahead = copysign(soil->ahead_m, track.way);
            for (int k = 0; k < 2; k++)
                track.at[k] += ahead * track.heading[k];
            soil->ahead = groundlink_ruts_mean(ruts, track.at, track.heading, soil->width);
        }
}

/* Add aerodynamic drag and damping to force and torque on the center of mass. */
static void slow_down(const struct vehicle *vehicle, const double velocity[3], const double turn[3])
{
    const double *c = vehicle->com;
    const double v[3] = {
        velocity[0] + turn[1] * c[2] - turn[2] * c[1],
        velocity[1] + turn[2] * c[0] - turn[0] * c[2],
        velocity[2] + turn[0] * c[1] - turn[1] * c[0],
    };
    double push = vehicle->linear_damping +
                  vehicle->drag * sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int k = 0; k < 3; k++) {
        vehicle->body->force[k] -= push * v[k];
        vehicle->body->torque[k] -= vehicle->angular_damping[k] * turn[k];
    }
}

/* Compute the forces of motors, tires, air and water on the bases. */
void groundlink_vehicles_roll(struct vehicle **vehicles, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        struct vehicle *vehicle = vehicles[i];
        struct body *body = vehicle->body;
        double velocity[3], turn[3];
        into_base(vehicle, vehicle->velocity, velocity);
        into_base(vehicle, body->turn, turn);
        groundlink_running_gear_go(vehicle->gear, velocity, turn, body->joints, vehicle->com,
                                   body->force, body->torque);
        body->force[2] += vehicle->shake;
        slow_down(vehicle, velocity, turn);
        if (vehicle->wading)
            groundlink_wade(vehicle, velocity, turn);
    }
}

/* Compute the forces of springs. */
void groundlink_vehicles_spring(struct vehicle **vehicles, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const struct running_gear *gear = vehicles[i]->gear;
        for (size_t k = 0; k < gear->wheel_count; k++) {
            const struct wheel *wheel = gear->wheels[k];
            struct joint *joint = &vehicles[i]->body->joints[k];
            double position = joint->position - sinkage(wheel);
            /* Along the base's z on the wheel; a spring pushes it down by the load that rests on it. */
            joint->force = wheel->along_spring - wheel->preload -
                           wheel->stiffness * (position + wheel->raised) -
                           wheel->damping * (joint->velocity + wheel->raised_speed);
            /* The engine's stop is beyond the deepest sinkage. */
            if (wheel->soil && position > wheel->soil->travel)
                joint->force -= wheel->soil->stop * (position - wheel->soil->travel);
        }
        if (gear->linkage.count)
            groundlink_linkage_turn(&vehicles[i]->gear->linkage,
                                    vehicles[i]->body->joints + gear->wheel_count);
    }
}

/* Find the motion of the bases' origins from that of the centers of mass. */
void groundlink_vehicles_sense(struct vehicle **vehicles, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        struct vehicle *vehicle = vehicles[i];
        const struct body *body = vehicle->body;
        double x = body->orientation[0], y = body->orientation[1], z = body->orientation[2];
        double w = body->orientation[3];
        const double rows[3][3] = {
            {1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
            {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
            {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)},
        };
        memcpy(vehicle->rows, rows, sizeof rows);
        double d[3];
        const double *c = vehicle->com, *o = body->turn;
        for (int k = 0; k < 3; k++) {
            d[k] = -(rows[k][0] * c[0] + rows[k][1] * c[1] + rows[k][2] * c[2]);
            vehicle->origin[k] = body->center[k] + d[k];
        }
        vehicle->velocity[0] = body->velocity[0] + o[1] * d[2] - o[2] * d[1];
        vehicle->velocity[1] = body->velocity[1] + o[2] * d[0] - o[0] * d[2];
        vehicle->velocity[2] = body->velocity[2] + o[0] * d[1] - o[1] * d[0];
        if (vehicle->gear->linkage.count)
            groundlink_linkage_place(&vehicle->gear->linkage,
                                     body->joints + vehicle->gear->wheel_count);
    }
}

/* Write the pose of a wheel's link. */
static void write_pose(const struct vehicle *vehicle, size_t place, char *pose)
{
    const struct wheel *wheel = vehicle->gear->wheels[place];
    const double *q = vehicle->body->orientation, *c = wheel->center;
    double position = vehicle->body->joints[place].position - sinkage(wheel), swung = 0.0;
    double hub[3] = {c[0], c[1], c[2] + position};
    if (wheel->arm) {
        groundlink_arm_carries(wheel->arm, c, position, hub);
        swung = wheel->arm->angle;
    }
    double ux = q[0], uy = q[1], uz = q[2], uw = q[3];
    if (wheel->steering || wheel->yaw != 0.0) {
        /* A steered wheel is turned about z first. */
        double half = (wheel->steering ? wheel->steering->angle : wheel->yaw) / 2, s = sin(half), k = cos(half);
        ux = q[0] * k + q[1] * s;
        uy = q[1] * k - q[0] * s;
        uz = q[2] * k + q[3] * s;
        uw = q[3] * k - q[2] * s;
    }
    double half = (swung + (wheel->shaft ? wheel->shaft->angle * wheel->ratio : 0.0)) / 2;
    double sine = sin(half), cosine = cos(half), row[7];
    for (int k = 0; k < 3; k++) {
        const double *r = vehicle->rows[k];
        row[k] = vehicle->origin[k] + r[0] * hub[0] + r[1] * hub[1] + r[2] * hub[2];
    }
    /* A turn about y: (0, sine, 0, cosine). */
    row[3] = ux * cosine - uz * sine;
    row[4] = uy * cosine + uw * sine;
    row[5] = uz * cosine + ux * sine;
    row[6] = uw * cosine - uy * sine;
    memcpy(pose, row, sizeof row);
}

/* Write the pose of a link that a servo moves. */
static void write_link(const struct vehicle *vehicle, const struct link *link, char *pose)
{
    const double *a = vehicle->body->orientation, *b = link->orientation, *c = link->position;
    double row[7] = {
        [3] = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        [4] = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        [5] = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        [6] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    };
    for (int k = 0; k < 3; k++) {
        const double *r = vehicle->rows[k];
        row[k] = vehicle->origin[k] + r[0] * c[0] + r[1] * c[1] + r[2] * c[2];
    }
    memcpy(pose, row, sizeof row);
}

/* Find the motor's torque on each wheel's axle in the last step. */
void groundlink_vehicle_torques(const struct vehicle *vehicle, double *torques)
{
    for (size_t k = 0; k < vehicle->gear->wheel_count; k++) {
        const struct wheel *wheel = vehicle->gear->wheels[k];
        const struct shaft *shaft = wheel->shaft;
        torques[k] = shaft ? shaft->torque / (wheel->ratio * shaft->tire_count) : 0.0;
    }
}

/* Write the states after the last step where messages have them, which is aligned to nothing. */
void groundlink_vehicles_write(struct vehicle **vehicles, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const struct vehicle *vehicle = vehicles[i];
        const struct body *body = vehicle->body;
        enum { POSE = 7 * sizeof(double), HALF = 3 * sizeof(double) };
        memcpy(vehicle->link_poses, vehicle->origin, HALF);
        memcpy(vehicle->link_poses + HALF, body->orientation, POSE - HALF);
        memcpy(vehicle->base_velocity, vehicle->velocity, HALF);
        memcpy(vehicle->base_velocity + HALF, body->turn, HALF);
        for (size_t k = 0; k < vehicle->gear->wheel_count; k++) {
            const struct wheel *wheel = vehicle->gear->wheels[k];
            double angle = wheel->shaft ? wheel->shaft->angle * wheel->ratio : 0.0;
            double speed = wheel->shaft ? wheel->shaft->speed * wheel->ratio : 0.0;
            write_pose(vehicle, k, vehicle->link_poses + (1 + k) * POSE);
            memcpy(vehicle->joint_positions + k * sizeof angle, &angle, sizeof angle);
            memcpy(vehicle->joint_velocities + k * sizeof speed, &speed, sizeof speed);
        }
        char *pose = vehicle->link_poses + (1 + vehicle->gear->wheel_count) * POSE;
        for (size_t k = 0; k < vehicle->link_count; k++)
            write_link(vehicle, &vehicle->links[k], pose + k * POSE);
        pose += vehicle->link_count * POSE;
        for (size_t k = 0; k < vehicle->gear->linkage.count; k++) {
            const struct arm *arm = vehicle->gear->linkage.arms[k];
            const struct joint *joint = &body->joints[vehicle->gear->wheel_count + k];
            struct link link = {.orientation = {0.0, sin(arm->angle / 2), 0.0, cos(arm->angle / 2)}};
            memcpy(link.position, arm->at, sizeof link.position);
            write_link(vehicle, &link, pose + k * POSE);
            size_t at = (vehicle->link_count + k) * sizeof joint->position;
            memcpy(vehicle->servo_positions + at, &joint->position, sizeof joint->position);
            memcpy(vehicle->servo_velocities + at, &joint->velocity, sizeof joint->velocity);
        }
    }
}
