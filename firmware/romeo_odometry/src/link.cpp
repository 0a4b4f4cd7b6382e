#include "link.h"

#include <Arduino.h>
#include <util/atomic.h>

#include "framing.h"

namespace {

constexpr uint8_t MOST_BYTES_A_CALL = 32; // a full USB packet takes two passes of the loop
constexpr uint8_t BYTES_A_PIECE = 6;
constexpr uint16_t BOOTLOADER_BAUD = 1200;

framing::Decoder decoder;
uint16_t dropped;

// At each start of a USB frame the core's interrupt sends what the buffer holds. In the middle of one of
// ours it would take the room away that we have just been told of: so each is a packet of its own.
struct StartOfFrameMasked {
    StartOfFrameMasked() {
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
            UDIEN &= ~_BV(SOFE);
        }
    }
    ~StartOfFrameMasked() {
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
            UDIEN |= _BV(SOFE);
        }
    }
};

// Into the USB buffer, by pieces: the core copies each with interrupts off, at 0.6 us a byte.
bool write(const uint8_t *data, uint8_t size) {
    while (size) {
        const uint8_t piece = size < BYTES_A_PIECE ? size : BYTES_A_PIECE;
        if (Serial.write(data, piece) != piece) {
            return false;
        }
        data += piece;
        size -= piece;
    }
    return true;
}

} // namespace

void link::begin() {
    Serial.begin(115200); // of no effect on native USB
}

bool link::is_open() {
    return Serial.dtr();
}

bool link::bootloader_asked() {
    return !Serial.dtr() && Serial.baud() == BOOTLOADER_BAUD;
}

const uint8_t *link::receive(uint8_t *size) {
    for (uint8_t i = 0; i < MOST_BYTES_A_CALL; ++i) {
        const int byte = Serial.read();
        if (byte < 0) {
            return nullptr;
        }
        *size = decoder.feed(static_cast<uint8_t>(byte));
        if (*size) {
            return decoder.content();
        }
    }
    return nullptr;
}

void link::send(const void *content, uint8_t size) {
    uint8_t encoded[PROTOCOL_LARGEST_ENCODED];
    const uint8_t encoded_size = framing::encode(content, size, encoded);
    const StartOfFrameMasked masked;
    // More than fits would make the core wait up to 250 ms for the host.
    if (Serial.availableForWrite() < encoded_size || !write(encoded, encoded_size)) {
        if (dropped < UINT16_MAX) {
            ++dropped;
        }
        return;
    }
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        Serial.flush();
    }
}

void link::refuse() {
    decoder.refuse();
}

uint16_t link::dropped_frames() {
    return dropped;
}

uint16_t link::bad_frames() {
    return decoder.bad();
}
