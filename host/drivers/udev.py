"""The udev rules of a robot's devices: who may use them, and that no modem program touches them."""

FILE = "/etc/udev/rules.d/60-swarmloc.rules"  # before 73-seat-late.rules, which acts on uaccess

_SERIAL = 'GROUP="dialout", MODE="0660", TAG+="uaccess", ENV{ID_MM_DEVICE_IGNORE}="1"'
RULES = f"""\
# swarmloc: the robot's devices, for the user at this computer (uaccess) and for the groups dialout
# and video. ModemManager, which would talk to the serial ports, is kept away.
# The Romeo board, its sketch and its bootloader:
ATTRS{{idVendor}}=="2341|2a03", ATTRS{{idProduct}}=="0036|8036", {_SERIAL}
# The CP2102 on the adapter of a YDLidar X4:
ATTRS{{idVendor}}=="10c4", ATTRS{{idProduct}}=="ea60", {_SERIAL}
# Cameras:
SUBSYSTEM=="video4linux", GROUP="video", MODE="0660", TAG+="uaccess"
"""
PASTE = (
    "paste this, then unplug the device and plug it in again:\n"
    f"  swarmloc doctor --udev-rules | sudo tee {FILE}\n"
    "  sudo udevadm control --reload"
)
