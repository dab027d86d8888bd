// SPDX-License-Identifier: Apache-2.0
/* Noise of an image sensor, see `imager.py`. */

#include <stddef.h>
#include <stdint.h>

/* Write to `read` the coded value of each pixel value with its noise: `coded` has 256 steps of
 * noise for each value. */
void groundlink_grain(size_t values, const uint8_t *pixels, const uint8_t *noise,
                      const uint8_t *coded, uint8_t *read)
{
    for (size_t i = 0; i < values; i++)
        read[i] = coded[pixels[i] << 8 | noise[i]];
}
