"""Plans: what would be reused or made, and why, without making anything; and what a run then makes."""

import pytest

from flows import engine
from gravcal.errors import ProductError
from gravcal.store import history, housekeeping, keys, location

ALL = ["start", "scale.one", "scale.other", "join"]


def plan(pipeline, **changes):
    """Actions and reasons by stage."""
    steps, _ = engine.plan(pipeline.module("flow").calibrate, pipeline.file(), pipeline.chosen | changes)
    return {step.stage.removeprefix(f"{pipeline.name}."): (step.action, *step.reasons) for step in steps}


def test_a_plan_of_nothing_made_yet(pipeline):
    """Contract: everything was never made, and planning makes nothing."""
    assert set(plan(pipeline).values()) == {("run", "never made")}
    assert housekeeping.folders() == []


#: What is changed: settings or (file, old, new); what the plan says of some stages; what a run then makes.
CHANGES = {
    "setting": ({"gain_one": 0.7}, {"scale.one": ("run", "gain: 1.0 -> 0.7")}, ["scale.one", "join"]),
    "file": (("raw", "abc", "abcd"), {"start": ("run", "input file MAG1B_2020-02-01_C_04.txt changed")}, ALL),
    "helper": (
        ("helper.py", "FACTOR * values", "FACTOR * values + 1"),
        {"start": ("run", "code changed: {name}.helper")},
        ALL,
    ),
    "science": (
        ("second.py", '["value"] * gain', '["value"] * gain + 1'),
        {n: ("run", "code changed: {name}.second") for n in ("scale.one", "scale.other", "join")},
        ALL[1:],
    ),
    "body": (("stages.py", "second.scaled(started, gain)", "second.scaled(started, -gain)"), {}, ALL[1:]),
    "version": (
        ("stages.py", '{name}.join", version=1', '{name}.join", version=2'),
        {"join": ("run", "version 1 -> 2")},
        ["join"],
    ),
    "comment": (("helper.py", "# a comment", "# another comment"), {}, []),
    "docstring": (("helper.py", '"""Twice."""', '"""Two times."""'), {}, []),
    "layout": (("helper.py", "FACTOR * values", "(FACTOR  *  values)"), {}, []),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_named_by_the_plan_and_makes_its_dependants_only(pipeline, change):
    """Contract: file, helper, science module, body and version are each part of the key; comments are no code.

    A setting with both values; below it, what may have to run.
    """
    pipeline.run()
    what, said, made = CHANGES[change]
    if change == "file":
        pipeline.raw.write_text(what[2])
    elif change != "setting":
        pipeline.replace(*(part.replace("{name}", pipeline.name) for part in what))
    settings = what if change == "setting" else {}
    found = plan(pipeline, **settings)
    for stage, reasons in said.items():
        assert found[stage] == tuple(one.replace("{name}", pipeline.name) for one in reasons)
    assert {stage for stage, (action, *_) in found.items() if action == "reuse"} == set(ALL) - set(made)
    if change == "setting":
        assert found["join"] == ("may run", f"after {pipeline.name}.scale.one")
    assert pipeline.run(**settings)[0] == made


def test_a_changed_data_file_is_named(pipeline, forget):
    """Contract: files beside the code that a module names, those they name, and one that comes; not those of others."""
    read = 'sum(len(path.read_text()) for path in Path(__file__).parent.glob("*.csv"))'
    pipeline.replace("helper.py", "FACTOR = 2.0", f"from pathlib import Path\nFACTOR = {read}")
    for name, text in (("one.csv", "1, see two.dat"), ("two.dat", "2"), ("other.dat", "3")):
        (pipeline.folder / name).write_text(text)
    pipeline.run()
    for name, text in (("one.csv", "2, see two.dat"), ("two.dat", "4"), ("new.csv", "5")):
        (pipeline.folder / name).write_text(text)
        forget()
        assert plan(pipeline)["start"] == ("run", f"data changed: {pipeline.name}/{name}")
        assert pipeline.run()[0][0] == "start"
    (pipeline.folder / "other.dat").write_text("6")
    forget()
    assert set(plan(pipeline).values()) == {("reuse",)}
    (pipeline.folder / "one.csv").write_text("under way")
    said = "one.csv: the code, or data that it reads, changed while this process was running"
    with pytest.raises(ProductError, match=said):
        plan(pipeline)


def test_a_changed_input_is_named(pipeline):
    """Contract: once the input was made anew, what reads it says so."""
    pipeline.run()
    from tasks.stage import inline, using

    stages = pipeline.module("stages")
    with using(inline):
        stages.start(pipeline.file(), event="fake-1", variant="", count=5, offset=0.0)
    assert plan(pipeline, count=5)["scale.one"] == ("run", f"input {pipeline.name}.start changed")


def test_products_of_other_versions_are_said_and_made_again_when_wanted(pipeline, monkeypatch, capsys):
    """Contract: plan, run and journal name them; the setting makes them again, once; only what computes counts."""
    here, library = keys.versions(), "numba"
    with monkeypatch.context() as patched:
        others = {library: "0.1", "xarray": "0.1", "python": "2.7", "gravcal": "0.0"}
        patched.setattr(keys, "versions", lambda: here | others)
        _, ref = pipeline.run()
    arguments, said = (pipeline.file(), pipeline.chosen), f"made by {library} 0.1, here {here[library]}"
    assert set(plan(pipeline).values()) == {("reuse", said)}
    assert engine.run(pipeline.module("flow").calibrate, *arguments, engine="inline") == ref
    assert f"products reused: 4 {said}. GRAVCAL_REMAKE_VERSIONS=1" in capsys.readouterr().err.replace("\n", " ")
    stages = history.last_run("fake-1", pipeline.name)["stages"].values()
    assert [one["other_versions"] for one in stages] == 4 * [[said]]
    monkeypatch.setenv("GRAVCAL_REMAKE_VERSIONS", "1")
    assert plan(pipeline)["start"] == ("run", said)
    assert pipeline.run() == (ALL, ref)
    assert pipeline.run() == ([], ref)
    assert set(plan(pipeline).values()) == {("reuse",)}
    reasons = {read.read_text() for read in (location.folder() / "quarantine").glob("*/why.txt")}
    assert reasons == {"made again, for other versions had made it\n"}


def test_a_plan_ends_where_the_flow_needs_a_content(pipeline):
    """Contract: a flow that looks into a product cannot be planned beyond it."""
    pipeline.replace("flow.py", "    one =", "    read(started)\n    one =")
    known = "from flows.engine import flow"
    pipeline.replace("flow.py", known, f"{known}\nfrom tasks.stage import read")
    assert plan(pipeline) == {"start": ("run", "never made"), "(the rest)": ("may run", f"after {pipeline.name}.start")}
    pipeline.run()
    assert set(plan(pipeline).values()) == {("reuse",)}


@pytest.mark.parametrize("same", [True, False])
def test_code_that_changed_under_a_running_process_is_refused(pipeline, same):
    """Contract: the label must name the code that ran; a long-lived process says that it has to start again."""
    pipeline.run()
    path = pipeline.folder / "helper.py"
    path.write_text(path.read_text().replace("2.0", "2.0" if same else "3.0") + "\n")
    with pytest.raises(ProductError, match="changed while this process was running.*Start gravcal again"):
        pipeline.run()
