// SPDX-License-Identifier: Apache-2.0
// Places the vertices of a terrain; used with surface.frag and GROUND.
//
// Heights are in a texture, and a vertex is a row and a column of it, so adjacent patches have
// identical vertices. Positions are computed relative to the eye, so they are exact far from the
// world's origin. A skirt of one pixel surrounds each patch: the largest gap between the edges of a
// coarse patch and of a fine patch.

uniform mat4 clip_from_turned;
uniform vec3 eye;
uniform vec3 forward;
uniform mat4 shadow_from_world[LIGHTS];
uniform sampler2D heights;
uniform ivec2 anchor;  // column and row of a vertex near the eye
uniform vec2 anchor_from_eye;
uniform float cell_m;
uniform float pixel;  // tangent of its angle
uniform int label;
in ivec3 knot;  // column and row in the patch, 1 for a skirt's lower edge
in ivec3 patch_at;  // column and row of the patch's first vertex, cells from vertex to vertex
centroid out vec3 seen;
out float ahead_m;
centroid out vec4 in_shadow_map[LIGHTS];
flat out int thing;

void main() {
    ivec2 number = min(patch_at.xy + patch_at.z * knot.xy, textureSize(heights, 0) - 1);
    float height = texelFetch(heights, number, 0).r;
    seen = vec3(anchor_from_eye + vec2(number - anchor) * cell_m, height - eye.z);
    seen.z -= float(knot.z) * pixel * length(seen);
    ahead_m = dot(forward, seen);
    thing = label;
    vec4 world = vec4(seen + eye, 1.0);
    for (int i = 0; i < LIGHTS; ++i) in_shadow_map[i] = shadow_from_world[i] * world;
    gl_Position = clip_from_turned * vec4(seen, 1.0);
}
