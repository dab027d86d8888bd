// SPDX-License-Identifier: Apache-2.0
// Color of the sky and of the sun along a ray, as it is stored.

uniform vec3 horizon;
uniform vec3 zenith;
uniform vec4 light_at[LIGHTS];
uniform vec3 light_power[LIGHTS];
uniform float exposure;

#include "developed.glsl"

vec3 sky(vec3 ray) {
    vec3 d = normalize(ray);
    vec3 c = mix(horizon, zenith, sqrt(clamp(d.z, 0.0, 1.0)));
#ifdef SUN
    float near = max(dot(d, light_at[0].xyz), 0.0);
    c += light_power[0] * (0.15 * pow(near, 60.0) + 20.0 * step(0.99996, near));
#endif
    return developed(c);
}
