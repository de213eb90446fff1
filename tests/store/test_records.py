"""The record beside a product: whole and fitting its product, or set aside with the reason and made again."""

import copy
import functools
import operator
import shutil

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flows import command, engine
from gravcal.errors import ProductError
from gravcal.store import history, housekeeping, keys, product, store


def of(folder):
    """Record of a folder."""
    return copy.deepcopy(store.read_record(folder))


def seal(folder, record):
    """Write a record with the right checksum, as one would who knows how."""
    (folder / "meta.json").write_bytes(store.sealed(record))


def newest(pipeline, stage):
    """Folder of the newest product of a stage."""
    return dict((link.name, folder) for link, folder in store.links())[f"{pipeline.name}.{stage}"]


def reason(store_folder):
    """Why something was set aside, the only one."""
    (why,) = (store_folder / "quarantine").rglob("*.txt")
    return why.read_text()


EDITS = {
    "a letter": (lambda text: text.replace(b'"seconds"', b'"Seconds"'), "checksum"),
    "half of it": (lambda text: text[: len(text) // 2], "checksum"),
    "no text": (lambda _: b"\xff\xfe", "checksum"),
    "without checksum": (lambda text: text[: text.rindex(store.SEAL)] + b"}", "checksum"),
}


@pytest.mark.parametrize("edit", EDITS)
def test_an_edited_record_is_set_aside_and_made_again(pipeline, store_folder, edit):
    """Contract: any edit without the checksum; verify finds it, the next run makes the same product."""
    _, ref = pipeline.run()
    folder, (change, expected) = newest(pipeline, "scale.one"), EDITS[edit]
    (folder / "meta.json").write_bytes(change((folder / "meta.json").read_bytes()))
    assert [(path, expected in text) for path, text in housekeeping.verify()] == [(folder, True)]
    assert pipeline.run() == (["scale.one"], ref)
    assert expected in reason(store_folder)
    assert housekeeping.verify() == []


altered = lambda record: record["recipe"]["settings"].update(gain=7.0)  # noqa: E731
FORGED = {
    "settings altered": (altered, "not that of its recipe"),
    "event altered": (lambda r: r["recipe"].update(event="other"), "not that of its recipe"),
    "settings and key": (lambda r: (altered(r), r.update(key=keys.key(r["recipe"]))), "another key"),
    "digest altered": (lambda r: r.update(digest="0" * 64), "another product"),
    "no place of the key": (lambda r: r.update(labels_at=[]), "another product"),
    "place before the file": (lambda r: r.update(labels_at=[-5, -5]), "another product"),
    "an input too few": (lambda r: r.update({"from": []}), "inputs"),
    "a file elsewhere": (lambda r: r.update(files={"../../x": "0" * 64}), "record.files"),
    "no digest": (lambda r: r.pop("digest"), '"digest" is a required'),
}


@pytest.mark.parametrize("forgery", FORGED)
def test_a_forged_record_with_a_right_checksum_is_set_aside(pipeline, store_folder, forgery):
    """Contract: wrong inner types, altered settings, inputs and digests; verify finds each, and it is made again."""
    _, ref = pipeline.run()
    folder, (change, expected) = newest(pipeline, "scale.one"), FORGED[forgery]
    record = of(folder)
    change(record)
    seal(folder, record)
    ((path, found),) = housekeeping.verify()
    assert path == folder
    assert expected in found
    assert engine.plan(pipeline.module("flow").calibrate, pipeline.file(), pipeline.chosen)[0][1].action == "run"
    assert pipeline.run() == (["scale.one"], ref)
    assert expected in reason(store_folder)


@pytest.mark.parametrize("rewritten", ["nothing", "key", "key and recipe", "key, recipe and product"])
def test_a_foreign_product_is_set_aside(pipeline, store_folder, rewritten):
    """Contract: another product under this key, with more and more of its record rewritten to fit."""
    _, ref = pipeline.run()
    folder, other = newest(pipeline, "scale.one"), newest(pipeline, "scale.other")
    own, record = of(folder), of(other)
    shutil.rmtree(folder)
    shutil.copytree(other, folder)
    if rewritten != "nothing":
        record["key"] = own["key"]
    if "recipe" in rewritten:
        record |= {"recipe": own["recipe"], "from": own["from"]}
    if "product" in rewritten:
        record["digest"] = own["digest"]
    seal(folder, record)
    ((path, _),) = housekeeping.verify()
    assert path == folder
    assert pipeline.run() == (["scale.one"], ref)
    assert ("another product" in reason(store_folder)) == ("recipe" in rewritten)


def test_a_product_named_in_place_of_an_input_is_found(pipeline):
    """Contract: by verify; what an input was stands in the key, where it lay does not."""
    pipeline.run()
    folder = newest(pipeline, "join")
    record = of(folder)
    record["from"].reverse()
    seal(folder, record)
    assert housekeeping.verify() == [(folder, "the record names another product than one that it was made of")]


@pytest.mark.parametrize("label", ["gravcal_key", "gravcal_recipe", "gravcal_digest"])
def test_labels_in_the_product_that_contradict_the_record_are_found(pipeline, monkeypatch, label):
    """Contract: verify compares key, recipe and digest that the file itself bears beside what the record says."""
    said = product.provenance
    with monkeypatch.context() as patched:
        patched.setattr(product, "provenance", lambda *of: said(*of) | {label: "x", "source": "".join(of[1:3])})
        pipeline.run()
    found = housekeeping.verify()
    assert {path for path, _ in found} == set(housekeeping.folders())
    assert {text for _, text in found} == {f"{label} in product.nc differs from the record"}


words = st.text("a0/.\x00\u00e4", max_size=5)
leaves = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | words
inner = leaves | st.lists(leaves, max_size=2)
plain = leaves | st.lists(leaves, max_size=3) | st.dictionaries(words, inner, max_size=3)
slow = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large]


def places(value, path=()):
    """Every place in a JSON value."""
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, one in inner:
        yield from places(one, (*path, name))


@settings(max_examples=20, deadline=None, suppress_health_check=slow)
@given(data=st.data())
def test_no_record_is_a_traceback_or_another_product(pipeline, store_folder, data):
    """Fuzz: any part replaced or removed, or any byte of the text, with and without the right checksum."""
    _, expected = pipeline.run()
    folder = newest(pipeline, data.draw(st.sampled_from(["start", "scale.one", "join"])))
    record, whole = of(folder), (folder / "meta.json").read_bytes()
    if data.draw(st.booleans()):
        known = list(places(record))[1:]
        path = known[data.draw(st.integers(0, 10**6)) % len(known)]
        inner = functools.reduce(operator.getitem, path[:-1], record)
        if data.draw(st.booleans()):
            del inner[path[-1]]
        else:
            inner[path[-1]] = data.draw(plain)
        seal(folder, record)
    else:
        at, byte = data.draw(st.integers(0, 10**6)) % len(whole), data.draw(st.integers(0, 255))
        (folder / "meta.json").write_bytes(whole[:at] + bytes([byte]) + whole[at + 1 :])
    housekeeping.verify()
    for entry in housekeeping.entries(newest_only=False):
        history.tree(entry)
        history.other_versions(entry.ref)
    housekeeping.prune(0.0)
    engine.plan(pipeline.module("flow").calibrate, pipeline.file(), pipeline.chosen)
    made, ref = pipeline.run()
    assert ref == expected
    assert np.isfinite(store.load(ref)["value"].values).all()
    shutil.rmtree(store_folder / "objects")  # what may be changed unseen, such as the machine's name, stays with it


@pytest.mark.parametrize("pruned", [False, True])
@pytest.mark.parametrize("which", ["product.nc", "meta.json", "report.html", "folder", "shelf"])
def test_a_link_that_leads_out_of_the_store_is_not_followed(store_folder, tmp_path, which, pruned):
    """Contract: each part of a product as a link to the same thing elsewhere; what is elsewhere stays as it is."""
    recipe = {"event": "e", "kind": "k", "variant": "", "version": 1, "settings": {}, "inputs": [], "code": ""}
    facts = {"seconds": 0.0, "modules": {}, "from": [], "stage": "", "versions": {}}
    data = product.settled(xr.Dataset({"value": ("row", np.ones(3), {"units": "1"})}))
    ref = store.put(keys.key(recipe), recipe, (data, {"report.html": "page"}), facts)
    folder, outside = ref.folder, tmp_path / "outside"
    path = {"folder": folder, "shelf": folder.parent}.get(which, folder / which)
    path.rename(outside)
    path.symlink_to(outside)
    before = sorted(outside.rglob("*"))
    assert [text for _, text in housekeeping.verify() if "link" in text or "follow" in text]
    if pruned:
        housekeeping.prune(-1.0, remove=True)
    else:
        assert (store.load(ref) is None) == (which != "report.html")
        assert store.find(ref.key) is None
        assert "link" in reason(store_folder)
    assert pruned == (path.is_symlink() and which == "shelf") or not path.is_symlink()
    assert sorted(outside.rglob("*")) == before
    assert store.put(ref.key, recipe, (data, {"report.html": "page"}), facts).digest == ref.digest


def test_a_readable_link_that_leads_elsewhere_is_not_followed(pipeline, store_folder, tmp_path):
    """Contract: report, plan, history and prune take no foreign folder for a product; verify names the link."""
    _, ref = pipeline.run()
    foreign = tmp_path / "foreign"
    shutil.copytree(ref.folder, foreign)
    (foreign / "report.html").write_text("foreign")
    for target in (foreign, ref.folder, foreign / ref.key, "..", "../../..", "../../objects"):
        link = store_folder / "latest" / "strange" / "com_offset.report"
        link.parent.mkdir(exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(target)
        assert store.linked(link) is None
        assert housekeeping.verify() == [(link, "a link that leads to no product of this store; it is not followed")]
        for event in ("strange", "", "/", "..", "*", "../../foreign"):
            with pytest.raises(ProductError, match="there is no report"):
                command.report_files(event, None)
        assert store.newest_record("strange", "com_offset.report") is None
        assert link.name not in {entry.ref.stage for entry in housekeeping.entries()}
    assert history.last_run("strange", "com_offset") is None
