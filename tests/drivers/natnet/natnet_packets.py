"""NatNet packets for tests: recorded ones, and made ones that have something in every section."""

import re
import struct


def recorded_datagrams(path):
    """Payloads of the UDP datagrams in a pcapng file of Ethernet packets: (from port, bytes)."""
    data = path.read_bytes()
    at = 0
    while at < len(data):
        kind, length = struct.unpack_from("<II", data, at)
        if kind == 6:  # enhanced packet block
            (captured,) = struct.unpack_from("<I", data, at + 20)
            ip = data[at + 28 + 14 : at + 28 + captured]
            udp = ip[4 * (ip[0] & 15) :]
            source, _, size, _ = struct.unpack_from(">HHHH", udp)
            yield source, udp[8:size]
        at += length


LINES = {
    "number": r"FrameID : (\d+)",
    "timestamp": r"Timestamp : ([\d.]+)",
    "software_ms": r"Software latency : ([\d.]+) milliseconds",
    "system_ms": r"System latency : ([\d.]+) milliseconds",
    "body": r"Rigid Body \[ID=(\d+)  Error=([\d.]+)  Valid=(\d)\]",
    "pose": r"\t(-?[\d.]+)" * 7,
}


def vendor_frames(path):
    """What the vendor's client printed: a dict of texts a frame."""
    frames = []
    for line in path.read_text().splitlines():
        for name, pattern in LINES.items():
            found = re.fullmatch(pattern, line)
            if found and name == "number":
                frames.append({})
            if found:
                assert name not in frames[-1]
                frames[-1][name] = found.groups()
    return frames


def ints(*values):
    return struct.pack(f"<{len(values)}i", *values)


def floats(rng, count):
    return struct.pack(f"<{count}f", *(rng.uniform(-2, 2) for _ in range(count)))


def body(rng, version, tracked=True):
    """A rigid body; before 3.0 with two markers of its own."""
    q = [rng.gauss(0, 1) for _ in range(4)]
    norm = sum(value * value for value in q) ** 0.5
    data = ints(rng.randrange(1, 1000)) + floats(rng, 3)
    data += struct.pack("<4f", *(value / norm for value in q))
    if version < (3, 0):
        data += ints(2) + floats(rng, 6) + ints(1, 2) + floats(rng, 2)
    return data + struct.pack("<fh", rng.random(), 1 if tracked else 0)


def channels(rng, number):
    return ints(number, 2, 3) + floats(rng, 3) + ints(1) + floats(rng, 1)


def full_packet(rng, version, bodies=3, precise=None):
    """A frame with something in every section; precise: whether it has a precise time (None: by
    the version). The last body is not tracked."""
    sized = version >= (4, 1)

    def section(*items):
        data = b"".join(items)
        return ints(len(items)) + (ints(len(data)) if sized else b"") + data

    marker = 26 if version >= (3, 0) else 22
    packet = ints(rng.randrange(1, 10**6))
    packet += section(
        b"all\0" + ints(3) + floats(rng, 9), "Käfer\0".encode() + ints(1) + floats(rng, 3)
    )
    packet += section(*(floats(rng, 3) for _ in range(4)))
    packet += section(*(body(rng, version, k < bodies - 1) for k in range(bodies)))
    packet += section(ints(7, 2) + body(rng, version) + body(rng, version))
    if sized:
        asset_marker = ints(5) + floats(rng, 4) + struct.pack("<h", 1) + floats(rng, 1)
        packet += section(ints(3, 1) + body(rng, version) + ints(2) + 2 * asset_marker)
    labelled = ints(rng.randrange(9)) + floats(rng, 4) + struct.pack("<h", 2) + floats(rng, 1)
    packet += section(*([labelled[:marker]] * 5))
    if version >= (2, 9):
        packet += section(channels(rng, 1), channels(rng, 2))
    if version >= (2, 11):
        packet += section(channels(rng, 3))
    if version < (3, 0):
        packet += struct.pack("<f", rng.uniform(1, 9e3))
    packet += struct.pack("<II", rng.randrange(99), 4) + struct.pack("<d", rng.uniform(1, 9e3))
    if version >= (3, 0):
        packet += struct.pack("<QQQ", *(rng.randrange(1, 2**53) for _ in range(3)))
    if precise or (precise is None and version >= (4, 1)):
        packet += struct.pack("<II", rng.randrange(1, 2**31), rng.randrange(1, 2**31))
    return with_header(7, packet + struct.pack("<hi", 1, 0))


def with_header(message, payload):
    return struct.pack("<HH", message, len(payload)) + payload
