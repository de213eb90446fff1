"""How long a series of 16 million samples takes to be seen in a web browser."""

import os
import subprocess
import tempfile

import numpy as np
import xarray as xr

from benchmarks import stopwatch as watch
from benchmarks.tables import CLI, Figure, at_most, of_tests, show, title

COUNT = 16_000_000
STORE_UNITS = {"units": "seconds since 2000-01-01 12:00:00", "long_name": "GPS time"}
DRAWN = "const p = document.querySelector('.plot'); return p && p.dataset.state === 'drawn' ? p.dataset.ms : null"
user = of_tests("browse.chromium")


def browse(options) -> list[Figure]:
    """From the click to the picture: a new server and a new page each time, with the file in memory and on the disk."""
    title(f"browse: page of a product with three series of {COUNT:,} samples, from the click to the picture")
    if user.missing():
        return show([Figure("opened in Chromium", f"not measured: {user.missing()}")])
    with tempfile.TemporaryDirectory() as folder, user.chromium(f"{folder}/profile") as browser:
        ref = invented(folder)
        page = f"/product/{ref.key}?variable=v"
        held = [opened(browser, folder, page) for _ in range(options.rounds)]
        cold = []
        for _ in range(options.rounds):
            forget(ref.path)
            cold.append(opened(browser, folder, page))
    return show(
        [
            at_most("file in memory", watch.middle(held), 1.0, " s", watch.span(held)),
            at_most("file on the disk only", watch.middle(cold), 1.0, " s", watch.span(cold)),
        ],
        "min .. max",
    )


def invented(folder):
    """Reference of the one product of a new store, three noisy series and their times."""
    from gravcal.store import store

    os.environ["GRAVCAL_PRODUCTS"] = folder
    wave = np.random.default_rng(1).standard_normal((COUNT, 3))
    clock = 7e8 + 0.1 * np.arange(COUNT)
    made = xr.Dataset({"v": (("time", "axis"), wave, {"units": "V"})}, {"time": ("time", clock, STORE_UNITS)})
    recipe = {"event": "taiji-t-2020-01-01", "kind": "inertial_sensor.align", "variant": "", "version": 1}
    recipe |= {"settings": {}, "inputs": [], "code": ""}
    return store.put("ab" * 32, recipe, (made, {}), {"stage": "", "seconds": 0.0, "from": [], "versions": {}})


def forget(path) -> None:
    """Let the system drop its copy of a file, so that the next reader waits for the disk."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def opened(browser, folder, page) -> float:
    """Seconds from asking a new server for a page until its figure is drawn, by the page's own clock."""
    environment = os.environ | {"GRAVCAL_PRODUCTS": folder}
    command = [*CLI, "browse", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server:
        try:
            address = server.stdout.readline().split()[-1]
            browser.get(address)  # the first answer comes when the server is up
            browser.get(address.rstrip("/") + page)
            return float(user.wait(browser, lambda one: one.execute_script(DRAWN))) / 1e3
        finally:
            server.terminate()
