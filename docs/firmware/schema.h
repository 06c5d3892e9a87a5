/* The channels of a far end, made by a program: do not edit. */
#ifndef SCHEMA_H
#define SCHEMA_H

#include "link.h"

#define CHANNEL_GYRO 0 /* 3 columns [rad/s], float32 */
#define CHANNEL_ACCELEROMETER 1 /* 3 columns [m/s^2], float32 */
#define CHANNEL_MAGNETOMETER 2 /* 3 columns [T], float32 */
#define CHANNEL_STAGE_POSITION 3 /* 3 columns [m], 2e-06 a count */
#define CHANNEL_COMMAND_STAGE_POSITION 4 /* 3 columns [m], 2e-06 a count */
#define CHANNEL_COMMAND_DIPOLE 5 /* 3 columns [A m^2], float32 */

static const struct link_channel schema_channels[] = {
    {3, 0, LINK_MEASURED},
    {3, 0, LINK_MEASURED},
    {3, 0, LINK_MEASURED},
    {3, 1, LINK_MEASURED},
    {3, 1, LINK_HOLD},
    {3, 0, LINK_ZERO},
};

static const struct link_schema schema = {
    0x7A35E611u, 500, 6, schema_channels, "feather",
};

#endif
