"""A scenario to a recording, at full speed."""

import time
from collections import Counter
from pathlib import Path
from typing import Any

from host.config import RobotConfig
from host.messages import DeviceBytes
from host.recording.log import Recorder, RecordingHeader
from host.sessions.recordings.runs import Progress, simulated, unseen
from host.simulation.world import scenarios
from host.sources.sensors import LIDAR_AND_CAMERA, has


def simulate_to_recording(
    scenario: str,
    output: Path,
    robot: RobotConfig,
    progress: Progress = unseen,
    sensors: str = LIDAR_AND_CAMERA,
) -> dict[str, Any]:
    """Record what a robot would measure in a scenario, with the truth; return figures by name.

    sensors: which there are besides the wheels. Raises UserError, and leaves no file, where the
    scenario cannot be simulated.
    """
    parsed = scenarios.parse_scenario(scenario)
    counts: Counter[str] = Counter()
    begin = time.monotonic()
    # Before the file: what cannot be simulated leaves none.
    simulation, messages = simulated(parsed, robot)
    header = RecordingHeader(simulation.config, sensors, scenario)
    with Recorder(output, header) as recorder:
        for message in messages:
            if not has(message, sensors):
                continue
            recorder.write(message)
            counts[type(message).__name__.lower()] += not isinstance(message, DeviceBytes)
            progress(message.time, parsed.seconds)
    wall = time.monotonic() - begin
    return {
        "recording": str(output),
        "seconds": parsed.seconds,
        "times_real_time": round(parsed.seconds / wall, 1),
        "megabytes": round(output.stat().st_size / 1e6, 1),
        **{f"{kind}_messages": count for kind, count in counts.items() if count},
    }
