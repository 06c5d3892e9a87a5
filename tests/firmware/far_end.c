/* link.c behind a pipe, for the tests: operations come in on stdin, what came of each goes out.
 *
 * In:  op, u32 clock [us], u16 count, count bytes. R: received; A: advance; F: a fault;
 *      S: a sample of the channel in byte 0, its 32-bit words after that; I: begin anew;
 *      M: as R, many times over, count is then in units of 1024 and the bytes come from a generator.
 * Out: u16 count, what it says, state, flags, u8 live and u32 words of each column a command
 *      channel, the counters.
 */
#include <stdio.h>
#include <stdlib.h>

#include "link.h"
#include "schema.h"

static struct link link;

static void write32(uint32_t value)
{
    for (int i = 0; i < 4; i++)
        putchar((int)(value >> 8 * i & 0xFF));
}

static void report(void)
{
    static uint8_t said[4096];
    size_t count = link_take(&link, said, sizeof said);
    putchar((int)(count & 0xFF));
    putchar((int)(count >> 8));
    fwrite(said, 1, count, stdout);
    putchar(link.state);
    putchar(link.flags);
    for (uint8_t i = 0; i < schema.channels; i++) {
        if (schema.channel[i].safe == LINK_MEASURED)
            continue;
        putchar(link_is_live(&link, i));
        for (uint8_t column = 0; column < schema.channel[i].columns; column++) {
            float number = link_float(&link, i, column);
            uint32_t bits;
            memcpy(&bits, &number, sizeof bits);
            write32(schema.channel[i].counts ? (uint32_t)link_count(&link, i, column) : bits);
        }
    }
    write32(link.counters.frames);
    write32(link.counters.malformed);
    write32(link.counters.bad_checksum);
    write32(link.counters.bad_version);
    write32(link.counters.unknown);
    write32(link.counters.bad_payload);
    write32(link.counters.gaps);
    write32(link.counters.repeated);
}

static void noise(size_t kilobytes, uint32_t now)
{
    uint32_t seed = now | 1;
    uint8_t bytes[1024], sink[LINK_OUT];
    while (kilobytes--) {
        for (size_t i = 0; i < sizeof bytes; i++) {
            seed ^= seed << 13;
            seed ^= seed >> 17;
            seed ^= seed << 5;
            bytes[i] = (uint8_t)(seed >> 9 & (seed >> 29 ? 0xFF : 0x0F));
        }
        link_receive(&link, bytes, sizeof bytes, now);
        link_take(&link, sink, sizeof sink);
    }
}

int main(void)
{
    int op;
    while ((op = getchar()) != EOF) {
        uint8_t head[6];
        uint8_t *bytes;
        uint32_t now;
        size_t count;
        if (fread(head, 1, 6, stdin) != 6)
            return 2;
        now = (uint32_t)head[0] | (uint32_t)head[1] << 8 | (uint32_t)head[2] << 16 |
              (uint32_t)head[3] << 24;
        count = (size_t)(head[4] | head[5] << 8);
        /* Of the exact size, so that a sanitizer sees a read beyond it. */
        bytes = malloc(count + 1);
        if (op != 'M' && fread(bytes, 1, count, stdin) != count)
            return 2;
        if (op == 'R') {
            link_receive(&link, bytes, count, now);
        } else if (op == 'A') {
            link_advance(&link, now);
        } else if (op == 'F') {
            link_fault(&link, "LIMIT", 3.0f, now);
        } else if (op == 'I') {
            link_init(&link, &schema, now);
        } else if (op == 'M') {
            noise(count, now);
        } else if (op == 'S' && count > 1) {
            uint32_t words[LINK_COLUMNS];
            memcpy(words, bytes + 1, (count - 1) / 4 * 4);
            if (schema.channel[bytes[0]].counts)
                link_sample_counts(&link, bytes[0], now - 7, (const int32_t *)words, now);
            else
                link_sample_floats(&link, bytes[0], now - 7, (const float *)(void *)words, now);
        }
        free(bytes);
        report();
    }
    return 0;
}
