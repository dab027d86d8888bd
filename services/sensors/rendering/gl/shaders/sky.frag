// SPDX-License-Identifier: Apache-2.0
// Draws the sky.

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

#include "sky.glsl"

void main() { color = vec4(sky(ray), 1.0); }
#endif
