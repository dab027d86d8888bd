// SPDX-License-Identifier: Apache-2.0
// Draws surfaces. Colors are linear until the last line. Attributes are interpolated where the
// triangle covers the pixel (`centroid`), because the center of a pixel may lie beyond a horizon.
// Lighting is diffuse: mirrors and gloss are not modeled.
//
// TRUTH: depth and labels instead of colors. GROUND: terrain instead of meshes; number of its
// materials. SOILS: each of these materials has a label. BUMPS: normal maps. LIGHTS: number of
// lights, which are the SUN or lamps. MAPS: number of shadow maps. WINDOW: the last one is around
// the eye. FOG: there is fog. RUTS: some cells of the terrain are drawn apart, by PRESSED, which has
// shading of its own.

#ifdef GROUND
// Bias of the mipmap level for patterns of the ground. The camera looks along the ground, while
// mipmap levels assume a perpendicular view.
const float SHARPER = -0.7;

uniform sampler2D cells;  // roots of colors, and the share of the sun's light
uniform usampler2D kinds;  // materials of cells
uniform sampler2DArray patterns;
uniform vec4 patterns_at[GROUND];  // of materials: layer, repetitions a meter, the eye's place
uniform vec4 cells_at;  // of the eye, and of a meter to the east and to the north
#ifdef PRESSED
centroid in vec4 pressed;  // normal, and the sun's light over that on the map's surface
#endif
#ifdef RUTS
uniform usampler2D rutted;  // cells that are drawn apart

// Of each cell a strip of this width, in cells, is drawn in any case: no gap shows along edges.
const float OVERLAP = 0.004;
#endif
#else
uniform sampler2D base;
uniform sampler2D bumps;
centroid in vec3 outwards;
centroid in vec2 place;
in vec3 paint;
#endif
uniform sampler2DShadow shadow_map;
uniform vec3 window_scale;  // from the sun's map to that around the eye
uniform vec3 window_shift;
uniform vec4 light_at[LIGHTS];
uniform vec3 light_power[LIGHTS];
uniform vec3 ambient_above;
uniform vec3 ambient_below;
uniform vec3 horizon;
uniform vec3 eye;
uniform float extinction;
uniform float exposure;
centroid in vec3 seen;
in float ahead_m;
centroid in vec4 in_shadow_map[LIGHTS];
flat in int thing;

#ifdef RUTS
bool is_apart(vec2 cell) {
    ivec2 last = textureSize(rutted, 0) - 1;
    return texelFetch(rutted, clamp(ivec2(floor(cell)), ivec2(0), last), 0).r != 0u;
}

void leave_out_ruts() {
    vec2 cell = (cells_at.xy + cells_at.zw * seen.xy) * vec2(textureSize(rutted, 0));
    vec2 one = vec2(OVERLAP), other = vec2(OVERLAP, -OVERLAP);
    if (is_apart(cell) && is_apart(cell + one) && is_apart(cell - one) && is_apart(cell + other) &&
        is_apart(cell - other))
        discard;
}
#endif

#ifdef TRUTH
layout(location = 0) out float depth;
layout(location = 1) out int label;

void main() {
#ifdef RUTS
    leave_out_ruts();
#endif
    depth = ahead_m;
#ifdef SOILS
    label = thing + int(texture(kinds, cells_at.xy + cells_at.zw * seen.xy).r);
#else
    label = thing;
#endif
}
#else
layout(location = 0) out vec4 color;

const float LAMP_RADIUS_M = 0.2;

#include "developed.glsl"

float lit(int i) {
    // Beyond its map's edge a lamp's light comes in so flat that only what is higher is there.
    vec3 q = in_shadow_map[i].xyz / in_shadow_map[i].w;
    float map = float(i);
    // The sun's map holds all that stands: beyond it nothing throws a shadow.
    bool beyond = false;
#ifdef SUN
    beyond = any(greaterThan(abs(q.xy - 0.5), vec2(0.5)));
#endif
    q.x = clamp(q.x, 0.0, 1.0);
#ifdef WINDOW
    vec3 near = window_scale * in_shadow_map[i].xyz + window_shift;
    if (all(lessThan(abs(near - 0.5), vec3(0.499)))) q = near, map += 1.0, beyond = false;
#endif
    return beyond ? 1.0 : texture(shadow_map, vec3((q.x + map) / float(MAPS), q.yz));
}

#ifdef BUMPS
vec3 bumped(vec3 n) {
    // The tangents that u and v have in the picture, by the chain rule.
    vec3 dx = dFdx(seen), dy = dFdy(seen);
    vec2 du = dFdx(place), dv = dFdy(place);
    vec3 across = cross(dy, n), along = cross(n, dx);
    vec3 t = across * du.x + along * dv.x;
    vec3 b = across * du.y + along * dv.y;
    // Pictures have their first row on top, which mirrors them: hence the sign.
    float scale = sign(dot(dx, across)) * inversesqrt(max(max(dot(t, t), dot(b, b)), 1e-20));
    vec3 local = texture(bumps, place).xyz * 2.0 - 1.0;
    return normalize(t * scale * local.x + b * scale * local.y + n * local.z);
}
#endif

void main() {
#ifdef RUTS
    leave_out_ruts();
#endif
#ifdef PRESSED
    vec3 n = normalize(pressed.xyz);
#elif defined(GROUND)
    vec3 n = vec3(0.0, 0.0, 1.0);  // the sun's share is known; all get alike of the sky
#else
    vec3 n = outwards;
#endif
#ifdef BUMPS
    n = bumped(normalize(n));
#endif
#ifdef GROUND
    vec2 cell = cells_at.xy + cells_at.zw * seen.xy;
    vec4 here = texture(cells, cell);
    vec4 pattern = patterns_at[texture(kinds, cell).r];
    float factor = texture(patterns, vec3(seen.xy * pattern.y + pattern.zw, pattern.x), SHARPER).r;
    vec3 albedo = here.rgb * here.rgb * (factor * factor * BRIGHTEST);
#else
    vec3 factor = texture(base, place).rgb;
    vec3 albedo = paint * factor * factor * BRIGHTEST;
#endif
    vec3 light = mix(ambient_below, ambient_above, n.z * 0.5 + 0.5);
    vec3 glow = vec3(0.0);
    for (int i = 0; i < LIGHTS; ++i) {
#if defined(SUN) && defined(GROUND)
        float share = here.a;
#ifdef PRESSED
        share *= pressed.w;
#endif
#elif defined(SUN)
        float share = max(dot(n, light_at[i].xyz), 0.0);
#else
        vec3 to = light_at[i].xyz - eye - seen;
        float squared = dot(to, to);
        // A flat lamp by Lambert's law, d^-4 for two cosines and the distance, taken back to d^-3:
        // what walls send on makes up for a part of what is lost on the way.
        float share = max(dot(n, to), 0.0) * max(to.z, 0.0) * inversesqrt(squared) / squared;
        if (squared < LAMP_RADIUS_M * LAMP_RADIUS_M) glow = light_power[i];
#endif
        light += share * lit(i) * light_power[i];
    }
    vec3 c = albedo * light + glow;
#ifdef FOG
    c = mix(horizon, c, exp(-extinction * length(seen)));
#endif
    color = vec4(developed(c), 1.0);
}
#endif
