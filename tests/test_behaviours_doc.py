"""docs/behaviours.md: its behaviour, loaded by its commands, drives."""

import re
import shlex
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from host.cli.main import main
from host.messages import Displacement, Truth
from host.recording.log import Recording

DOCUMENT = (Path(__file__).parents[1] / "docs" / "behaviours.md").read_text(encoding="utf-8")
(EXAMPLE,) = re.findall(r"```python\n(.*?)```", DOCUMENT, re.DOTALL)
COMMANDS, FORMATION = re.findall(r"```sh\n(.*?)```", DOCUMENT, re.DOTALL)


def test_the_example_follows_a_teammate_on_all_stacks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("follow.py").write_text(EXAMPLE, encoding="utf-8")
    body = EXAMPLE[EXAMPLE.index("class") :]
    assert len([line for line in body.splitlines() if line]) <= 10
    live, offline = (shlex.split(line)[1:] for line in COMMANDS.splitlines())
    run = CliRunner().invoke(main, offline)
    assert run.exit_code == 0, run.output
    messages = list(Recording(Path("followed.mcap")).messages())
    turned = sum(abs(m.dpsi) for m in messages if isinstance(m, Displacement))
    assert turned > 0.3
    truths = [m for m in messages if isinstance(m, Truth)]
    nearest = truths[-1].positions[np.argmin(np.hypot(*truths[-1].positions.T))]
    assert abs(np.arctan2(nearest[1], nearest[0])) < 1.0
    run = CliRunner().invoke(main, live)
    assert run.exit_code == 0, run.output
    assert "contacts" in run.output


def test_the_formation_is_recorded(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    simulate = shlex.split(FORMATION.splitlines()[0])[1:]
    short = [word.replace("seconds=40", "seconds=1") for word in simulate]
    assert short != simulate
    run = CliRunner().invoke(main, short)
    assert run.exit_code == 0, run.output
    truths = [m for m in Recording(Path("line.mcap")).messages() if isinstance(m, Truth)]
    assert len(truths[-1].identities) == 5
