// SPDX-License-Identifier: Apache-2.0
// What Embree takes for the same rays when it is called from C: for one ray after the other, in one
// instance of the terrain and an instance array with motion blur of bodies that share a mesh; and for
// eight at a time in a single mesh of everything at rest, which is its fastest form.
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

enum { WIDE = 8 };

struct rayhit8 {
    float origin[3][WIDE], near[WIDE], direction[3][WIDE], time[WIDE], far[WIDE];
    uint32_t mask[WIDE], id[WIDE], flags[WIDE];
    float normal[3][WIDE], u[WIDE], v[WIDE];
    uint32_t primitive[WIDE], geometry[WIDE], instance[WIDE], instance_primitive[WIDE];
} __attribute__((aligned(32)));

static handle (*new_scene)(handle);
static handle (*new_geometry)(handle, int);
static void (*share)(handle, int, unsigned, int, const void *, size_t, size_t, size_t);
static void (*set_scene)(handle, handle), (*set_scenes)(handle, handle *, size_t);
static void (*set_steps)(handle, unsigned), (*commit)(handle), (*commit_scene)(handle);
static unsigned (*attach)(handle, handle);
static void (*intersect1)(handle, struct rayhit *, void *);
static void (*intersect8)(const int32_t *, handle, struct rayhit8 *, void *);
static void (*update)(handle, int, unsigned);
static int (*device_error)(handle);

static handle device, top, array, rest;
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
    intersect8 =
        (void (*)(const int32_t *, handle, struct rayhit8 *, void *))dlsym(embree, "rtcIntersect8");
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

// Build a scene of everything at rest, on the same device; return 0, or Embree's error.
int raw_build_rest(const float *vertices, size_t vertex_count, const uint32_t *faces, size_t count)
{
    rest = mesh(vertices, vertex_count, faces, count);
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

// Write the ranges of all rays in the world at rest, eight neighbors at a time; there are whole eights.
void raw_trace_rest(size_t count, float max_range, const float *origins, const float *directions,
                    float *ranges)
{
    static const int32_t all[WIDE] __attribute__((aligned(32))) = {-1, -1, -1, -1, -1, -1, -1, -1};
    // RTCIntersectArguments: of neighboring rays, for geometry of every kind.
    struct {
        int32_t flags;
        uint32_t feature_mask;
        void *context, *filter, *intersect;
    } coherent = {1 << 16, ~0u, NULL, NULL, NULL};
    struct rayhit8 eight = {0};
    memset(eight.mask, -1, sizeof eight.mask);
    for (size_t ray = 0; ray < count; ray += WIDE) {
        for (size_t axis = 0; axis < 3; axis++) {
            memcpy(eight.origin[axis], origins + axis * count + ray, sizeof eight.origin[axis]);
            memcpy(eight.direction[axis], directions + axis * count + ray,
                   sizeof eight.direction[axis]);
        }
        memset(eight.geometry, -1, sizeof eight.geometry);
        for (size_t lane = 0; lane < WIDE; lane++)
            eight.far[lane] = max_range;
        intersect8(all, rest, &eight, &coherent);
        for (size_t lane = 0; lane < WIDE; lane++)
            ranges[ray + lane] = eight.geometry[lane] == ~0u ? INFINITY : eight.far[lane];
    }
}
