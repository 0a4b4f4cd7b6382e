"""The live page as one self-contained document: nothing in it is loaded from anywhere."""

from importlib.resources import files


def page() -> str:
    """page.html with page.css and page.js inside."""
    folder = files("host.viewer")
    html, css, js = (
        (folder / f"page.{kind}").read_text(encoding="utf-8") for kind in ("html", "css", "js")
    )
    return html.replace("/* page.css */", css).replace("/* page.js */", js)
