"""What the live page costs a robot: share of a core with 0, 1, 5 and 20 readers, beside none.

    python tools/bench/outputs.py

The end of a swarm20 run is told to a viewer ten times a second for six seconds; readers are another
process. The share is that of this process: building the message, and sending it.
"""

import subprocess
import sys
import time

from host.messages import Scan
from host.pipeline import Now
from host.sessions.localizing import localize
from host.sessions.runs import simulate_scenario
from host.viewer.scene import Scene
from host.viewer.server import Viewer

SECONDS, RATE_HZ = 6.0, 10.0
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
    """Measure each number of readers, and print the shares."""
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


def _share(viewer: Viewer, now: Now, scans: list[Scan]) -> float:
    begin, cpu = time.monotonic(), time.process_time()
    for k in range(int(SECONDS * RATE_HZ)):
        viewer.take(scans[-1])
        viewer.look(now)
        time.sleep(max(0.0, begin + (k + 1) / RATE_HZ - time.monotonic()))
    return (time.process_time() - cpu) / (time.monotonic() - begin)


if __name__ == "__main__":
    main()
