#include "usb_control.h"

#include <Arduino.h>
#include <util/atomic.h>

// The core's handler. As a function it does the same, and its RETI leaves interrupts on.
extern "C" void USB_COM_vect();

void usb_control::step() {
    bool requested;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        UENUM = 0;
        UEIENX = 0; // the core enables its interrupt at each reset of the bus
        requested = UEINTX & _BV(RXSTPI);
    }
    if (!requested) {
        return;
    }
    // The core's interrupt at each start of frame would select another endpoint in between.
    const uint8_t interrupts = UDIEN;
    UDIEN = 0;
    USB_COM_vect();
    UDIEN = interrupts;
}
