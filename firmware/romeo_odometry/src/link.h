// Frames over the board's own USB port. Nothing here ever waits for the host.
#pragma once

#include <stdint.h>

namespace link {

void begin();

// Has a host the port open?
bool is_open();

// Did the host ask for the bootloader? It does so by closing the port at 1200 baud.
bool bootloader_asked();

// The content of the next frame received, or nullptr; `size` is set with it. It is valid until the
// next call. Takes in a limited number of bytes a call.
const uint8_t *receive(uint8_t *size);

// Send a frame whole where the USB buffer has room for it now; otherwise drop and count it.
void send(const void *content, uint8_t size);

// The last frame received has no meaning here.
void refuse();

// Since start; both stay at 65535.
uint16_t dropped_frames();
uint16_t bad_frames();

} // namespace link
