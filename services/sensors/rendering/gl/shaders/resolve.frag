// SPDX-License-Identifier: Apache-2.0
// Averages the light of a pixel's samples, of which those without a surface (alpha 0) show the sky.
// Colors are square roots of light. The sky is not drawn before: on a CPU, surfaces would not save
// its cost where they hide it, because Mesa shades hidden fragments, too, if there are samples.

uniform sampler2DMS drawn;
in vec3 ray;
layout(location = 0) out vec4 color;

#include "sky.glsl"

void main() {
    ivec2 first = FINER * ivec2(gl_FragCoord.xy);
    vec3 across = dFdx(ray), down = dFdy(ray);
    vec3 light = vec3(0.0);
    for (int y = 0; y < FINER; ++y) for (int x = 0; x < FINER; ++x) {
        vec2 at = (vec2(x, y) + 0.5) / float(FINER) - 0.5;
        vec3 behind = roundEven(255.0 * sky(ray + at.x * across + at.y * down)) * (1.0 / 255.0);
        for (int i = 0; i < 4; ++i) {
            vec4 surface = texelFetch(drawn, first + ivec2(x, y), i);
            vec3 root = surface.a > 0.0 ? surface.rgb : behind;
            light += root * root;
        }
    }
    color = vec4(sqrt(light / float(4 * FINER * FINER)), 1.0);
}
