"""The link between robots: signatures, replays, a network that loses, delays and reorders."""

import math
import socket
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import LinkSettings, parse_config
from host.drivers.link.device import Link
from host.drivers.link.protocol import DATAGRAM_BYTES, Receiver, Report, decode, encode
from host.errors import UserError
from host.geometry import Path
from host.messages import Displacement, Health, Message, TeammateOdometry

KEY = b"sixteen characters"
BEGAN = 1_700_000_000_000_000  # us since 1970


def a_report(sequence=0, **changes):
    seconds = 0.1 * sequence
    plain = Report(3, BEGAN, sequence, round(seconds * 1e6), 0.02, (seconds, 0.0, 0.1), (0.0, 0.0))
    return replace(plain, **changes)


def a_receiver(own=1):
    return Receiver(KEY, own, BEGAN, 60.0)


def fed(receiver, report, late=0.0, key=KEY):
    seconds = report.sent * 1e-6
    return receiver.feed(encode(report, key), 50.0 + seconds + late, BEGAN * 1e-6 + seconds)


@settings(max_examples=30)
@given(
    st.integers(0, 65535),
    st.integers(0, 2**64 - 1),
    st.floats(-1e5, 1e5),
    st.floats(-1e5, 1e5),
)
def test_what_is_sent_is_what_is_read(robot, sequence, x, heading):
    report = a_report(robot=robot, sequence=sequence, age=0.5, pose=(x, -x, heading))
    assert decode(encode(report, KEY), KEY) == report


@settings(max_examples=50)
@given(st.integers(0, DATAGRAM_BYTES - 1), st.integers(1, 255))
def test_a_changed_byte_is_noticed(place, change):
    datagram = bytearray(encode(a_report(), KEY))
    datagram[place] ^= change
    assert decode(bytes(datagram), KEY) in ("foreign", "forged")


@settings(max_examples=50)
@given(st.binary(max_size=200))
def test_garbage_is_counted_and_never_raises(datagram):
    receiver = a_receiver()
    assert receiver.feed(datagram, 1.0, 1.0) is None
    assert receiver.counts["foreign"] + receiver.counts["forged"] == 1


def test_another_key_and_impossible_numbers_are_refused():
    receiver = a_receiver()
    assert fed(receiver, a_report(), key=b"another key, as long") is None
    assert fed(receiver, a_report(pose=(math.nan, 0.0, 0.0))) is None
    assert fed(receiver, a_report(variances=(-1.0, 0.0))) is None
    assert (receiver.counts["forged"], receiver.counts["malformed"]) == (1, 2)


def test_a_recorded_datagram_is_refused():
    receiver = a_receiver()
    for sequence in range(3):
        assert fed(receiver, a_report(sequence)) is not None
    assert fed(receiver, a_report(1)) is None
    assert receiver.counts["repeated"] == 1
    # An hour later even a receiver that knows nothing of the robot refuses it.
    fresh = a_receiver()
    assert fresh.feed(encode(a_report(1), KEY), 1.0, BEGAN * 1e-6 + 3600.0) is None
    assert fresh.off_clock == {3: pytest.approx(3599.9)}
    # A session that is older than the one that is known is over.
    newer = a_report(session=BEGAN + 5_000_000)
    assert fed(receiver, newer) is not None
    assert fed(receiver, a_report(7)) is None


def test_a_robot_that_starts_again_begins_anew():
    receiver = a_receiver()
    fed(receiver, a_report(0))
    fed(receiver, a_report(5))
    heard = fed(receiver, a_report(0, session=BEGAN + 9_000_000, pose=(0.0, 0.0, 0.0)))
    assert heard.restarted
    assert (heard.dx, heard.dy, heard.dpsi) == (0.0, 0.0, 0.0)


def test_own_datagrams_come_back_and_twins_are_noticed():
    receiver = a_receiver(own=3)
    assert fed(receiver, a_report()) is None
    assert receiver.twins == 0
    assert fed(receiver, a_report(session=BEGAN + 1)) is None
    assert receiver.twins == 1


@pytest.mark.parametrize("seed", range(3))
def test_a_lossy_late_network_loses_no_motion(seed):
    """Half is lost, the rest is up to 0.3 s late and out of order: the path's end is the sender's.

    Times are those of the odometry to a few milliseconds: what is least late shows the clock.
    """
    random = np.random.default_rng(seed)
    sender = Path(100.0)
    datagrams = []
    for k in range(1, 200):
        sender.append(Displacement(0.1 * k, 0.1, 0.02, 0.0, float(random.normal(0.0, 0.1)), 1e-5))
        report = a_report(k, age=0.0, pose=tuple(sender.last), variances=(1e-5 * k, 0.0))
        if random.uniform() < 0.5 or k == 199:
            datagrams.append((0.1 * k + random.exponential(0.05), k, encode(report, KEY)))
    receiver, path, times = a_receiver(), Path(100.0), []
    first = None
    for arrival, k, datagram in sorted(datagrams):
        heard = receiver.feed(datagram, 50.0 + arrival, BEGAN * 1e-6 + arrival)
        if heard is None:
            continue
        if first is None:
            first = sender.poses(np.array([0.1 * k]))[0]
        path.append(heard.step)
        times.append(heard.time - 50.0 - 0.1 * k)
    end = sender.poses(np.array([19.9]))[0]
    assert receiver.counts["heard"] + receiver.counts["repeated"] == len(datagrams)
    assert path.last[2] == pytest.approx(end[2] - first[2], abs=1e-9)
    assert np.hypot(*path.last[:2]) == pytest.approx(np.hypot(*(end - first)[:2]), abs=1e-9)
    assert np.median(np.abs(times)) < 0.02
    assert np.abs(times[20:]).max() < 0.06


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


def a_link(robot, port, **changes):
    plain = {"robot": robot, "key": KEY.decode(), "address": "127.255.255.255", "port": port}
    return Link(LinkSettings(**{**plain, **changes}))


def test_two_robots_hear_each_other_by_broadcast():
    port, stop = free_port(), threading.Event()
    emitted: list[list[Message]] = [[], []]
    links = [a_link(1, port), a_link(2, port)]
    threads = [
        threading.Thread(target=link.run, args=(news.append, stop))
        for link, news in zip(links, emitted, strict=True)
    ]
    for thread in threads:
        thread.start()

    def heard():
        return [each for each in emitted[1] if isinstance(each, TeammateOdometry)]

    def said():
        health = [each for each in emitted[1] if isinstance(each, Health)]
        return any(each.ok and each.reason == "hears robot 1" for each in health)

    try:
        end = time.monotonic() + 20.0
        while not (len(heard()) >= 3 and said()):
            assert time.monotonic() < end, emitted
            for link in links:
                link.take(Displacement(time.monotonic(), 0.05, 0.01, 0.0, 0.0))
            time.sleep(0.05)
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert {each.identity for each in heard()} == {1}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[link]\nkey = "short"', "at least 16"),
        (f'[link]\nkey = "{"a" * 20}"', "repeats one character"),
        ('[link]\naddress = "everybody"', "broadcast"),
        ("[link]\nrobot = -1", "robot"),
        ("[link]\nport = 80", "port"),
    ],
)
def test_bad_settings_are_refused_in_words(text, says):
    with pytest.raises(UserError, match=says):
        parse_config(text)


def test_the_key_stays_out_of_recordings():
    config = parse_config(f'[link]\nrobot = 2\nkey = "{KEY.decode()}"')
    assert config.link.on
    assert KEY.decode() not in config.model_dump_json()
    assert KEY.decode() not in repr(config)
