// SPDX-License-Identifier: Apache-2.0
// Draws depth as seen from a light.

uniform mat4 clip_from_world;
in vec3 position;
in mat4 world_from_link;

void main() { gl_Position = clip_from_world * world_from_link * vec4(position, 1.0); }
