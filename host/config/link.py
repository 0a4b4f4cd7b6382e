"""The settings of the link between robots in robot.toml: odometry by UDP, signed."""

import ipaddress

from pydantic import Field

from host.config.section import Line, Section, Text, contradiction

_LEAST_KEY = 16  # characters: guessed sooner, if it is a word


class LinkSettings(Section):
    """How robots hear each other's odometry; without a key there is no link.

    robot: this robot's number, another one for each. key: the same for all. It stays out of
    recordings. clock_tolerance_s: how far apart robots' calendar clocks may be; a datagram that
    is older is refused as recorded and sent again.
    """

    robot: int = Field(0, ge=0, le=65535)
    key: Line = Field("", exclude=True, repr=False)
    address: Text = "255.255.255.255"
    port: int = Field(47800, ge=1024, le=65535)
    rate_hz: float = Field(10.0, ge=1.0, le=50.0)
    clock_tolerance_s: float = Field(60.0, ge=1.0, le=1e6)

    @property
    def on(self) -> bool:
        """Is there a link at all?"""
        return bool(self.key)

    @contradiction
    def _key_and_address(self) -> None:
        if self.key and len(self.key) < _LEAST_KEY:
            raise ValueError(
                f"key has {len(self.key)} characters: at least {_LEAST_KEY}, or none for no link; "
                "make one with: openssl rand -hex 16"
            )
        if len(set(self.key)) == 1:
            raise ValueError("key repeats one character: make one with: openssl rand -hex 16")
        try:
            address = ipaddress.IPv4Address(self.address)
        except ValueError:
            address = ipaddress.IPv4Address(0)
        if address.is_unspecified or address.is_multicast:
            raise ValueError(
                f"address ({self.address}) must be that of a network's broadcast or of one "
                "computer, as 255.255.255.255 or 192.168.0.255"
            )
