// Control requests of the USB host, served by the loop.
//
// The Arduino core serves them in an interrupt that lets no other in, and waits in it for the host's
// next packet: encoder edges are lost meanwhile, and a host that never goes on stops everything.
#pragma once

namespace usb_control {

// Serve the next request, if there is one. Waits for the host's packets with interrupts on: a host
// that never sends them is a loop that hangs, which the watchdog ends.
void step();

} // namespace usb_control
