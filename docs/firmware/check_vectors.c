/* Lets link.c have the conversation of vectors.txt, on the host:
 *
 *     cc -std=c99 -o check_vectors check_vectors.c link.c && ./check_vectors < vectors.txt
 *
 * Prints the first answer that differs and returns 1, or how many agree. Not for the firmware.
 */
#include <stdio.h>

#include "link.h"
#include "schema.h"

static char line[8192], host[4096], far_end[4096];

static size_t bytes_of(const char *hex, uint8_t *to)
{
    size_t count = 0;
    unsigned byte;
    while (sscanf(hex + 2 * count, "%2x", &byte) == 1)
        to[count++] = (uint8_t)byte;
    return count;
}

int main(void)
{
    static struct link link;
    static uint8_t sent[2048], expected[2048], answered[2048];
    unsigned long now;
    int steps = 0;

    while (fgets(line, sizeof line, stdin)) {
        size_t count, length;
        if (line[0] == '#')
            continue;
        if (sscanf(line, "%lu %4095s %4095s", &now, host, far_end) != 3) {
            printf("not a step: %s", line);
            return 1;
        }
        if (steps == 0)
            link_init(&link, &schema, (uint32_t)now);
        count = bytes_of(host, sent);
        link_receive(&link, sent, count, (uint32_t)now);
        length = link_take(&link, answered, sizeof answered);
        count = bytes_of(far_end, expected);
        if (length != count || memcmp(answered, expected, count) != 0) {
            printf("at %lu us, after %s, it should say %s but said ", now, host, far_end);
            for (size_t i = 0; i < length; i++)
                printf("%02x", answered[i]);
            printf("\n");
            return 1;
        }
        steps++;
    }
    printf("%d steps agree\n", steps);
    return 0;
}
