// Frames on the line: COBS(content, CRC-16), zero byte (see protocol.toml). Pure.
#pragma once

#include <stdint.h>

#include "protocol.h"

namespace framing {

// Polynomial 0x1021, start 0, not reflected.
uint16_t crc16(const void *data, uint8_t size);

// The bytes of a frame on the line, for `size` bytes of content (at most
// PROTOCOL_LARGEST_FRAME) into `encoded` (PROTOCOL_LARGEST_ENCODED bytes). Returns how many.
uint8_t encode(const void *content, uint8_t size, uint8_t *encoded);

class Decoder {
public:
    // One more byte from the line. Returns the size of the content of the frame that it ends, 0
    // where it ends none.
    uint8_t feed(uint8_t byte);

    // That content, until the next call of feed.
    const uint8_t *content() const { return buffer; }

    // Frames refused since start; stays at 65535. The caller adds those it cannot use.
    uint16_t bad() const { return refused; }
    void refuse();

private:
    uint8_t finish();

    uint8_t buffer[PROTOCOL_LARGEST_ENCODED];
    uint8_t length = 0;
    uint16_t refused = 0;
};

} // namespace framing
