// SPDX-License-Identifier: Apache-2.0
/* Bullet by its C API: motion, contacts and forces of all vehicles in one call each.
 *
 * PyBullet's library exports the C API but keeps its handle of a world to itself. Bullet gives a
 * plugin a handle of the world that loads it, so this library is a plugin that keeps the handle. Names
 * and layouts are those of PhysicsClientC_API.h, SharedMemoryPublic.h and plugins/b3PluginAPI.h of
 * bullet3.
 */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>

#include "bodies.h"

/* SHARED_MEMORY_MAGIC_NUMBER of PyBullet 3.2.7: Bullet loads no plugin of another version. */
enum { VERSION = 202010061 };

enum { CONTROL_MODE_TORQUE = 1, EF_LINK_FRAME = 1 };

typedef struct client *Client;
typedef struct command *Command;
typedef struct status *Status;

struct contact_point {
    int flags;
    int body_a, body_b, link_a, link_b;
    double on_a[3], on_b[3], normal_on_b[3];
    double distance, normal_force;
    double friction_force[2], friction_direction[2][3];
};

struct contact_points {
    int count;
    const struct contact_point *points;
};

struct plugin_context {
    Client client;
};

#define FUNCTIONS(each)                                                                            \
    each(int, SubmitClientCommand, (Client, Command))                                              \
    each(Status, ProcessServerStatus, (Client))                                                    \
    each(Command, InitStepSimulationCommand, (Client))                                             \
    each(Command, RequestActualStateCommandInit, (Client, int))                                    \
    each(int, GetStatusActualState, (Status, int *, int *, int *, const double **, const double **, \
                                     const double **, const double **))                            \
    each(Command, InitRequestContactPointInformation, (Client))                                    \
    each(void, GetContactPointInformation, (Client, struct contact_points *))                      \
    each(Command, ApplyExternalForceCommandInit, (Client))                                         \
    each(void, ApplyExternalForce, (Command, int, int, const double *, const double *, int))       \
    each(void, ApplyExternalTorque, (Command, int, int, const double *, int))                      \
    each(Command, JointControlCommandInit2, (Client, int, int))                                    \
    each(int, JointControlSetDesiredForceTorque, (Command, int, double))

#define DECLARE(result, name, arguments) static result(*b3##name) arguments;
FUNCTIONS(DECLARE)

static _Thread_local Client loading;

int initPlugin_groundlink(struct plugin_context *context)
{
    loading = context->client;
    return VERSION;
}

void exitPlugin_groundlink(struct plugin_context *context)
{
    (void)context;
}

int executePluginCommand_groundlink(struct plugin_context *context, const void *arguments)
{
    (void)context;
    (void)arguments;
    return 0;
}

/* Return the handle of the world that this thread loaded the plugin into last. */
Client groundlink_bullet_world(void)
{
    return loading;
}

/* Find Bullet's functions in a library that is loaded; return the name of one that is missing. */
const char *groundlink_bullet_bind(void *library)
{
#define BIND(result, name, arguments)                                                              \
    *(void **)&b3##name = dlsym(library, "b3" #name);                                              \
    if (!b3##name)                                                                                 \
        return "b3" #name;
    FUNCTIONS(BIND)
    return NULL;
}

/* The world is of this process, so its answer is there when a command returns. PyBullet's own calls
 * read the clock before and after. */
static Status do_now(Client world, Command command)
{
    b3SubmitClientCommand(world, command);
    return b3ProcessServerStatus(world);
}

void groundlink_bullet_step(Client world)
{
    do_now(world, b3InitStepSimulationCommand(world));
}

void groundlink_bullet_sense(Client world, struct body **bodies, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        struct body *body = bodies[i];
        Status status = do_now(world, b3RequestActualStateCommandInit(world, body->number));
        const double *q, *u;
        b3GetStatusActualState(status, NULL, NULL, NULL, NULL, &q, &u, NULL);
        for (int k = 0; k < 3; k++) {
            body->center[k] = q[k];
            body->velocity[k] = u[k];
            body->turn[k] = u[3 + k];
        }
        for (int k = 0; k < 4; k++)
            body->orientation[k] = q[3 + k];
        for (int k = 0; k < body->joint_count; k++) {
            struct joint *joint = &body->joints[k];
            joint->position = q[joint->q];
            joint->velocity = u[joint->u];
        }
    }
}

void groundlink_bullet_push(Client world, struct body **bodies, size_t count)
{
    static const double origin[3];
    for (size_t i = 0; i < count; i++) {
        const struct body *body = bodies[i];
        /* Bullet mixes up the vectors of several forces in one command. */
        Command command = b3ApplyExternalForceCommandInit(world);
        b3ApplyExternalForce(command, body->number, BASE, body->force, origin, EF_LINK_FRAME);
        do_now(world, command);
        command = b3ApplyExternalForceCommandInit(world);
        b3ApplyExternalTorque(command, body->number, BASE, body->torque, EF_LINK_FRAME);
        do_now(world, command);
        command = b3JointControlCommandInit2(world, body->number, CONTROL_MODE_TORQUE);
        for (int k = 0; k < body->joint_count; k++)
            b3JointControlSetDesiredForceTorque(command, body->joints[k].u, body->joints[k].force);
        do_now(world, command);
    }
}

static void add(struct contacts *contacts, const struct contact_point *found, int of_b)
{
    if (contacts->count == contacts->room) {
        size_t room = 2 * contacts->room + 64;
        void *grown = realloc(contacts->points, room * sizeof *contacts->points);
        if (!grown)
            abort();
        contacts->points = grown;
        contacts->room = room;
    }
    struct contact *point = &contacts->points[contacts->count++];
    point->body = of_b ? found->body_b : found->body_a;
    point->link = of_b ? found->link_b : found->link_a;
    point->other = of_b ? found->body_a : found->body_b;
    point->force = found->normal_force;
    for (int k = 0; k < 3; k++) {
        point->point[k] = of_b ? found->on_a[k] : found->on_b[k];
        point->normal[k] = of_b ? -found->normal_on_b[k] : found->normal_on_b[k];
    }
}

void groundlink_bullet_contacts(Client world, struct contacts *contacts)
{
    do_now(world, b3InitRequestContactPointInformation(world));
    struct contact_points found;
    b3GetContactPointInformation(world, &found);
    contacts->count = 0;
    for (int i = 0; i < found.count; i++)
        if (found.points[i].normal_force > 0.0) {
            add(contacts, &found.points[i], 0);
            add(contacts, &found.points[i], 1);
        }
}

void groundlink_contacts_free(struct contacts *contacts)
{
    free(contacts->points);
    contacts->points = NULL;
    contacts->count = contacts->room = 0;
}
