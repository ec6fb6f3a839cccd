"""The page of `tertia report` in a browser: it works, without network, wide and narrow."""

import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from terminal import run

pytest.importorskip("plotly")
pytest.importorskip("jinja2")
webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    BROWSER is None or DRIVER is None, reason="there is no chromium with chromedriver here"
)
WIDTHS = [1280, 390]
WAIT_S = 60.0
END = "return scrollY + innerHeight >= document.documentElement.scrollHeight - 2"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a page with every section, of radars on the earth, with dates."""
    folder = tmp_path_factory.mktemp("scene")
    output = folder / "report.html"
    scene = ("--set-up", "tma", "--aircraft", 6, "--radar-count", 2, "--station-count", 3)
    place = ("--origin", "50.1,14.26", "--duration", 300)
    assert run("simulate", folder, *scene, *place).code == 0
    files = {name: folder / f"{name}.csv" for name in ("plots", "truth", "bearings")}
    for file in files.values():
        frame = pl.read_csv(file, infer_schema_length=None)
        time = pl.datetime(2026, 3, 1) + pl.duration(milliseconds=1000 * pl.col("time_s"))
        text = time.dt.to_string("%Y-%m-%dT%H:%M:%S%.3fZ")
        frame.with_columns(text.alias("time_s")).write_csv(file)
    done = run(
        *("report", files["plots"], "--output", output, "--by", "target"),
        *("--sensors", folder / "sensors.toml", "--plans", folder / "plans.json"),
        *("--truth", files["truth"], "--bearings", files["bearings"]),
    )
    assert done.code == 0, done.err
    return output


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(executable_path=DRIVER)
    driver = webdriver.Chrome(options=options, service=service)
    yield driver
    driver.quit()


def until(holds: Callable[[], Any], what: str) -> Any:
    """Wait until something holds."""
    end = time.monotonic() + WAIT_S
    while not (found := holds()):
        assert time.monotonic() < end, what
        time.sleep(0.05)
    return found


@pytest.fixture(scope="module", params=WIDTHS)
def opened(request: pytest.FixtureRequest, browser: Any, page: Path) -> Iterator[Any]:
    """Open the page; nothing that is done there may write to the console or ask the network."""
    size = {"width": request.param, "height": 844, "deviceScaleFactor": 1}
    mobile = {"mobile": request.param < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size | mobile)
    for log in ("browser", "performance"):
        browser.get_log(log)
    visit(browser, page)
    yield browser
    check_quiet(browser, page)


def visit(browser: Any, page: Path) -> None:
    """Open a page, and wait until its figures are drawn."""
    browser.get(page.as_uri())
    until(
        lambda: browser.execute_script(
            "return [...document.querySelectorAll('.plot')].every((p) => p.querySelector('.xtick'))"
        ),
        "not all figures are drawn",
    )


def check_quiet(browser: Any, page: Path) -> None:
    """Check that the page has written nothing to the console, and asked for itself alone."""
    assert browser.get_log("browser") == []
    messages = [json.loads(one["message"])["message"] for one in browser.get_log("performance")]
    asked = [
        one["params"]["request"]["url"]
        for one in messages
        if one["method"] == "Network.requestWillBeSent"
    ]
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [page.as_uri()]


def click(browser: Any, element: Any) -> None:
    """Click in the middle of the window, where nothing covers it."""
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
    element.click()


def slider(browser: Any) -> float:
    return float(browser.execute_script("return document.getElementById('time').value"))


def test_a_page_of_bearings_alone(browser: Any, page: Path) -> None:
    """It has its figures, without a map to be played, on a light page and a dark one.

    This test comes first: it opens another page than those below, which share theirs.
    """
    alone = page.with_name("bearings.html")
    files = ["--sensors", str(page.with_name("sensors.toml"))]
    files += ["--bearings", str(page.with_name("bearings.csv")), "--by", "target"]
    done = run("report", *files, "--output", alone)
    assert done.code == 0, done.err
    for log in ("browser", "performance"):
        browser.get_log(log)
    visit(browser, alone)
    assert len(browser.find_elements("css selector", ".plot")) == 4
    assert browser.find_elements("id", "play") == []
    click(browser, browser.find_element("id", "theme"))
    assert browser.execute_script("return document.documentElement.dataset.theme") in {
        "light",
        "dark",
    }
    check_quiet(browser, alone)


def test_nothing_is_cut_off(opened: Any) -> None:
    """The page is as wide as its window, and texts of figures are within them."""
    widths = opened.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
    assert widths[0] <= widths[1]
    outside = opened.execute_script(
        """
        const found = [];
        for (const plot of document.querySelectorAll(".plot")) {
          const box = plot.getBoundingClientRect();
          for (const text of plot.querySelectorAll("text")) {
            const own = text.getBoundingClientRect();
            if (!own.width) continue;
            if (own.left < box.left - 2 || own.right > box.right + 2 || own.bottom > box.bottom + 2
                || own.top < box.top - 2) found.push([plot.id, text.textContent]);
          }
        }
        return found;
        """
    )
    assert outside == []
    boxes = opened.find_elements("css selector", ".scroll")
    assert boxes
    for box in boxes:
        assert box.value_of_css_property("overflow-x") == "auto"


def test_every_control(opened: Any) -> None:
    """Sections, play, slider, ellipses, legends and the theme do what they say."""
    script = opened.execute_script
    for link in opened.find_elements("css selector", "nav a"):
        link.click()
        name = link.get_attribute("href").split("#")[1]
        top = f"return document.getElementById('{name}').getBoundingClientRect().top"
        until(lambda top=top: -1 <= script(top) < 80 or script(END), f"{name} is not shown")

    play = opened.find_element("id", "play")
    # so slow that the end does not come meanwhile, however busy the machine is
    script("document.getElementById('speed').value = 1")
    before = slider(opened)
    click(opened, play)
    until(lambda: slider(opened) > before, "time stands still")
    assert play.text == "Pause"
    click(opened, play)
    assert play.text == "Play"
    held = slider(opened)
    time.sleep(0.2)
    assert slider(opened) == held

    handle = opened.find_element("id", "time")
    shown = "return document.getElementById('figure-map').data.at(-1).x.length"
    # HOME and END
    handle.send_keys("\ue011")
    clock = "return document.getElementById('clock').value"
    until(lambda: script(clock) < "00:01:00", "time does not go back")
    until(lambda: script(shown) == 0, "somebody has a track at the beginning")
    handle.send_keys("\ue010")
    until(lambda: script(shown) > 0, "nobody has a track at the end")

    width = (
        "const x = document.getElementById('figure-map').data.at(-4).x.slice(0, 25);"
        "return Math.max(...x) - Math.min(...x)"
    )
    small = script(width)
    script(
        "const f = document.getElementById('factor'); f.selectedIndex = f.options.length - 1;"
        "f.dispatchEvent(new Event('change'))"
    )
    until(lambda: script(width) > 1.5 * small, "ellipses do not grow")

    colour = "return getComputedStyle(document.body).backgroundColor"
    light = script(colour)
    click(opened, opened.find_element("id", "theme"))
    assert script(colour) != light


def test_legends(opened: Any) -> None:
    """A click on the first entry hides its line, in every figure of lines; maps have colours."""
    figures = (
        "[...document.querySelectorAll('.plot')]"
        ".filter((p) => p.data.some((t) => t.type !== 'heatmap'))"
    )
    hidden = f"return {figures}.map((p) => p.data.filter((t) => t.visible === 'legendonly').length)"
    before = opened.execute_script(hidden)
    for entry in opened.execute_script(
        f"return {figures}.map((p) => [...p.querySelectorAll('.legendtoggle')].at(-1))"
    ):
        click(opened, entry)
    until(
        lambda: all(
            now > was for now, was in zip(opened.execute_script(hidden), before, strict=True)
        ),
        "a legend does nothing",
    )


def test_times_are_those_of_the_day(opened: Any) -> None:
    """Seconds since midnight are dates on all axes of time, and none is on others."""
    axes = opened.execute_script(
        "return [...document.querySelectorAll('.plot')]"
        ".map((p) => [p.layout.xaxis.title.text, p._fullLayout.xaxis.type, p.data.length])"
    )
    assert {kind for title, kind, _ in axes if title == "time (UTC)"} == {"date"}
    assert sum(title == "time (UTC)" for title, *_ in axes) >= 6
    assert {kind for title, kind, _ in axes if title != "time (UTC)"} == {"linear"}
    first = opened.execute_script(
        "return new Date(document.getElementById('figure-updates').data[0].x[0]).toISOString()"
    )
    assert first.startswith("2026-03-01T00:0")
    cells = opened.execute_script(
        "return [...document.querySelectorAll('#track-table tbody td:nth-child(3)')]"
        ".map((t) => t.textContent)"
    )
    assert cells
    assert all(re.fullmatch(r"00:0\d:\d\d", cell) for cell in cells)


def test_the_map_has_degrees_and_distances(opened: Any) -> None:
    texts = opened.execute_script(
        "return [...document.querySelectorAll('#figure-map .textpoint text')]"
        ".map((t) => t.textContent)"
    )
    for pattern in (r"\d+(\.\d+)?° N", r"\d+(\.\d+)?° E", r"\d+ km", "radar-1"):
        assert any(re.fullmatch(pattern, text) for text in texts), (pattern, texts)


def test_tables_are_files(opened: Any, tmp_path: Path) -> None:
    """Each table is downloaded by its link, without a network, with all its rows."""
    behaviour = {"behavior": "allow", "downloadPath": str(tmp_path)}
    opened.execute_cdp_cmd("Browser.setDownloadBehavior", behaviour)
    tables = opened.find_elements("css selector", ".scroll")
    assert len(tables) >= 8
    for table in tables:
        name = table.get_attribute("id")
        click(opened, opened.find_element("css selector", f"#{name}-note a"))
        file = tmp_path / f"{name}.csv"
        until(file.exists, f"{name} is not downloaded")
        rows = table.find_elements("css selector", "tbody tr")
        assert len(pl.read_csv(file, infer_schema_length=None)) == len(rows)
