// The firmware's version, told in `identity`. `swarmloc flash` reads it from here.
#pragma once

#define FIRMWARE_VERSION_MAJOR 0
#define FIRMWARE_VERSION_MINOR 1
#define FIRMWARE_VERSION_PATCH 0
