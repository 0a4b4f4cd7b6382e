// The firmware's version, reported in `identity`. `swarmloc flash` reads it from here, and
// tools/generate_protocol.py for the host, which names a board with another version.
#pragma once

#define FIRMWARE_VERSION_MAJOR 0
#define FIRMWARE_VERSION_MINOR 2
#define FIRMWARE_VERSION_PATCH 0
