// SPDX-License-Identifier: Apache-2.0
// Places the blades of tufts of grass; used with surface.frag.
//
// A tuft is an instance: blades that lean away from its middle, each a strip that bends under its own
// weight. Far tufts are fewer and have wider blades.

uniform mat4 clip_from_turned;
uniform vec3 eye;
uniform vec3 forward;
uniform mat4 shadow_from_world[LIGHTS];
in vec3 knot;  // number of the blade, side -1..1, height 0..1
in vec4 root;  // foot of the tuft, and its height
in vec4 look;  // color, and widening of the blades
in float draw;  // random, 0..1
in int tuft_label;
centroid out vec3 seen;
centroid out vec3 outwards;
centroid out vec2 place;
out vec3 paint;
out float ahead_m;
centroid out vec4 in_shadow_map[LIGHTS];
flat out int thing;

const float WIDTH_M = 0.014;
const float SPREAD_M = 0.14;

float drawn(float n) { return fract((draw + 0.37) * (97.13 * n + 311.7)); }

void main() {
    float height = root.w * (0.65 + 0.35 * drawn(knot.x + 0.1));
    float lean = 0.15 + 0.55 * drawn(knot.x + 0.2);
    float azimuth = 6.2831853 * drawn(knot.x + 0.3);
    float off = SPREAD_M * sqrt(drawn(knot.x + 0.4));
    float foot_azimuth = 6.2831853 * drawn(knot.x + 0.5);
    vec2 out_of = vec2(cos(azimuth), sin(azimuth));
    vec2 middle = root.xy + off * vec2(cos(foot_azimuth), sin(foot_azimuth));
    middle += out_of * lean * height * knot.z * knot.z;
    float half_width = WIDTH_M * look.w * (1.0 - 0.85 * knot.z) * knot.y;
    vec3 world = vec3(middle + half_width * vec2(-out_of.y, out_of.x), root.z + height * knot.z);
    seen = world - eye;
    outwards = normalize(vec3(0.5 * out_of, 1.0));
    place = vec2(0.0);
    paint = look.rgb * (0.5 + 0.7 * knot.z) * (0.8 + 0.4 * drawn(knot.x + 0.6));
    ahead_m = dot(forward, seen);
    thing = tuft_label;
    for (int i = 0; i < LIGHTS; ++i) in_shadow_map[i] = shadow_from_world[i] * vec4(world, 1.0);
    gl_Position = clip_from_turned * vec4(seen, 1.0);
}
