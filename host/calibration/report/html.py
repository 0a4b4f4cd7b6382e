"""The report of a calibration: one HTML file that needs nothing beside it."""

import html
from pathlib import Path
from typing import Any

import tomlkit

from host.calibration.report import diagram
from host.calibration.report.palette import ROLES
from host.calibration.report.text import (
    as_json,
    as_text,
    found,
    limit,
    needed,
    row_verdict,
    value_alike,
    value_and_sigma,
)
from host.calibration.result import Calibration, Fitted, ReportPicture
from host.calibration.robot_file import in_lines
from host.errors import UserError

__all__ = ["as_html", "as_json", "as_text", "write_html"]

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
        raise UserError(
            f"cannot write the report {path}",
            error.strerror or str(error),
            "choose a file in a folder that exists and that you may write to",
        ) from error


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
        '<div class="verdict failed"><strong>✗ Not to be used</strong>'
        f"<ul>{reasons}</ul>{residuals}</div>"
    )


def _table(title: str, head: list[tuple[str, str]], rows: list[list[str]], note: str = "") -> str:
    """head: (class, words) of each column; rows: cells that are HTML already."""
    ths = "".join(f'<th class="{kind}">{words}</th>' for kind, words in head)
    body = "\n".join(
        "<tr>"
        + "".join(
            f'<td class="{kind}">{cell}</td>' for (kind, _), cell in zip(head, row, strict=True)
        )
        + "</tr>"
        for row in rows
    )
    return (
        f'<h2>{title}</h2>\n<div class="wide"><table>\n<thead><tr>{ths}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>" + (f'\n<p class="note">{note}</p>' * bool(note))
    )


def _fitted(calibration: Calibration) -> str:
    if not calibration.fitted:
        return ""
    head = [("", "Value"), ("n", "Fitted ± σ"), ("n", "σ at most"), ("n", "Before")]
    head += [("n", "First half"), ("n", "Second half"), ("", "Verdict")]
    note = (
        "σ is the standard deviation of the fitted value. The halves are the same fit on the first "
        "and the second half of the data alone; they should agree."
    )
    return _table("Fitted values", head, [_fitted_row(row) for row in calibration.fitted], note)


def _fitted_row(row: Fitted) -> list[str]:
    first, second = ("", "") if row.halves is None else (value_alike(row, h) for h in row.halves)
    key = f'<span class="key">{_text(row.key)}</span>' if row.key else ""
    return [
        _text(row.name) + key,
        _text(value_and_sigma(row)),
        _text(limit(row)),
        "" if row.before is None else _text(value_alike(row, row.before)),
        _text(first),
        _text(second),
        _word(row_verdict(row)) or f'<span class="advice">no bound: {_text(row.unbounded)}</span>',
    ]


def _word(word: str) -> str:
    mark = {"ok": "✓ ", "fails": "✗ "}.get(word, "")
    return f'<span class="{word}">{mark}{word}</span>' if word else ""


def _checks(calibration: Calibration) -> str:
    if not calibration.checks:
        return ""
    head = [("", "Check"), ("n", "Found"), ("n", "Needed"), ("", "Verdict")]
    rows = [
        [
            _text(check.name)
            + ("" if check.passed else f'<span class="advice">{_text(check.advice)}</span>'),
            _text(found(check)),
            _text(needed(check)),
            _word(row_verdict(check)),
        ]
        for check in calibration.checks
    ]
    return _table("Checks", head, rows)


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
        for role, look in ROLES.items()
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
    if not settings:
        return ""
    plain = ((key, _rounded(value)) for key, value in settings.items())
    items = (
        (key, in_lines(value) if isinstance(value, list) else tomlkit.item(value))
        for key, value in plain
    )
    lines = "\n".join(f"{key} = {item.as_string()}" for key, item in items)
    return f"<h2>For robot.toml</h2>\n<pre>{_text(lines)}</pre>"


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
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{str(k).replace('_', ' ')} {_short(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        tables = any(isinstance(inner, dict) for inner in value)
        return ("\n" if tables else "; ").join(map(_within, value)) or "none"
    return str(value)


def _within(value: Any) -> str:
    """What a list holds; a list in it is a point."""
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_short, value))})"
    return _short(value)


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _rounded(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(inner) for inner in value]
    value = value.tolist() if hasattr(value, "tolist") else value
    return float(f"{value:.6g}") if isinstance(value, float) else value
