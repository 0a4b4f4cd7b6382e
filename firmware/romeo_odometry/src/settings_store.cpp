#include "settings_store.h"

#include <avr/eeprom.h>

#include "settings.h"

namespace {

uint8_t *const START = nullptr; // of the EEPROM

settings_frame current;
settings::Record record; // what the EEPROM is to hold
uint8_t next = sizeof record; // byte of it to look at; all is written at its end
bool was_defaulted;

} // namespace

void settings_store::begin() {
    eeprom_read_block(&record, START, sizeof record);
    was_defaulted = !settings::unpack(record, &current);
    if (was_defaulted) {
        current = settings::defaults();
    }
}

const settings_frame &settings_store::in_force() {
    return current;
}

bool settings_store::defaulted() {
    return was_defaulted;
}

void settings_store::write(const settings_frame &wanted) {
    current = settings::bounded(wanted);
    record = settings::pack(current);
    next = 0;
    was_defaulted = false;
}

void settings_store::step() {
    if (next == sizeof record || !eeprom_is_ready()) {
        return;
    }
    const uint8_t wanted = reinterpret_cast<const uint8_t *>(&record)[next];
    if (eeprom_read_byte(START + next) != wanted) {
        eeprom_write_byte(START + next, wanted); // starts it, and returns
    }
    ++next;
}
