/* The computer at the other end of the board's USB cable. */
#ifndef USB_HOST_H
#define USB_HOST_H

#include <simavr/sim_avr.h>
#include <stddef.h>
#include <stdint.h>

enum { USB_PACKET = 64, USB_QUEUE = 16, USB_DESCRIPTOR = 512 };

/* One control transfer: its direction and length stand in the setup packet. */
typedef struct {
    uint8_t setup[8];
    uint8_t data[8]; /* what follows the setup packet where the host sends */
    int abandoned;   /* nothing follows it */
} usb_transfer;

/* One packet of the serial port that came in from the board. */
typedef struct {
    uint64_t cycle;
    uint32_t size;
    uint8_t data[USB_PACKET];
} usb_packet;

typedef enum { USB_UNPLUGGED, USB_DEBOUNCE, USB_RECOVERY, USB_RUNNING } usb_state;
typedef enum { CONTROL_IDLE, CONTROL_SETUP, CONTROL_SENT, CONTROL_READ, CONTROL_ACK, CONTROL_DONE }
    usb_stage;

typedef struct {
    avr_t *avr;
    avr_int_vector_t *general; /* USB_GEN: bus reset and start of frame */
    usb_state state;
    usb_stage stage;
    uint32_t ticks; /* since the state began */
    uint32_t stage_gap, stage_wait; /* ticks between a control transfer's stages, and left of them */

    usb_transfer queue[USB_QUEUE]; /* the first is under way */
    uint32_t queued;
    uint8_t reply[USB_DESCRIPTOR];
    uint32_t replied;

    uint8_t device[18], configuration[USB_DESCRIPTOR];
    uint32_t device_size, configuration_size;
    uint8_t bulk_in, bulk_out; /* endpoint numbers, from the configuration descriptor */
    int configured, open, reading;

    usb_packet *received;
    size_t received_first, received_end, received_room;
    uint8_t *sending;
    size_t sending_first, sending_end, sending_room;
} usb_host;

void usb_host_init(usb_host *host, avr_t *avr);
void usb_host_free(usb_host *host);

/* What a host does in 100 us of bus time; to be called that often. */
void usb_host_tick(usb_host *host);

/* The board is gone from the bus, as after a reset: the port is closed, unsent bytes are lost. */
void usb_host_unplugged(usb_host *host);

/* Set the serial port's baud rate and its DTR and RTS, once earlier requests are through.
 * 0, or -1 where too many are waiting. */
int usb_host_set_line(usb_host *host, uint32_t baudrate, int ready);

/* A control transfer of any kind, for requests of the host's own, at most 8 bytes of zero to the board.
 * abandoned: its setup packet alone. 0, or -1 where too many are waiting. */
int usb_host_request(usb_host *host, const uint8_t setup[8], int abandoned);

/* Bytes for the board, sent when the port is open and the board takes them. -1: out of memory. */
int usb_host_send(usb_host *host, const uint8_t *data, size_t size);

/* The oldest packet not yet taken, or NULL. It stays valid until the next tick. */
const usb_packet *usb_host_take(usb_host *host);

#endif
