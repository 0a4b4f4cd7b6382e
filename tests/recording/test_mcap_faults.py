"""Recordings cut, damaged or tampered with: read up to the fault, which is said in words."""

import dataclasses
import errno
import io
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from host.errors import UserError
from host.recording.log import Recorder, Recording
from host.recording.repair import repair
from tools.kill_recordings import what_a_run_records

RECORDS = "/swarmloc/records"
HEAD = struct.Struct("<BQ")


def bits(messages):
    """A list in a form that tells apart whatever differs in one bit."""
    return [
        (type(message).__name__, *(repr(np.asarray(value).tolist()) for value in values(message)))
        for message in messages
    ]


def values(message):
    return [getattr(message, field.name) for field in dataclasses.fields(message)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """(the file, its bytes, its messages)"""
    path = tmp_path_factory.mktemp("recording") / "whole.mcap"
    header, messages = what_a_run_records("arena4:seconds=1.3,seed=1,mocap_hz=20")
    with Recorder(path, header) as recorder:
        for message in messages:
            recorder.write(message)
    return path, path.read_bytes(), bits(Recording(path).messages())


def pieces(data):
    """(opcode, begin, end) of each record of an MCAP file without chunks."""
    place, found = 8, []
    while place < len(data) - 8:
        opcode, length = HEAD.unpack_from(data, place)
        found.append((opcode, place, place + 9 + length))
        place += 9 + length
    return found


def ours(data):
    """(begin, end) of each of our records."""
    channel = None
    found = []
    for opcode, begin, end in pieces(data):
        if opcode == 0x0F:
            break  # the index follows
        if opcode == 0x04 and RECORDS.encode() in data[begin:end]:
            (channel,) = struct.unpack_from("<H", data, begin + 9)
        if opcode == 0x05 and struct.unpack_from("<H", data, begin + 9) == (channel,):
            found.append((begin, end))
    return found


def read(path):
    """(the messages before a fault, what is said of it)"""
    found = []
    try:
        recording = Recording(path)
        for message in recording.messages():
            found.append(message)
    except UserError as error:
        return bits(found), str(error)
    return bits(found), "; ".join(recording.remarks)


def test_a_whole_one_has_nothing_to_be_said(whole):
    path, data, messages = whole
    assert read(path) == (messages, "")
    assert len(messages) > 150
    assert len(ours(data)) > 70


def test_cut_at_each_percent_it_gives_all_that_is_whole(whole, tmp_path):
    _, data, messages = whole
    records = ours(data)
    before = 0
    for percent in range(1, 100, 2):
        path = tmp_path / "cut.mcap"
        cut = len(data) * percent // 100
        path.write_bytes(data[:cut])
        found, said = read(path)
        assert found == messages[: len(found)]
        assert said
        assert len(found) >= before
        before = len(found)
        if records[0][1] <= cut < records[-1][0]:
            assert "unfinished" in said


def test_a_flipped_bit_at_each_percent_is_said_and_costs_nothing_before_it(whole, tmp_path):
    _, data, messages = whole
    records = ours(data)
    random = np.random.default_rng(4)
    for percent in range(100):
        place = len(data) * percent // 100 + int(random.integers(len(data) // 100))
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(random.integers(8))
        path = tmp_path / "flipped.mcap"
        path.write_bytes(flipped)
        found, said = read(path)
        assert said, f"byte {place}"
        assert found == messages[: len(found)], f"byte {place}"
        if "is damaged at byte" in said:
            whole_before = sum(end <= place for _, end in records)
            assert f"saves the {whole_before} records before" in said, f"byte {place}"


class BadSector(io.FileIO):
    """A file of which nothing can be read from `begin` on."""

    begin = 0

    def readinto(self, buffer):
        if self.tell() + len(buffer) > self.begin:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return super().readinto(buffer)


def test_what_a_bad_sector_of_the_disk_leaves_is_read_and_saved(whole, tmp_path, monkeypatch):
    path, data, expected = whole
    begin, _ = ours(data)[len(ours(data)) // 2]

    def opened(path, mode):
        return open(path, mode) if mode != "rb" else io.BufferedReader(BadSector(path), 1)

    monkeypatch.setattr(Path, "open", opened)
    with pytest.raises(UserError, match=r"cannot read the recording .*\nInput/output error"):
        Recording(path)
    monkeypatch.setattr(BadSector, "begin", begin)
    messages, said = read(path)
    assert 20 < len(messages) < len(expected)
    assert messages == expected[: len(messages)]
    assert f"is damaged at byte {begin} of {len(data)}\nInput/output error" in said
    saved = repair(path, tmp_path / "saved.mcap")
    monkeypatch.undo()
    assert read(saved.output)[0] == messages


def test_missing_doubled_and_exchanged_records_are_said(whole, tmp_path):
    _, data, messages = whole
    (a, b), (c, d) = ours(data)[40:42]
    path = tmp_path / "changed.mcap"
    for changed, words in (
        (data[:a] + data[b:], "record 40 is missing before record 41"),
        (data[:b] + data[a:b] + data[b:], "record 40 comes twice"),
        (data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:], "record 40 is missing"),
    ):
        path.write_bytes(changed)
        found, said = read(path)
        assert words in said
        assert found == messages[: len(found)]
        assert (len(found) == len(messages)) == ("twice" in words)


def test_topics_that_another_tool_took_out_cost_no_message(whole, tmp_path):
    _, data, messages = whole
    kept = {(begin, end) for begin, end in ours(data)}
    parts = [
        data[begin:end]
        for opcode, begin, end in pieces(data)
        if opcode != 0x05 or (begin, end) in kept
    ]
    path = tmp_path / "filtered.mcap"
    path.write_bytes(data[:8] + b"".join(parts) + data[-8:])
    found, said = read(path)
    assert found == messages
    assert "topics for other tools are damaged or were changed" in said


@pytest.mark.parametrize("share", [0.3, 0.9])
@pytest.mark.parametrize("how", ["cut", "flipped"])
def test_repaired_it_opens_with_an_index_and_holds_what_was_whole(whole, tmp_path, share, how):
    _, data, _ = whole
    place = int(share * len(data))
    path = tmp_path / "broken.mcap"
    damaged = bytearray(data)
    damaged[place] ^= 4
    path.write_bytes(data[:place] if how == "cut" else damaged)
    before, said = read(path)
    done = repair(path, tmp_path / "new.mcap")
    assert done.fault.split(":")[0] in said
    after, now_said = read(done.output)
    assert after == before
    assert now_said.startswith("repaired: ")
    with done.output.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics.message_count == done.messages
        numbers = [
            message.sequence
            for _, channel, message in reader.iter_messages()
            if channel.topic == RECORDS
        ]
    assert numbers == list(range(done.records))
    with pytest.raises(UserError, match="exists already"):
        repair(path, done.output)


def test_a_disk_that_is_full_leaves_no_half_of_a_repaired_file(whole, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("host.recording.repair.Writer.finish", full)
    with pytest.raises(UserError, match="No space left on device"):
        repair(whole[0], tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


def test_what_cannot_be_repaired_is_said(tmp_path, whole):
    _, data, _ = whole
    for content, words in ((b"hello\n", "no MCAP file"), (data[:60], "can be saved")):
        (tmp_path / "a.mcap").write_bytes(content)
        with pytest.raises(UserError, match=words):
            repair(tmp_path / "a.mcap", tmp_path / "b.mcap")
        assert not (tmp_path / "b.mcap").exists()


def test_killed_at_random_moments_it_loses_at_most_one_message():
    """In its own process, which forks: this one may have threads."""
    script = (
        "import sys, pathlib, tempfile\n"
        "from tools.kill_recordings import killed, what_a_run_records\n"
        "header, messages = what_a_run_records('arena4:seconds=2,seed=3,mocap_hz=20')\n"
        "with tempfile.TemporaryDirectory() as folder:\n"
        "    for seed in range(16):\n"
        "        print(killed(pathlib.Path(folder) / f'{seed}.mcap', header, messages, seed))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], env=os.environ, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    lost = [int(word) for word in done.stdout.split()]
    assert len(lost) == 16
    assert max(lost) <= 1
