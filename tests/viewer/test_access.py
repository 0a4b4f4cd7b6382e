"""Who may read: by Origin, Host and token."""

import pytest

from host.viewer.access import Access, access

LOCAL, SHARED = Access(8737, ""), Access(8737, "secret")


@pytest.mark.parametrize(
    "host", ["127.0.0.1:8737", "localhost:8737", "[::1]:8737", "192.168.4.7:8737"]
)
def test_an_address_may_read_with_or_without_an_origin_of_its_own(host: str) -> None:
    assert not LOCAL.refusal("/", host, [])
    assert not LOCAL.refusal("/stream", host, [f"http://{host}"])


@pytest.mark.parametrize(
    "host",
    [None, "", "evil.example:8737", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:x",
     "localhost.evil:8737", "[::1:8737", "127.0.0.1:8737@evil.example", "0x7f.1:8737"],
)  # fmt: skip
def test_another_name_may_not(host: str | None) -> None:
    assert "not called" in LOCAL.refusal("/", host, [])


@pytest.mark.parametrize(
    "origins",
    [["http://evil.example"], ["null"], [""], ["https://127.0.0.1:8737"], ["http://127.0.0.1:8738"],
     ["http://localhost:8737"], ["http://127.0.0.1:8737", "http://evil.example"]],
)  # fmt: skip
def test_a_page_from_elsewhere_may_not(origins: list[str]) -> None:
    assert "elsewhere" in LOCAL.refusal("/stream", "127.0.0.1:8737", origins)


@pytest.mark.parametrize(
    "query",
    ["", "?", "?token=", "?token=Secret", "?tokens=secret", "?x=secret",
     "?token=wrong&token=secret", "?token=sécret"],
)  # fmt: skip
def test_without_the_token_nobody_reads_a_shared_robot(query: str) -> None:
    assert "token" in SHARED.refusal("/stream" + query, "192.168.4.7:8737", [])
    assert not SHARED.refusal("/stream?token=secret", "192.168.4.7:8737", [])


def test_a_token_is_asked_for_where_others_reach_the_server() -> None:
    assert access("127.0.0.1", 1).token == access("::1", 1).token == ""
    tokens = {access(address, 1).token for address in ("0.0.0.0", "::", "192.168.4.7")}
    assert len(tokens) == 3
    assert min(map(len, tokens)) >= 20
