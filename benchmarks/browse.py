"""`python -m benchmarks browse`: how long a series of 16 million samples takes to be seen in a web browser."""

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import stopwatch as watch
from benchmarks.tables import Figure, at_most, show, title

COUNT = 16_000_000
STORE_UNITS = {"units": "seconds since 2000-01-01 12:00:00", "long_name": "GPS time"}
FLAGS = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
FLAGS += "--disable-component-update --disable-sync --disable-dev-shm-usage --window-size=1300,1000"
DRAWN = "const p = document.querySelector('.plot'); return p && p.dataset.state === 'drawn' ? p.dataset.ms : null"


def run(options) -> list[Figure]:
    """From the click to the picture: a new server and a new page each time, with the file in memory and on the disk."""
    title(f"browse: page of a product with three series of {COUNT:,} samples, from the click to the picture")
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        return show([Figure("opened in Chromium", "not measured: Chromium and its driver are not installed")])
    with tempfile.TemporaryDirectory() as folder, chromium(folder) as browser:
        path, key = invented(folder)
        page = f"/product/{key}?variable=v"
        held = [opened(browser, folder, page) for _ in range(options.rounds)]
        cold = []
        for _ in range(options.rounds):
            forget(path)
            cold.append(opened(browser, folder, page))
    return show(
        [
            at_most("file in memory", watch.middle(held), 1.0, " s", watch.span(held)),
            at_most("file on the disk only", watch.middle(cold), 1.0, " s", watch.span(cold)),
        ],
        "min .. max",
    )


def invented(folder) -> tuple[Path, str]:
    """Store with one product of three noisy series and their times; the path of the file, and its key."""
    import xarray as xr

    from gravcal.store import store

    os.environ["GRAVCAL_PRODUCTS"] = folder
    wave = np.random.default_rng(1).standard_normal((COUNT, 3))
    clock = 7e8 + 0.1 * np.arange(COUNT)
    made = xr.Dataset({"v": (("time", "axis"), wave, {"units": "V"})}, {"time": ("time", clock, STORE_UNITS)})
    recipe = {"event": "taiji-t-2020-01-01", "kind": "inertial_sensor.align", "variant": "", "version": 1}
    recipe |= {"settings": {}, "inputs": [], "code": ""}
    ref = store.put("ab" * 32, recipe, (made, {}), {"stage": "", "seconds": 0.0, "from": [], "versions": {}})
    return ref.path, ref.key


def forget(path) -> None:
    """Let the system drop its copy of a file, so that the next reader waits for the disk."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


@contextlib.contextmanager
def chromium(folder):
    """Chromium without a screen."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    for flag in (*FLAGS.split(), f"--user-data-dir={folder}/profile"):
        options.add_argument(flag)
    options.binary_location = shutil.which("chromium")
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        yield browser
    finally:
        browser.quit()


def opened(browser, folder, page) -> float:
    """Seconds from asking a new server for a page until its figure is drawn, by the page's own clock."""
    from selenium.webdriver.support.ui import WebDriverWait

    command = [sys.executable, "-m", "flows.cli", "browse", "--port", "0"]
    environment = os.environ | {"GRAVCAL_PRODUCTS": folder}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server:
        try:
            address = server.stdout.readline().split()[-1]
            browser.get(address)  # the first answer comes when the server is up
            browser.get(address.rstrip("/") + page)
            return float(WebDriverWait(browser, 60, 0.05).until(lambda one: one.execute_script(DRAWN))) / 1e3
        finally:
            server.terminate()
