// Does a wheel follow its motor? Where it does not, the control drives it harder and harder. Pure.
#pragma once

#include <stdint.h>

#include "protocol.h"
#include "tick_counter.h"

class RunawayDetector {
public:
    // Settings within their bounds. The wheel's state stays.
    void configure(const settings_frame &settings);

    // Forget what was seen.
    void restart() {
        elapsed = noisy = 0;
        begun = false;
    }

    // So many control periods have passed, the wheel stands at `position` (ticks, modulo 2^32), is
    // asked to run at `asked` ticks/s, and its motor is now driven with `duty` of `full_duty`. Has it been
    // driven hard for settings.runaway without making a quarter of that speed in the direction
    // of the duty? An encoder that is dead or counts the other way looks so, and a wheel that is
    // blocked or whose motor has no supply. The time begins anew, once, when the wheel first moves
    // the new way: a heavy robot takes long to run out the old one.
    bool step(uint8_t periods, int32_t position, int16_t asked, int16_t duty, int16_t full_duty);

    // The motor is driven, and so many edges came in these periods. Have there been for
    // settings.runaway more than a wheel can make, or as many against its direction as with it? Then
    // its count is worth nothing.
    bool listen(uint8_t periods, const EdgeCounts &edges);

private:
    uint16_t most_edges = 0; // of a wheel in a period
    uint16_t noisy = 0;      // periods; others count down
    uint16_t limit = 0;   // periods; 0: never
    uint16_t elapsed = 0; // periods driven hard since the last progress; others count down
    bool forward = false; // the direction of the duty
    bool begun = false;   // has the wheel moved that way since?
    int32_t mark = 0;     // where progress is counted from
};
