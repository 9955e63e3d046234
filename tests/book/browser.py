"""A headless Chromium that sees only this machine, and what it says about a page."""

import json
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from selenium import webdriver
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.support.ui import WebDriverWait

INSPECT = (Path(__file__).parent / "inspect.js").read_text(encoding="utf-8")
ASK = """const done = arguments[0];
(async () => done({value: %s}))().catch((error) => done({error: String(error)}));"""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
DRIVER = "chromedriver"
FLAGS = (
    "--headless",
    "--no-sandbox",  # for users that may not make one, root in a container for example
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",  # as on a phone, where they take no width
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE localhost",
)
WIDE, NARROW = 1400, 400  # px: a desk and a phone
THEMES = ("light", "dark")


def missing() -> list[str]:
    """Programs that this machine lacks to run these tests."""
    absent = [] if any(map(shutil.which, BROWSERS)) else [" or ".join(BROWSERS)]
    return absent + ([] if shutil.which(DRIVER) else [DRIVER])


@contextmanager
def serve(folder: Path) -> Iterator[str]:
    """Serve a folder to this machine; yield its address."""
    server = ThreadingHTTPServer(("localhost", 0), partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)  # s a poll
    thread.start()
    try:
        yield f"http://localhost:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class Quiet(SimpleHTTPRequestHandler):
    """The standard handler, without a line for each request."""

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing: a failed request is found in the browser's log."""


class Chromium(webdriver.Chrome):
    """Chromium that has a page when `get` returns; under load it says so before."""

    def get(self, url: str) -> None:
        super().get(url)
        if url == "about:blank":  # which has nothing to wait for
            return
        there = "return document.readyState === 'complete' && document.body?.childElementCount > 0"
        with suppress(TimeoutException):  # a page may be empty
            wait(self, there, 5)


@contextmanager
def chromium(profile: Path) -> Iterator[webdriver.Chrome]:
    """Start Chromium with an empty profile; end it afterwards."""
    options = webdriver.ChromeOptions()
    options.binary_location = next(filter(None, map(shutil.which, BROWSERS)))
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = Chromium(options, webdriver.ChromeService(shutil.which(DRIVER)))
    try:
        driver.set_script_timeout(60)
        # A window without a screen may have no focus, and then draws none.
        driver.execute_cdp_cmd("Emulation.setFocusEmulationEnabled", {"enabled": True})
        yield driver
    finally:
        driver.quit()


def ask(driver: webdriver.Chrome, expression: str) -> Any:
    """The value of an expression in the page, awaited."""
    answer = driver.execute_async_script(ASK % expression)
    if "error" in answer:
        raise RuntimeError(f"{expression} in {driver.current_url}: {answer['error']}")
    return answer.get("value")


def wait(driver: webdriver.Chrome, condition: str, seconds: float = 30) -> None:
    """Wait until a script returns something true."""
    WebDriverWait(driver, seconds, 0.05).until(lambda found: found.execute_script(condition))


def resize(driver: webdriver.Chrome, width: int) -> None:
    """Set the window's width in px: below 500 px the window itself cannot be made smaller."""
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


def prefer(driver: webdriver.Chrome, scheme: str) -> None:
    """Set the system's colour scheme, as the page sees it."""
    feature = {"name": "prefers-color-scheme", "value": scheme}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})


def drain(driver: webdriver.Chrome) -> None:
    """Forget what was logged so far."""
    for log in ("browser", "performance"):
        driver.get_log(log)


def traffic(driver: webdriver.Chrome, address: str) -> tuple[list[str], int]:
    """Complaints, and the bytes of the page and its pictures, since the logs were drained.

    A complaint is an error on the console, or a request that failed or left this machine.  The
    files in _static serve the whole book and are not counted.
    """
    complaints = [
        f"console: {entry['message']}"
        for entry in driver.get_log("browser")
        if entry["level"] == "SEVERE"
    ]
    addresses: dict[str, str] = {}
    size = 0
    for entry in driver.get_log("performance"):
        event = json.loads(entry["message"])["message"]
        parameters = event["params"]
        match event["method"]:
            case "Network.requestWillBeSent":
                target = urlsplit(parameters["request"]["url"])
                addresses[parameters["requestId"]] = target.geturl()
                if target.scheme in ("http", "https") and target.netloc != urlsplit(address).netloc:
                    complaints.append(f"leaves this machine: {target.geturl()}")
            case "Network.responseReceived" if parameters["response"]["status"] >= 400:
                response = parameters["response"]
                complaints.append(f"{response['status']}: {response['url']}")
            case "Network.loadingFailed" if not parameters.get("canceled"):
                failed = addresses.get(parameters["requestId"], "?")
                complaints.append(f"{parameters['errorText']}: {failed}")
            # what was asked for before the logs were drained is not the page's
            case "Network.loadingFinished" if parameters["requestId"] in addresses:
                if "/_static/" not in addresses[parameters["requestId"]]:
                    size += int(parameters["encodedDataLength"])
    return complaints, size
