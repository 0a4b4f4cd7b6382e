"""What recording and the live page cost a robot: shares of a core, and bytes per second.

    python tools/bench/outputs.py

Recorded is what 30 s of a scenario measure, with the estimates made of it, as a live run does;
truth, which a robot has not, is left out. The share is the recorder's; a copy of the file's bytes
is the floor.

The end of a swarm20 run is sent to a viewer ten times per second for six seconds; readers are in
another process. The share is that of this process: building the message, and sending it.
"""

import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from mcap.reader import make_reader

from host.messages import Now, Scan, Truth
from host.recording.log import Recorder
from host.sessions.offline.localizing import localize
from host.sessions.recordings.runs import simulate_scenario
from host.viewer.scene import Scene
from host.viewer.server import Viewer
from tools.kill_recordings import what_a_run_records

SECONDS, RATE_HZ = 6.0, 10.0
RECORDED_S = 30.0
READ = """
import sys, threading
from websockets.sync.client import connect
def read():
    with connect(sys.argv[1]) as stream:
        for _ in stream:
            pass
threads = [threading.Thread(target=read, daemon=True) for _ in range(int(sys.argv[2]))]
for thread in threads:
    thread.start()
print("reading", flush=True)
sys.stdin.read()
"""


def main() -> None:
    """Measure recording, then each number of readers, and print the shares."""
    for scenario in ("arena4", "swarm20"):
        _recording(scenario)
    run = simulate_scenario("swarm20:seconds=8,seed=1", None)
    (*_, last) = localize(run.messages, run.config)
    scans = [message for message in run.messages if isinstance(message, Scan)]
    print("share of one core, swarm20")
    for readers in (0, 1, 5, 20):
        scene = Scene(run.config, run.config.filter.profile)
        for message in run.messages:
            scene.take(message)
        with Viewer(scene, port=0) as viewer:
            stream = viewer.url.replace("http:", "ws:") + "stream"
            with subprocess.Popen(
                [sys.executable, "-c", READ, stream, str(readers)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            ) as other:
                assert other.stdin is not None
                assert other.stdout is not None
                other.stdout.readline()
                share = _share(viewer, Now(last, last.time), scans)
                other.stdin.close()
        print(f"{readers:3d} readers  {100.0 * share:5.2f} %")


def _recording(scenario: str) -> None:
    header, messages = what_a_run_records(f"{scenario}:seconds={RECORDED_S:g},seed=1")
    messages = [message for message in messages if not isinstance(message, Truth)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        cpu = time.process_time()
        with Recorder(path, header) as recorder:
            for message in messages:
                recorder.write(message)
        cpu = time.process_time() - cpu
        kilobytes = path.stat().st_size / 1e3
        copy = time.process_time()
        shutil.copyfile(path, Path(folder) / "b.mcap")
        copy = time.process_time() - copy
        topics = _bytes_by_topic(path)
    print(
        f"recording {scenario}: {kilobytes / RECORDED_S:.1f} kB/s, {100 * cpu / RECORDED_S:.2f} % "
        f"of a core (a copy of the file {100 * copy / RECORDED_S:.3f} %)"
    )
    for topic, size in topics.most_common():
        print(f"  {topic:24s} {size / 1e3 / RECORDED_S:6.2f} kB/s")


def _bytes_by_topic(path: Path) -> "Counter[str]":
    sizes: Counter[str] = Counter()
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            sizes[channel.topic] += len(message.data) + 31  # with the head of its record
    return sizes


def _share(viewer: Viewer, now: Now, scans: list[Scan]) -> float:
    begin, cpu = time.monotonic(), time.process_time()
    for k in range(int(SECONDS * RATE_HZ)):
        viewer.take(scans[-1])
        viewer.look(now)
        time.sleep(max(0.0, begin + (k + 1) / RATE_HZ - time.monotonic()))
    return (time.process_time() - cpu) / (time.monotonic() - begin)


if __name__ == "__main__":
    main()
