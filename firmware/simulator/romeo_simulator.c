/* A Romeo board that runs a sketch's real machine code: ATmega32U4 by libsimavr, the encoders'
 * pins, the motors' pins, and a USB host on the other end of the cable.
 *
 * To be loaded as a library. Times are processor cycles at 16 MHz since the start. Nothing of
 * libsimavr's structures leaves this folder: they differ from version to version.
 */
#include "usb_host.h"
#include "wheels.h"

#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Data addresses of the ATmega32U4's registers */
enum { MCUSR = 0x54, WDTCSR = 0x60 };

enum { VECTORS = 64, USB_TICK = 1600 /* 100 us */, NO_ADDRESS = -1 };

/* The Arduino core leaves the word 0x7777 for the bootloader at 0x800, or, for newer ones, in the
 * last two bytes of RAM. */
enum { BOOTLOADER_KEY = 0x7777, KEY_ADDRESS = 0x800 };

typedef struct {
    const avr_t *avr;
    uint64_t count, worst, worst_latency, pending_since, began;
} vector_time;

typedef struct {
    avr_t *avr;
    usb_host usb;
    uint64_t next_usb_tick;
    encoder encoders[WHEELS];
    void (*reset)(avr_t *);
    int was_reset;
    uint64_t watchdog_resets;
    int bootloader;
    uint32_t code_end;
    char error[256];
    vector_time vectors[VECTORS];
    int64_t watched;       /* byte address in flash, or NO_ADDRESS */
    uint64_t passes, last_pass, worst_pass;
    uint64_t deaf_since, worst_deaf; /* with interrupts off, while something is watched */
    uint32_t deaf_from, worst_deaf_from; /* byte addresses */
} romeo;

/* ---- what happens inside ---- */

static void note_error(avr_t *avr, const int level, const char *format, va_list arguments) {
    romeo *board = avr ? avr->custom.data : NULL;
    if (level == LOG_ERROR && board && !board->error[0])
        vsnprintf(board->error, sizeof board->error, format, arguments);
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) {
    (void)avr, (void)cycles; /* virtual time passes all the same */
}

static avr_cycle_count_t nothing(avr_t *avr, avr_cycle_count_t when, void *parameter) {
    (void)avr, (void)when, (void)parameter;
    return 0;
}

static void on_reset(avr_t *avr) {
    romeo *board = avr->custom.data;
    board->was_reset = 1;
    if (board->reset)
        board->reset(avr);
}

static void on_pending(avr_irq_t *irq, uint32_t value, void *parameter) {
    vector_time *time = parameter;
    (void)irq;
    if (value)
        time->pending_since = time->avr->cycle;
}

static void on_running(avr_irq_t *irq, uint32_t value, void *parameter) {
    vector_time *time = parameter;
    uint64_t now = time->avr->cycle;
    (void)irq;
    if (value) {
        uint64_t latency = now - time->pending_since;
        time->count++;
        time->began = now;
        if (latency > time->worst_latency)
            time->worst_latency = latency;
    } else if (now - time->began > time->worst) {
        time->worst = now - time->began;
    }
}

static void hook_interrupts(romeo *board) {
    avr_int_table_t *table = &board->avr->interrupts;
    for (int i = 0; i < table->vector_count; i++) {
        avr_int_vector_t *vector = table->vector[i];
        vector_time *time = &board->vectors[vector->vector % VECTORS];
        time->avr = board->avr;
        avr_irq_register_notify(&vector->irq[AVR_INT_IRQ_PENDING], on_pending, time);
        avr_irq_register_notify(&vector->irq[AVR_INT_IRQ_RUNNING], on_running, time);
    }
}

static int key_at(const romeo *board, uint16_t address) {
    const uint8_t *data = board->avr->data;
    return (data[address] | data[address + 1] << 8) == BOOTLOADER_KEY;
}

/* What the bootloader does with every reset before it starts the sketch, and the cable. */
static void start_sketch(romeo *board) {
    avr_t *avr = board->avr;
    board->was_reset = 0;
    avr_cycle_timer_reset(avr); /* the watchdog's is the only one */
    avr->data[MCUSR] = avr->data[WDTCSR] = 0;
    /* Or libsimavr looks at a low pin at every cycle, for an interrupt by level. */
    for (int interrupt = 0; interrupt < EXTINT_COUNT; interrupt++)
        avr_extint_set_strict_lvl_trig(avr, interrupt, 0);
    encoders_restore(avr, board->encoders);
    usb_host_unplugged(&board->usb);
    board->last_pass = 0;
}

static void after_reset(romeo *board) {
    board->watchdog_resets++;
    if (key_at(board, KEY_ADDRESS) || key_at(board, board->avr->ramend - 1))
        board->bootloader = 1;
    start_sketch(board);
}

static void note_pass(romeo *board) {
    uint64_t now = board->avr->cycle;
    if (board->last_pass) {
        board->passes++;
        if (now - board->last_pass > board->worst_pass)
            board->worst_pass = now - board->last_pass;
    }
    board->last_pass = now;
}

static void note_deafness(romeo *board) {
    avr_t *avr = board->avr;
    if (avr->sreg[S_I]) {
        uint64_t deaf = board->deaf_since ? avr->cycle - board->deaf_since : 0;
        if (deaf > board->worst_deaf) {
            board->worst_deaf = deaf;
            board->worst_deaf_from = board->deaf_from;
        }
        board->deaf_since = 0;
    } else if (!board->deaf_since) {
        board->deaf_since = avr->cycle;
        board->deaf_from = avr->pc;
    }
}

static int crashed(romeo *board) {
    avr_t *avr = board->avr;
    if (!board->error[0] && avr->state == cpu_Done)
        snprintf(board->error, sizeof board->error, "it sleeps with interrupts off");
    else if (!board->error[0] && (avr->state == cpu_Crashed || avr->pc >= board->code_end))
        snprintf(board->error, sizeof board->error, "it left its program, to 0x%04x", avr->pc);
    return board->error[0] != 0;
}

static void run_to(romeo *board, uint64_t cycle) {
    avr_t *avr = board->avr;
    /* The timer makes a sleeping processor wake there as well. */
    avr_cycle_timer_register(avr, cycle - avr->cycle, nothing, board);
    avr->run_cycle_limit = board->watched == NO_ADDRESS ? USB_TICK : 1;
    while (avr->cycle < cycle && !crashed(board)) {
        avr_run(avr);
        if (board->was_reset) {
            after_reset(board);
            return;
        }
        if (avr->pc == board->watched)
            note_pass(board);
        if (board->watched != NO_ADDRESS)
            note_deafness(board);
    }
}

/* ---- the library's functions ---- */

void romeo_free(romeo *board) {
    if (!board)
        return;
    usb_host_free(&board->usb);
    if (board->avr) {
        avr_terminate(board->avr);
        free(board->avr);
    }
    free(board);
}

/* image: the flash's content from address 0. encoder_edges: 2 or 4. NULL: it cannot be made. */
romeo *romeo_new(const uint8_t *image, uint32_t size, int encoder_edges) {
    romeo *board = calloc(1, sizeof *board);
    avr_global_logger_set(note_error);
    avr_t *avr = board ? avr_make_mcu_by_name("atmega32u4") : NULL;
    if (!avr) {
        free(board);
        return NULL;
    }
    board->avr = avr;
    board->watched = NO_ADDRESS;
    board->code_end = size;
    avr->custom.data = board;
    avr_init(avr);
    avr->frequency = 16000000;
    avr->sleep = no_sleep;
    board->reset = avr->reset;
    avr->reset = on_reset;
    if (size > avr->flashend + 1) {
        romeo_free(board);
        return NULL;
    }
    avr_loadcode(avr, (uint8_t *)image, size, 0);
    encoders_init(board->encoders, encoder_edges);
    usb_host_init(&board->usb, avr);
    hook_interrupts(board);
    start_sketch(board);
    return board;
}

uint64_t romeo_cycle(const romeo *board) { return board->avr->cycle; }
/* What brought the sketch down, or "". */
const char *romeo_error(const romeo *board) { return board->error; }
uint64_t romeo_watchdog_resets(const romeo *board) { return board->watchdog_resets; }
/* Nonzero once a watchdog reset found the bootloader's key: from then on only time passes. */
int romeo_bootloader(const romeo *board) { return board->bootloader; }
int romeo_configured(const romeo *board) { return board->usb.configured; }
int romeo_open(const romeo *board) { return board->usb.open; }

/* Run to the first instruction at or after `until`. 0, or -1 where the sketch crashed. */
int romeo_run(romeo *board, uint64_t until) {
    avr_t *avr = board->avr;
    while (avr->cycle < until && !crashed(board)) {
        uint64_t next = until;
        if (board->bootloader) {
            avr->cycle = until;
            break;
        }
        if (board->next_usb_tick < next)
            next = board->next_usb_tick;
        for (int wheel = 0; wheel < WHEELS; wheel++) {
            uint64_t step = encoder_next(&board->encoders[wheel]);
            if (step < next)
                next = step;
        }
        if (next > avr->cycle)
            run_to(board, next);
        encoders_step(avr, board->encoders);
        if (board->next_usb_tick <= avr->cycle) {
            usb_host_tick(&board->usb);
            board->next_usb_tick += USB_TICK;
        }
    }
    return crashed(board) ? -1 : 0;
}

/* The reset button, without the bootloader's wait of 8 s. */
void romeo_reset(romeo *board) {
    avr_reset(board->avr);
    start_sketch(board);
}

/* Quadrature steps, forward positive, evenly spread from now to `until`; what is left of the turn
 * before is not made. */
void romeo_turn(romeo *board, int wheel, int64_t steps, uint64_t until) {
    encoder_turn(&board->encoders[wheel], steps, board->avr->cycle, until);
}

/* Noise on a channel (0 A, 1 B) of a wheel's encoder: `count` pulses of inverted level from now on. */
void romeo_disturb(romeo *board, int wheel, int channel, uint64_t width, uint64_t period,
                   uint64_t count) {
    encoder_disturb(&board->encoders[wheel], channel, board->avr->cycle, width, period, count);
}

int64_t romeo_steps(const romeo *board, int wheel) { return board->encoders[wheel].steps; }

int romeo_set_line(romeo *board, uint32_t baudrate, int ready) {
    return usb_host_set_line(&board->usb, baudrate, ready);
}

/* What else a host may ask: setup packet, and whether it stops after that. */
int romeo_request(romeo *board, const uint8_t *setup, int abandoned) {
    return usb_host_request(&board->usb, setup, abandoned);
}

/* The host waits for so many times 100 us before each stage of a control transfer. */
void romeo_set_stage_gap(romeo *board, uint32_t gap) { board->usb.stage_gap = gap; }

void romeo_set_reading(romeo *board, int reading) { board->usb.reading = reading; }

int romeo_send(romeo *board, const uint8_t *data, uint32_t size) {
    return usb_host_send(&board->usb, data, size);
}

uint32_t romeo_unsent(const romeo *board) {
    return board->usb.sending_end - board->usb.sending_first;
}

/* The oldest packet: its size (0: there is none), 64 bytes at most, and when it was read. */
uint32_t romeo_take(romeo *board, uint8_t *data, uint64_t *cycle) {
    const usb_packet *packet = usb_host_take(&board->usb);
    if (!packet)
        return 0;
    memcpy(data, packet->data, packet->size);
    *cycle = packet->cycle;
    return packet->size;
}

/* The device descriptor (which = 1) or the configuration descriptor (2), 512 bytes at most. */
uint32_t romeo_descriptor(const romeo *board, int which, uint8_t *data) {
    const usb_host *usb = &board->usb;
    uint32_t size = which == 1 ? usb->device_size : usb->configuration_size;
    memcpy(data, which == 1 ? usb->device : usb->configuration, size);
    return size;
}

double romeo_motor(const romeo *board, int wheel) { return motor_duty(board->avr, wheel); }

/* Address of the byte in RAM, registers included, or NULL beyond its end. */
uint8_t *romeo_ram(romeo *board, uint32_t address) {
    return address <= board->avr->ramend ? board->avr->data + address : NULL;
}

/* Copy the EEPROM out of the board (write = 0) or into it. */
void romeo_eeprom(romeo *board, uint8_t *data, uint32_t size, int write) {
    avr_eeprom_desc_t content = {.ee = data, .offset = 0, .size = size};
    avr_ioctl(board->avr, write ? AVR_IOCTL_EEPROM_SET : AVR_IOCTL_EEPROM_GET, &content);
}

/* Overwrite the program from this byte address; 0, or -1 where it ends beyond the flash. */
int romeo_patch(romeo *board, uint32_t address, const uint8_t *data, uint32_t size) {
    if (address > board->avr->flashend || size > board->avr->flashend + 1 - address) {
        return -1;
    }
    memcpy(board->avr->flash + address, data, size);
    return 0;
}

/* Of one interrupt: count, worst cycles in it, worst cycles from its request to its start. */
void romeo_vector(const romeo *board, int vector, uint64_t figures[3]) {
    const vector_time *time = &board->vectors[vector % VECTORS];
    figures[0] = time->count;
    figures[1] = time->worst;
    figures[2] = time->worst_latency;
}

/* Measure the cycles from one pass of this byte address in flash to the next; -1 ends it. It
 * halves the simulation's speed. */
void romeo_watch(romeo *board, int64_t address) {
    board->watched = address;
    board->passes = board->worst_pass = board->last_pass = 0;
}

void romeo_passes(const romeo *board, uint64_t figures[2]) {
    figures[0] = board->passes;
    figures[1] = board->worst_pass;
}

/* While a place is watched: the longest time with interrupts off, in cycles, and the byte address
 * where it began. */
void romeo_deaf(const romeo *board, uint64_t figures[2]) {
    figures[0] = board->worst_deaf;
    figures[1] = board->worst_deaf_from;
}

/* Forget the figures of interrupts and passes. */
void romeo_clear_figures(romeo *board) {
    for (int i = 0; i < VECTORS; i++)
        board->vectors[i].count = board->vectors[i].worst = board->vectors[i].worst_latency = 0;
    board->passes = board->worst_pass = board->worst_deaf = board->deaf_since = 0;
}
