/* The pins of the board's two encoders and motors. */
#ifndef WHEELS_H
#define WHEELS_H

#include <simavr/sim_avr.h>
#include <stdint.h>

enum { LEFT, RIGHT, WHEELS };
enum { CHANNEL_A, CHANNEL_B, CHANNELS };

typedef struct { char port; uint8_t bit; } pin;

/* Noise on a pin: pulses that invert its level, so and so wide and far from each other. */
typedef struct {
    uint64_t first, period, width; /* cycles */
    uint64_t edges, done;          /* two a pulse */
} pulses;

typedef struct {
    pin a, b;
    pulses noise[CHANNELS];
    int64_t steps;        /* made since the start, forward positive */
    int64_t wanted, done; /* of the present turn, with sign, and so many of them made */
    uint64_t from, until; /* cycles */
} encoder;

/* Put both encoders at rest on the pins of a sketch that counts 2 or 4 edges. */
void encoders_init(encoder encoders[WHEELS], int edges);

/* Turn by quadrature steps, evenly spread from now to `until`; an unfinished turn is given up. */
void encoder_turn(encoder *e, int64_t steps, uint64_t now, uint64_t until);

/* Invert the level of a channel `count` times for `width` cycles, `period` apart, the first time now;
 * noise before is given up. The width is less than the period. */
void encoder_disturb(encoder *e, int channel, uint64_t now, uint64_t width, uint64_t period,
                     uint64_t count);

/* The cycle of the next step or edge of noise, UINT64_MAX where there is none. */
uint64_t encoder_next(const encoder *e);

/* Make the steps and edges that are due and put them on the pins. */
void encoders_step(avr_t *avr, encoder encoders[WHEELS]);

/* Put the levels back on the pins after a reset. */
void encoders_restore(avr_t *avr, encoder encoders[WHEELS]);

/* Duty of a motor, -1 to 1: positive where its direction pin is high. */
double motor_duty(const avr_t *avr, int wheel);

#endif
