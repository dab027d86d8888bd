// SPDX-License-Identifier: Apache-2.0
// What Embree takes for the same rays when it is called from C for one ray after the other: one
// instance of the terrain, and an instance array with motion blur of bodies that share a mesh.
//
// No header of Embree's is needed: its functions are looked up in the library, enumerators and
// layouts are those of Embree 4.4.
#include <dlfcn.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

typedef void *handle;

enum { TRIANGLES = 0, INSTANCE = 121, INSTANCE_ARRAY = 122 };
enum { INDEX = 0, VERTEX = 1, TRANSFORM = 23 };
enum { UINT = 0x5001, UINT3 = 0x5003, FLOAT3 = 0x9003, FLOAT4X4 = 0x9244 };

struct rayhit {
    float origin[3], near, direction[3], time, far;
    uint32_t mask, id, flags;
    float normal[3], u, v;
    uint32_t primitive, geometry, instance, instance_primitive;
} __attribute__((aligned(16)));

static handle (*new_scene)(handle);
static handle (*new_geometry)(handle, int);
static void (*share)(handle, int, unsigned, int, const void *, size_t, size_t, size_t);
static void (*set_scene)(handle, handle), (*set_scenes)(handle, handle *, size_t);
static void (*set_steps)(handle, unsigned), (*commit)(handle), (*commit_scene)(handle);
static unsigned (*attach)(handle, handle);
static void (*intersect1)(handle, struct rayhit *, void *);
static void (*update)(handle, int, unsigned);
static int (*device_error)(handle);

static handle device, top, array;
static unsigned array_steps;

static handle mesh(const float *vertices, size_t vertex_count, const uint32_t *faces, size_t count)
{
    handle geometry = new_geometry(device, TRIANGLES), scene = new_scene(device);
    share(geometry, VERTEX, 0, FLOAT3, vertices, 0, 12, vertex_count);
    share(geometry, INDEX, 0, UINT3, faces, 0, 12, count);
    commit(geometry);
    attach(scene, geometry);
    commit_scene(scene);
    return scene;
}

// Build the scene on a device of ours; `vertices` may be read 16 bytes past their end. Return 0, or Embree's error.
int raw_build(const char *library, handle ours, const float *vertices, size_t vertex_count, const uint32_t *faces,
              size_t count, const float *body_vertices, size_t body_vertex_count,
              const uint32_t *body_faces, size_t body_count, const float *matrices, unsigned steps,
              size_t bodies, const uint32_t *zeros)
{
    handle embree = dlopen(library, RTLD_NOW);
    if (!embree)
        return -1;
    new_scene = (handle(*)(handle))dlsym(embree, "rtcNewScene");
    new_geometry = (handle(*)(handle, int))dlsym(embree, "rtcNewGeometry");
    share = (void (*)(handle, int, unsigned, int, const void *, size_t, size_t, size_t))dlsym(
        embree, "rtcSetSharedGeometryBuffer");
    set_scene = (void (*)(handle, handle))dlsym(embree, "rtcSetGeometryInstancedScene");
    set_scenes = (void (*)(handle, handle *, size_t))dlsym(embree, "rtcSetGeometryInstancedScenes");
    set_steps = (void (*)(handle, unsigned))dlsym(embree, "rtcSetGeometryTimeStepCount");
    commit = (void (*)(handle))dlsym(embree, "rtcCommitGeometry");
    commit_scene = (void (*)(handle))dlsym(embree, "rtcCommitScene");
    attach = (unsigned (*)(handle, handle))dlsym(embree, "rtcAttachGeometry");
    intersect1 = (void (*)(handle, struct rayhit *, void *))dlsym(embree, "rtcIntersect1");
    update = (void (*)(handle, int, unsigned))dlsym(embree, "rtcUpdateGeometryBuffer");
    device_error = (int (*)(handle))dlsym(embree, "rtcGetDeviceError");

    device = ours;
    top = new_scene(device);
    handle terrain = new_geometry(device, INSTANCE);
    set_scene(terrain, mesh(vertices, vertex_count, faces, count));
    commit(terrain);
    attach(top, terrain);
    handle body = mesh(body_vertices, body_vertex_count, body_faces, body_count);
    array = new_geometry(device, INSTANCE_ARRAY);
    set_scenes(array, &body, 1);
    share(array, INDEX, 0, UINT, zeros, 0, 4, bodies);
    set_steps(array, array_steps = steps);
    for (unsigned step = 0; step < steps; step++)
        share(array, TRANSFORM, step, FLOAT4X4, matrices + 16 * step * bodies, 0, 64, bodies);
    commit(array);
    attach(top, array);
    commit_scene(top);
    return device_error(device);
}

// Take the matrices anew, as after every revolution.
void raw_move(void)
{
    for (unsigned step = 0; step < array_steps; step++)
        update(array, TRANSFORM, step);
    commit(array);
    commit_scene(top);
}

// Write the ranges of all rays; arrays of vectors are component after component.
void raw_trace(size_t count, float max_range, const float *origins, const float *directions,
               const float *times, float *ranges)
{
    for (size_t ray = 0; ray < count; ray++) {
        struct rayhit one = {.time = times[ray], .far = max_range, .mask = ~0u, .geometry = ~0u,
                             .instance = ~0u, .instance_primitive = ~0u, .primitive = ~0u};
        for (size_t axis = 0; axis < 3; axis++) {
            one.origin[axis] = origins[axis * count + ray];
            one.direction[axis] = directions[axis * count + ray];
        }
        intersect1(top, &one, NULL);
        ranges[ray] = one.geometry == ~0u ? INFINITY : one.far;
    }
}
