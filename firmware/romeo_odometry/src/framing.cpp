#include "framing.h"

#include <string.h>
#include <util/crc16.h>

namespace {

constexpr uint8_t CRC_SIZE = 2;

// COBS for less than 255 bytes: each zero is replaced by the distance to the next one, and the
// first distance is put in front. Decodes in place; returns the size of the result, 0 where a
// distance leads out of the data.
uint8_t cobs_decode(uint8_t *data, uint8_t size) {
    uint8_t next_zero = 0;
    while (next_zero < size) {
        const uint8_t distance = data[next_zero];
        if (distance == 0 || distance > size - next_zero) {
            return 0;
        }
        data[next_zero] = 0;
        next_zero += distance;
    }
    memmove(data, data + 1, size - 1);
    return size - 1;
}

} // namespace

uint16_t framing::crc16(const void *data, uint8_t size) {
    const uint8_t *next = static_cast<const uint8_t *>(data);
    uint16_t crc = 0;
    while (size--) {
        crc = _crc_xmodem_update(crc, *next++);
    }
    return crc;
}

uint8_t framing::encode(const void *content, uint8_t size, uint8_t *encoded) {
    const uint8_t end = 1 + size + CRC_SIZE;
    memcpy(encoded + 1, content, size);
    const uint16_t crc = crc16(encoded + 1, size);
    encoded[1 + size] = crc & 0xff;
    encoded[2 + size] = crc >> 8;
    uint8_t next_zero = end;
    for (uint8_t i = end; i-- > 0;) {
        if (i == 0 || encoded[i] == 0) {
            encoded[i] = next_zero - i;
            next_zero = i;
        }
    }
    encoded[end] = PROTOCOL_DELIMITER;
    return end + 1;
}

uint8_t framing::Decoder::feed(uint8_t byte) {
    if (byte != PROTOCOL_DELIMITER) {
        // What does not fit is forgotten: a full buffer tells that the frame is too long.
        if (length < sizeof buffer) {
            buffer[length++] = byte;
        }
        return 0;
    }
    const uint8_t size = length ? finish() : 0;
    length = 0;
    return size;
}

uint8_t framing::Decoder::finish() {
    // The buffer has room for the delimiter as well, which is not stored: full means too long.
    if (length == sizeof buffer) {
        refuse();
        return 0;
    }
    const uint8_t size = cobs_decode(buffer, length);
    if (size <= CRC_SIZE) {
        refuse();
        return 0;
    }
    const uint8_t content_size = size - CRC_SIZE;
    const uint16_t told = buffer[content_size] | static_cast<uint16_t>(buffer[content_size + 1]) << 8;
    if (crc16(buffer, content_size) != told) {
        refuse();
        return 0;
    }
    return content_size;
}

void framing::Decoder::refuse() {
    if (refused < UINT16_MAX) {
        ++refused;
    }
}
