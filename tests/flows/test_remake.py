"""Lineage: from a product down to the raw files, and back up again."""

import pytest

from flows.engine import remake
from gravcal.errors import ProductError
from gravcal.store import history, housekeeping


def entry(pipeline, part="join"):
    """Entry of one product of the pipeline."""
    return housekeeping.resolve(f"fake-1/{pipeline.name}.{part}")


def test_history_reaches_the_raw_files(pipeline):
    """Contract: the tree of a product ends in files with their SHA-256."""
    pipeline.run()
    node = history.tree(entry(pipeline))
    assert [inner["name"].rpartition(".")[2] for inner in node["inputs"]] == ["one", "other"]
    raw = node["inputs"][0]["inputs"][0]["inputs"][0]
    assert raw["name"] == str(pipeline.raw)
    assert len(raw["digest"]) == 64
    assert [one["path"] for one in history.raw_files(entry(pipeline).ref.key)] == [str(pipeline.raw)]


def test_a_product_is_made_again_equal(pipeline, store_folder):
    """Contract: from raw files, in another store, bit for bit; the store itself is not touched."""
    pipeline.run()
    before = sorted(path for path in store_folder.rglob("*"))
    outcome = remake(entry(pipeline))
    assert outcome["equal"]
    assert [one["verdict"] for one in outcome["stages"]] == ["equal"] * 4
    assert sorted(path for path in store_folder.rglob("*")) == before


def test_a_product_of_other_code_is_told_apart(pipeline):
    """Contract: which stage differs and which code changed."""
    pipeline.run()
    pipeline.replace("second.py", '["value"] * gain', '["value"] * gain + 1')
    outcome = remake(entry(pipeline))
    assert not outcome["equal"]
    found = {one["stage"].removeprefix(f"{pipeline.name}."): (one["verdict"], one["why"]) for one in outcome["stages"]}
    assert found["start"] == ("equal", "")
    assert found["scale.one"] == ("different", f"code changed: {pipeline.name}.second")


def test_a_changed_raw_file_is_refused(pipeline):
    """Contract: a rebuild is from the same bytes."""
    pipeline.run()
    pipeline.raw.write_text("xyz")
    with pytest.raises(ProductError, match="raw file changed"):
        remake(entry(pipeline))
    pipeline.raw.unlink()
    with pytest.raises(ProductError, match="not there any more"):
        remake(entry(pipeline))
