// What the host may set, its bounds, and how it is kept in EEPROM. Pure.
#pragma once

#include <stdint.h>

#include "protocol.h"

namespace settings {

// As stored: the version of this layout, the fields of settings_frame, CRC-16 of both.
struct __attribute__((packed)) Record {
    uint8_t version;
    settings_frame fields;
    uint16_t crc;
};

settings_frame defaults();

// The same with each field brought to its nearest bound.
settings_frame bounded(settings_frame wanted);

Record pack(const settings_frame &fields);

// Returns whether the record is whole and of this version; only then it changes `fields`.
bool unpack(const Record &record, settings_frame *fields);

} // namespace settings
