"""Access to the stream: refused to web pages of other origins and without the token.

A page of another origin can make a browser ask this server for something; the browser then says
where the page came from (Origin) and by which name it found this server (Host). Origin keeps
pages elsewhere out, Host those that gave their own name this server's address (DNS rebinding).
Where others share the network, only who was given the token may read.
"""

import hmac
import ipaddress
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit


@dataclass(frozen=True, slots=True)
class Access:
    """Access rules of a server. port: where it listens; token: "" if none is needed.

    apps: origins that may read beside the server's own pages.
    """

    port: int
    token: str
    apps: Sequence[str] = ()

    def refusal(self, target: str, host: str | None, origins: Sequence[str]) -> str:
        """Why a request may not pass, as text; "" where it may.

        target: path and query; host: its Host; origins: its Origin headers, none from a program.
        """
        if not self._is_own_name(host):
            return f"this server is not called {host}"
        if any(origin not in (f"http://{host}", *self.apps) for origin in origins):
            return "pages from elsewhere may not read this robot"
        given = parse_qs(urlsplit(target).query).get("token", [""])[0]
        if self.token and not hmac.compare_digest(given.encode(), self.token.encode()):
            return "the token in the address is missing or wrong: use the printed one"
        return ""

    def _is_own_name(self, host: str | None) -> bool:
        """Only literal addresses and localhost: a name could be anybody's."""
        try:
            parts = urlsplit(f"//{host or ''}")
            if (parts.port or 80) != self.port:
                return False
            return parts.hostname == "localhost" or bool(ipaddress.ip_address(parts.hostname or ""))
        except ValueError:
            return False


def access(address: str, port: int, driven: bool = False) -> Access:
    """The rules for a server at an address.

    A token unless only this computer reaches it; also there where who reads may drive, for other
    users of this computer reach it, too.
    """
    open_to_all = ipaddress.ip_address(address).is_loopback and not driven
    return Access(port, "" if open_to_all else secrets.token_urlsafe(16))
