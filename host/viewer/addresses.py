"""Where a server listens, and the address by which others reach it."""

import ipaddress
import socket


def listening_socket(address: str, port: int) -> socket.socket:
    """A socket that listens. Raises OSError where there can be none, ValueError for no address."""
    version = ipaddress.ip_address(address).version
    family = socket.AF_INET6 if version == 6 else socket.AF_INET
    return socket.create_server((address, port), family=family)


def bracketed(address: str) -> str:
    """An address as it stands in a URL."""
    return f"[{address}]" if ":" in address else address


def reachable(address: str) -> str:
    """What others call this computer: the address, or where it listens at all of them, one."""
    if not ipaddress.ip_address(address).is_unspecified:
        return address
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # of a network for examples; nothing is sent
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])
