"""From a recording that was cut short or damaged: what can be read of it, with an index."""

import contextlib
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.writer import CompressionType, Writer

from host.errors import UserError, cannot_write
from host.recording.appended import PROFILE
from host.recording.checked import REPAIRED, CheckedMcap, is_mcap

_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Repaired:
    """output: the new file. fault: what was wrong, as text. messages: of all topics; records: of
    these, ours."""

    output: Path
    fault: str
    messages: int
    records: int


def repair(path: Path, output: Path) -> Repaired:
    """Copy what can be read of `path` into `output`: in chunks, compressed, indexed.

    Raises UserError where nothing can be read, and where `output` exists or cannot be written.
    """
    if not is_mcap(path):
        raise UserError(
            f"{path} is no MCAP file", "its first bytes are others", "use a copy of the recording"
        )
    fault, messages, records = _examined(path)
    if not messages:
        raise UserError(f"nothing of {path} can be saved", fault, "the run ended at its start")
    try:
        with output.open("xb") as file:
            writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
            writer.start(profile=PROFILE, library="swarmloc")
            writer.add_metadata(REPAIRED, {"fault": fault, "file": path.name})
            _copy(path, writer)
            writer.finish()  # type: ignore[no-untyped-call]
    except FileExistsError as error:
        raise UserError(
            f"{output} exists already", "recordings are never overwritten", "give --output another"
        ) from error
    except OSError as error:
        with contextlib.suppress(OSError):
            output.unlink()  # else it would be in the way of the next try
        raise cannot_write(output, error, "check the disk's free space") from error
    return Repaired(output, fault, messages, records)


def _examined(path: Path) -> tuple[str, int, int]:
    """What is wrong with a file in words, and how many messages stand before, and of ours."""
    file = CheckedMcap(path)
    messages = records = 0
    fault = ""
    try:
        for record, data in file.all_records():
            messages += isinstance(record, McapMessage)
            records += data is not None
    except UserError as error:
        fault = f"{error.what}: {error.why}"
    return fault or "; ".join(file.remarks) or "nothing was wrong", messages, records


def _copy(path: Path, writer: Writer) -> None:
    """What stands before the fault, in its order."""
    schemas = {0: 0}
    channels: dict[int, int] = {}
    try:
        for record, _ in CheckedMcap(path).all_records():
            if isinstance(record, Schema):
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            elif isinstance(record, Channel):
                channels[record.id] = writer.register_channel(
                    record.topic,
                    record.message_encoding,
                    schemas[record.schema_id],
                    record.metadata,
                )
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Attachment):
                writer.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )
            elif isinstance(record, McapMessage):
                writer.add_message(
                    channels[record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
    except UserError:
        return  # as it was examined
