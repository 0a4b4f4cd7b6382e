/* For the host what avr-libc has for the board: bit by bit, from its documented polynomial. */
#pragma once

#include <stdint.h>

static inline uint16_t _crc_xmodem_update(uint16_t crc, uint8_t data) {
    crc ^= (uint16_t)(data << 8);
    for (int bit = 0; bit < 8; ++bit) {
        crc = (uint16_t)(crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1);
    }
    return crc;
}
