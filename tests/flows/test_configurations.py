"""Configurations: what a what-if leaves alone, what a name stands for, and promotion."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from commands import gravcal, printed_json

from flows import command
from gravcal import catalog
from gravcal.errors import CatalogError
from gravcal.store import configurations, history, housekeeping, location, store

SCRIPT = Path(__file__).parent / "run_campaign.py"


@pytest.fixture
def run(fakecal):
    """Return a function that runs the invented calibration here; it must deliver."""

    def run_(*options, word="run"):
        inline = () if word == "plan" else ("--engine", "inline")
        assert gravcal(word, "fakecal", "--data", fakecal, *inline, *options) == 0

    return run_


def links(name=None):
    """Keys that the links of the invented event lead to, by stage."""
    found = location.links("fake-1", name).glob("*.*")
    return {link.name.partition(".")[2]: link.readlink().name for link in found}


def test_an_experiment_has_links_and_runs_of_its_own_and_leaves_the_delivery(run):
    """Contract: operational links and a delivered event stay; the name is made of the change; what is shared is one."""
    run()
    before = links()
    run("--set", "gain=3")
    assert links() == before
    own = links("gain-3.0")
    assert own["scale.one"] != before["scale.one"]
    assert own["start"] == before["start"]
    assert housekeeping.prune(keep_s=-1e9) == []  # nothing of either is without a link
    assert history.last_run("fake-1", "fakecal")["stages"]
    with location.configured("gain-3.0"):
        assert history.last_run("fake-1", "fakecal")["configuration"] == "gain-3.0"
    assert {one["configuration"] for one in history.runs()} == {"operational", "gain-3.0"}
    run()
    assert links() == before


def test_prune_by_configuration_removes_an_experiment_and_nothing_that_others_need(run, capsys):
    """Contract: by name or pattern, what only it led to, with its links; never what is operational; pins stay."""
    run()
    delivered = links()
    for gain in (3, 4):
        run("--set", f"gain={gain}", "--as", f"try-{gain}")
    first, second = links("try-3"), links("try-4")
    run("--set", "gain=5", "--as", "other")
    unlinked = {*links("other").values()}
    for link in location.links("fake-1", "other").glob("*.*"):
        link.unlink()
    assert gravcal("products", "pin", second["scale.one"]) == 0
    assert housekeeping.prune(keep_s=3600, configuration="try-*") == []  # the links are young
    assert gravcal("products", "prune", "--configuration", "operational") == 2
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(configurations, "promoted", lambda: {"try-3"})
        gone = [path for path, _ in housekeeping.prune(keep_s=-1e9, configuration="try-*")]
    assert "try-3" not in {path.stem for path in gone} | {path.parent.name for path in gone}  # promoted
    assert "try-4" in {path.stem for path in gone} & {path.parent.name for path in gone}
    assert gravcal("products", "prune", "--configuration", "try-*", "--older-than-h", "-1", "--remove") == 0
    assert (links("try-3"), links("try-4"), links()) == ({}, {}, delivered)
    left = {path.name for path in housekeeping.folders()}
    assert first["scale.one"] not in left
    assert left == {*delivered.values(), second["scale.one"], *unlinked}  # those of others wait for a prune of all
    assert gravcal("products", "unpin", second["scale.one"]) == 0


def test_what_a_name_stands_for_never_changes(run, fakecal, capsys):
    """Contract: a name alone runs its experiment again, with the same settings, though it stands beside others.

    Other settings under the same name are refused until it is pruned, links and all; a name that was never run is
    an error with those that were; the catalogue's own value is no experiment.
    """
    run("--set", "gain=2.0")
    assert configurations.names("fakecal") == []
    assert not (location.links("fake-1") / "as").exists()
    here = ("run", "fakecal", "--data", fakecal, "--engine", "inline", "--as")
    assert gravcal(*here, "mine", "--set", "gain=2.0") == 1
    run("--set", "gain=3", "--set", "count=5", "--as", "mine")
    before = links("mine")
    assert printed_json(capsys, *here, "mine")["total"] == 3.0 * 2 * sum(range(8))
    assert gravcal(*here, "other") == 1
    assert "one of operational, catalogue, mine" in " ".join(capsys.readouterr().err.split())
    assert gravcal(*here, "mine", "--set", "gain=4") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "found gain=4.0; expected count=5, gain=3.0" in said
    assert "prune --configuration mine --older-than-h 0 --remove." in said
    assert links("mine") == before
    assert gravcal("products", "prune", "--configuration", "mine", "--older-than-h", "-1", "--remove") == 0
    assert links("mine") == {}
    assert gravcal(*here, "mine", "--set", "gain=4") == 0


@pytest.mark.parametrize("name", ["../x", "", ".", "a/b", "-a", "x" * 81, "operational", "catalogue"])
def test_a_name_is_a_plain_word(fakecal, name):
    """Contract: it becomes a folder; what the two of the house stand for cannot be said anew."""
    with pytest.raises(CatalogError, match="expected letters" if name not in ("operational", "catalogue") else name):
        configurations.chosen("fakecal", {"gain": "3"}, name)
    assert configurations.chosen("fakecal", {}, "operational").configuration == "operational"


def test_names_made_of_changes_are_stable_readable_and_differ(fakecal):
    """Contract: in the order of the alphabet; what a folder cannot be called is replaced and told by a digest."""
    made = lambda **given: configurations.chosen("com_offset", given).configuration  # noqa: E731
    assert made(noise_order="25") == made(noise_order=25) == "noise_order-25"
    assert made(noise_order="25", lowpass_hz="0.3") == made(lowpass_hz=0.3, noise_order=25)
    assert made(lowpass_hz="0.3", noise_order=25) == "lowpass_hz-0.3,noise_order-25"
    entry = lambda value: json.dumps([{"cause": "torque.dipole_gain", "parameters": {"rod_y": {"value": value}}}])  # noqa: E731
    one, other = made(model=entry(0.03)), made(model=entry(0.04))
    assert one.startswith("model-torque.dipole_gain-")
    assert one != other
    assert configurations.NAME.fullmatch(made(**{n: e.value * 2 for n, e in floats("com_offset")}))


def floats(calibration):
    """Parameters of a calibration that may be doubled."""
    entries = catalog.parameters(calibration).entries.items()
    return [(n, e) for n, e in entries if isinstance(e.value, float) and (e.maximum or 0) >= 2 * e.value > 0]


def test_a_plan_compares_with_the_same_configuration(run, fakecal, capsys):
    """Contract: an experiment with its own last product; one that never was with the operational one; records none."""
    run()
    run("--set", "gain=3", "--as", "mine")
    run("--set", "gain=4", "--as", "other")
    plan = lambda *given: [one["reasons"] for one in planned(fakecal, capsys, *given)]  # noqa: E731
    assert plan() == plan("--as", "mine") == plan("--set", "gain=3") == [[], []]
    assert plan("--set", "gain=5") == [[], ["gain: 2.0 -> 5.0"]]
    assert configurations.names("fakecal") == ["mine", "other"]
    (fakecal / "MAG1B_2020-02-01_C_04.txt").write_text("longer")
    run()
    kind = next(entry.ref.kind for entry in housekeeping.entries() if entry.ref.kind.endswith("start"))
    assert plan("--as", "mine")[1] == [f"input {kind} changed"]


def test_a_plan_shows_by_stage_what_is_made_again_and_for_how_long(run, fakecal, capsys):
    """Contract: nothing that is reused unless wanted; time as of the last run, of other events for a new one."""
    run()
    for entry in housekeeping.entries():
        took = {"seconds": 30.0 if entry.ref.stage.endswith("scale.one") else 4.0}
        (entry.ref.folder / "meta.json").write_bytes(store.sealed(entry.record | took))
    capsys.readouterr()
    assert gravcal("plan", "fakecal", "--data", fakecal, "--set", "gain=5") == 0
    heads, row, said = capsys.readouterr().out.splitlines()
    assert row.split()[1:6] == ["1", "1", "run", "30", "s"]
    assert row.endswith("gain: 2.0 -> 5.0")
    assert said == "reuse: 1, run: 1, may run: 0; about 30 s of processor time (--all shows what is reused)"
    assert gravcal("plan", "fakecal", "--data", fakecal, "--set", "gain=5", "--all") == 0
    assert "reuse " in capsys.readouterr().out
    assert gravcal("plan", "fakecal", "--data", fakecal) == 0
    assert capsys.readouterr().out == "reuse: 2, run: 0, may run: 0 (--all shows what is reused)\n"
    (fakecal / "7").mkdir()
    (fakecal / "7" / "MAG1B_2020-02-01_C_04.txt").write_text("other")
    assert gravcal("plan", "fakecal", "--data", fakecal / "7") == 0
    assert capsys.readouterr().out.splitlines()[-1] == "reuse: 0, run: 2, may run: 0; about 34 s of processor time"


def test_a_plan_takes_the_folder_of_many_days_that_a_campaign_takes(tmp_path, capsys, monkeypatch):
    """Contract: one line a stage for all days; a single day is named by --date as before."""
    for day in ("2020-02-01", "2020-02-02"):
        (tmp_path / f"MAG1B_{day}_C_04.txt").write_text("")
    planned = []
    monkeypatch.setattr(command.engine, "plan", lambda _, source, __: (planned.append(source.event), [[]])[1])
    assert gravcal("plan", "magnetometer", "--data", tmp_path) == 0
    assert planned == ["grace-c-2020-02-01", "grace-c-2020-02-02"]
    assert gravcal("plan", "magnetometer", "--data", tmp_path, "--date", "2020-02-02") == 0
    assert planned[2:] == ["grace-c-2020-02-02"]
    assert gravcal("run", "magnetometer", "--data", tmp_path) == 1
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / "MAG1B_2020-02-01_C_04.txt").write_text("")
    twice, again, once = sorted(command.many_sources("magnetometer", None, tmp_path), key=lambda one: one.event)
    assert [one.event for one in (twice, again, once)] == ["grace-c-2020-02-01"] * 2 + ["grace-c-2020-02-02"]
    assert "copy: found files of this day" in twice.error + again.error  # two events of one name would be one result
    capsys.readouterr()


def planned(fakecal, capsys, *given):
    """Steps of a plan."""
    return printed_json(capsys, "plan", "fakecal", "--data", fakecal, *given)


def test_a_promoted_experiment_is_what_plain_runs_do(run, fakecal, capsys):
    """Contract: with who, when and why in a journal; a plan shows only what changes; the catalogue can come back.

    Wrong usage without --why; an error with an empty one, an unknown name, or what holds already.
    """
    run()
    before = links()
    run("--set", "gain=3", "--as", "mine")
    assert gravcal("promote", "fakecal", "mine") == 2
    for name, why in (("mine", " "), ("other", "x"), ("catalogue", "x"), ("operational", "x")):
        assert gravcal("promote", "fakecal", name, "--why", why) == 1
    assert configurations.promotions("fakecal") == []
    assert gravcal("promote", "fakecal", "mine", "--why", "closer to the truth", "--who", "an operator") == 0
    assert links() == before  # until the next run
    assert [(one["action"], one["reasons"]) for one in planned(fakecal, capsys)] == [("reuse", []), ("reuse", [])]
    run()
    assert links()["scale.one"] == links("mine")["scale.one"] != before["scale.one"]
    last = configurations.promotions("fakecal")[-1]
    assert (last["name"], last["who"], last["why"]) == ("mine", "an operator", "closer to the truth")
    assert last["when"].startswith("20")
    run("--set", "count=5")  # an experiment is made of all that differs from the catalogue
    assert links("count-5,gain-3.0")
    run("--set", "gain=2")
    assert links("catalogue")["scale.one"] == before["scale.one"]
    assert gravcal("promote", "fakecal", "catalogue", "--why", "not closer after all") == 0
    run()
    assert links() == before
    assert [one["name"] for one in configurations.promotions("fakecal")] == ["mine", "catalogue"]


@pytest.mark.parametrize("text", ["[]", "{", '{"settings": 3}', '{"settings": {"gone": 1}}', "\x00\xff"])
def test_a_broken_record_is_an_error_with_its_place(fakecal, text):
    """Contract: no trace, nothing run with half of the settings."""
    path = location.folder() / "configurations" / "fakecal" / "mine.json"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    with pytest.raises(CatalogError, match="mine"):
        configurations.chosen("fakecal", {}, "mine")
    path.rename(path.with_name("promotions.jsonl"))
    with pytest.raises(CatalogError, match=r"promotions|operational"):
        configurations.chosen("fakecal", {})


def test_experiments_are_listed_as_such_and_a_comparison_needs_events_of_both(run, fakecal, capsys):
    """Contract: products with their configurations, by their path below latest; an error that says what to run."""
    run()
    run("--set", "gain=3", "--as", "mine")
    listed = printed_json(capsys, "products", "list", "--as", "mine")
    assert sorted(one["configurations"] for one in listed) == [["mine"], ["mine", "operational"]]
    stage = next(one["product"] for one in listed if one["configurations"] == ["mine"]).partition("/")[2]
    key = printed_json(capsys, "history", f"fake-1/as/mine/{stage}")["record"]["key"]
    assert key == links("mine")["scale.one"] != links()["scale.one"]
    assert housekeeping.resolve(f"fake-1/{stage}").ref.key == links()["scale.one"]
    assert gravcal("compare", "fakecal", "operational", "mine") == 1  # its flow has no report
    assert "found 0 events of operational" in " ".join(capsys.readouterr().err.split())
    assert gravcal("compare", "fakecal", "operational", "other") == 1


def test_a_campaign_of_an_experiment_leaves_the_delivery(run, fakecal, pipeline, environment):
    """Contract: in workers of Dask; its settings are recorded."""
    run()
    before = links()
    pipeline.event(fakecal / "events", 1)
    words = ["campaign", "fakecal", "--data", fakecal / "events", "--set", "gain=3", "--engine", "inline"]
    command_line = [sys.executable, SCRIPT, *map(str, words), "--workers", "1"]
    subprocess.run(command_line, check=True, env=environment, capture_output=True)
    assert links() == before
    assert links("gain-3.0")
    assert configurations.names("fakecal") == ["gain-3.0"]


def test_settings_say_what_they_are_and_what_was_tried(run, capsys):
    """Contract: value, unit, reason of parameters; recorded configurations; one of either by name."""
    run("--set", "gain=3", "--as", "mine")
    assert gravcal("promote", "fakecal", "mine", "--why", "because") == 0
    document = printed_json(capsys, "settings", "fakecal")
    gain = document["parameters"]["gain"]
    assert (gain["value"], gain["catalogue"], gain["unit"], gain["reason"]) == (3.0, 2.0, "1", "invented")
    assert document["configurations"] == {"mine": {"gain": 3.0}}
    assert document["operational"]["why"] == "because"
    assert gain["stages"] == ["scale"]
    for one, text in ((), "invented"), (("gain",), "invented"), (("mine",), "3.0"):
        assert gravcal("settings", "fakecal", *one) == 0
        assert text in capsys.readouterr().out
    assert gravcal("settings", "fakecal", "nothing") == 1
    assert gravcal("settings") == 0
    assert "com_offset" in capsys.readouterr().out


def test_events_of_the_catalogue_say_whether_their_files_are_at_hand(tmp_path, monkeypatch, capsys):
    """Contract: name, calibration, date, folder or why not."""
    monkeypatch.setenv("GRAVCAL_DATA", str(tmp_path))
    (tmp_path / "ACC1A_2020-02-01_C_04.txt").write_text("")
    known = {row["event"]: row for row in printed_json(capsys, "events")}
    assert len(known) == len(catalog.names("events"))
    assert known["grace-c-2020-02-01"] | {"files": ""} == {
        "event": "grace-c-2020-02-01", "calibration": "com_offset", "date": "2020-02-01", "files": ""}  # fmt: skip
    assert known["grace-c-2020-02-01"]["files"] == str(tmp_path)
    assert known["grace-c-2018-07-29"]["files"] == "no data"
    assert known["taiji-1-2022-08"]["date"] == "unknown"
    assert [gravcal("events", name) for name in ("com_ofset", "com_offset")] == [2, 0]
    assert "kbr_phase_centre" not in capsys.readouterr().out
