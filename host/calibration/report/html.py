"""The report of a calibration: one HTML file that needs nothing beside it."""

import html
from pathlib import Path
from typing import Any

from host.calibration import robot_file
from host.calibration.report import diagram
from host.calibration.report.text import check_cells, fitted_cells, value_alike
from host.calibration.result import Calibration, Fitted, ReportPicture
from host.errors import cannot_write

_CSS = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
_NO_MATPLOTLIB = (
    "The pictures are missing, because matplotlib is not installed: "
    "pip install matplotlib and calibrate once more."
)


def write_html(
    path: Path, calibration: Calibration, source: str, date: str, config_name: str
) -> None:
    """Write the report. Without matplotlib it has no pictures, and says so.

    source: where the data came from; config_name: the robot's file. Raises UserError where the
    file cannot be written.
    """
    page = as_html(calibration, source, date, config_name)
    try:
        path.write_text(page, encoding="utf-8", errors="replace")
    except OSError as error:
        next_step = "choose a file in a folder that exists and that you may write to"
        raise cannot_write(f"the report {path}", error, next_step) from error


def as_html(calibration: Calibration, source: str, date: str, config_name: str) -> str:
    """The report as the text of one HTML page."""
    title = f"Calibration: {calibration.kind}"
    parts = [
        f"<h1>{_text(title)}</h1>",
        f'<p class="about">{_text(config_name)} · from {_text(source)} · {_text(date)}</p>',
        _verdict(calibration),
        _fitted(calibration),
        _checks(calibration),
        _pictures(calibration.pictures),
        _written(calibration.new_settings()),
        _figures(calibration.figures),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_text(title)}, {_text(date)}</title>\n<style>\n{_CSS}</style>\n</head>\n<body>\n"
        + "\n".join(part for part in parts if part)
        + "\n</body>\n</html>\n"
    )


def _text(value: object) -> str:
    return html.escape(str(value))


def _verdict(calibration: Calibration) -> str:
    residuals = f"<p>Residuals: {_text(calibration.residuals)}</p>" if calibration.residuals else ""
    residuals += "".join(f"<p>Beware: {_text(each)}</p>" for each in calibration.warnings)
    failures = calibration.failures
    if not failures:
        return f'<div class="verdict passed"><strong>✓ Passed</strong>{residuals}</div>'
    reasons = "".join(f"<li>{_text(failure)}</li>" for failure in failures)
    return (
        f'<div class="verdict failed"><strong>✗ Refused</strong><ul>{reasons}</ul>{residuals}</div>'
    )


def _table(title: str, head: list[str], rows: list[list[str]], note: str = "") -> str:
    """head: of the columns, numbers between two of words; rows: cells that are HTML already."""
    kinds = ["", *["n"] * (len(head) - 2), ""]

    def line(tag: str, cells: list[str]) -> str:
        row = zip(kinds, cells, strict=True)
        return "".join(f'<{tag} class="{kind}">{cell}</{tag}>' for kind, cell in row)

    body = "\n".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    return (
        f'<h2>{title}</h2>\n<div class="wide"><table>\n<thead><tr>{line("th", head)}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>" + (f'\n<p class="note">{note}</p>' * bool(note))
    )


def _fitted(calibration: Calibration) -> str:
    if not calibration.fitted:
        return ""
    head = ["Value", "Fitted ± σ", "σ at most", "Before", "First half", "Second half", "Verdict"]
    note = (
        "σ is the standard deviation of the fitted value. The halves are the same fit on the first "
        "and the second half of the data alone; they should agree."
    )
    return _table("Fitted values", head, [_fitted_row(row) for row in calibration.fitted], note)


def _fitted_row(row: Fitted) -> list[str]:
    *cells, verdict = fitted_cells(row)
    halves = ("", "") if row.halves is None else (value_alike(row, half) for half in row.halves)
    key = f'<span class="key">{_text(row.key)}</span>' if row.key else ""
    return [
        _text(row.name) + key,
        *map(_text, (*cells, *halves)),
        _word(verdict) or f'<span class="advice">no bound: {_text(row.unbounded)}</span>',
    ]


def _word(word: str) -> str:
    mark = {"ok": "✓ ", "fails": "✗ "}.get(word, "")
    return f'<span class="{word}">{mark}{word}</span>' if word else ""


def _checks(calibration: Calibration) -> str:
    if not calibration.checks:
        return ""
    rows = []
    for check in calibration.checks:
        *cells, verdict = check_cells(check)
        advice = "" if check.passed else f'<span class="advice">{_text(check.advice)}</span>'
        rows.append([_text(check.name) + advice, *map(_text, cells), _word(verdict)])
    return _table("Checks", ["Check", "Found", "Needed", "Verdict"], rows)


def _pictures(pictures: tuple[ReportPicture, ...]) -> str:
    if not pictures:
        return ""
    try:
        figures = [_figure(picture, number) for number, picture in enumerate(pictures, 1)]
    except ImportError:
        return f'<h2>Pictures</h2>\n<p class="note">{_text(_NO_MATPLOTLIB)}</p>'
    return (
        f'<h2>Pictures</h2>\n{_colours(pictures)}<div class="pictures">\n'
        + "\n".join(figures)
        + "\n</div>"
    )


def _colours(pictures: tuple[ReportPicture, ...]) -> str:
    """What the colours mean, of those that are in the pictures."""
    roles = {series.role for picture in pictures for series in picture.series}
    marks = [
        f'<span><i style="background:{look.colour}"></i>{_text(look.meaning)}</span>'
        for role, look in diagram.ROLES.items()
        if role in roles
    ]
    return f'<p class="colours">{" ".join(marks)}</p>\n' if marks else ""


def _figure(picture: ReportPicture, number: int) -> str:
    label = f'<svg role="img" aria-label="{_text(picture.title)}"'
    drawn = diagram.svg(picture, number).replace("<svg", label, 1)
    caption = f"<figcaption>{_text(picture.caption)}</figcaption>" if picture.caption else ""
    return f"<figure><h3>{_text(picture.title)}</h3>\n{drawn}\n{caption}</figure>"


def _written(settings: dict[str, Any]) -> str:
    """Everything that goes into robot.toml, in SI units, as TOML."""
    lines = robot_file.as_lines(settings)
    return f"<h2>For robot.toml</h2>\n<pre>{_text(lines)}</pre>" if settings else ""


def _figures(figures: dict[str, Any]) -> str:
    if not figures:
        return ""
    rows = "\n".join(
        f"<dt>{_text(name.replace('_', ' '))}</dt><dd>{_text(_short(value))}</dd>"
        for name, value in figures.items()
    )
    return f"<h2>Further figures</h2>\n<dl>\n{rows}\n</dl>"


def _short(value: Any) -> str:
    """A value of any kind in few digits; what a table holds beside each other, tables in lines."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, dict):
        return ", ".join(f"{str(k).replace('_', ' ')} {_short(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        if any(isinstance(inner, dict) for inner in value):
            return "\n".join(map(_short, value))
        return f"({', '.join(map(_short, value))})"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
