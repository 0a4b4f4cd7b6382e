"""The live page as one self-contained document: nothing in it is loaded from anywhere."""

from importlib.resources import files

_PARTS = ("page.css", "layers.js", "page.js", "pictures.js", "playback.js")


def page(driven: bool = False) -> str:
    """page.html with style and programs inside. driven: with a stick to drive by."""
    folder = files("host.viewer")
    html = (folder / "page.html").read_text(encoding="utf-8")
    for part in _PARTS:
        html = html.replace(f"/* {part} */", (folder / part).read_text(encoding="utf-8"))
    stick = (folder / "stick.html").read_text(encoding="utf-8") if driven else ""
    return html.replace("<!-- stick.html -->", stick)
