import os
import random
import struct
from collections import Counter

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from host.drivers.natnet import protocol as natnet
from host.drivers.natnet.frames import MocapFrame
from host.drivers.natnet.protocol import Echo, MocapDecoder, ServerInfo
from host.messages import Bodies
from tests.drivers.natnet.natnet_packets import (
    full_packet,
    recorded_datagrams,
    vendor_frames,
    with_header,
)

LATENCY_TO_END = 4 + 8 + 8 + 2 + 4  # bytes, before 3.0: latency, timecode, timestamp, flags, end
VERSIONS = [(2, 7), (2, 9), (2, 10), (2, 11), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]


@pytest.fixture(scope="module")
def oracle():
    """The vendor's sample in Python: (payload, version) -> what it reads."""
    try:
        from natnetsdk.NatNetClient import NatNetClient
    except ImportError:
        if os.environ.get("CI") == "true":
            raise
        pytest.skip("natnetsdk is not installed: pip install natnetsdk==4.1.1")
    client = NatNetClient()

    def read(payload, version):
        return client._NatNetClient__unpack_mocap_data(payload, len(payload), *version)[1]

    return read


def assert_same(frame, reading):
    """The frame is what the vendor's sample read."""
    bodies, end = reading.rigid_body_data.rigid_body_list, reading.suffix_data
    assert frame.number == reading.prefix_data.frame_number
    assert frame.identities.tolist() == [body.id_num for body in bodies]
    assert frame.tracked.tolist() == [body.tracking_valid for body in bodies]
    assert frame.positions.tolist() == [list(body.pos) for body in bodies]
    assert frame.quaternions.tolist() == [list(body.rot) for body in bodies]
    assert frame.errors.tolist() == [body.error for body in bodies]
    assert frame.timecode == (end.timecode, end.timecode_sub)
    assert frame.timestamp == end.timestamp
    assert frame.recording == end.is_recording
    assert frame.models_changed == end.tracked_models_changed
    if frame.exposed:
        assert frame.exposed == end.stamp_camera_mid_exposure
        assert frame.received == end.stamp_data_received
        assert frame.transmitted == end.stamp_transmit
    if frame.precise_time != (0, 0):
        assert frame.precise_time == (end.prec_timestamp_secs, end.prec_timestamp_frac_secs)


@pytest.fixture(scope="module")
def traffic(recorded):
    """Values of all that a recorded server sent, and the decoder; frames also as bytes."""
    decoder = MocapDecoder()
    packets = [
        packet
        for source, packet in recorded_datagrams(recorded("natnet/traffic.pcapng"))
        if source in (1510, 1511)
    ]
    values = [decoder.feed(packet) for packet in packets]
    frames = [(v, p) for v, p in zip(values, packets, strict=True) if isinstance(v, MocapFrame)]
    return values, frames, decoder


def test_recorded_traffic_is_read_without_remainder(traffic):
    values, frames, decoder = traffic
    assert dict(decoder.counts) == {"frames": 518, "malformed": 0, "unversioned": 0, "others": 5}
    assert values[0] == ServerInfo(
        "Motive", (2, 1, 0, 0), (3, 0), 3312787, True, 1511, "239.255.42.99"
    )
    assert sum(isinstance(value, Echo) for value in values) == 9
    numbers = [frame.number for frame, _ in frames]
    assert numbers == list(range(162734, 163252))


def test_recorded_frames_equal_the_vendors_client(traffic, recorded):
    values, frames, _ = traffic
    hz = values[0].clock_hz
    printed = vendor_frames(recorded("natnet/SampleClient_output.txt"))
    assert len(printed) == 251  # of the 518 it printed the first ones
    for (frame, _), text in zip(frames, printed, strict=False):
        assert str(frame.number) == text["number"][0]
        # What was printed was rounded, a half upwards: 1356.125 as 1356.13.
        assert frame.timestamp == pytest.approx(float(text["timestamp"][0]), rel=0, abs=0.005001)
        software = 1000.0 * (frame.transmitted - frame.received) / hz
        system = 1000.0 * (frame.transmitted - frame.exposed) / hz
        assert software == pytest.approx(float(text["software_ms"][0]), rel=0, abs=0.005001)
        assert system == pytest.approx(float(text["system_ms"][0]), rel=0, abs=0.005001)
        identity, error, valid = text["body"]
        assert frame.identities.tolist() == [int(identity)]
        assert frame.tracked.tolist() == [valid == "1"]
        read = (*frame.positions[0], *frame.quaternions[0], frame.errors[0])
        shown = [float(word) for word in (*text["pose"], error)]
        np.testing.assert_allclose(read, shown, rtol=0, atol=0.005001)


def test_recorded_frames_equal_the_vendors_sample(traffic, oracle):
    for frame, packet in traffic[1]:
        assert_same(frame, oracle(packet[4:], (3, 0)))


@pytest.mark.parametrize("version", VERSIONS)
def test_full_packets_equal_the_vendors_sample(version, oracle):
    for seed in range(20):
        rng = random.Random(f"{version} {seed}")
        packet = full_packet(rng, version, bodies=seed % 5, precise=version >= (4, 0))
        decoder = MocapDecoder(version)
        frame = decoder.feed(packet)
        assert decoder.counts["frames"] == 1, f"seed {version} {seed}"
        payload = packet[4:]
        if version < (3, 0):  # the sample does not know of the latency that real servers send
            payload = payload[:-LATENCY_TO_END] + payload[4 - LATENCY_TO_END :]
        assert_same(frame, oracle(payload, version))


RECORDED_OLD = [("1.7.2", (2, 7), 1), ("1.9.0", (2, 9), 2)]


@pytest.fixture(params=RECORDED_OLD, ids=lambda case: case[0])
def old(request, recorded):
    """A datagram that a server before 3.0 sent, its version, and the number of its body."""
    motive, version, identity = request.param
    return recorded(f"natnet/frame-motive-{motive}-001.bin").read_bytes(), version, identity


def test_recorded_frames_before_3_0_are_read_whole(old):
    packet, version, identity = old
    decoder = MocapDecoder(version)
    frame = decoder.feed(packet)
    assert dict(decoder.counts) == {"frames": 1, "malformed": 0, "unversioned": 0, "others": 0}
    assert frame.identities.tolist() == [identity]
    assert frame.tracked.tolist() == [True]
    # The frame's first marker set lists the body's markers; the body's origin is their centre.
    at = packet.index(b"\0", 12) + 1
    assert struct.unpack_from("<i", packet, at) == (3,)
    markers = np.frombuffer(packet, "<f4", 9, at + 4).reshape(3, 3)
    np.testing.assert_allclose(frame.positions[0], markers.mean(axis=0), atol=2e-3)
    assert frame.errors[0] < 0.001
    (latency,) = struct.unpack_from("<f", packet, len(packet) - LATENCY_TO_END)
    assert frame.timestamp == pytest.approx(latency, rel=1e-6)


def test_frames_before_3_0_are_sent_as_recorded(old):
    packet, version, _ = old
    sent = natnet.frame_packet(MocapDecoder(version).feed(packet), version)
    assert sent[4:8] == packet[4:8]
    assert sent[-LATENCY_TO_END:] == packet[-LATENCY_TO_END:]
    pose, end = sent[20:52], sent[56:62]  # before and after the markers, of which ours sends none
    place = packet.index(pose)
    (markers,) = struct.unpack_from("<i", packet, place + 32)
    after = place + 36 + 20 * markers
    assert packet[after : after + 6] == end


def test_4_0_is_read_with_and_without_precise_time():
    for precise in (False, True):
        packet = full_packet(random.Random(1), (4, 0), precise=precise)
        frame = MocapDecoder((4, 0)).feed(packet)
        assert (frame.precise_time != (0, 0)) == precise
        assert frame.exposed
        assert frame.recording


def frames():
    poses = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.14, 3.14))
    return st.lists(st.tuples(st.integers(1, 2**31 - 1), poses, st.booleans()), max_size=6)


@given(frames(), st.sampled_from(VERSIONS), st.sampled_from(["y", "z"]))
def test_bodies_survive_the_way_through_bytes(rows, version, up):
    identities = np.array([row[0] for row in rows], dtype=np.int64)
    poses = np.array([row[1] for row in rows]).reshape(-1, 3)
    tracked = np.array([row[2] for row in rows], dtype=bool)
    poses[~tracked] = np.nan
    sent = natnet.frame_of(
        Bodies(12.5, identities, poses), up, 41, exposed=2**60 + 1, received=5, transmitted=6
    )
    packet = natnet.frame_packet(sent, version)
    heard = MocapDecoder(version).feed(packet)
    assert heard.number == 41
    assert heard.timestamp == 12.5
    expected = (2**60 + 1, 5, 6) if version >= (3, 0) else (0, 0, 0)
    assert (heard.exposed, heard.received, heard.transmitted) == expected
    bodies = natnet.bodies_of(heard, 3.0, up)
    assert bodies.time == 3.0
    np.testing.assert_array_equal(bodies.identities, identities[tracked])
    np.testing.assert_allclose(bodies.poses, poses[tracked], atol=4e-6)


@given(st.lists(st.floats(-1, 1), min_size=7, max_size=7), st.sampled_from(["y", "z"]))
def test_floor_poses_are_those_of_the_rotated_axis(numbers, up):
    position, quaternion = np.array(numbers[:3]), np.array(numbers[3:])
    assume(np.linalg.norm(quaternion) > 1e-3)
    quaternion /= np.linalg.norm(quaternion)
    # Turns Motive's frame into the floor's, so that y up becomes z up.
    turn = Rotation.from_euler("x", 90 if up == "y" else 0, degrees=True)
    ahead = turn.apply(Rotation.from_quat(quaternion).apply([1.0, 0.0, 0.0]))
    where = turn.apply(position)
    (pose,) = natnet.floor_poses(position[None], quaternion[None], up)
    np.testing.assert_allclose(pose[:2], where[:2], atol=1e-12)
    if np.hypot(*ahead[:2]) > 1e-6:
        expected = np.arctan2(ahead[1], ahead[0])
        assert np.cos(pose[2] - expected) == pytest.approx(1.0, abs=1e-12)


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1))
def test_questions_and_answers(asked, server):
    message, question = natnet.split(natnet.echo_request(asked))
    assert message == natnet.ECHO_REQUEST
    assert MocapDecoder().feed(natnet.echo_response(question, server)) == Echo(asked, server)


def test_a_question_as_recorded(recorded):
    datagrams = recorded_datagrams(recorded("natnet/traffic.pcapng"))
    asked = [packet for source, packet in datagrams if source not in (1510, 1511)]
    messages = [natnet.split(packet)[0] for packet in asked]
    echo = asked[messages.index(natnet.ECHO_REQUEST)]
    assert natnet.echo_request(*struct.unpack("<Q", echo[4:])) == echo
    first = asked[messages.index(natnet.CONNECT)]
    ours = natnet.connect("NatNetLib")
    assert len(first) == 4 + 264
    assert ours[4:260] == first[4:260]  # the same name in the same field


@pytest.mark.parametrize("version", [(2, 10), (3, 0), (4, 1)])
def test_server_info_there_and_back(version):
    full = ServerInfo("Motive", (3, 1, 0, 1), version, 10_000_000, False, 1511, "0.0.0.0")
    decoder = MocapDecoder()
    info = decoder.feed(natnet.server_info(full))
    assert decoder.version == version
    if version >= (3, 0):
        assert info == full
    else:
        assert info == ServerInfo("Motive", (3, 1, 0, 1), version)


def test_frames_before_the_version_is_known_are_counted():
    decoder = MocapDecoder()
    assert decoder.feed(full_packet(random.Random(0), (3, 0))) is None
    assert decoder.counts["unversioned"] == 1


def test_a_tracked_body_out_of_this_world_is_damage():
    good = natnet.frame_of(Bodies(1.0, np.array([1]), np.array([[1.0, 2.0, 0.5]])), "y")
    for position, quaternion in (
        ([np.nan, 0, 0], [0, 0, 0, 1]),
        ([0, np.inf, 0], [0, 0, 0, 1]),
        ([0, 0, 0], [0, 0, 0, 0]),
        ([0, 0, 0], [1e30, 0, 0, 1e30]),
    ):
        bad = MocapFrame(1, good.identities, np.array([position]), np.array([quaternion]),
                    good.errors, good.tracked)  # fmt: skip
        decoder = MocapDecoder((3, 0))
        assert decoder.feed(natnet.frame_packet(bad, (3, 0))) is None
        assert decoder.counts["malformed"] == 1


def mutate(rng, packet):
    """A damaged packet, and whether it is torn: not all of one packet's bytes any more."""
    data = bytearray(packet)
    kind = rng.randrange(5)
    if kind == 0:  # flipped bits
        for _ in range(rng.randrange(1, 4)):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        return bytes(data), False
    if kind == 1:  # a count or a size that cannot be
        at = rng.randrange(len(data) - 4)
        data[at : at + 4] = struct.pack("<I", rng.choice((0, 1, 0x7FFFFFFF, 2**32 - 1, 2**31)))
        return bytes(data), False
    if kind == 2:  # the end is missing
        return bytes(data[: rng.randrange(len(data))]), True
    if kind == 3:  # the end is missing, and the header says so
        return with_header(7, bytes(data[4 : rng.randrange(5, len(data))])), True
    extra = rng.randbytes(rng.randrange(1, 40))  # more follows
    return (with_header(7, bytes(data[4:]) + extra) if rng.random() < 0.5 else packet + extra), True


def test_damaged_packets_raise_nothing_and_torn_ones_give_no_frame():
    seed = 20261122
    print(f"seed {seed}")
    rng = random.Random(seed)
    info = natnet.server_info(ServerInfo("Motive", (3, 1, 0, 0), (4, 1), 10**7, True, 1511))
    packets = [(version, full_packet(rng, version)) for version in VERSIONS]
    packets.append(((4, 1), info))
    decoders = {version: MocapDecoder(version) for version in VERSIONS}
    answers = 0
    for k in range(100_000):
        version, packet = packets[k % len(packets)]
        damaged, torn = mutate(rng, packet)
        decoder = decoders[version]
        decoder.version = version
        value = decoder.feed(damaged)
        assert not (torn and isinstance(value, MocapFrame)), f"case {k}"
        answers += isinstance(value, (ServerInfo, Echo))
        if isinstance(value, MocapFrame) and k % 10 == 0:
            assert np.isfinite(natnet.bodies_of(value, 0.0, "y").poses).all(), f"case {k}"
    counts = sum((decoder.counts for decoder in decoders.values()), Counter())
    assert sum(counts.values()) + answers == 100_000
    assert min(counts["frames"], counts["malformed"], answers) > 1000


@given(st.binary(max_size=400))
def test_noise_is_counted(data):
    decoder = MocapDecoder((4, 1))
    value = decoder.feed(data)
    assert isinstance(value, (ServerInfo, Echo)) or sum(decoder.counts.values()) == 1
