/* The far end of our link: what a laboratory's microcontroller speaks to the twin.
 *
 * C99, no dynamic memory, nothing of the library but memcpy, memmove and memset. The protocol is in
 * docs/link.md; how to use this in a firmware, in README.md beside this file. No function blocks,
 * none may be called from an interrupt while another runs.
 */
#ifndef LINK_H
#define LINK_H

#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LINK_VERSION 1
#define LINK_LONGEST_FRAME 254   /* header, payload and check, before stuffing */
#define LINK_HEADER 12
#define LINK_LONGEST_PAYLOAD (LINK_LONGEST_FRAME - LINK_HEADER - 2)
#define LINK_LONGEST_TEXT 32

/* What may be set by the compiler's -D to fit a smaller or larger firmware. */
#ifndef LINK_CHANNELS
#define LINK_CHANNELS 8          /* most channels */
#endif
#ifndef LINK_COLUMNS
#define LINK_COLUMNS 16          /* most numbers in a sample or a set-point; at most 58 */
#endif
#ifndef LINK_OUT
#define LINK_OUT 1024            /* bytes that wait to be sent */
#endif

enum link_state { LINK_SAFE = 0, LINK_ARMED = 1, LINK_FAULT = 2 };

enum link_flag { LINK_GREETED = 1, LINK_LIVE = 2 };

enum link_type {
    LINK_HELLO = 1,
    LINK_TIMESYNC = 2,
    LINK_SAMPLES = 3,
    LINK_SETPOINT = 4,
    LINK_ARM = 5,
    LINK_DISARM = 6,
    LINK_SAFE_STOP = 7,
    LINK_EVENT = 8
};

/* What a channel does when the far end is not armed; LINK_MEASURED: it is no command. */
enum link_safe { LINK_MEASURED = 0, LINK_ZERO = 1, LINK_HOLD = 2 };

struct link_channel {
    uint8_t columns;
    uint8_t counts; /* 1: int32, 0: float32 */
    uint8_t safe;   /* enum link_safe */
};

/* Made by generate.py from the channels that the twin is told of: schema.h. */
struct link_schema {
    uint32_t hash;
    uint16_t longest_valid_ms; /* no set-point is taken for longer */
    uint8_t channels;
    const struct link_channel *channel;
    const char *name; /* ASCII, at most 32 characters are sent */
};

struct link_counters {
    uint32_t frames;
    uint32_t malformed;
    uint32_t bad_checksum;
    uint32_t bad_version;
    uint32_t unknown;
    uint32_t bad_payload;
    uint32_t gaps;
    uint32_t repeated;
};

struct link {
    const struct link_schema *schema;
    struct link_counters counters;
    uint8_t state; /* enum link_state */
    uint8_t flags; /* of enum link_flag */

    /* Private from here on. */
    uint8_t packet[LINK_LONGEST_FRAME + 1];
    uint16_t packet_length;
    uint8_t packet_too_long;
    uint8_t heard;
    uint16_t last_received;
    uint16_t sequence;
    uint8_t waiting; /* armed, and no set-point has come yet */
    uint32_t waiting_until_us;
    uint8_t live[LINK_CHANNELS];
    uint32_t until_us[LINK_CHANNELS];
    uint32_t output[LINK_CHANNELS][LINK_COLUMNS];
    uint8_t out[LINK_OUT];
    uint16_t out_length;
    uint32_t lost;
};

/* Begin: safe, not greeted, and a greeting waits to be sent.
 * Returns 0 if the schema has more channels or columns than this file was compiled for; the far
 * end then is in a fault and cannot be armed. */
int link_init(struct link *link, const struct link_schema *schema, uint32_t now_us);

/* Bytes that came; any number, cut anywhere. Answers wait in link_take. */
void link_receive(struct link *link, const uint8_t *bytes, size_t count, uint32_t now_us);

/* Enforce the set-points' time-to-live. Call it in every round of the main loop, before the
 * outputs are used, and at least once in half an hour (the clock wraps after 71.6 minutes). */
void link_advance(struct link *link, uint32_t now_us);

/* Move bytes to be sent into `to`; returns how many. */
size_t link_take(struct link *link, uint8_t *to, size_t room);

/* Send one sample that was true at `time_us`. Returns 0 if it is no such channel or does not fit
 * into what waits to be sent: it is lost, and the host is told with the next frame. */
int link_sample_floats(struct link *link, uint8_t channel, uint32_t time_us, const float *values,
                       uint32_t now_us);
int link_sample_counts(struct link *link, uint8_t channel, uint32_t time_us,
                       const int32_t *values, uint32_t now_us);

/* 1: do what link_float or link_count says. 0: do what is safe. A stage then stops with its ramp
 * and holds with its current on; wheels, coils and valves get zero, which is what the two read. */
int link_is_live(const struct link *link, uint8_t channel);
float link_float(const struct link *link, uint8_t channel, uint8_t column);
int32_t link_count(const struct link *link, uint8_t channel, uint8_t column);

/* Something is wrong with the machine: be safe until the host acknowledges it with a DISARM.
 * The code is at most eight ASCII characters of your own ("LIMIT", "HOT"). */
void link_fault(struct link *link, const char *code, float value, uint32_t now_us);

/* Tell the host something, and go on. */
void link_event(struct link *link, const char *code, float value, uint32_t now_us);

/* CRC-16/IBM-3740, for tests. */
uint16_t link_checksum(const uint8_t *data, size_t count);

#ifdef __cplusplus
}
#endif

#endif
