"""The page of `tertia report` in a browser: it works, without network, wide and narrow."""

import json
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from tertia import cli

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
    """Return a page with every section."""
    folder = tmp_path_factory.mktemp("scene")
    output = folder / "report.html"
    command = ["simulate", str(folder), "--set-up", "tma", "--aircraft", "6", "--radar-count", "2"]
    for arguments in (
        [*command, "--duration", "300", "--station-count", "3"],
        ["report", str(folder / "plots.csv"), "--output", str(output), "--by", "target"]
        + [
            part
            for name, file in (
                ("sensors", "sensors.toml"),
                ("plans", "plans.json"),
                ("truth", "truth.csv"),
                ("bearings", "bearings.csv"),
            )
            for part in (f"--{name}", str(folder / file))
        ],
    ):
        result = CliRunner().invoke(cli.app, arguments, catch_exceptions=False)
        assert result.exit_code == 0, result.stderr
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
    done = CliRunner().invoke(cli.app, ["report", *files, "--output", str(alone)])
    assert done.exit_code == 0, done.stderr
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
    run = opened.execute_script
    for link in opened.find_elements("css selector", "nav a"):
        link.click()
        name = link.get_attribute("href").split("#")[1]
        top = f"return document.getElementById('{name}').getBoundingClientRect().top"
        until(lambda top=top: -1 <= run(top) < 80 or run(END), f"{name} is not shown")

    play = opened.find_element("id", "play")
    # so slow that the end does not come meanwhile, however busy the machine is
    run("document.getElementById('speed').value = 1")
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
    until(lambda: run(clock).startswith("0 of"), "time does not go back")
    until(lambda: run(shown) == 0, "somebody has a track at the beginning")
    handle.send_keys("\ue010")
    until(lambda: run(shown) > 0, "nobody has a track at the end")

    width = (
        "const x = document.getElementById('figure-map').data.at(-3).x.slice(0, 25);"
        "return Math.max(...x) - Math.min(...x)"
    )
    small = run(width)
    run(
        "const f = document.getElementById('factor'); f.selectedIndex = f.options.length - 1;"
        "f.dispatchEvent(new Event('change'))"
    )
    until(lambda: run(width) > 1.5 * small, "ellipses do not grow")

    colour = "return getComputedStyle(document.body).backgroundColor"
    light = run(colour)
    click(opened, opened.find_element("id", "theme"))
    assert run(colour) != light


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
