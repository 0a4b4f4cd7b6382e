"""Recordings, old ones and ROS bags, into MCAP recordings or tables."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

from host.config import RobotConfig
from host.messages import DeviceBytes
from host.recording.log import SUFFIX, Recorder
from host.recording.tables import Tables
from host.sessions.recordings.runs import Progress, open_recording, read_as, unseen


def export(
    source: str, output: Path, robot: RobotConfig | None = None, progress: Progress = unseen
) -> dict[str, Any]:
    """Write what a source holds to a new recording or, elsewhere than to *.mcap, a folder of CSV.

    source: a recording or bag:FILE,... robot: the configuration to read it as if taken with.
    Returns figures by name. Raises UserError; what is before the damage of a source is written.
    """
    recording = open_recording(source)
    config = robot or recording.header.config
    header = replace(recording.header, config=config)
    table = output.suffix != SUFFIX
    counts: Counter[str] = Counter()
    with Tables(output) if table else Recorder(output, header) as sink:
        for message in read_as(recording, config):
            sink.write(message)
            counts[type(message).__name__.lower()] += not isinstance(message, DeviceBytes)
            progress(100.0 * recording.share, 100.0)
    rows = sink.rows if isinstance(sink, Tables) else counts
    what = "rows" if table else "messages"
    remarks = {"recording": "; ".join(recording.remarks)} if recording.remarks else {}
    return {
        "output": str(output),
        **remarks,
        **{f"{name}_{what}": count for name, count in rows.items() if count},
    }
