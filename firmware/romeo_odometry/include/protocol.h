/* Written by tools/generate_protocol.py from firmware/romeo_odometry/protocol.toml. Do not edit. */
#ifndef ROMEO_PROTOCOL_H
#define ROMEO_PROTOCOL_H

#include <assert.h>
#include <stdint.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "frames are little-endian"
#endif

#define PROTOCOL_HASH 0x1acd120cUL
#define PROTOCOL_DELIMITER 0x00
/* Largest id + fields, and the same with CRC, COBS byte and delimiter, in bytes. */
#define PROTOCOL_LARGEST_FRAME 32
#define PROTOCOL_LARGEST_ENCODED 36

/* [ms] without a velocity frame for so long, both wheels stop */
#define PROTOCOL_COMMAND_TIMEOUT_MS 150
/* [Hz] displacement frames a second, by default */
#define PROTOCOL_REPORT_RATE_HZ 50
/* [Hz] lowest report rate */
#define PROTOCOL_REPORT_RATE_MIN_HZ 10
/* [Hz] highest report rate */
#define PROTOCOL_REPORT_RATE_MAX_HZ 100
/* [ticks/s] settings.full_speed by default: 160 revolutions a minute of 1920 ticks each */
#define PROTOCOL_FULL_SPEED_TICKS_PER_S 5120
/* [ticks/s] lowest settings.full_speed */
#define PROTOCOL_FULL_SPEED_MIN_TICKS_PER_S 100
/* [1/16] settings.proportional by default */
#define PROTOCOL_PROPORTIONAL_16THS 32
/* [1/16 s] settings.integral by default */
#define PROTOCOL_INTEGRAL_16THS_PER_S 128
/* [ticks/s2] settings.acceleration by default */
#define PROTOCOL_ACCELERATION_TICKS_PER_S2 14000
/* [ticks/s2] lowest settings.acceleration */
#define PROTOCOL_ACCELERATION_MIN_TICKS_PER_S2 100
/* [ms] settings.runaway by default */
#define PROTOCOL_RUNAWAY_MS 300
/* [nm] settings.left_radius and right_radius by default: wheels of 65 mm */
#define PROTOCOL_RADIUS_NM 32500000UL
/* [nm] largest settings.left_radius and right_radius */
#define PROTOCOL_RADIUS_MAX_NM 1000000000UL
/* [nm] settings.track by default */
#define PROTOCOL_TRACK_NM 144000000UL
/* [nm] smallest settings.track */
#define PROTOCOL_TRACK_MIN_NM 10000000UL
/* [ticks] settings.counts_per_turn by default */
#define PROTOCOL_COUNTS_PER_TURN 1920
/* [ticks] smallest settings.counts_per_turn */
#define PROTOCOL_COUNTS_PER_TURN_MIN 4
/* [1] identity.board of a DFRobot Romeo V2 */
#define PROTOCOL_BOARD_ROMEO_V2 1

/* Host to board. Who are you? The board answers with identity, at any time and as often as
 * asked. */
#define HELLO_ID 0x01
struct __attribute__((packed)) hello_frame {
    uint8_t id; /* HELLO_ID */
};
static_assert(sizeof(struct hello_frame) == 1, "hello_frame is not packed");

/* Board to host. The answer to hello. */
#define IDENTITY_ID 0x02
struct __attribute__((packed)) identity_frame {
    uint8_t id; /* IDENTITY_ID */
    /* [1] hash of the definition the firmware was built with */
    uint32_t protocol_hash;
    /* [1] firmware version */
    uint8_t version_major;
    /* [1] firmware version */
    uint8_t version_minor;
    /* [1] firmware version */
    uint8_t version_patch;
    /* [1] kind of board, one of the board_ constants */
    uint8_t board;
    /* [1] encoder edges that are counted in one period of a channel: 2 or 4 */
    uint8_t edges_per_period;
};
static_assert(sizeof(struct identity_frame) == 10, "identity_frame is not packed");

/* Board to host. How far the wheels have turned; sent at the report rate, whether or not they
 * move. */
#define DISPLACEMENT_ID 0x10
/* no hello since start: a host that has said hello learns from it that the board restarted */
#define DISPLACEMENT_STATUS_FRESH 0x01
/* the last velocity is older than the command timeout: wheels stopped; clear before the first */
#define DISPLACEMENT_STATUS_COMMAND_TIMED_OUT 0x02
/* the stored settings were missing or damaged: defaults are in force until the next write */
#define DISPLACEMENT_STATUS_SETTINGS_DEFAULTED 0x04
/* the left motor was driven hard and its encoder did not follow for settings.runaway: both
 * motors are off until a velocity frame of zero */
#define DISPLACEMENT_STATUS_LEFT_RUNAWAY 0x08
/* the same of the right motor */
#define DISPLACEMENT_STATUS_RIGHT_RUNAWAY 0x10
#define DISPLACEMENT_STATUS_ALL 0x1f
struct __attribute__((packed)) displacement_frame {
    uint8_t id; /* DISPLACEMENT_ID */
    /* [frames] counts up by one a frame, dropped ones included */
    uint16_t sequence;
    /* [us] micros() when both counters were read; wraps after 71.6 min */
    uint32_t board_time_us;
    /* [ticks] running count of the left encoder since start, forward positive, modulo 2^32 */
    int32_t left_ticks;
    /* [ticks] running count of the right encoder since start, forward positive, modulo 2^32 */
    int32_t right_ticks;
    /* [um] running distance since start, forward positive, modulo 2^32 */
    int32_t distance_um;
    /* [urad] running heading since start, counter-clockwise positive, modulo 2^32 (not modulo
     * a rotation) */
    int32_t heading_urad;
    /* [bits] see the bits */
    uint8_t status;
    /* [edges] illegal transitions of the left encoder since start, modulo 2^16: too short or
     * too fast for a wheel, so noise or missed edges */
    uint16_t left_illegal;
    /* [edges] the same of the right encoder; with 4 edges a period, one too short to show
     * whose it was is counted for both */
    uint16_t right_illegal;
    /* [frames] not sent since start because the host did not read; stays at 65535 */
    uint16_t dropped_frames;
    /* [frames] received since start and refused (COBS, CRC, id or length); stays at 65535 */
    uint16_t bad_frames;
};
static_assert(sizeof(struct displacement_frame) == 32, "displacement_frame is not packed");

/* Host to board. Target wheel speeds, in force until the next one or the command timeout.
 * Both zero is the stop command, which also ends the runaway state. */
#define VELOCITY_ID 0x11
struct __attribute__((packed)) velocity_frame {
    uint8_t id; /* VELOCITY_ID */
    /* [ticks/s] left wheel, forward positive */
    int16_t left_ticks_per_s;
    /* [ticks/s] right wheel, forward positive */
    int16_t right_ticks_per_s;
};
static_assert(sizeof(struct velocity_frame) == 5, "velocity_frame is not packed");

/* Host to board. The board answers with settings. */
#define READ_SETTINGS_ID 0x20
struct __attribute__((packed)) read_settings_frame {
    uint8_t id; /* READ_SETTINGS_ID */
};
static_assert(sizeof(struct read_settings_frame) == 1, "read_settings_frame is not packed");

/* Both ways. To the board: store these and use them from now on. From the board: those in
 * force; its answer to read_settings and to a write (values out of range are brought to the
 * nearest bound). */
#define SETTINGS_ID 0x21
/* level high on the left direction pin drives backward */
#define SETTINGS_REVERSED_LEFT_MOTOR 0x01
/* level high on the right direction pin drives backward */
#define SETTINGS_REVERSED_RIGHT_MOTOR 0x02
/* the left encoder counts down when driving forward */
#define SETTINGS_REVERSED_LEFT_ENCODER 0x04
/* the right encoder counts down when driving forward */
#define SETTINGS_REVERSED_RIGHT_ENCODER 0x08
#define SETTINGS_REVERSED_ALL 0x0f
struct __attribute__((packed)) settings_frame {
    uint8_t id; /* SETTINGS_ID */
    /* [Hz] displacement frames a second, between report_rate_min_hz and report_rate_max_hz */
    uint8_t report_rate_hz;
    /* [bits] what is wired the other way round, see the bits */
    uint8_t reversed;
    /* [ticks/s] of a wheel that runs freely at full duty; the control's feed-forward is
     * target / full_speed */
    uint16_t full_speed;
    /* [1/16] control: share of full duty for an error of full_speed */
    uint8_t proportional;
    /* [1/16 s] control: share of full duty for each second of an error of full_speed */
    uint8_t integral;
    /* [ticks/s2] the target speed is followed no faster; a command timeout stops at once */
    uint16_t acceleration;
    /* [ms] a motor that is driven hard for so long while its encoder makes less than a
     * quarter of the target speed, or counts the other way, switches both off; 0 for boards
     * without encoders: never */
    uint16_t runaway;
    /* [nm] rolling radius of the left wheel */
    uint32_t left_radius;
    /* [nm] rolling radius of the right wheel */
    uint32_t right_radius;
    /* [nm] distance between the left and the right wheel */
    uint32_t track;
    /* [ticks] of one revolution of a wheel */
    uint32_t counts_per_turn;
};
static_assert(sizeof(struct settings_frame) == 27, "settings_frame is not packed");

#endif
