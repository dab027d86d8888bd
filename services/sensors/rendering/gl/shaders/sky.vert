// SPDX-License-Identifier: Apache-2.0
// Covers the picture with one triangle, and computes the ray of each pixel.

uniform mat3 world_from_clip;
out vec3 ray;

void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
    ray = world_from_clip * vec3(corner, 1.0);
    gl_Position = vec4(corner, 1.0, 1.0);
}
