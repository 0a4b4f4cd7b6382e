/* A USB host as simavr's device controller sees one: bus reset, frames, control and bulk transfers.
 *
 * Two things a controller does are left out of libsimavr 1.6 and made up for here. It sends no
 * start of frame, without which the Arduino core flushes nothing. And it accepts a transfer's next
 * stage before the processor has seen the last one (its endpoints have one bank), where a real
 * controller answers NAK; so the endpoint's flags are read first.
 */
#include "usb_host.h"

#include <simavr/avr_usb.h>
#include <stdlib.h>
#include <string.h>

/* Registers and bits of the ATmega32U4, datasheet section 22 */
enum {
    UDCON = 0xE0, UDINT = 0xE1, UDIEN = 0xE2, UDFNUML = 0xE4, UDFNUMH = 0xE5,
    UEINTX = 0xE8, UENUM = 0xE9, UECONX = 0xEB,
    DETACH = 1 << 0, SOFI = 1 << 2, RXOUTI = 1 << 2, RXSTPI = 1 << 3, EPEN = 1 << 0,
    USB_GEN_VECTOR = 10,
};

/* USB 2.0, table 9-4, and the CDC's PSTN subclass 1.2, table 13 */
enum {
    SET_ADDRESS = 5, GET_DESCRIPTOR = 6, SET_CONFIGURATION = 9,
    SET_LINE_CODING = 0x20, SET_CONTROL_LINE_STATE = 0x22,
    DESCRIPTOR_DEVICE = 1, DESCRIPTOR_CONFIGURATION = 2, DESCRIPTOR_ENDPOINT = 5,
    FROM_DEVICE = 0x80, CLASS_INTERFACE = 0x21, LINE_READY = 3 /* DTR and RTS */,
};

/* In ticks of 100 us. USB 2.0, 7.1.7.3: 100 ms from attach to reset; 7.1.7.5: 10 ms after it. */
enum { DEBOUNCE = 1000, RECOVERY = 100, FRAME = 10 };

static uint8_t endpoint_register(usb_host *host, uint8_t endpoint, uint16_t address) {
    avr_t *avr = host->avr;
    uint8_t selected = avr->data[UENUM];
    avr->data[UENUM] = endpoint;
    avr_io_addr_t io = AVR_DATA_TO_IO(address);
    uint8_t value = avr->io[io].r.c(avr, address, avr->io[io].r.param);
    avr->data[UENUM] = selected;
    return value;
}

static int enabled(usb_host *host, uint8_t endpoint) {
    return endpoint_register(host, endpoint, UECONX) & EPEN;
}

static int usb_ioctl(usb_host *host, uint32_t request, uint8_t pipe, uint8_t *data, uint32_t *size) {
    struct avr_io_usb transfer = {.pipe = pipe, .sz = *size, .buf = data};
    int result = avr_ioctl(host->avr, request, &transfer);
    *size = transfer.sz;
    return result;
}

static void raise_general(usb_host *host, uint8_t flag) {
    host->avr->data[UDINT] |= flag;
    if (host->avr->data[UDIEN] & flag)
        avr_raise_interrupt(host->avr, host->general);
}

static int enqueue(usb_host *host, uint8_t type, uint8_t request, uint16_t value, uint16_t length,
                   const uint8_t *data) {
    if (host->queued == USB_QUEUE)
        return -1;
    usb_transfer *transfer = &host->queue[host->queued++];
    uint8_t setup[8] = {type, request, value & 0xFF, value >> 8, 0, 0, length & 0xFF, length >> 8};
    memcpy(transfer->setup, setup, sizeof setup);
    memset(transfer->data, 0, sizeof transfer->data);
    if (data)
        memcpy(transfer->data, data, length);
    transfer->abandoned = 0;
    return 0;
}

/* ---- a control transfer, one stage a tick at most ---- */

static uint32_t wanted(const usb_transfer *transfer) {
    return transfer->setup[6] | transfer->setup[7] << 8;
}

static void find_endpoints(usb_host *host) {
    const uint8_t *at = host->configuration, *end = at + host->configuration_size;
    for (; at + 2 <= end && at[0] >= 2 && at + at[0] <= end; at += at[0]) {
        if (at[1] != DESCRIPTOR_ENDPOINT || at[0] < 7 || (at[3] & 3) != 2 /* bulk */)
            continue;
        if (at[2] & FROM_DEVICE)
            host->bulk_in = at[2] & 0x0F;
        else
            host->bulk_out = at[2] & 0x0F;
    }
}

static void keep_descriptor(usb_host *host, uint8_t kind) {
    if (kind == DESCRIPTOR_DEVICE) {
        host->device_size = host->replied < sizeof host->device ? host->replied : sizeof host->device;
        memcpy(host->device, host->reply, host->device_size);
    } else if (kind == DESCRIPTOR_CONFIGURATION) {
        host->configuration_size = host->replied;
        memcpy(host->configuration, host->reply, host->replied);
        find_endpoints(host);
    }
}

static void finish(usb_host *host, int accepted) {
    const uint8_t *setup = host->queue[0].setup;
    if (accepted && setup[1] == GET_DESCRIPTOR)
        keep_descriptor(host, setup[3]);
    else if (accepted && setup[1] == SET_CONFIGURATION)
        host->configured = 1;
    else if (accepted && setup[1] == SET_CONTROL_LINE_STATE)
        host->open = setup[2] & 1;
    host->queued--;
    memmove(host->queue, host->queue + 1, host->queued * sizeof host->queue[0]);
    host->stage = CONTROL_IDLE;
}

static usb_stage read_reply(usb_host *host, usb_transfer *transfer) {
    uint8_t packet[USB_PACKET];
    uint32_t size = 0;
    int result = usb_ioctl(host, AVR_IOCTL_USB_READ, 0, packet, &size);
    if (result == AVR_IOCTL_USB_STALL) {
        finish(host, 0);
        return CONTROL_IDLE;
    }
    if (result < 0)
        return CONTROL_READ;
    if (size > sizeof host->reply - host->replied)
        size = sizeof host->reply - host->replied;
    memcpy(host->reply + host->replied, packet, size);
    host->replied += size;
    return size < USB_PACKET || host->replied >= wanted(transfer) ? CONTROL_ACK : CONTROL_READ;
}

static void next_stage(usb_host *host) {
    usb_transfer *transfer = &host->queue[0];
    uint32_t size = 0;
    int result;
    if (!host->queued || !enabled(host, 0))
        return;
    switch (host->stage) {
    case CONTROL_IDLE:
        size = sizeof transfer->setup;
        if (usb_ioctl(host, AVR_IOCTL_USB_SETUP, 0, transfer->setup, &size) == 0) {
            host->replied = 0;
            host->stage = CONTROL_SETUP;
            if (transfer->abandoned)
                finish(host, 0);
        }
        break;
    case CONTROL_SETUP:
        if (endpoint_register(host, 0, UEINTX) & RXSTPI)
            break; /* the sketch has not seen it yet */
        size = wanted(transfer);
        if (transfer->setup[0] & FROM_DEVICE)
            host->stage = CONTROL_READ;
        else if (size == 0)
            host->stage = CONTROL_DONE;
        else if (usb_ioctl(host, AVR_IOCTL_USB_WRITE, 0, transfer->data, &size) == 0)
            host->stage = CONTROL_SENT;
        break;
    case CONTROL_SENT:
        if (!(endpoint_register(host, 0, UEINTX) & RXOUTI))
            host->stage = CONTROL_DONE;
        break;
    case CONTROL_READ:
        host->stage = read_reply(host, transfer);
        break;
    case CONTROL_ACK: /* the host's empty packet says that it has read all */
        if (usb_ioctl(host, AVR_IOCTL_USB_WRITE, 0, transfer->data, &size) == 0)
            finish(host, 1);
        break;
    case CONTROL_DONE: /* the board's empty packet says that it has done all */
        result = usb_ioctl(host, AVR_IOCTL_USB_READ, 0, host->reply, &size);
        if (result != AVR_IOCTL_USB_NAK)
            finish(host, result == 0);
        break;
    }
}

static void control(usb_host *host) {
    usb_stage before = host->stage;
    if (host->stage_wait) {
        host->stage_wait--;
        return;
    }
    next_stage(host);
    if (host->stage != before)
        host->stage_wait = host->stage_gap;
}

/* ---- the serial port's bytes ---- */

static void *grown(void *items, size_t *room, size_t needed, size_t size) {
    if (needed <= *room)
        return items;
    size_t more = 2 * needed + 256;
    void *larger = realloc(items, more * size);
    if (larger)
        *room = more;
    return larger;
}

static void read_bulk(usb_host *host) {
    usb_packet *packets =
        grown(host->received, &host->received_room, host->received_end + 1, sizeof *packets);
    if (!packets)
        return; /* no memory: as if this read came too late */
    host->received = packets;
    usb_packet *packet = &packets[host->received_end];
    packet->size = 0;
    packet->cycle = host->avr->cycle;
    if (usb_ioctl(host, AVR_IOCTL_USB_READ, host->bulk_in, packet->data, &packet->size) == 0 &&
        packet->size)
        host->received_end++;
}

static void write_bulk(usb_host *host) {
    uint32_t size = host->sending_end - host->sending_first;
    if (size > USB_PACKET)
        size = USB_PACKET;
    uint8_t *data = host->sending + host->sending_first;
    uint32_t sent = size;
    if (size && usb_ioctl(host, AVR_IOCTL_USB_WRITE, host->bulk_out, data, &sent) == 0)
        host->sending_first += size;
    if (host->sending_first == host->sending_end)
        host->sending_first = host->sending_end = 0;
}

static void bulk(usb_host *host) {
    if (!host->configured || !host->open)
        return;
    if (host->reading && enabled(host, host->bulk_in))
        read_bulk(host);
    if (enabled(host, host->bulk_out))
        write_bulk(host);
}

/* ---- the bus ---- */

static void enumerate(usb_host *host) {
    /* What the program asked of the port already comes after. */
    usb_transfer asked[USB_QUEUE];
    uint32_t count = host->queued;
    memcpy(asked, host->queue, sizeof asked);
    host->queued = 0;
    enqueue(host, FROM_DEVICE, GET_DESCRIPTOR, DESCRIPTOR_DEVICE << 8, 18, NULL);
    enqueue(host, 0, SET_ADDRESS, 1, 0, NULL);
    enqueue(host, FROM_DEVICE, GET_DESCRIPTOR, DESCRIPTOR_CONFIGURATION << 8, USB_DESCRIPTOR, NULL);
    enqueue(host, 0, SET_CONFIGURATION, 1, 0, NULL);
    for (uint32_t i = 0; i < count && host->queued < USB_QUEUE; i++)
        host->queue[host->queued++] = asked[i];
}

static void start_of_frame(usb_host *host) {
    uint16_t frame = (host->ticks / FRAME) & 0x7FF;
    host->avr->data[UDFNUML] = frame & 0xFF;
    host->avr->data[UDFNUMH] = frame >> 8;
    raise_general(host, SOFI);
}

static void enter(usb_host *host, usb_state state) {
    host->state = state;
    host->ticks = 0;
}

void usb_host_tick(usb_host *host) {
    int attached = !(host->avr->data[UDCON] & DETACH);
    host->ticks++;
    if (!attached && host->state != USB_UNPLUGGED)
        usb_host_unplugged(host);
    switch (host->state) {
    case USB_UNPLUGGED:
        if (attached)
            enter(host, USB_DEBOUNCE);
        break;
    case USB_DEBOUNCE:
        if (host->ticks >= DEBOUNCE) {
            avr_ioctl(host->avr, AVR_IOCTL_USB_RESET, NULL);
            enter(host, USB_RECOVERY);
        }
        break;
    case USB_RECOVERY:
        if (host->ticks >= RECOVERY) {
            enumerate(host);
            enter(host, USB_RUNNING);
        }
        break;
    case USB_RUNNING:
        if (host->ticks % FRAME == 0)
            start_of_frame(host);
        control(host);
        bulk(host);
        break;
    }
}

void usb_host_unplugged(usb_host *host) {
    enter(host, USB_UNPLUGGED);
    host->stage = CONTROL_IDLE;
    host->queued = 0;
    host->configured = host->open = 0;
    host->sending_first = host->sending_end = 0;
}

int usb_host_set_line(usb_host *host, uint32_t baudrate, int ready) {
    uint8_t coding[7] = {baudrate, baudrate >> 8, baudrate >> 16, baudrate >> 24, 0, 0, 8};
    if (host->queued + 2 > USB_QUEUE)
        return -1;
    enqueue(host, CLASS_INTERFACE, SET_LINE_CODING, 0, sizeof coding, coding);
    return enqueue(host, CLASS_INTERFACE, SET_CONTROL_LINE_STATE, ready ? LINE_READY : 0, 0, NULL);
}

int usb_host_request(usb_host *host, const uint8_t setup[8], int abandoned) {
    uint16_t value = setup[2] | setup[3] << 8, length = setup[6] | setup[7] << 8;
    int to_board = !(setup[0] & FROM_DEVICE) && !abandoned;
    if (to_board && length > sizeof host->queue[0].data)
        return -1;
    if (enqueue(host, setup[0], setup[1], value, length, NULL) != 0)
        return -1;
    host->queue[host->queued - 1].abandoned = abandoned;
    return 0;
}

int usb_host_send(usb_host *host, const uint8_t *data, size_t size) {
    if (!size) /* before the first byte there is no room yet, which is no failure */
        return 0;
    uint8_t *sending = grown(host->sending, &host->sending_room, host->sending_end + size, 1);
    if (!sending)
        return -1;
    host->sending = sending;
    memcpy(sending + host->sending_end, data, size);
    host->sending_end += size;
    return 0;
}

const usb_packet *usb_host_take(usb_host *host) {
    if (host->received_first == host->received_end) {
        host->received_first = host->received_end = 0;
        return NULL;
    }
    return &host->received[host->received_first++];
}

void usb_host_init(usb_host *host, avr_t *avr) {
    memset(host, 0, sizeof *host);
    host->avr = avr;
    host->reading = 1;
    for (int i = 0; i < avr->interrupts.vector_count; i++)
        if (avr->interrupts.vector[i]->vector == USB_GEN_VECTOR)
            host->general = avr->interrupts.vector[i];
}

void usb_host_free(usb_host *host) {
    free(host->received);
    free(host->sending);
}
