"""A file of several bodies beside the wheels of one robot."""

from pathlib import Path

import pytest

from host.config import Mocap, RobotConfig
from host.errors import UserError
from host.messages import Bodies
from host.sessions.recordings.truth_files import TruthFile, with_truth
from tests.calibration.wheels.test_calibrate import gathered, wandering


def test_the_body_that_moves_as_the_wheels_do_is_named(tmp_path: Path) -> None:
    made, other = wandering(3, 25.0), wandering(9, 25.0)
    lines = ["time,x,y,heading,body"]
    for name, drive in (("mine", made), ("other", other)):
        rows = zip(drive.truth_times.tolist(), drive.truth.tolist(), strict=True)
        lines += [f"{time},{x},{y},{heading},{name}" for time, (x, y, heading) in rows]
    path = tmp_path / "take.csv"
    path.write_text("\n".join(lines))
    steps = gathered(made, RobotConfig()).displacements
    with pytest.raises(UserError, match="body mine moves as these wheels do: name it"):
        with_truth(steps, TruthFile(path, "other"), Mocap())
    messages, _ = with_truth(steps, TruthFile(path, "mine"), Mocap(body=4))
    frame = next(each for each in messages if isinstance(each, Bodies))
    assert frame.identities.tolist() == [4, 5]
