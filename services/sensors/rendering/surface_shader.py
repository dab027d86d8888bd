# SPDX-License-Identifier: Apache-2.0
"""How surfaces are drawn: GLSL.

Rule: what costs time is compiled in only where it is needed, see `programs.Options`. Colours are
linear until the last line. Lighting is diffuse: mirrors and gloss are not modelled.
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
out vec3 at;
out vec3 outwards;
out vec2 place;
out vec3 paint;
out float ahead_m;
out vec4 in_shadow_map[LIGHTS];
flat out int thing;

void main() {
    vec4 world = world_from_link * vec4(position, 1.0);
    vec3 seen = world.xyz - eye;
    at = world.xyz;
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
uniform sampler2D base;
uniform sampler2D bumps;
uniform sampler2DShadow shadow_map;
uniform vec4 light_at[LIGHTS];
uniform vec3 light_power[LIGHTS];
uniform vec3 ambient_above;
uniform vec3 ambient_below;
uniform vec3 horizon;
uniform vec3 eye;
uniform float extinction;
uniform float exposure;
in vec3 at;
in vec3 outwards;
in vec2 place;
in vec3 paint;
in float ahead_m;
in vec4 in_shadow_map[LIGHTS];
flat in int thing;
layout(location = 0) out vec4 colour;
layout(location = 1) out float depth;
#ifdef LABELS
layout(location = 2) out int label;
#endif

DEVELOPED;

float lit(int i) {
    // Beyond its map's edge a lamp's light comes in so flat that only what is higher is there.
    vec3 q = in_shadow_map[i].xyz / in_shadow_map[i].w;
    return texture(shadow_map, vec3((clamp(q.x, 0.0, 1.0) + float(i)) / float(LIGHTS), q.yz));
}

#ifdef BUMPS
vec3 bumped(vec3 n) {
    // The tangents that u and v have in the picture, by the chain rule.
    vec3 dx = dFdx(at), dy = dFdy(at);
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
    vec3 n = outwards;
#ifdef BUMPS
    n = bumped(normalize(n));
#endif
    vec3 factor = texture(base, place).rgb;
    vec3 albedo = paint * factor * factor * BRIGHTEST;
    vec3 light = mix(ambient_below, ambient_above, n.z * 0.5 + 0.5);
    vec3 glow = vec3(0.0);
    for (int i = 0; i < LIGHTS; ++i) {
#ifdef SUN
        float share = max(dot(n, light_at[i].xyz), 0.0);
#else
        vec3 to = light_at[i].xyz - at;
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
    c = mix(horizon, c, exp(-extinction * distance(at, eye)));
#endif
    colour = vec4(developed(c), 1.0);
    depth = ahead_m;
#ifdef LABELS
    label = thing;
#endif
}
"""
