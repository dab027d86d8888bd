# SPDX-License-Identifier: Apache-2.0
"""GLSL that draws surfaces.

Expensive features are compiled in only where needed, see `programs.Options`. With TRUTH the shader
writes depth and labels instead of color. Colors are linear until the last line. Attributes are
interpolated where the triangle covers the pixel (`centroid`), because the center of a pixel may lie
beyond a horizon. Lighting is diffuse: mirrors and gloss are not modeled.
"""

VERTEX = """
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
"""

FRAGMENT = """
#ifdef GROUND
uniform sampler2D cells;  // roots of colors, and the share of the sun's light
uniform usampler2D kinds;  // materials of cells
uniform sampler2DArray patterns;
uniform vec4 patterns_at[GROUND];  // of materials: layer, repetitions a meter, the eye's place
uniform vec4 cells_at;  // of the eye, and of a meter to the east and to the north
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
#ifdef TRUTH
layout(location = 0) out float depth;
layout(location = 1) out int label;

void main() {
    depth = ahead_m;
    label = thing;
}
#else
layout(location = 0) out vec4 color;

DEVELOPED;

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
#ifdef GROUND
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
"""
