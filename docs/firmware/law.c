/* An attitude law in C, flown by the twin over a socket: three wheels along x, y and z.
 *
 *     twin controllers --header sads > channels.h
 *     cc -std=c99 -I. -o law law.c link.c -lm
 *     twin run sads --controller tcp://127.0.0.1:5001 &
 *     ./law 127.0.0.1 5001
 *
 * It is the near end of our link (link.md): it greets, arms, and answers the last sample of each
 * tick with a set-point. Only POSIX sockets tie it to a kind of computer.
 */
#define _POSIX_C_SOURCE 200112L
#include <math.h>
#include <netdb.h>
#include <stdio.h>
#include <sys/socket.h>
#include <unistd.h>

#include "link.h"

#include "channels.h"

#define PROPORTIONAL 5.0f /* N m, per unit of the error quaternion's vector part */
#define DERIVATIVE 8.0f   /* N m s */
#define VALID_FOR_MS 200

static float samples[CHANNEL_COMMAND_WHEEL_TORQUE][LINK_COLUMNS]; /* measured ones come first */
static uint16_t sequence = 1, last_heard;
static int line;

static void put16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)value;
    to[1] = (uint8_t)(value >> 8);
}

/* Header, payload and check, stuffed, ended by a zero. The clock is of no use to the twin. */
static int say(uint8_t type, const uint8_t *payload, size_t count)
{
    uint8_t frame[LINK_LONGEST_FRAME] = {LINK_VERSION, type}, out[LINK_LONGEST_FRAME + 2];
    size_t length = LINK_HEADER + count, mark = 0, filled = 1;

    put16(frame + 2, sequence++);
    put16(frame + 8, last_heard);
    memcpy(frame + LINK_HEADER, payload, count);
    put16(frame + length, link_checksum(frame, length));
    length += 2;
    for (size_t i = 0; i <= length; i++) {
        if (i < length && frame[i]) {
            out[filled++] = frame[i];
        } else {
            out[mark] = (uint8_t)(filled - mark);
            mark = filled;
            out[filled++] = 0;
        }
    }
    return send(line, out, filled, 0) == (ssize_t)filled;
}

static int arm(void)
{
    uint8_t hello[6] = {0}, permission[6];

    for (int i = 0; i < 4; i++)
        hello[i] = permission[i] = (uint8_t)(schema.hash >> 8 * i);
    put16(permission + 4, VALID_FOR_MS);
    return say(LINK_HELLO, hello, sizeof hello) && say(LINK_ARM, permission, sizeof permission);
}

/* e = conjugate(q_d) q, its real part not below 0. The wheels get K_p e + K_d w, the body less. */
static int answer(void)
{
    const float *q = samples[CHANNEL_ESTIMATE_ATTITUDE], *rate = samples[CHANNEL_ESTIMATE_RATE];
    const float *d = samples[CHANNEL_REFERENCE_ATTITUDE];
    float real = d[0] * q[0] + d[1] * q[1] + d[2] * q[2] + d[3] * q[3];
    float error[3] = {
        d[0] * q[1] - d[1] * q[0] - d[2] * q[3] + d[3] * q[2],
        d[0] * q[2] + d[1] * q[3] - d[2] * q[0] - d[3] * q[1],
        d[0] * q[3] - d[1] * q[2] + d[2] * q[1] - d[3] * q[0],
    };
    uint8_t payload[16] = {CHANNEL_COMMAND_WHEEL_TORQUE, 0};

    put16(payload + 2, VALID_FOR_MS);
    for (int i = 0; i < 3; i++) {
        float torque = copysignf(PROPORTIONAL, real) * error[i] + DERIVATIVE * rate[i];
        memcpy(payload + 4 + 4 * i, &torque, 4); /* little-endian, as every PC */
    }
    return say(LINK_SETPOINT, payload, sizeof payload);
}

/* A frame as it came, stuffed; 0 if there is nothing to go on with. */
static int hear(const uint8_t *packet, size_t count)
{
    uint8_t body[LINK_LONGEST_FRAME + 1];
    size_t length = 0;

    for (size_t i = 0; i < count; i += packet[i]) {
        if (i)
            body[length++] = 0;
        for (size_t j = i + 1; j < i + packet[i] && j < count; j++)
            body[length++] = packet[j];
    }
    if (length < LINK_HEADER + 2 || length > LINK_LONGEST_FRAME
        || link_checksum(body, length - 2) != (body[length - 2] | body[length - 1] << 8))
        return 1;
    last_heard = (uint16_t)(body[2] | body[3] << 8);
    /* channel, rows, a row's clock, then its numbers */
    if (body[1] != LINK_SAMPLES || body[LINK_HEADER] >= CHANNEL_COMMAND_WHEEL_TORQUE
        || length != LINK_HEADER + 6 + 4u * schema.channel[body[LINK_HEADER]].columns + 2)
        return 1;
    memcpy(samples[body[LINK_HEADER]], body + LINK_HEADER + 6, length - LINK_HEADER - 8);
    return body[LINK_HEADER] != CHANNEL_REFERENCE_RATE || answer();
}

int main(int count, char **words)
{
    struct addrinfo hints = {0}, *place;
    uint8_t bytes[512], packet[LINK_LONGEST_FRAME + 1];
    size_t length = 0;
    ssize_t got;

    hints.ai_socktype = SOCK_STREAM;
    if (count != 3 || getaddrinfo(words[1], words[2], &hints, &place)) {
        fprintf(stderr, "law HOST PORT\n");
        return 2;
    }
    line = socket(place->ai_family, place->ai_socktype, place->ai_protocol);
    if (line < 0 || connect(line, place->ai_addr, place->ai_addrlen) || !arm()) {
        perror("law");
        return 1;
    }
    while ((got = recv(line, bytes, sizeof bytes, 0)) > 0) {
        for (ssize_t i = 0; i < got; i++) {
            if (bytes[i] && length < sizeof packet) {
                packet[length++] = bytes[i];
            } else if (!bytes[i]) {
                if (!hear(packet, length))
                    return 0;
                length = 0;
            }
        }
    }
    freeaddrinfo(place);
    close(line);
    return 0;
}
