"""What every test has: a store of its own, and a small invented pipeline for tests of the machinery."""

import importlib
import sys
import textwrap
from pathlib import Path

import pytest
import seeds

from flows.engine import single_threaded
from gravcal.store import keys

single_threaded()  # before numpy, as every command does: two workers of pytest share two cores
SEED = seeds.settle()
SHARED = Path(__file__).parents[2] / "shared"
#: Folders and files of tests that run much and look at no picture.
UNSEEN = ("calibrations/", "discovery/", "independent/", "flows/test_every_calibration.py", "test_bad_input.py")
UNSEEN += ("test_docs_commands.py", "test_measured.py", "test_recovery.py")


def _forget():
    """Look at the code again, as a new process would; what is known of modules by their content stays."""
    keys._files.clear()
    keys._bodies.clear()
    for cached in (one for name, one in vars(keys).items() if hasattr(one, "cache_clear") and name != "_parsed"):
        cached.cache_clear()


def pytest_collection_modifyitems(items):
    """Long files first; skipped is what needs a folder beside the project where it is not, data or that of the mark."""
    long = "docs", "docs_commands", "fuzz", "recovery", "serve", "wheel", "bad_input", "published_methods", "readme"
    items.sort(key=lambda item: item.path.stem.removeprefix("test_") not in long)
    for item in items:
        for mark in item.iter_markers("measured"):
            folder = SHARED.joinpath(*(mark.args or ("data",)))
            if not folder.is_dir():
                item.add_marker(pytest.mark.skip(reason=f"no folder {folder}"))


def pytest_report_header():
    """Seed of everything that is hidden at random in this run."""
    return f"GRAVCAL_TEST_SEED={SEED}"


PIPELINE = {
    "__init__.py": "",
    "helper.py": '''
        """Shared helper."""
        FACTOR = 2.0

        def doubled(values):
            """Twice."""
            return FACTOR * values  # a comment
        ''',
    "first.py": '''
        """First step."""
        import numpy as np
        import xarray as xr
        from {name} import helper

        def numbers(count, offset):
            """Numbers on a grid."""
            values = np.round(helper.doubled(np.arange(count, dtype=float)), 6) + round(offset)
            return xr.Dataset({"value": ("time", values)}, {"time": np.arange(count, dtype=float)})
        ''',
    "second.py": '''
        """Second step."""
        def scaled(dataset, gain):
            """Scaled numbers."""
            return dataset.assign(value=dataset["value"] * gain)

        def mean(first, second):
            """Mean of two."""
            return first.assign(value=(first["value"] + second["value"]) / 2)
        ''',
    "stages.py": '''
        """Stages."""
        from gravcal.store import product
        from tasks.stage import lazy, stage

        first = lazy("{name}.first")
        second = lazy("{name}.second")
        SCHEMA = {"time": {"dims": "time"}, "value": {"dims": "time", "units": "m", "long_name": "a value"}}
        for kind in ("start", "scale", "join"):
            product.register("{name}." + kind, SCHEMA)

        @stage(reads=["file"], writes="{name}.start", version=1)
        def start(file, *, count: int, offset: float):
            """Numbers, as many as wanted and the file says."""
            return first.numbers(count + len(file.path.read_text()), offset)

        @stage(reads=["{name}.start"], writes="{name}.scale", version=1)
        def scale(started, *, gain: float):
            """Scaled numbers."""
            return second.scaled(started, gain)

        @stage(reads=["{name}.scale"], writes="{name}.join", version=1)
        def join(one, other):
            """Both."""
            return second.mean(one, other)
        ''',
    "flow.py": '''
        """Flow of start, two scales and a join."""
        from flows.engine import flow
        from {name} import stages

        @flow(name="{name}")
        def calibrate(file, chosen):
            """Ten lines."""
            numbers = {"count": chosen["count"], "offset": chosen["offset"]}
            started = stages.start(file, event=chosen["event"], variant="", **numbers)
            one = stages.scale(started, variant="one", gain=chosen["gain_one"])
            other = stages.scale(started, variant="other", gain=chosen["gain_other"])
            return stages.join(one, other)
        ''',
}


@pytest.fixture
def forget():
    """Function that looks at the code again, as a new process would."""
    return _forget


@pytest.fixture(autouse=True)
def store_folder(tmp_path, monkeypatch):
    """Let every test have its own empty store."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "products"))
    _forget()
    return tmp_path / "products"


@pytest.fixture(autouse=True, scope="module")
def _pictures(request):
    """Where nobody looks, draw figures but write none, a fifth of a run, and compress no product, a tenth."""
    with pytest.MonkeyPatch.context() as patch:
        if str(request.path.relative_to(Path(__file__).parent)).startswith(UNSEEN):
            patch.setattr("matplotlib.figure.Figure.savefig", lambda _, to, **__: to.write(b"<svg/>"))
            patch.setattr("gravcal.store.product.SMALL", 1 << 40)  # bytes
        yield


@pytest.fixture
def rng(request):
    """Generator of one test, whatever ran before it; its module states the RNG_LEVEL of all its draws."""
    return seeds.generator(request.node.name, request.module.RNG_LEVEL)


@pytest.fixture
def pipeline(tmp_path, monkeypatch):
    """Return a package of helper, first, second, stages and flow below tmp_path, and ways to change it."""
    name = f"fake_{tmp_path.name.replace('-', '_').lower()}"
    folder = tmp_path / "code" / name
    folder.mkdir(parents=True)
    for file, text in PIPELINE.items():
        (folder / file).write_text(textwrap.dedent(text).replace("{name}", name))
    raw = tmp_path / "MAG1B_2020-02-01_C_04.txt"
    raw.write_text("abc")
    monkeypatch.syspath_prepend(str(folder.parent))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield Pipeline(name, folder, raw)
    for module in [module for module in sys.modules if module.partition(".")[0] == name]:
        del sys.modules[module]


class Pipeline:
    """The invented pipeline of one test."""

    def __init__(self, name, folder, raw):
        self.name, self.folder, self.raw = name, folder, raw
        self.chosen = {"event": "fake-1", "count": 4, "offset": 0.0, "gain_one": 1.0, "gain_other": 3.0}

    def event(self, folder, number):
        """Let the file of an event come into a folder of its number; it says which."""
        (folder / str(number)).mkdir(parents=True)
        (folder / str(number) / self.raw.name).write_text("a" * number)

    def replace(self, file, old, new):
        """Change the code, then forget what this process knew, as a new process would."""
        path = self.folder / file
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        for module in [module for module in sys.modules if module.partition(".")[0] == self.name]:
            del sys.modules[module]
        importlib.invalidate_caches()
        _forget()

    def module(self, part):
        """One module of the package."""
        return importlib.import_module(f"{self.name}.{part}")

    def file(self):
        """The Level-1 file the flow starts from."""
        from gravcal.io.archive import LevelOneFile

        return LevelOneFile(self.raw, None, "MAG1B", "C", "2020-02-01", "04")

    def run(self, **changes):
        """Run the flow here; names of the stages that were made, and the result."""
        from tasks.stage import inline, using

        made = []

        def note(call, state, _):
            if state == "made":
                made.append(call.unmade.stage.removeprefix(f"{self.name}."))

        with using(inline, note):
            ref = self.module("flow").calibrate(self.file(), self.chosen | changes)
        return made, ref
