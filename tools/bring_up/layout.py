"""Where things go on the robot's computer, and what the service is."""

import hashlib
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
PREFIX = "/opt/swarmloc"  # the environment, and what the tool did
PROGRAM = f"{PREFIX}/bin/swarmloc"
COMMAND = "/usr/local/bin/swarmloc"
ROBOT = "/etc/swarmloc/robot.toml"
UNIT = "swarmloc.service"
UNIT_FILE = f"/etc/systemd/system/{UNIT}"
UNIT_LINK = f"/etc/systemd/system/multi-user.target.wants/{UNIT}"
RULES = "/etc/udev/rules.d/60-swarmloc.rules"
STATE = f"{PREFIX}/bringup.json"
GROUPS = ("dialout", "video")

# Python and the firmware's toolchain. On 32-bit ARM there are no wheels of the large packages.
PACKAGES = (
    "python3", "python3-venv", "ca-certificates", "gcc-avr", "avr-libc", "arduino-core-avr",
    "avrdude", "v4l-utils",
)  # fmt: skip
ARM32 = {
    "numpy": "python3-numpy",
    "scipy": "python3-scipy",
    "opencv-python-headless": "python3-opencv",
}
ARM32_BUILD = (
    "build-essential",
    "python3-dev",
    "cmake",
    "nasm",
)  # simplejpeg comes as source there

UNIT_TEXT = f"""\
[Unit]
Description=swarmloc: where this robot's teammates are
Wants=network-online.target
After=network-online.target
StartLimitIntervalSec=0

[Service]
# Ready once every device is healthy: until then `systemctl status` says which one is not.
Type=notify
ExecStart={PROGRAM} run --robot {ROBOT}
TimeoutStartSec=infinity
WatchdogSec=15
Restart=always
RestartSec=2
# It stops the motors when it is told to end. Where it dies, the board does: 0.15 s after the last
# command.
KillSignal=SIGTERM
TimeoutStopSec=10
# A user of its own, who may do no more than open the devices.
DynamicUser=yes
SupplementaryGroups={" ".join(GROUPS)}
StateDirectory=swarmloc
WorkingDirectory=%S/swarmloc
Environment=OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
NoNewPrivileges=yes
ProtectHome=yes

[Install]
WantedBy=multi-user.target
"""


def digest() -> str:
    """Of all that is installed: whether the environment is up to date."""
    files = [SOURCE / "pyproject.toml"]
    for folder in ("host", "swarmloc", "firmware", "robots"):
        files += sorted(path for path in (SOURCE / folder).rglob("*") if path.is_file())
    total = hashlib.sha256()
    for path in files:
        if "__pycache__" not in path.parts:
            total.update(str(path.relative_to(SOURCE)).encode() + b"\0" + path.read_bytes())
    return total.hexdigest()
