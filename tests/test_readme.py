"""What the README promises is so."""

import contextlib
import io
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_example_finds_the_teammate():
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {})
    x, y = map(float, printed.getvalue().strip("[] \n").split())
    assert abs(x - 1.12) < 0.03
    assert abs(y - 0.2) < 0.03
