"""Parts of the work against the best public peer, both timed in turn in the same run; a page from click to picture."""

import os
import subprocess
import tempfile
import warnings
from pathlib import Path

import numpy as np

from benchmarks import tables as watch
from benchmarks.gradient_torque import orbit_points
from benchmarks.tables import CLI, Figure, at_least, at_most, of_tests, show, title

EPOCHS = 172_800  # two a second for a day
RECORDS = 864_000  # of a day of ACC1A at 10 Hz
COUNT = 16_000_000  # samples of a series
DRAWN = "const p = document.querySelector('.plot'); return p && p.dataset.state === 'drawn' ? p.dataset.ms : null"


def readers(options) -> list[Figure]:
    """A full day of ACC1A to arrays with GPS time, flags and checks, against polars reading the bytes as numbers."""
    import polars

    from flows import com_offset
    from gravcal.calibrations.align import gps_tags
    from gravcal.io.readers import read

    title(f"readers: ACC1A of a day, {RECORDS:,} records")
    with tempfile.TemporaryDirectory() as folder:
        com_offset.CALIBRATION.simulate(folder, seed=1, truth=None, effects={}, settings={"span": "day"})
        path, *clocks = (next(Path(folder).glob(f"{name}_*")) for name in ("ACC1A", "TIM1B", "CLK1B"))
        head = path.read_bytes().partition(b"# End of YAML header\n")[0].count(b"\n") + 1
        clocks = [read(clock) for clock in clocks]
        work = {
            "polars": lambda: polars.read_csv(path, separator=" ", has_header=False, skip_lines=head),
            "GPS time": lambda: gps_tags(read(path), *clocks, 20.0).time,
        }
        spent = watch.interleaved(work, options.rounds)
    ratio = watch.ratios(spent["GPS time"], spent["polars"])
    return show(
        [
            watch.seconds("polars alone", spent["polars"]),
            watch.seconds("read: arrays, flags, checks, GPS time", spent["GPS time"]),
            at_most("read with GPS time / polars", watch.middle(ratio), 2.0, "", watch.span(ratio)),
        ],
        "min .. max",
    )


def attitude(options) -> list[Figure]:
    """Attitude and state transition of one manoeuvre, against scipy's DOP853 restarted at every edge."""
    from gravcal.physics.dynamics import integrate_with_sensitivity

    title("attitude: 180 s of square wave, attitude and 6 x 6 state transition at 1 Hz")
    peer = of_tests("physics.physics_references")
    state, torque, at = peer.manoeuvre()
    work = integrate_with_sensitivity, peer.attitude_by_scipy, (at, state, torque)
    return show(against("scipy DOP853", *work, options.rounds, 50), "min .. max")


def against(name, ours, peer, given, rounds, wanted):
    """Times of two functions of the same, ours and a peer's, and their ratio, round by round; ours 20 times in each."""
    work = {"ours": lambda: [ours(*given) for _ in range(20)], "peer": lambda: peer(*given)}
    spent = watch.interleaved(work, rounds)
    spent["ours"] = [s / 20 for s in spent["ours"]]
    ratio = watch.ratios(spent["peer"], spent["ours"])
    return [
        watch.seconds("gravcal", spent["ours"]),
        watch.seconds(name, spent["peer"]),
        at_least(f"{name} / gravcal", watch.middle(ratio), wanted, "", watch.span(ratio)),
    ]


def field(options) -> list[Figure]:
    """IGRF-14 at epochs of their own, against ChaosMagPy with the same fraction of each interval."""
    from gravcal.physics import magnetic

    title(f"field: IGRF-14 at {EPOCHS:,} epochs with their own times, along an orbit")
    peer = of_tests("physics.physics_references")
    given = 633787200.0 + 0.5 * np.arange(EPOCHS), orbit_points(EPOCHS, 0.5), 14
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rounds, chaos = max(options.rounds // 2, 2), peer.field_by_chaosmagpy
        figures = against("ChaosMagPy", magnetic.field_e, chaos, given, rounds, 10)
        difference = float(np.abs(magnetic.field_e(*given) - chaos(*given)).max() * 1e9)
    return show([*figures, at_most("largest difference, calendar apart", difference, 0.01, " nT")], "min .. max")


def browse(options) -> list[Figure]:
    """From the click to the picture: a new server and a new page each time, with the file in memory and on the disk."""
    user = of_tests("browse.chromium")
    title(f"browse: page of a product with three series of {COUNT:,} samples, from the click to the picture")
    if user.missing():
        return show([Figure("opened in Chromium", f"not measured: {user.missing()}")])
    with tempfile.TemporaryDirectory() as folder, user.chromium(f"{folder}/profile") as browser:
        ref = product(folder)
        page = f"/product/{ref.key}?variable=acceleration_b"
        held = [opened(user, browser, folder, page) for _ in range(options.rounds)]
        cold = []
        for _ in range(options.rounds):
            with ref.path.open("rb") as file:  # the system drops its copy, so that the next reader waits for the disk
                os.fsync(file.fileno())
                os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
            cold.append(opened(user, browser, folder, page))
    return show(
        [
            at_most("file in memory", watch.middle(held), 1.0, " s", watch.span(held)),
            at_most("file on the disk only", watch.middle(cold), 1.0, " s", watch.span(cold)),
        ],
        "min .. max",
    )


def product(folder):
    """Reference of the one product of a new store, three noisy series and their times."""
    shop = of_tests("browse.invented_store")
    os.environ["GRAVCAL_PRODUCTS"] = folder
    made = shop.dataset(COUNT)
    made["acceleration_b"].values[:] = np.random.default_rng(1).standard_normal((COUNT, 3))
    return shop.put(f"{shop.EVENT}/com_offset.align", made)


def opened(user, browser, folder, page) -> float:
    """Seconds from asking a new server for a page until its figure is drawn, by the page's own clock."""
    environment = os.environ | {"GRAVCAL_PRODUCTS": folder}
    command = [*CLI, "browse", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server:
        try:
            address = server.stdout.readline().split()[-1]
            browser.get(address)  # the first answer comes when the server is up
            browser.get(address.partition("/?")[0] + page)
            return float(user.wait(browser, lambda one: one.execute_script(DRAWN))) / 1e3
        finally:
            server.terminate()
