// SPDX-License-Identifier: Apache-2.0
// Places the vertices of meshes.

uniform mat4 clip_from_turned;  // projection and rotation: positions come relative to the eye
uniform vec3 eye;
uniform vec3 forward;
uniform mat4 shadow_from_world[LIGHTS];
in vec3 position;
in vec3 normal;
in vec2 uv;
in vec3 tint;
in int label;
in mat4 world_from_link;
in int vehicle;
centroid out vec3 seen;  // from the eye
centroid out vec3 outwards;
centroid out vec2 place;
out vec3 paint;
out float ahead_m;
centroid out vec4 in_shadow_map[LIGHTS];
flat out int thing;

void main() {
    vec4 world = world_from_link * vec4(position, 1.0);
    seen = world.xyz - eye;
    outwards = mat3(world_from_link) * normal;
    place = uv;
    paint = tint;
    ahead_m = dot(forward, seen);
    thing = label + vehicle;
    for (int i = 0; i < LIGHTS; ++i) in_shadow_map[i] = shadow_from_world[i] * world;
    gl_Position = clip_from_turned * vec4(seen, 1.0);
}
