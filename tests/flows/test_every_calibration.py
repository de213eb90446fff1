"""Every calibration through campaign, plan, history and rebuild, on the smallest events they take."""

import io
import json
import os
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from flows import campaign, cli_store, command, engine
from flows.remake import remake
from gravcal.data import housekeeping, memory

#: Calibration: what makes its simulated event small.
SMALL = {
    "com_offset": {"manoeuvres": "pitch_high"},
    "kbr_phase_centre": {"manoeuvres": "+pitch_a"},
    "inertial_sensor": {"roll_s": "13000", "swing_at_s": "900"},
    "gradient_torque": {"duration_s": "3000", "field_degree": "8"},
}


@pytest.fixture(scope="module")
def level_one(tmp_path_factory):
    """Return a folder with one small event of each calibration, and a store for all tests of this module."""
    folder = tmp_path_factory.mktemp("every")
    for name, settings in SMALL.items():
        command.flow_module(name).simulate(folder / name, seed=1, truth=None, effects={}, settings=settings)
    return folder


@pytest.fixture(autouse=True)
def _one_store(level_one, monkeypatch):
    """Let all tests of this module use one store."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(level_one / "products"))
    memory.clear()


def made(name, level_one):
    """Row of a campaign of one event in this process."""
    chosen = campaign.Campaign(name, command.chosen(name, None), "inline", None, 0)
    summary = campaign.run(chosen, campaign.sources(name, None, level_one / name))
    (row,) = summary["events"]
    return row


@pytest.mark.parametrize("name", SMALL)
def test_a_campaign_delivers_and_a_plan_reuses_all(name, level_one):
    """Contract: a folder is enough; the second campaign makes nothing; the plan of the store finds the files again."""
    row = made(name, level_one)
    assert row["status"] == "delivered", row
    again = made(name, level_one)
    assert (again["made"], again["reused"]) == (0, row["made"] + row["reused"])
    (source,) = command.sources(name, None, None, None, None)
    assert {step.action for step in command.plan(name, source, command.chosen(name, None))} == {"reuse"}
    assert source.event == row["event"]


@pytest.mark.parametrize("name", SMALL)
def test_history_and_rebuild_reach_every_product(name, level_one):
    """Contract: each kind has a history down to raw files, and is made again from them bit for bit."""
    event = made(name, level_one)["event"]
    known = {entry.ref.stage: entry for entry in housekeeping.entries(event)}
    for entry in known.values():
        printed = io.StringIO()
        with redirect_stdout(printed):
            cli_store.history(entry.ref.name)
        raw = str(level_one / name)
        assert raw in printed.getvalue() or entry.ref.kind == "gradient_torque.field"  # from a file of the package
    memory.clear()
    outcome = remake(known[f"{name}.report"])
    assert {one["stage"] for one in outcome["stages"]} == set(known)
    assert [one for one in outcome["stages"] if one["verdict"] != "equal"] == []


def test_satellites_pairs_and_split_mirrors_are_found(level_one, tmp_path):
    """Contract: a pair is one event by any of its letters; files of a day in two trees are one event of the mirror."""
    for letter, expected in (("C", 1), ("CD", 1), ("D", 1)):
        sources = campaign.sources("kbr_phase_centre", letter, level_one / "kbr_phase_centre")
        assert [source.satellite for source in sources] == ["CD"] * expected
    made("com_offset", level_one)
    for path in (level_one / "com_offset").glob("*.txt"):
        tree = tmp_path / path.name[3:5]
        tree.mkdir(exist_ok=True)
        (tree / path.name).symlink_to(path)
    (source,) = campaign.sources("com_offset", None, tmp_path)
    assert source.folder == Path(tmp_path)
    assert engine.left(command.flow_module("com_offset").calibrate, source, command.chosen("com_offset", None)).ref


THROUGH_PREFECT = """
import json, os, sys
from pathlib import Path
from flows import command, engine, prefect_server
from gravcal.data import housekeeping
found = {}
with prefect_server.running(prefect_server.begin()) as url:
    os.environ["PREFECT_API_URL"] = url
    for name in sys.argv[2:]:
        module = command.flow_module(name)
        (day,) = module.days(Path(sys.argv[1]) / name)
        source = module.source(data=day[0], satellite=day[1], date=day[2])
        seen = []
        arguments = source, command.chosen(name, None)
        engine.run(module.calibrate, *arguments, listener=lambda call, state, ref: seen.append(state))
        products = {entry.ref.stage: [entry.ref.key, entry.ref.digest] for entry in housekeeping.entries(source.event)}
        found[name] = {"states": seen, "products": products, "prefect": "prefect" in sys.modules}
print(json.dumps(found))
"""


def test_tasks_of_prefect_make_the_same_products(level_one, prefect_home, tmp_path):
    """Contract: every calibration runs as a flow of Prefect tasks; keys and contents are those of the inline engine."""
    command_line = [sys.executable, "-c", THROUGH_PREFECT, str(level_one), *SMALL]
    own = {"GRAVCAL_PRODUCTS": str(tmp_path / "products"), "PREFECT_HOME": str(prefect_home)}
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT")} | own
    done = subprocess.run(command_line, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    for name, found in json.loads(done.stdout).items():
        event = made(name, level_one)["event"]
        inline = {entry.ref.stage: [entry.ref.key, entry.ref.digest] for entry in housekeeping.entries(event)}
        assert found["prefect"]
        assert found["states"] == ["made"] * len(inline)
        assert found["products"] == inline
