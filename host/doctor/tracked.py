"""Is this robot's own body among those that motion capture tracks?"""

import numpy as np

from host.doctor.findings import Finding, Level
from host.doctor.watching import Watched
from host.drivers.natnet.client import MOCAP

_SHARE = 0.5  # of the frames; fewer, and it is hidden or badly marked


def own_body(watched: Watched, body: int) -> list[Finding]:
    """What is wrong with a body of this number, by the frames that have any."""
    frames = [bodies.identities for bodies in watched.bodies if len(bodies.identities)]
    if not frames:
        return []  # the driver says why
    share = float(np.mean([body in identities for identities in frames]))
    if share >= _SHARE:
        return []
    others = sorted({int(number) for identities in frames for number in identities} - {body})
    if share == 0.0:
        numbers = ", ".join(map(str, others))
        return [
            Finding(
                MOCAP,
                Level.WARN,
                f"this robot's own body, number {body}, is not tracked; tracked: {numbers}",
                "set body in [mocap] to the robot's streaming ID in Motive, or enable its rigid "
                "body there",
            )
        ]
    return [
        Finding(
            MOCAP,
            Level.WARN,
            f"this robot's own body, number {body}, is in {100.0 * share:.0f} % of the frames",
            "look at its markers: hidden, loose, or too like another robot's",
        )
    ]
