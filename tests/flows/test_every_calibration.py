"""Every calibration through campaign, plan, history, rebuild and discovery, on the smallest events they take.

Their products open anywhere: the CF conventions 1.11, checked by IOOS compliance-checker on every kind.
"""

import dataclasses
import functools
import importlib
import io
import json
import pkgutil
import re
import shutil
import subprocess
import sys
import warnings
from contextlib import redirect_stdout
from importlib import resources
from pathlib import Path

import astropy_iers_data
import commands
import pytest

import gravcal
import tasks
from flows import campaign, cli, command, discover, engine, output
from flows.calibration import known, load
from flows.engine import remake
from gravcal.browse import store_index, timeline
from gravcal.errors import GravcalError, ProductError
from gravcal.io import readers
from gravcal.store import configurations, housekeeping, keys, location, product
from tasks import stage

#: Calibration: what makes its simulated event small.
SMALL = {
    "com_offset": {"manoeuvres": "pitch_high"},
    "kbr_phase_centre": {"manoeuvres": "+pitch_a,-yaw_a,+pitch_b,-yaw_b", "quiet_s": "900", "phase_step_s": "1"},
    "inertial_sensor": {"roll_s": "13000", "swing_at_s": "900"},
    "gradient_torque": {"duration_s": "3000", "field_degree": "8"},
    "magnetometer": {"duration_s": "600"},
    "ranging": {"phase_step_s": "1", "date": "2020-09-12"},  # days of their own: events hold one calibration's files
    "thrusters": {"duration_s": "10800", "quiet_s": "900"},
    "routine": {"quiet_s": "360"},
}
SMALL = {name: how for name, how in SMALL.items() if name in known()}  # as installed

ROOT = Path(gravcal.__file__).parent.parent
EARTH = Path(astropy_iers_data.__file__).parent
#: Shipped data files that are in no stage's key, and why.
READ_BY_NO_STAGE = {
    "catalog/satellites/": "numbers of a satellite are settings of the stages that take them",
    "catalog/parameters/": "parameters are the settings of the stages, those of simulations make input files",
    "catalog/published/": "printed values are a setting of the reports",
    "catalog/events/": "an event's satellites and date choose the input files",
    "catalog/designs/": "designs of sessions make input files",
    "catalog/schema.json": "what a file of the catalogue may say, checked where it is read",
    "gravcal/browse/": "pages of gravcal browse, which reads products and makes none",
    "gravcal/report/history.html": "gravcal series writes it, no stage",
    "gravcal/report/comparison.html": "gravcal compare writes it, no stage",
    "gravcal/report/reproduction.html": "gravcal reproduce writes it, no stage",
    "flows/": "options of commands, what records say, settings of engines: what of it a stage takes are its settings",
    "gravcal/io/archives.toml": "where archives are, for gravcal fetch; no stage fetches",
}


@pytest.fixture(scope="module")
def level_one(tmp_path_factory):
    """Return a folder with one small event of each calibration, and a store for all tests of this module."""
    folder = tmp_path_factory.mktemp("every")
    for name, settings in SMALL.items():
        command.record(name).simulate(folder / name, seed=1, truth=None, effects={}, settings=settings)
    for name in {"kbr_phase_centre", "ranging"} & set(SMALL):
        commands.shortened(folder / name, 8)
    return folder


@pytest.fixture(autouse=True)
def _one_store(level_one, monkeypatch):
    """Let all tests of this module use one store."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(level_one / "products"))


def made(name, level_one, settings=None):
    """Row of a campaign of one event in this process."""
    chosen = campaign.Campaign(name, command.chosen(name, settings), "inline", None, 0)
    summary = campaign.run(chosen, command.many_sources(name, None, level_one / name))
    (row,) = summary["events"]
    return row


@pytest.mark.parametrize("name", SMALL)
def test_a_campaign_delivers_a_plan_reuses_all_and_a_simulated_event_says_so_wherever_it_is_shown(name, level_one):
    """Contract: a folder is enough; the second campaign makes nothing; the plan of the store finds the files again.

    Row, document, verdict, page, every product, and the browser say the origin; a gravity field alone has none.
    """
    row = made(name, level_one)
    assert row["status"] == "delivered", row
    again = made(name, level_one)
    assert (again["made"], again["reused"]) == (0, row["made"] + row["reused"])
    (source,) = command.sources(name, None, None, None, None)
    assert {step.action for step in engine.plan(load(name).flow, source, command.chosen(name, None))[0]} == {"reuse"}
    assert source.event == row["event"]
    assert row["origin"] == "simulated"
    document = json.loads((Path(row["report"]) / "result.json").read_text())
    assert (document["origin"], row["verdict"][:11]) == ("simulated", "SIMULATED. ")
    page = (Path(row["report"]) / "report.html").read_text().partition("<body>")[2]
    assert page.index('class="origin">Simulated data') < page.index("SIMULATED. ") < page.index("<h1>")
    told = {entry.ref.kind: store_index.origin(entry.ref.path) for entry in housekeeping.entries(row["event"])}
    assert {kind for kind, origin in told.items() if origin != "simulated"} <= {"gradient_torque.field"}
    (shown,) = [one for one in store_index.results() if (one["event"], one["calibration"]) == (row["event"], name)]
    assert shown["origin"] == "simulated"
    assert {point.mood for point in timeline.points(command.record(name))} == {"simulated"}


#: Calibration: a setting of its last stages.
WHAT_IF = {
    "com_offset": "requirement_um=51.0",
    "kbr_phase_centre": "requirement_mrad=0.31",
    "inertial_sensor": "k_y_sigma=4e-05",
    "gradient_torque": "requirement_m_s2=2e-13",
    "magnetometer": "agreement_limit=2e-05",
    "ranging": "determined_limit_mm=101.0",
    "thrusters": "agreement_limit=2e-05",
    "routine": "agreement_limit=2e-05",
}


@pytest.mark.parametrize("name", SMALL)
def test_an_experiment_is_said_in_document_and_page(name, level_one):
    """Contract: "configuration" and a banner; the operational report stays; equal products are shared."""
    event = made(name, level_one)["event"]
    before = {link.name: link.readlink() for link in location.links(event).glob("*.*")}
    row = made(name, level_one, [WHAT_IF[name]])
    assert row["status"] == "delivered", row
    configuration = WHAT_IF[name].replace("=", "-")
    folder, own = location.links(event, configuration), location.links(event)
    assert {link.name: link.readlink() for link in own.glob("*.*")} == before
    documents = [json.loads((one / f"{name}.report" / "result.json").read_text()) for one in (own, folder)]
    assert [one["configuration"] for one in documents] == ["operational", configuration]
    pages = [(one / f"{name}.report" / "report.html").read_text() for one in (own, folder)]
    assert [f"Experiment {configuration}" in page for page in pages] == [False, True]
    shared = [link.name for link in folder.glob("*.*") if link.readlink().name == before[link.name].name]
    assert len(shared) == len(list(folder.glob("*.*"))) - row["made"] > 0
    configurations.record(command.chosen(name, [WHAT_IF[name]]))
    compared = command.compare(name, "operational", configuration, row["event"].split("-")[1].upper())
    (one,) = compared["events"]
    assert list(one["settings"]) == [WHAT_IF[name].partition("=")[0]]
    assert [value["name"] for value in one["values"]] == list(row["values"])
    assert "in_sigma" in one["values"][0]


RECORD = "gravcal/store/schemas/_record.schema.json"  # of the store's own records: no number depends on it
opened, watched = [], []  # paths that a stage opens, and whether one runs


def _watch(event, arguments):
    """Note what is opened while a stage runs."""
    if watched and event == "open" and isinstance(arguments[0], str):
        opened.append(arguments[0])


sys.addaudithook(_watch)


def watching(monkeypatch):
    """Files of the package that stages open from now on, and those of them that are in no key of their stage."""
    perform, seen, forgotten = stage._make, set(), []

    def observed(call, *rest):
        for module in [one for title, one in list(sys.modules.items()) if title.startswith("gravcal.")]:
            if module not in (keys, sys.modules["gravcal.catalog"]):
                for value in vars(module).values():
                    getattr(value, "cache_clear", lambda: None)()
        opened.clear()
        watched.append(True)
        try:
            return perform(call, *rest)
        finally:
            watched.clear()
            paths = {Path(one).resolve() for one in opened if Path(one).suffix != ".py" and "__pycache__" not in one}
            for top in (ROOT / "gravcal", ROOT / "tasks", ROOT / "flows", ROOT / "catalog", EARTH):
                own = {path.relative_to(top.parent).as_posix() for path in paths if path.is_relative_to(top)} - {RECORD}
                seen.update(own)
                parts = keys.fingerprint(call.stage.body, call.stage.also)
                forgotten.extend((call.stage.name, part) for part in own - set(parts))

    monkeypatch.setattr(stage, "_make", observed)
    return seen, forgotten


@pytest.mark.parametrize("name", SMALL)
def test_history_and_rebuild_reach_every_product(name, level_one, monkeypatch):
    """Contract: each kind has a history down to raw files, is made again from them bit for bit, and its key is whole.

    The system says which files of the package a stage opens, with nothing remembered from the stage before.
    """
    event = made(name, level_one)["event"]
    own = housekeeping.entries(event, configuration=location.OPERATIONAL)
    known = {entry.ref.stage: entry for entry in own if "discovery" not in entry.ref.stage}
    for entry in known.values():
        printed = io.StringIO()
        with redirect_stdout(printed):
            cli.history(entry.ref.name, with_settings=False, json=None)
        raw = str(level_one / name)
        assert raw in printed.getvalue() or entry.ref.kind == "gradient_torque.field"  # from a file of the package
    seen, forgotten = watching(monkeypatch)
    outcome = remake(known[f"{name}.report"])
    assert {one["stage"] for one in outcome["stages"] if "discovery" not in one["stage"]} == set(known)
    assert [one for one in outcome["stages"] if one["verdict"] != "equal"] == []
    assert forgotten == []
    assert seen >= {"gravcal/report/page.html", f"gravcal/store/schemas/{name}.schema.json"}


def stages():
    """All stages of the package, those of discovery with the observations of every calibration."""
    modules = [importlib.import_module(f"tasks.{one.name}") for one in pkgutil.iter_modules(tasks.__path__)]
    found = [one for module in modules for one in vars(module).values() if isinstance(one, stage.Stage)]
    names = [path.parent.name for path in (ROOT / "gravcal" / "calibrations").glob("*/observations.py")]
    also = tuple(f"gravcal.calibrations.{name}.observations" for name in names)
    return {one.name: dataclasses.replace(one, also=also) if one.also else one for one in found}


def shipped():
    """Names of all files of the package that are no code."""
    found = {path for top in ("gravcal", "tasks", "flows", "catalog") for path in (ROOT / top).rglob("*")}
    files = (path for path in found if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts)
    return {path.relative_to(ROOT).as_posix() for path in files}


def test_no_data_file_of_the_package_is_forgotten():
    """Contract: every file that is no code is in the key of a stage, or is listed here with the reason why not."""
    keyed = {part for one in stages().values() for part in keys.fingerprint(one.body, one.also) if "/" in part}
    listed = {name for name in shipped() if name.startswith(tuple(READ_BY_NO_STAGE))}
    assert keyed >= {f"{EARTH.name}/data/{name}" for name in ("finals2000A.all", "Leap_Second.dat")}
    assert shipped() - keyed == listed
    assert len(listed) < len(shipped())
    assert all(any(name.startswith(one) for name in listed) for one in READ_BY_NO_STAGE)


def test_one_number_in_any_data_file_makes_again_what_reads_it(level_one, tmp_path, monkeypatch, forget):
    """Contract: each file of the key changed in turn in a copy of the packages; plan names the stages, and the file."""
    for name in SMALL:
        made(name, level_one)
    copies = {"gravcal": tmp_path / "gravcal", EARTH.name: tmp_path / EARTH.name}
    for top, copy in copies.items():
        shutil.copytree(keys.top_folder(top), copy, ignore=shutil.ignore_patterns("__pycache__"))
    own = keys.top_folder

    def copied(top):
        return copies.get(top) or own(top)

    copied.cache_clear = own.cache_clear
    monkeypatch.setattr(keys, "top_folder", copied)

    def planned(names=SMALL):
        forget()
        found = {}
        for name in names:
            (source,) = command.sources(name, None, None, None, None)
            for step in engine.plan(load(name).flow, source, command.chosen(name, None))[0]:
                assert step.action == "reuse" or step.reasons
                if step.action == "run":
                    assert step.reasons == (f"data changed: {part}",)
                    found.setdefault(name, []).append(step.stage)
        return found

    assert planned() == {}
    keyed = {part for one in stages().values() for part in keys.fingerprint(one.body, one.also) if "/" in part}
    again = {}
    for part in sorted(keyed):
        top, _, rest = part.partition("/")
        path, whole = copies[top] / rest, (copies[top] / rest).read_bytes()
        place = max(whole.rfind(digit) for digit in b"0123456789") % (len(whole) + 1)  # the end if there is none
        path.write_bytes(whole[:place] + (b"8" if whole[place : place + 1] == b"7" else b"7") + whole[place + 1 :])
        again[part] = planned(("com_offset",) if "/readers/" in part else SMALL)
        path.write_bytes(whole)
    of_searches = {part for part in keyed if "calibrations/" in part and part.endswith("/discovery.toml")}
    assert {part for part, found in again.items() if not found} - of_searches == {"gravcal/report/joint.toml"}
    assert all("ingest.MAG1B_C" in again[part]["com_offset"] for part in keyed if "/readers/products/" in part)
    assert again["gravcal/physics/IGRF13.shc"] == again["gravcal/physics/IGRF14.shc"]
    of_field = again["gravcal/physics/IGRF14.shc"]  # of these stages and of those whose modules import them
    assert set(of_field) == {"com_offset", "magnetometer", "routine", "thrusters"}
    assert {"com_offset.field", "magnetometer.align", "thrusters.align"} <= set(sum(of_field.values(), []))
    assert again["gravcal/io/GGM05S.gfc"] == {"gradient_torque": ["gradient_torque.field"]}
    assert again["gravcal/report/page.html"] == {name: [f"{name}.report"] for name in SMALL}
    assert {name for found in again.values() for name in found} == set(SMALL)
    assert "com_offset.align" in again[f"{EARTH.name}/data/Leap_Second.dat"]["com_offset"]


@pytest.mark.parametrize("name", ["com_offset", "kbr_phase_centre", "inertial_sensor"])
def test_manoeuvres_and_failures_have_an_origin_too(name, level_one, tmp_path, capsys):
    """Contract: what is detected in files, and the document of a run that failed, have the origin of their files."""
    for path in (level_one / name).iterdir():
        (tmp_path / path.name).symlink_to(path)
    (day,) = command.record(name).days(tmp_path)
    source = command.source(name, None, day[0], day[1], day[2])
    document = command.detect(name, source, command.chosen(name, None))
    assert document["origin"] == "simulated"
    output.manoeuvres(document, None)
    assert capsys.readouterr().out.splitlines()[-1].startswith("SIMULATED. ")
    assert command.failed(name, source, GravcalError("lost"))["origin"] == "simulated"
    next(path for path in tmp_path.iterdir() if path.name.startswith(("SCA1B", "ORB"))).unlink()
    how = campaign.Campaign(name, command.chosen(name, None), "inline", None, 0)
    summary = campaign.run(how, [source])
    assert (summary["status"], summary["origin"], summary["events"][0]["origin"]) == ("failed", *2 * ["simulated"])


def test_nothing_is_simulated_into_a_folder_of_others(tmp_path):
    """Contract: refused before anything is written."""
    kept = tmp_path / "KBR1B_2020-02-05_Y_04.txt"
    kept.write_text("header:\n# End of YAML header\n")
    with pytest.raises(ProductError, match=kept.name):
        command.simulate(next(iter(SMALL)), tmp_path, 1, tmp_path / "truth.json", None, None)
    assert list(tmp_path.iterdir()) == [kept]


def test_satellites_pairs_and_split_mirrors_are_found(level_one, tmp_path):
    """Contract: a pair is one event by any of its letters; files of a day in two trees are one event of the mirror."""
    for letter, expected in (("C", 1), ("CD", 1), ("D", 1)):
        sources = command.many_sources("kbr_phase_centre", letter, level_one / "kbr_phase_centre")
        assert [source.satellite for source in sources] == ["CD"] * expected
    made("com_offset", level_one)
    for path in (level_one / "com_offset").glob("*.txt"):
        tree = tmp_path / path.name[3:5]
        tree.mkdir(exist_ok=True)
        (tree / path.name).symlink_to(path)
    (source,) = command.many_sources("com_offset", None, tmp_path)
    assert source.folder == Path(tmp_path)
    steps, _ = engine.plan(command.record("com_offset").flow, source, command.chosen("com_offset", None))
    assert {step.action for step in steps} == {"reuse"}


@pytest.mark.skipif("com_offset" not in SMALL, reason="its four variants are not installed")
def test_tasks_of_prefect_make_the_same_products(level_one, prefect_home, tmp_path, monkeypatch):
    """Contract: four variants in threads of Prefect, and a search; keys, contents, links are those of inline."""
    event = made("com_offset", level_one, [WHAT_IF["com_offset"]])["event"]
    configuration, used = WHAT_IF["com_offset"].replace("=", "-"), []
    products = lambda: {  # noqa: E731
        entry.ref.stage: (entry.ref.key, entry.ref.digest)
        for entry in housekeeping.entries(event, configuration=configuration)
    }
    inline, chosen = products(), configurations.record(command.chosen("com_offset", [WHAT_IF["com_offset"]]))
    (source,) = command.sources("com_offset", None, None, None, None)
    searched = discover.flow_of("com_offset"), source, command.chosen("com_offset", None)
    found = engine.run(*searched, engine="inline")  # whose model holds for records of this digest
    monkeypatch.setenv("PREFECT_HOME", str(prefect_home))
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "products"))
    monkeypatch.setattr(engine, "warn", used.append)
    engine.run(load("com_offset").flow, source, chosen)
    assert used == []  # Prefect answered
    assert products() == inline != {}
    assert list(location.links(event).glob("*.*")) == []
    assert engine.run(*searched).key == found.key


ORDER = "§2.4 Dimensions"  # the house puts vectors on the last axis; CF recommends, but does not ask, the contrary


@pytest.fixture(scope="module")
def kinds(level_one):
    """Return files of products by kind, of all flows and of discovery."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("GRAVCAL_PRODUCTS", str(level_one / "products"))
        for name in SMALL:
            assert made(name, level_one)["status"] == "delivered"
            if name in discover.names():
                (source,) = command.sources(name, None, None, None, None)
                engine.run(discover.flow_of(name), source, command.chosen(name, None), engine="inline")
        links = sorted((location.folder() / "latest").glob("*/*.*"))
    found = {}
    for link in links:
        kind = ".".join(link.name.split(".")[:2])
        kind = kind.partition("_")[0] if kind.startswith("ingest") else kind  # of any satellite
        found.setdefault(kind, link / "product.nc")
    return found


@functools.cache
def checker():
    """IOOS compliance-checker with its conventions."""
    from compliance_checker.cf import util
    from compliance_checker.suite import CheckSuite

    for name in filter(re.compile("get_.*_variables?").fullmatch, [*vars(util)]):  # of a file, asked for at every check
        setattr(util, name, functools.lru_cache(1)(getattr(util, name)))
    util.StandardNameTable = functools.cache(util.StandardNameTable)
    CheckSuite.load_all_available_checkers()
    return CheckSuite()


def complaints(path):
    """What the checker finds in one file, but for the recommended order of dimensions."""
    suite = checker()
    found = []
    for groups, errors in suite.run_all(suite.load_dataset(str(path)), ["cf:1.11"]).values():
        found += [f"{name}: {problem[0]!r}" for name, problem in errors.items()]
        found += [f"{group.name}: {'; '.join(group.msgs)}" for group in groups if group.value[0] < group.value[1]]
    return [text for text in found if not text.startswith(ORDER)]


def test_every_kind_of_product_passes_the_checker(kinds):
    """Contract: no error, warning or remark on any kind that the calibrations make."""
    assert {"ingest", *SMALL} <= {kind.partition(".")[0] for kind in kinds}
    assert len(kinds) > 70
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the checker's own libraries
        found = {kind: complaints(path) for kind, path in kinds.items()}
    assert {kind: texts for kind, texts in found.items() if texts} == {}


@pytest.mark.skipif(not shutil.which("ncdump"), reason="ncdump is not installed")
def test_ncdump_shows_every_kind(kinds):
    """Contract: another netCDF library reads names, units and sizes of what we write."""
    for path in kinds.values():
        shown = subprocess.run(["ncdump", "-h", path], check=True, capture_output=True, text=True).stdout
        assert 'Conventions = "CF-' in shown


def test_every_unit_is_known_to_udunits():
    """Contract: also of kinds and variables that the small events do not make; all columns of Level-1 records."""
    from cf_units import Unit

    for name in (*SMALL, "discovery"):
        importlib.import_module(f"tasks.{name}")
    stated = [one.get("units") for schema in product._schemas.values() for one in (schema or {}).values()]
    units = {unit for one in stated for unit in (one if isinstance(one, tuple) else (one,)) if unit}
    assert len(units) > 30
    names = [path.stem for path in Path(readers.PRODUCTS).glob("*.toml")]
    assert len(names) > 20
    tables = [readers.table_of(name) for name in names]
    units |= {column.units for one in tables for column in (*one.columns, *one.optional, *one.repeated)}
    for unit in units:
        Unit(unit)


@pytest.mark.parametrize("name", SMALL)
def test_a_report_begins_with_its_verdict_and_its_numbers_can_be_traced(level_one, name):
    """Contract: origin, then verdict; one style, no script, nothing asked of other hosts, pictures described.

    What document and page name finds the product, as `gravcal products show` looks for it.
    """
    folder = Path(made(name, level_one)["report"])
    page = (folder / "report.html").read_text()
    body = page.partition("<main>")[2].lstrip()
    assert re.match(r'<p class="origin">Simulated data: [^<]*</p>\s*<p class="verdict', body)
    assert (resources.files("gravcal.report") / "report.css").read_text().strip() in page
    assert "<script" not in page
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#|https://doi\.org)[^"']+""", page)
    assert all("alt=" in tag for tag in re.findall(r"<img[^>]*>", page))
    named = json.loads((folder / "result.json").read_text())["provenance"]["products"]
    assert len(named) >= 3
    for what, key in named.items():  # of a routine day also whose
        assert set(housekeeping.resolve(key).ref.stage.split(".")) <= set(what.split("."))
        assert key[:12] in page, what
