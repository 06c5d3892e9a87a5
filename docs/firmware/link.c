/* The far end of our link; link.h says what each function is for, docs/link.md the protocol. */
#include "link.h"

#if LINK_COLUMNS > 58
#error "a frame holds at most 58 columns"
#endif
#if LINK_OUT < 300 || LINK_OUT > 65535
#error "LINK_OUT: 300 to 65535 bytes, so that the longest frame fits"
#endif

#define ALL_CHANNELS 255
#define NOTHING 0x80000000u /* the int32 that says that there is no value */

/* ---- numbers as bytes, little-endian on any machine ---- */

static uint16_t get16(const uint8_t *from)
{
    return (uint16_t)(from[0] | (uint16_t)(from[1] << 8));
}

static uint32_t get32(const uint8_t *from)
{
    return (uint32_t)get16(from) | (uint32_t)get16(from + 2) << 16;
}

static void put16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)(value & 0xFF);
    to[1] = (uint8_t)(value >> 8);
}

static void put32(uint8_t *to, uint32_t value)
{
    put16(to, (uint16_t)(value & 0xFFFF));
    put16(to + 2, (uint16_t)(value >> 16));
}

static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

uint16_t link_checksum(const uint8_t *data, size_t count)
{
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < count; i++) {
        crc = (uint16_t)(crc ^ (uint16_t)(data[i] << 8));
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)((crc & 0x8000) ? (crc << 1) ^ 0x1021 : crc << 1);
    }
    return crc;
}

/* ---- sending ---- */

/* Queue a frame whose payload stands at body + LINK_HEADER. Returns 0 if there is no room. */
static int queue_frame(struct link *link, uint8_t *body, uint8_t type, size_t payload,
                       uint32_t now_us)
{
    size_t length = LINK_HEADER + payload;
    size_t room = LINK_OUT - (size_t)link->out_length;
    uint8_t *code, *to;

    /* Lost frames leave a gap in the count, by which the host sees them too. */
    uint16_t sequence = link->sequence++;
    if (length + 2 + 2 > room) {
        link->lost++;
        return 0;
    }
    body[0] = LINK_VERSION;
    body[1] = type;
    put16(body + 2, sequence);
    put32(body + 4, now_us);
    put16(body + 8, link->last_received);
    body[10] = link->state;
    body[11] = link->flags;
    put16(body + length, link_checksum(body, length));
    length += 2;

    code = link->out + link->out_length;
    to = code + 1;
    *code = 1;
    for (size_t i = 0; i < length; i++) {
        if (body[i] != 0) {
            *to++ = body[i];
            (*code)++;
        } else {
            code = to++;
            *code = 1;
        }
    }
    *to++ = 0;
    link->out_length = (uint16_t)(to - link->out);
    return 1;
}

static int send_event(struct link *link, const char *code, float value, uint32_t now_us)
{
    uint8_t body[LINK_HEADER + 12 + 2];
    memset(body, 0, sizeof body);
    for (int i = 0; i < 8 && code[i] != 0; i++)
        body[LINK_HEADER + i] = (uint8_t)code[i];
    put32(body + LINK_HEADER + 8, bits_of(value));
    return queue_frame(link, body, LINK_EVENT, 12, now_us);
}

/* Queue a frame, and before it the number of those that were lost. */
static int send_frame(struct link *link, uint8_t *body, uint8_t type, size_t payload,
                      uint32_t now_us)
{
    if (link->lost > 0) {
        uint32_t lost = link->lost;
        if (send_event(link, "FULL", (float)lost, now_us))
            link->lost = 0;
        else
            link->lost = lost; /* the report that found no room is not one of them */
    }
    return queue_frame(link, body, type, payload, now_us);
}

void link_event(struct link *link, const char *code, float value, uint32_t now_us)
{
    uint8_t body[LINK_HEADER + 12 + 2];
    memset(body, 0, sizeof body);
    for (int i = 0; i < 8 && code[i] != 0; i++)
        body[LINK_HEADER + i] = (uint8_t)code[i];
    put32(body + LINK_HEADER + 8, bits_of(value));
    (void)send_frame(link, body, LINK_EVENT, 12, now_us);
}

static void send_hello(struct link *link, uint32_t now_us)
{
    uint8_t body[LINK_HEADER + 6 + LINK_LONGEST_TEXT + 2];
    size_t text = 0;
    put32(body + LINK_HEADER, link->schema->hash);
    put16(body + LINK_HEADER + 4, link->schema->longest_valid_ms);
    while (text < LINK_LONGEST_TEXT && link->schema->name[text] != 0) {
        body[LINK_HEADER + 6 + text] = (uint8_t)link->schema->name[text];
        text++;
    }
    (void)send_frame(link, body, LINK_HELLO, 6 + text, now_us);
}

static int send_sample(struct link *link, uint8_t channel, uint32_t time_us,
                       const uint32_t *words, uint32_t now_us)
{
    uint8_t body[LINK_HEADER + 6 + 4 * LINK_COLUMNS + 2];
    uint8_t columns = link->schema->channel[channel].columns;
    body[LINK_HEADER] = channel;
    body[LINK_HEADER + 1] = 1;
    put32(body + LINK_HEADER + 2, time_us);
    for (uint8_t i = 0; i < columns; i++)
        put32(body + LINK_HEADER + 6 + 4 * i, words[i]);
    return send_frame(link, body, LINK_SAMPLES, 6 + 4 * (size_t)columns, now_us);
}

static int is_measured(const struct link *link, uint8_t channel, uint8_t counts)
{
    return link->schema != 0 && channel < link->schema->channels &&
           link->schema->channel[channel].safe == LINK_MEASURED &&
           link->schema->channel[channel].counts == counts;
}

int link_sample_floats(struct link *link, uint8_t channel, uint32_t time_us, const float *values,
                       uint32_t now_us)
{
    uint32_t words[LINK_COLUMNS];
    if (!is_measured(link, channel, 0))
        return 0;
    for (uint8_t i = 0; i < link->schema->channel[channel].columns; i++)
        words[i] = bits_of(values[i]);
    return send_sample(link, channel, time_us, words, now_us);
}

int link_sample_counts(struct link *link, uint8_t channel, uint32_t time_us,
                       const int32_t *values, uint32_t now_us)
{
    uint32_t words[LINK_COLUMNS];
    if (!is_measured(link, channel, 1))
        return 0;
    for (uint8_t i = 0; i < link->schema->channel[channel].columns; i++)
        words[i] = (uint32_t)values[i];
    return send_sample(link, channel, time_us, words, now_us);
}

size_t link_take(struct link *link, uint8_t *to, size_t room)
{
    size_t count = link->out_length < room ? link->out_length : room;
    memcpy(to, link->out, count);
    memmove(link->out, link->out + count, link->out_length - count);
    link->out_length = (uint16_t)(link->out_length - count);
    return count;
}

/* ---- being safe ---- */

static void make_safe(struct link *link)
{
    if (link->state == LINK_ARMED)
        link->state = LINK_SAFE;
    link->flags &= (uint8_t)~LINK_LIVE;
    link->waiting = 0;
    memset(link->live, 0, sizeof link->live);
    for (uint8_t i = 0; i < link->schema->channels; i++)
        if (link->schema->channel[i].safe == LINK_ZERO)
            memset(link->output[i], 0, sizeof link->output[i]);
}

void link_fault(struct link *link, const char *code, float value, uint32_t now_us)
{
    make_safe(link);
    link->state = LINK_FAULT;
    link_event(link, code, value, now_us);
}

static int is_over(uint32_t until_us, uint32_t now_us)
{
    /* Half the clock's range lies ahead and half behind, so that it may wrap. */
    return (uint32_t)(now_us - until_us) < 0x80000000u;
}

void link_advance(struct link *link, uint32_t now_us)
{
    int expired = -1;
    if (link->state != LINK_ARMED)
        return;
    if (link->waiting && is_over(link->waiting_until_us, now_us))
        expired = ALL_CHANNELS;
    for (uint8_t i = 0; i < link->schema->channels && expired < 0; i++)
        if (link->live[i] && is_over(link->until_us[i], now_us))
            expired = i;
    if (expired >= 0) {
        make_safe(link);
        link_event(link, "EXPIRED", (float)expired, now_us);
    }
}

int link_is_live(const struct link *link, uint8_t channel)
{
    return link->state == LINK_ARMED && channel < LINK_CHANNELS && link->live[channel];
}

float link_float(const struct link *link, uint8_t channel, uint8_t column)
{
    float value;
    memcpy(&value, &link->output[channel][column], sizeof value);
    return value;
}

int32_t link_count(const struct link *link, uint8_t channel, uint8_t column)
{
    int32_t value;
    memcpy(&value, &link->output[channel][column], sizeof value);
    return value;
}

/* ---- what the host says ---- */

static int is_allowed(const struct link *link, uint16_t valid_ms)
{
    return valid_ms > 0 && valid_ms <= link->schema->longest_valid_ms;
}

static void hear_hello(struct link *link, const uint8_t *payload, uint32_t now_us)
{
    int same = get32(payload) == link->schema->hash;
    /* Who greets begins anew: what the last host armed is not this one's. */
    make_safe(link);
    if (same)
        link->flags |= LINK_GREETED;
    else
        link->flags &= (uint8_t)~LINK_GREETED;
    send_hello(link, now_us);
    if (!same)
        link_event(link, "SCHEMA", 0.0f, now_us);
}

static void hear_timesync(struct link *link, const uint8_t *payload, uint32_t now_us)
{
    uint8_t body[LINK_HEADER + 12 + 2];
    memcpy(body + LINK_HEADER, payload, 8);
    put32(body + LINK_HEADER + 8, now_us);
    (void)send_frame(link, body, LINK_TIMESYNC, 12, now_us);
}

static void hear_arm(struct link *link, const uint8_t *payload, uint32_t now_us)
{
    uint16_t valid_ms = get16(payload + 4);
    if (get32(payload) != link->schema->hash || !(link->flags & LINK_GREETED)) {
        link_event(link, "SCHEMA", 0.0f, now_us);
    } else if (link->state == LINK_FAULT) {
        link_event(link, "FAULTED", 0.0f, now_us);
    } else if (!is_allowed(link, valid_ms)) {
        link_event(link, "VALUE", (float)ALL_CHANNELS, now_us);
    } else {
        make_safe(link);
        link->state = LINK_ARMED;
        link->waiting = 1;
        link->waiting_until_us = now_us + 1000u * valid_ms;
        link_event(link, "ARMED", 0.0f, now_us);
    }
}

static int is_a_value(const struct link_channel *channel, uint32_t word)
{
    return channel->counts ? word != NOTHING : (word & 0x7F800000u) != 0x7F800000u;
}

static void hear_setpoint(struct link *link, const uint8_t *payload, uint32_t now_us)
{
    uint8_t number = payload[0];
    uint16_t valid_ms = get16(payload + 2);
    const struct link_channel *channel = link->schema->channel + number;
    int good = payload[1] == 0 && is_allowed(link, valid_ms);

    if (link->state != LINK_ARMED) {
        link_event(link, "UNARMED", (float)LINK_SETPOINT, now_us);
        return;
    }
    for (uint8_t i = 0; i < channel->columns; i++)
        good = good && is_a_value(channel, get32(payload + 4 + 4 * i));
    if (!good) {
        link_event(link, "VALUE", (float)number, now_us);
        return;
    }
    for (uint8_t i = 0; i < channel->columns; i++)
        link->output[number][i] = get32(payload + 4 + 4 * i);
    link->live[number] = 1;
    link->until_us[number] = now_us + 1000u * valid_ms;
    link->waiting = 0;
    link->flags |= LINK_LIVE;
}

static void hear(struct link *link, uint8_t type, const uint8_t *payload, uint32_t now_us)
{
    switch (type) {
    case LINK_HELLO:
        hear_hello(link, payload, now_us);
        break;
    case LINK_TIMESYNC:
        hear_timesync(link, payload, now_us);
        break;
    case LINK_SETPOINT:
        hear_setpoint(link, payload, now_us);
        break;
    case LINK_ARM:
        hear_arm(link, payload, now_us);
        break;
    case LINK_DISARM:
        make_safe(link);
        link->state = LINK_SAFE;
        link_event(link, "SAFE", 0.0f, now_us);
        break;
    case LINK_SAFE_STOP:
        make_safe(link);
        link_event(link, "SAFE", 0.0f, now_us);
        break;
    default:
        break;
    }
}

/* ---- receiving ---- */

/* Is the payload as long as its type wants it? -1: the host sends no such type. */
static int fits(const struct link *link, uint8_t type, const uint8_t *payload, size_t length)
{
    switch (type) {
    case LINK_HELLO:
        return length >= 6;
    case LINK_TIMESYNC:
        return length == 12;
    case LINK_SETPOINT:
        return length >= 4 && payload[0] < link->schema->channels &&
               link->schema->channel[payload[0]].safe != LINK_MEASURED &&
               length == 4 + 4 * (size_t)link->schema->channel[payload[0]].columns;
    case LINK_ARM:
        return length == 6;
    case LINK_DISARM:
    case LINK_SAFE_STOP:
        return length == 0;
    default:
        return -1;
    }
}

/* Undo the stuffing in place; returns the length, 0 if the packet contradicts itself. */
static size_t unstuff(uint8_t *packet, size_t length)
{
    size_t from = 0, to = 0;
    while (from < length) {
        uint8_t code = packet[from];
        size_t stop = from + code;
        if (stop > length)
            return 0;
        for (from++; from < stop; from++)
            packet[to++] = packet[from];
        if (code < 255 && stop < length)
            packet[to++] = 0;
    }
    return to;
}

static void check(struct link *link, uint32_t now_us)
{
    uint8_t *body = link->packet;
    struct link_counters *counters = &link->counters;
    size_t length = unstuff(body, link->packet_length);
    uint16_t sequence, missed;
    int fit;

    if (length < LINK_HEADER + 2) {
        counters->malformed++;
        return;
    }
    length -= 2;
    if (link_checksum(body, length) != get16(body + length)) {
        counters->bad_checksum++;
        return;
    }
    if (body[0] != LINK_VERSION) {
        counters->bad_version++;
        return;
    }
    sequence = get16(body + 2);
    missed = (uint16_t)(sequence - link->last_received - 1);
    if (link->heard && body[1] != LINK_HELLO) {
        if (sequence == link->last_received) {
            counters->repeated++;
            return;
        }
        counters->gaps += missed;
    }
    link->heard = 1;
    link->last_received = sequence;
    fit = fits(link, body[1], body + LINK_HEADER, length - LINK_HEADER);
    if (fit < 0) {
        counters->unknown++;
    } else if (fit == 0) {
        counters->bad_payload++;
    } else {
        counters->frames++;
        hear(link, body[1], body + LINK_HEADER, now_us);
    }
}

void link_receive(struct link *link, const uint8_t *bytes, size_t count, uint32_t now_us)
{
    /* What has expired is over before anything that came later is heard. */
    link_advance(link, now_us);
    for (size_t i = 0; i < count; i++) {
        if (bytes[i] != 0) {
            if (link->packet_length < sizeof link->packet)
                link->packet[link->packet_length++] = bytes[i];
            else
                link->packet_too_long = 1;
            continue;
        }
        if (link->packet_too_long)
            link->counters.malformed++;
        else if (link->packet_length > 0)
            check(link, now_us);
        link->packet_length = 0;
        link->packet_too_long = 0;
    }
}

int link_init(struct link *link, const struct link_schema *schema, uint32_t now_us)
{
    static const struct link_schema nothing = {0, 0, 0, 0, ""};
    int fit = schema->channels <= LINK_CHANNELS;
    memset(link, 0, sizeof *link);
    for (uint8_t i = 0; fit && i < schema->channels; i++)
        fit = schema->channel[i].columns > 0 && schema->channel[i].columns <= LINK_COLUMNS;
    link->schema = fit ? schema : &nothing;
    if (!fit)
        link->state = LINK_FAULT;
    send_hello(link, now_us);
    return fit;
}
