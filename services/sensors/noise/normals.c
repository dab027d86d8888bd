// SPDX-License-Identifier: Apache-2.0
/* Standard normal numbers: those that numpy's `Generator(Philox(key, counter)).standard_normal` gives
 * in float32, in a third of its time.
 *
 * Sources: Salmon et al. (2011), "Parallel random numbers: as easy as 1, 2, 3" (Philox 4x64, 10 rounds);
 * Marsaglia and Tsang (2000), "The ziggurat method for generating random variables".
 */

#include <math.h>
#include <stddef.h>
#include <stdint.h>

/* The ziggurat's 256 layers for numbers of 23 bits; a structure of the same name in
 * `scanning/draws.py` fills it. `right` is where the lowest one ends. */
struct ziggurat {
    uint32_t inside[256];             /* numbers below are under the curve */
    float width[256], height[256];
    float right, per_right;
};

enum { BLOCKS = 16, NUMBERS = 8 * BLOCKS };

struct stream {
    uint64_t key[2], counter[4];
    uint32_t numbers[NUMBERS];
    int used;
};

/* Draw the next numbers. */
static void refill(struct stream *stream)
{
    for (int block = 0; block < BLOCKS; block++) {
        for (int word = 0; word < 4 && !++stream->counter[word]; word++)
            ;
        uint64_t a = stream->counter[0], b = stream->counter[1], c = stream->counter[2],
                 d = stream->counter[3], left = stream->key[0], right = stream->key[1];
        for (int round = 0; round < 10; round++) {
            const unsigned __int128 first = (unsigned __int128)0xD2E7470EE14C6C93u * a;
            const unsigned __int128 second = (unsigned __int128)0xCA5A826395121157u * c;
            a = (uint64_t)(second >> 64) ^ b ^ left;
            b = (uint64_t)second;
            c = (uint64_t)(first >> 64) ^ d ^ right;
            d = (uint64_t)first;
            left += 0x9E3779B97F4A7C15u;
            right += 0xBB67AE8584CAA73Bu;
        }
        const uint64_t words[4] = {a, b, c, d};
        for (int word = 0; word < 4; word++) {
            stream->numbers[8 * block + 2 * word] = (uint32_t)words[word];
            stream->numbers[8 * block + 2 * word + 1] = (uint32_t)(words[word] >> 32);
        }
    }
    stream->used = 0;
}

static inline uint32_t next(struct stream *stream)
{
    if (stream->used == NUMBERS)
        refill(stream);
    return stream->numbers[stream->used++];
}

/* A number in 0..1. */
static inline float uniform(struct stream *stream)
{
    return (float)(next(stream) >> 8) * (1 / 16777216.0f);
}

/* Return a number beyond the end of the lowest layer. */
static float tail(const struct ziggurat *ziggurat, struct stream *stream, uint32_t place)
{
    for (;;) {
        const float beyond = -ziggurat->per_right * log1pf(-uniform(stream));
        const float other = -log1pf(-uniform(stream));
        if (other + other > beyond * beyond)
            return place >> 8 & 1 ? -(ziggurat->right + beyond) : ziggurat->right + beyond;
    }
}

/* Write numbers of the stream that a key and the two upper words of a counter name. */
void groundlink_normals(const struct ziggurat *ziggurat, const uint64_t key[2],
                        const uint64_t counter[2], size_t count, float *normals)
{
    struct stream stream = {
        .key = {key[0], key[1]}, .counter = {0, 0, counter[0], counter[1]}, .used = NUMBERS};
    for (size_t i = 0; i < count;) {
        const uint32_t drawn = next(&stream), layer = drawn & 255, place = drawn >> 9;
        /* The sign by arithmetic: no processor foresees it. */
        float normal = (float)(int32_t)place * ziggurat->width[layer] *
                       (float)(1 - 2 * (int32_t)(drawn >> 8 & 1));
        if (place >= ziggurat->inside[layer]) {
            if (layer == 0) {
                normal = tail(ziggurat, &stream, place);
            } else {
                const float low = ziggurat->height[layer], high = ziggurat->height[layer - 1];
                if (!((high - low) * uniform(&stream) + low < exp(-0.5 * normal * normal)))
                    continue;
            }
        }
        normals[i++] = normal;
    }
}
