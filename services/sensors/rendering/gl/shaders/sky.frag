// SPDX-License-Identifier: Apache-2.0
// Draws the sky and the sun.

uniform vec3 horizon;
uniform vec3 zenith;
uniform vec4 light_at[LIGHTS];
uniform vec3 light_power[LIGHTS];
uniform float exposure;
in vec3 ray;
#ifdef TRUTH
layout(location = 0) out float depth;
layout(location = 1) out int label;

void main() {
    depth = uintBitsToFloat(0x7F800000u);  // +infinity
    label = -1;
}
#else
layout(location = 0) out vec4 color;

#include "developed.glsl"

void main() {
    vec3 d = normalize(ray);
    vec3 c = mix(horizon, zenith, sqrt(clamp(d.z, 0.0, 1.0)));
#ifdef SUN
    float near = max(dot(d, light_at[0].xyz), 0.0);
    c += light_power[0] * (0.15 * pow(near, 60.0) + 20.0 * step(0.99996, near));
#endif
    color = vec4(developed(c), 1.0);
}
#endif
