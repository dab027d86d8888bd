// SPDX-License-Identifier: Apache-2.0
// Averages the light of a pixel's samples. Colors are square roots of light.

uniform sampler2DMS drawn;
layout(location = 0) out vec4 color;

void main() {
    ivec2 first = FINER * ivec2(gl_FragCoord.xy);
    vec3 light = vec3(0.0);
    for (int y = 0; y < FINER; ++y) for (int x = 0; x < FINER; ++x) for (int i = 0; i < 4; ++i) {
        vec3 root = texelFetch(drawn, first + ivec2(x, y), i).rgb;
        light += root * root;
    }
    color = vec4(sqrt(light / float(4 * FINER * FINER)), 1.0);
}
