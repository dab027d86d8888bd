// SPDX-License-Identifier: Apache-2.0
// Places the vertices of pressed ground; used with surface.frag, GROUND and PRESSED.

uniform mat4 clip_from_turned;
uniform vec3 eye;
uniform vec3 forward;
uniform mat4 shadow_from_world[LIGHTS];
uniform vec3 origin_from_eye;
uniform int label;
in vec3 at;  // from an origin near the eye
in vec3 normal;
in float sunward;  // share of the sun's light over that of the map's surface
centroid out vec3 seen;
out float ahead_m;
centroid out vec4 in_shadow_map[LIGHTS];
centroid out vec4 pressed;
flat out int thing;

void main() {
    seen = origin_from_eye + at;
    ahead_m = dot(forward, seen);
    thing = label;
    pressed = vec4(normal, sunward);
    vec4 world = vec4(seen + eye, 1.0);
    for (int i = 0; i < LIGHTS; ++i) in_shadow_map[i] = shadow_from_world[i] * world;
    gl_Position = clip_from_turned * vec4(seen, 1.0);
}
