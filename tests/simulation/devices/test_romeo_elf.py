"""The simulated board: its USB, its pins, its memory, and what becomes of a program that fails."""

import errno
import os
import shutil
import tempfile
from pathlib import Path

import pytest

from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import DisplacementFrame, HelloFrame, IdentityFrame, VelocityFrame
from host.errors import UserError
from host.flashing.elf import flash_image
from host.simulation.devices import romeo_library
from host.simulation.devices.romeo_elf import CHANNEL_A, CHANNEL_B, LEFT, RIGHT, RomeoElf

# Registers of the ATmega32U4, datasheet section 31
PINB, DDRC, PORTC, PIND, DDRD, PORTD, PORTE = 0x23, 0x27, 0x28, 0x29, 0x2A, 0x2B, 0x2E
TCCR3A, OCR3A, TCCR4C, OCR4D = 0x90, 0x98, 0xC2, 0xD2
READY_S = 0.2  # found by the host, port opened
FORWARD = [(0, 0), (1, 0), (1, 1), (0, 1)]  # (A, B), A ahead


def ready(elf: Path) -> RomeoElf:
    board = RomeoElf(elf)
    board.open_port()
    board.run(READY_S)
    return board


def frames(board: RomeoElf) -> list[object]:
    decoder = BoardDecoder()
    return [frame for _, data in board.take() for frame in decoder.feed(data)]


# ---- USB


def test_the_host_reads_what_a_leonardo_says_of_itself(elf: Path) -> None:
    board = RomeoElf(elf)
    assert (board.configured, board.device_descriptor) == (False, b"")
    board.run(READY_S)
    assert board.configured
    device, rest = board.device_descriptor, board.configuration_descriptor
    assert (device[0], device[1], len(device)) == (18, 1, 18)
    assert int.from_bytes(device[8:10], "little") == 0x2341
    assert int.from_bytes(device[10:12], "little") == 0x8036
    assert int.from_bytes(rest[2:4], "little") == len(rest)
    kinds, endpoints = [], {}
    while rest:
        kinds.append(rest[1])
        if rest[1] == 5:
            endpoints[rest[2]] = rest[3]
        rest = rest[rest[0] :]
    assert (kinds.count(2), kinds.count(4)) == (1, 2)
    # Of the CDC: one interrupt endpoint to the host, one bulk endpoint each way.
    assert sorted(endpoints.values()) == [2, 2, 3]
    assert [address & 0x80 for address, kind in endpoints.items() if kind == 3] == [0x80]
    assert {address & 0x80 for address, kind in endpoints.items() if kind == 2} == {0, 0x80}


def test_bytes_flow_while_the_port_is_open(elf: Path) -> None:
    board = RomeoElf(elf)
    board.send(encode(HelloFrame()))
    board.run(0.3)
    assert (board.port_open, board.take(), board.unsent) == (False, [], len(encode(HelloFrame())))
    board.open_port()
    board.run(0.4)
    assert (board.port_open, board.unsent) == (True, 0)
    assert sum(isinstance(frame, IdentityFrame) for frame in frames(board)) == 1
    board.close_port()
    board.run(0.41)
    assert not board.port_open
    board.take()
    board.run(0.6)
    assert board.take() == []


def test_no_bytes_may_be_sent_at_any_time(elf: Path) -> None:
    board = RomeoElf(elf)
    board.send(b"")
    assert board.unsent == 0


def test_a_host_that_does_not_read_gets_nothing_until_it_does(elf: Path) -> None:
    board = ready(elf)
    board.reading = False
    board.take()
    board.run(0.5)
    assert board.take() == []
    board.reading = True
    board.run(1.0)
    packets = board.take()
    assert 0.5 < packets[0][0] < 0.501
    assert all(0 < len(data) <= 64 for _, data in packets)
    assert [at for at, _ in packets] == sorted(at for at, _ in packets)


def test_the_same_calls_give_the_same_bytes_at_the_same_times(elf: Path) -> None:
    def talk(pieces: int) -> tuple[list[tuple[float, bytes]], bytes, tuple[float, float]]:
        board = ready(elf)
        board.turn(LEFT, 3001, 1.2)
        board.turn(RIGHT, -1999, 1.0)
        board.send(encode(VelocityFrame(900, -700)))
        for piece in range(pieces):
            board.run(READY_S + (piece + 1) / pieces)
        return board.take(), board.ram(0x100, 2560), board.motors

    assert talk(1) == talk(1)
    assert talk(1)[0] == talk(10)[0]


def test_too_many_requests_to_the_port_are_refused_in_words(elf: Path) -> None:
    board = RomeoElf(elf)
    for _ in range(8):
        board.open_port()
    with pytest.raises(UserError, match="too many"):
        board.open_port()


# ---- wheels


def levels(board: RomeoElf, edges: int, wheel: int) -> tuple[int, int]:
    b, d = board.ram(PINB, 1)[0], board.ram(PIND, 1)[0]
    if edges == 4:
        return (b >> 4 & 1, b >> 5 & 1) if wheel == LEFT else (b >> 6 & 1, b >> 7 & 1)
    return (d >> 1 & 1, b >> 5 & 1) if wheel == LEFT else (d & 1, b >> 7 & 1)


@pytest.mark.parametrize("edges", [2, 4])
def test_wheels_turn_in_quadrature_each_its_own_way(elf: Path, edges: int) -> None:
    board = RomeoElf(elf, edges)
    board.run(0.05)
    board.turn(LEFT, 9, 0.059)
    board.turn(RIGHT, -9, 0.059)
    for k in range(1, 10):
        board.run(0.0505 + 0.001 * k)
        assert board.steps == (k, -k)
        assert levels(board, edges, LEFT) == FORWARD[k % 4]
        assert levels(board, edges, RIGHT) == FORWARD[-k % 4]
    board.run(0.2)
    assert board.steps == (9, -9)


def test_steps_are_evenly_spread_and_the_last_comes_at_the_end(elf: Path) -> None:
    board = RomeoElf(elf)
    board.run(0.05)
    start, microsecond = board.now, 1e-6
    board.turn(LEFT, 7, start + 0.001)
    for k in range(1, 8):
        board.run(start + 0.001 * k / 7 - microsecond)
        assert board.steps == (k - 1, 0)
        board.run(start + 0.001 * k / 7 + microsecond)
        assert board.steps == (k, 0)


def test_a_new_turn_replaces_what_is_left_of_the_last(elf: Path) -> None:
    board = RomeoElf(elf)
    board.turn(LEFT, 100, 0.1)
    board.run(0.0505)
    assert board.steps == (50, 0)
    board.turn(LEFT, -10, 0.1)
    board.run(0.2)
    assert board.steps == (40, 0)


@pytest.mark.parametrize("edges", [2, 4])
def test_noise_inverts_a_level_for_its_width_and_leaves_the_steps_alone(
    elf: Path, edges: int
) -> None:
    board = RomeoElf(elf, edges)
    board.run(0.05)
    board.turn(RIGHT, 1, 0.051)
    board.run(0.052)
    for channel in (CHANNEL_A, CHANNEL_B):
        still = list(FORWARD[1])
        inverted = [level ^ (which == channel) for which, level in enumerate(still)]
        start = board.now
        board.disturb(RIGHT, channel, 0.001, 0.003, 2)
        for after, expected in (
            (0.0005, inverted),
            (0.0015, still),
            (0.0035, inverted),
            (0.0045, still),
            (0.009, still),
        ):
            board.run(start + after)
            assert list(levels(board, edges, RIGHT)) == expected
            assert levels(board, edges, LEFT) == FORWARD[0]
        board.disturb(RIGHT, channel, 0.1)
        board.run(board.now + 0.001)
        board.disturb(RIGHT, channel, 0.1, count=0)
        board.run(board.now + 0.001)
        assert list(levels(board, edges, RIGHT)) == still
    assert board.steps == (0, 1)


def test_a_request_must_be_one(elf: Path) -> None:
    board = RomeoElf(elf)
    with pytest.raises(ValueError, match="8 bytes"):
        board.request(b"\x80\x06")
    with pytest.raises(UserError, match="more than 8"):
        board.request(bytes.fromhex("2120000000004000"))


def test_a_reset_changes_no_level_of_the_encoders(elf: Path) -> None:
    board = ready(elf)
    board.turn(LEFT, 2, 0.25)
    board.turn(RIGHT, 3, 0.25)
    board.run(0.3)
    board.reset()
    for time in (0.3, 0.32, 0.6):
        board.run(time)
        assert (levels(board, 2, LEFT), levels(board, 2, RIGHT)) == (FORWARD[2], FORWARD[3])
    board.open_port()
    board.turn(LEFT, 2, 0.65)
    board.turn(RIGHT, 1, 0.65)  # back to where A is low: one count more of it
    board.run(0.8)
    last = [frame for frame in frames(board) if isinstance(frame, DisplacementFrame)][-1]
    assert (last.left_ticks, last.right_ticks) == (1, 0)


@pytest.mark.parametrize(
    ("registers", "motors"),
    [
        # Compare outputs on, direction pins high (PD4, PE6) and low.
        ({TCCR3A: 0x81, OCR3A: 51, TCCR4C: 0x09, OCR4D: 102, PORTD: 0x10}, (0.2, -0.4)),
        ({TCCR3A: 0x81, OCR3A: 51, TCCR4C: 0x09, OCR4D: 102, PORTE: 0x40}, (-0.2, 0.4)),
        # Inverted.
        ({TCCR3A: 0xC1, OCR3A: 51, TCCR4C: 0x0D, OCR4D: 102, PORTD: 0x10}, (0.8, -0.6)),
        # Off: the ports' levels count (PC6, PD7), whatever the compare registers hold.
        ({TCCR3A: 0x01, OCR3A: 51, TCCR4C: 0x01, OCR4D: 102, PORTD: 0x90, PORTC: 0}, (0.0, -1.0)),
        ({TCCR3A: 0x01, OCR3A: 51, TCCR4C: 0x01, PORTD: 0x10, PORTC: 0x40}, (1.0, 0.0)),
        # Pins that are inputs drive nothing.
        ({TCCR3A: 0x81, OCR3A: 51, TCCR4C: 0x09, OCR4D: 102, DDRC: 0, DDRD: 0}, (0.0, 0.0)),
    ],
)
def test_motors_are_what_the_pwm_and_direction_pins_say(
    elf: Path, registers: dict[int, int], motors: tuple[float, float]
) -> None:
    board = ready(elf)
    outputs = {DDRC: 0x40, DDRD: 0x90, PORTC: 0, PORTD: 0, PORTE: 0, OCR3A + 1: 0}
    for address, value in (outputs | registers).items():
        board.poke(address, bytes([value]))
    assert board.motors == pytest.approx(motors)


# ---- memory and figures


def test_ram_is_reached_by_symbol_and_address(elf: Path) -> None:
    board = RomeoElf(elf)
    board.run(0.5)
    millis = int.from_bytes(board.ram("timer0_millis", 4), "little")
    assert millis == pytest.approx(500, abs=2)
    board.poke("timer0_millis", (1234).to_bytes(4, "little"))
    assert int.from_bytes(board.ram("timer0_millis", 4), "little") == 1234
    assert len(board.ram(0x100, 2560)) == 2560
    for place, size in ((0x100, 2561), (0xB00, 1), (0x100, 0)):
        with pytest.raises(ValueError, match="bytes of RAM"):
            board.ram(place, size)
    with pytest.raises(UserError, match="no symbol 'not_there'"):
        board.ram("not_there", 1)


def test_the_eeprom_begins_as_given_and_outlives_a_reset(elf: Path) -> None:
    assert RomeoElf(elf).eeprom == b"\xff" * 1024
    board = RomeoElf(elf, eeprom=b"settings")
    assert board.eeprom == b"settings" + b"\xff" * 1016
    board.reset()
    assert board.eeprom[:8] == b"settings"
    board.eeprom = b"other"
    assert board.eeprom[:8] == b"otherngs"
    with pytest.raises(ValueError, match="1024"):
        board.eeprom = bytes(1025)


def test_interrupts_are_counted_and_timed(elf: Path) -> None:
    board = ready(elf)
    board.turn(LEFT, 1000, 1.5)
    board.turn(RIGHT, -500, 1.5)
    board.clear_figures()
    board.watch("loop")
    board.run(2.0 + READY_S)
    found = board.interrupts
    assert found["TIMER0_OVF"].count == pytest.approx(2.0 * 16e6 / 64 / 256, abs=1)
    assert found["TIMER1_COMPA"].count == pytest.approx(200, abs=1)
    assert found["USB_GEN"].count == pytest.approx(2000, abs=1)
    assert (found["INT1"].count, found["INT0"].count) == (500, 250)
    assert all(0 < one.worst_cycles < 16_000 for one in found.values())
    assert all(0 < one.worst_latency_cycles < 16_000 for one in found.values())
    passes = board.passes
    assert 32e6 / passes.count < passes.worst_cycles < 32_000
    board.clear_figures()
    assert (board.interrupts, board.passes.count) == ({}, 0)


def test_time_is_the_boards_own(elf: Path) -> None:
    board = ready(elf)
    board.run(3.0)
    decoder = BoardDecoder()
    seen = [
        (at, frame.board_time_us)
        for at, data in board.take()
        for frame in decoder.feed(data)
        if isinstance(frame, DisplacementFrame)
    ]
    # It goes out with the next start of frame.
    assert all(0.0 < at - clock / 1e6 < 0.0015 for at, clock in seen)
    assert board.now == pytest.approx(3.0, abs=1e-6)
    assert board.now >= 3.0


# ---- what goes wrong


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("0100", "Invalid Opcode"),  # reserved
        ("e0e0f3e30994", "left its program"),  # ldi r30, 0; ldi r31, 0x33; ijmp
        ("f8948895", "sleeps with interrupts off"),  # cli; sleep
    ],
)
def test_a_program_that_crashes_is_an_error(elf: Path, code: str, why: str) -> None:
    board = ready(elf)
    board.patch("loop", bytes.fromhex(code))
    with pytest.raises(UserError, match="crashed") as error:
        board.run(1.0)
    assert why in error.value.why
    assert board.now < 0.3
    with pytest.raises(UserError, match="crashed"):
        board.run(1.0)


def test_after_the_bootloader_was_asked_for_only_time_passes(elf: Path) -> None:
    board = ready(elf)
    board.open_port(1200)
    board.run(0.3)
    board.close_port(1200)
    board.run(1.0)
    assert board.bootloader_asked
    assert not board.configured
    board.take()
    board.run(5.0)
    assert (board.now, board.take()) == (5.0, [])


def test_a_file_that_is_no_program_for_the_board_is_refused(tmp_path: Path) -> None:
    for content in (b"", b"\x7fELF", b"#!/bin/sh\n" * 10, Path("/bin/true").read_bytes()):
        file = tmp_path / "file.elf"
        file.write_bytes(content)
        with pytest.raises(UserError, match="cannot simulate"):
            flash_image(file)
    with pytest.raises(UserError, match="cannot simulate"):
        flash_image(tmp_path / "absent.elf")


def test_a_full_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> str:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(tempfile, "mkdtemp", full)
    with pytest.raises(UserError, match=r"(?s)cannot build.*No space left.*free space"):
        romeo_library.build()


def test_what_the_simulator_lacks_is_told_with_the_line_to_paste(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with monkeypatch.context() as patched:
        patched.setattr(romeo_library, "COMPILE", ("no-such-compiler",))
        with pytest.raises(UserError, match="sudo apt install") as error:
            romeo_library.build()
        assert "no C compiler" in error.value.why
    if shutil.which(romeo_library.COMPILE[0]) is None:
        return
    monkeypatch.setattr(romeo_library, "LIBRARIES", ("-lsimavr-not-there",))
    with pytest.raises(UserError, match="libsimavr-dev is not installed"):
        romeo_library.build()
    monkeypatch.setattr(romeo_library, "SOURCES", tmp_path / "nowhere")
    with pytest.raises(UserError, match="install swarmloc again"):
        romeo_library.build()
