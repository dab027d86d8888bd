// SPDX-License-Identifier: Apache-2.0
/* CRC-64 of records, eight bytes at a time: polynomial of ECMA-182, reflected, as in xz and in the
 * packets of Ouster's LiDARs. Little endian. */

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define POLYNOMIAL 0xC96C5795D7870F42u

/* Write the CRC of each of `count` records of `size` bytes into its last 8 bytes. */
void groundlink_crc64(uint8_t *records, size_t count, size_t size)
{
    uint64_t table[8][256];
    for (size_t byte = 0; byte < 256; byte++) {
        uint64_t crc = byte;
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? POLYNOMIAL : 0);
        table[0][byte] = crc;
    }
    for (size_t byte = 0; byte < 256; byte++)
        for (size_t later = 1; later < 8; later++) {
            const uint64_t before = table[later - 1][byte];
            table[later][byte] = before >> 8 ^ table[0][before & 255];
        }
    for (uint8_t *record = records; record < records + count * size; record += size) {
        const uint8_t *at = record, *end = record + size - 8;
        uint64_t crc = UINT64_MAX;
        for (; end - at >= 8; at += 8) {
            uint64_t word;
            memcpy(&word, at, 8);
            word ^= crc;
            crc = 0;
            for (size_t byte = 0; byte < 8; byte++)
                crc ^= table[7 - byte][word >> 8 * byte & 255];
        }
        for (; at < end; at++)
            crc = crc >> 8 ^ table[0][(crc ^ *at) & 255];
        crc = ~crc;
        memcpy(record + size - 8, &crc, 8);
    }
}
