"""The page by touch, by keyboard, by screen reader and on paper."""

import time

import pytest

from tests.viewer import scenes


@pytest.fixture
def page(served, browser):
    """A page with a teammate on it, and the protocol of its browser: `page(command, values)`."""
    running = served(scenes.health(), now=scenes.now(1.0, (1.0, 0.5)))
    browser.driver.get(running.viewer.url)
    browser.wait_for("scene && scene.estimates.length === 1")
    yield lambda command, **values: browser.driver.execute_cdp_cmd(command, values)
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


def touch(page, kind, *fingers):
    points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(fingers)]
    page("Input.dispatchTouchEvent", type=kind, touchPoints=points)


def test_two_fingers_zoom_about_where_they_are_and_one_pans(page, browser):
    before = browser.driver.execute_script("return view.scale")
    x, y = browser.driver.execute_script(
        "const {left, top} = map.getBoundingClientRect(), [x, y] = toPixel([1, .5]);"
        "return [left + x, top + y]"
    )
    touch(page, "touchStart", (x - 40, y), (x + 40, y))
    for step in range(1, 5):
        touch(page, "touchMove", (x - 40 - 10 * step, y), (x + 40 + 10 * step, y))
    touch(page, "touchEnd")
    assert browser.driver.execute_script("return view.scale") == pytest.approx(2 * before, rel=0.02)
    place = browser.driver.execute_script(
        "const {left, top} = map.getBoundingClientRect(), [x, y] = toPixel([1, .5]);"
        "return [left + x, top + y]"
    )
    assert place == pytest.approx([x, y], abs=3.0)  # what lies between the fingers stays there
    was = browser.driver.execute_script("return [view.x, view.y]")
    touch(page, "touchStart", (300, 300))
    for step in range(1, 4):
        touch(page, "touchMove", (300 + 10 * step, 300 + 5 * step))
    touch(page, "touchEnd")
    now = browser.driver.execute_script("return [view.x, view.y]")
    assert now == pytest.approx([was[0] + 30, was[1] + 15], abs=1.0)


def test_everything_is_reached_by_the_tabulator_and_shows_that_it_is(page, browser):
    reached = []
    for _ in range(12):
        browser.driver.switch_to.active_element.send_keys("\ue004")
        reached.append(
            browser.driver.execute_script(
                "const at = document.activeElement;"
                "return [at.id || at.name, getComputedStyle(at).outlineStyle]"
            )
        )
    wanted = ["map", "pause", "north", "measure", "fit", "scan", "candidates", "bearings"]
    assert [name for name, _ in reached][: len(wanted)] == wanted
    assert all(style == "solid" for _, style in reached[: len(wanted)])


def told_to_screen_readers(page):
    """Role and name of everything, as the browser now has them."""
    return {
        (node["role"]["value"], node.get("name", {}).get("value", ""))
        for node in page("Accessibility.getFullAXTree")["nodes"]
        if not node["ignored"]
    }


def test_a_screen_reader_is_told_what_a_person_sees(page):
    told = told_to_screen_readers(page)
    for _ in range(100):  # the browser tells of what is new when it finds the time
        if ("cell", "1") in told:
            break
        time.sleep(0.1)
        told = told_to_screen_readers(page)
    roles = {role for role, _ in told}
    assert {"status", "table", "toolbar", "banner", "main"} <= roles
    for name in ("pause", "north up", "measure", "fit"):
        assert ("button", name) in told
    assert ("checkbox", "lidar") in told
    assert any(role == "image" and name.startswith("Map around") for role, name in told)
    cells = {name for role, name in told if role == "cell"}
    assert {"1", "1.12", "27"} <= cells


def test_on_paper_it_is_dark_on_white_without_controls(page, browser):
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    page("Emulation.setEmulatedMedia", media="screen", features=dark)
    on_screen = browser.wait_for("colours.ink === '#f0efe9' && colours.ink")
    page("Emulation.setEmulatedMedia", media="print", features=dark)
    assert browser.wait_for("colours.ink === '#1a1a19' && colours.ink") != on_screen
    hidden = browser.driver.execute_script(
        "return ['tools', 'layers', 'map', 'teammates'].map(id => !at(id).offsetParent)"
    )
    assert hidden == [True, True, False, False]
