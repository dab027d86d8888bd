// SPDX-License-Identifier: Apache-2.0
// Tone curve. Squares and square roots approximate the sRGB curve: 2.0 is close to 2.2 and costs
// nothing.

vec3 developed(vec3 light) {
    // Dark stays dark and lights do not burn out: Narkowicz 2015, "ACES Filmic Tone Mapping Curve".
    vec3 c = light * exposure;
    return sqrt(min(c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14), 1.0));
}
