#include "link.h"

#include <Arduino.h>
#include <util/atomic.h>

#include "framing.h"

namespace {

constexpr uint8_t MOST_BYTES_A_CALL = 32; // a full USB packet takes two passes of the loop
constexpr uint16_t BOOTLOADER_BAUD = 1200;

framing::Decoder decoder;
uint16_t dropped;

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
    // More than fits would make the core wait up to 250 ms for the host.
    if (Serial.availableForWrite() >= encoded_size &&
        Serial.write(encoded, encoded_size) == encoded_size) {
        // Out with it as a packet of its own. Otherwise the core does so in an interrupt each
        // millisecond: between that question and that write it would take the room away again.
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
            Serial.flush();
        }
    } else if (dropped < UINT16_MAX) {
        ++dropped;
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
