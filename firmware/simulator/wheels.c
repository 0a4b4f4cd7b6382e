/* Encoders as levels on the board's pins, motors as what its PWM and direction pins say. */
#include "wheels.h"

#include <simavr/avr_ioport.h>
#include <stdlib.h>
#include <string.h>

/* Data addresses of the ATmega32U4's registers */
enum {
    PINC = 0x26, PIND = 0x29, PINE = 0x2C, DDR = 1, PORT = 2, /* after each PIN */
    TCCR3A = 0x90, TCCR3B = 0x91, ICR3 = 0x96, OCR3A = 0x98,
    TCCR4C = 0xC2, OCR4C = 0xD1, OCR4D = 0xD2,
};

static const encoder external_interrupts[WHEELS] = {
    {.a = {'D', 1}, .b = {'B', 5}}, /* D2 (INT1), D9 */
    {.a = {'D', 0}, .b = {'B', 7}}, /* D3 (INT0), D11 */
};
static const encoder pin_change[WHEELS] = {
    {.a = {'B', 4}, .b = {'B', 5}}, /* D8, D9 */
    {.a = {'B', 6}, .b = {'B', 7}}, /* D10, D11 */
};

void encoders_init(encoder encoders[WHEELS], int edges) {
    memcpy(encoders, edges == 4 ? pin_change : external_interrupts, WHEELS * sizeof *encoders);
}

/* A leads B where the wheel turns forward: (A, B) = 00, 10, 11, 01. */
static int level_a(const encoder *e) {
    return ((e->steps & 3) == 1 || (e->steps & 3) == 2) ^ (e->noise[CHANNEL_A].done & 1);
}
static int level_b(const encoder *e) {
    return ((e->steps & 3) >= 2) ^ (e->noise[CHANNEL_B].done & 1);
}

static avr_irq_t *line(avr_t *avr, pin where) {
    return avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(where.port), where.bit);
}

/* Without it, any write to the port would put the pull-ups' levels on its inputs. */
static void set_external(avr_t *avr, const encoder encoders[WHEELS], char port) {
    uint8_t mask = 0, value = 0;
    for (const encoder *e = encoders; e < encoders + WHEELS; e++) {
        if (e->a.port == port) {
            mask |= 1 << e->a.bit;
            value |= level_a(e) << e->a.bit;
        }
        if (e->b.port == port) {
            mask |= 1 << e->b.bit;
            value |= level_b(e) << e->b.bit;
        }
    }
    avr_ioport_external_t external = {.name = port, .mask = mask, .value = value};
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &external);
}

static void drive(avr_t *avr, const encoder encoders[WHEELS], const encoder *e) {
    set_external(avr, encoders, e->a.port);
    avr_raise_irq(line(avr, e->a), level_a(e));
    set_external(avr, encoders, e->b.port);
    avr_raise_irq(line(avr, e->b), level_b(e));
}

void encoders_restore(avr_t *avr, encoder encoders[WHEELS]) {
    for (encoder *e = encoders; e < encoders + WHEELS; e++) {
        /* The reset cleared the register alone, and a level that is no news is not put there. */
        line(avr, e->a)->value = !level_a(e);
        line(avr, e->b)->value = !level_b(e);
        drive(avr, encoders, e);
    }
}

void encoder_turn(encoder *e, int64_t steps, uint64_t now, uint64_t until) {
    e->from = now;
    e->until = until > now ? until : now;
    e->wanted = steps;
    e->done = 0;
}

void encoder_disturb(encoder *e, int channel, uint64_t now, uint64_t width, uint64_t period,
                     uint64_t count) {
    uint64_t open = e->noise[channel].done & 1; /* a pulse, which ends now */
    e->noise[channel] = (pulses){.first = now - open * width, .period = period, .width = width,
                                 .edges = 2 * (count + open), .done = open};
}

static uint64_t next_step(const encoder *e) {
    int64_t steps = llabs(e->wanted);
    if (e->done == steps)
        return UINT64_MAX;
    return e->from + (uint64_t)((unsigned __int128)(e->until - e->from) * (e->done + 1) / steps);
}

static uint64_t next_edge(const pulses *noise) {
    if (noise->done == noise->edges)
        return UINT64_MAX;
    return noise->first + noise->done / 2 * noise->period + (noise->done & 1) * noise->width;
}

uint64_t encoder_next(const encoder *e) {
    uint64_t next = next_step(e);
    for (int channel = 0; channel < CHANNELS; channel++)
        if (next_edge(&e->noise[channel]) < next)
            next = next_edge(&e->noise[channel]);
    return next;
}

void encoders_step(avr_t *avr, encoder encoders[WHEELS]) {
    for (encoder *e = encoders; e < encoders + WHEELS; e++) {
        if (encoder_next(e) > avr->cycle)
            continue;
        if (next_step(e) <= avr->cycle) {
            e->steps += e->wanted > 0 ? 1 : -1;
            e->done++;
        }
        for (int channel = 0; channel < CHANNELS; channel++)
            e->noise[channel].done += next_edge(&e->noise[channel]) <= avr->cycle;
        drive(avr, encoders, e);
    }
}

static int level(const avr_t *avr, uint16_t pin_register, int bit) {
    return avr->data[pin_register + PORT] >> bit & 1;
}

static double share(int compare, int top) { return compare >= top ? 1.0 : (double)compare / top; }

/* E1 on D5, OC3A. Its port's level counts while no compare output is on the pin. */
static double left_duty(const avr_t *avr) {
    const uint8_t *data = avr->data;
    int mode = (data[TCCR3A] & 3) | (data[TCCR3B] >> 1 & 12), output = data[TCCR3A] >> 6;
    if (output < 2)
        return level(avr, PINC, 6);
    int top = mode & 8 ? data[ICR3] | data[ICR3 + 1] << 8 : (0x80 << (mode & 3)) - 1;
    double duty = share(data[OCR3A] | data[OCR3A + 1] << 8, top);
    return output == 2 ? duty : 1.0 - duty;
}

/* E2 on D6, OC4D: libsimavr does not model Timer4, but keeps what is written to it. */
static double right_duty(const avr_t *avr) {
    const uint8_t *data = avr->data;
    int output = data[TCCR4C] >> 2 & 3;
    if (output == 0)
        return level(avr, PIND, 7);
    double duty = share(data[OCR4D], data[OCR4C] ? data[OCR4C] : 255 /* as after a reset */);
    return output == 3 ? 1.0 - duty : duty;
}

double motor_duty(const avr_t *avr, int wheel) {
    int output = wheel == LEFT ? avr->data[PINC + DDR] & 1 << 6 : avr->data[PIND + DDR] & 1 << 7;
    int forward = wheel == LEFT ? level(avr, PIND, 4) : level(avr, PINE, 6); /* D4, D7 */
    double duty = wheel == LEFT ? left_duty(avr) : right_duty(avr);
    if (!output || duty == 0.0)
        return 0.0;
    return forward ? duty : -duty;
}
