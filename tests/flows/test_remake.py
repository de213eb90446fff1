"""Lineage: from a product down to the raw files and back up again; the record of the last run of each event."""

import pytest

from flows import engine
from flows.engine import remake
from gravcal.errors import ProductError
from gravcal.store import history, housekeeping


def entry(pipeline, part="join"):
    """Entry of one product of the pipeline."""
    return housekeeping.resolve(f"fake-1/{pipeline.name}.{part}")


def test_history_reaches_the_raw_files_and_a_product_is_made_again_equal(pipeline, store_folder):
    """Contract: the tree ends in files with their SHA-256; from them in another store bit for bit, ours untouched."""
    pipeline.run()
    node = history.tree(entry(pipeline))
    assert [inner["name"].rpartition(".")[2] for inner in node["inputs"]] == ["one", "other"]
    raw = node["inputs"][0]["inputs"][0]["inputs"][0]
    assert raw["name"] == str(pipeline.raw)
    assert len(raw["digest"]) == 64
    assert [one["path"] for one in history.raw_files(entry(pipeline).ref.key)] == [str(pipeline.raw)]
    before = sorted(path for path in store_folder.rglob("*"))
    outcome = remake(entry(pipeline))
    assert outcome["equal"]
    assert [one["verdict"] for one in outcome["stages"]] == ["equal"] * 4
    assert sorted(path for path in store_folder.rglob("*")) == before


def test_a_product_of_other_code_or_of_another_raw_file_is_told_apart(pipeline):
    """Contract: which stage differs and which code changed; a rebuild is from the same bytes."""
    pipeline.run()
    pipeline.replace("second.py", '["value"] * gain', '["value"] * gain + 1')
    outcome = remake(entry(pipeline))
    assert not outcome["equal"]
    found = {one["stage"].removeprefix(f"{pipeline.name}."): (one["verdict"], one["why"]) for one in outcome["stages"]}
    assert found["start"] == ("equal", "")
    assert found["scale.one"] == ("different", f"code changed: {pipeline.name}.second")
    pipeline.raw.write_text("xyz")
    with pytest.raises(ProductError, match="raw file changed"):
        remake(entry(pipeline))
    pipeline.raw.unlink()
    with pytest.raises(ProductError, match="not there any more"):
        remake(entry(pipeline))


def run(pipeline, **changes):
    """Run the invented flow through the engine, inline."""
    return engine.run(pipeline.module("flow").calibrate, pipeline.file(), pipeline.chosen | changes, engine="inline")


def states(pipeline):
    """State of each stage in the last run."""
    record = history.last_run("fake-1", pipeline.name)
    return {stage.removeprefix(f"{pipeline.name}."): one["state"] for stage, one in record["stages"].items()}


def test_a_run_says_what_it_made_and_what_it_reused_or_where_it_failed(pipeline):
    """Contract: made at first; with another gain only what depends on it; then nothing; a failure with its reason."""
    run(pipeline)
    assert states(pipeline) == dict.fromkeys(("start", "scale.one", "scale.other", "join"), "made")
    run(pipeline, gain_one=2.0)
    assert states(pipeline) == {"start": "reused", "scale.one": "made", "scale.other": "reused", "join": "made"}
    run(pipeline, gain_one=2.0)
    assert set(states(pipeline).values()) == {"reused"}
    pipeline.replace("second.py", "return first.assign", "raise ValueError('no mean')\n    return first.assign")
    pipeline.chosen["event"] = "fake-2"
    with pytest.raises(ValueError, match="no mean"):
        run(pipeline)
    record = history.last_run("fake-2", pipeline.name)
    assert (record["status"], record["error"]) == ("failed", "ValueError: no mean")
    assert (f"{pipeline.name}.join" in record["stages"], record["failed"]) == (False, f"{pipeline.name}.join")
    assert {one["event"] for one in history.runs()} == {"fake-1", "fake-2"}


def test_a_failed_attempt_stands_beside_the_last_delivered_run(pipeline, tmp_path):
    """Contract: another folder fails; what was delivered before keeps its state, and the next run replaces both."""
    pipeline.replace("second.py", '["value"] * gain', '["value"] * [gain][dataset["value"].size - 7]')
    run(pipeline)
    before = history.last_run("fake-1", pipeline.name)
    own, pipeline.raw = pipeline.raw, tmp_path / "elsewhere.txt"
    pipeline.raw.write_text("abcd")
    for _ in range(2):
        with pytest.raises(IndexError):
            run(pipeline)
        record = history.last_run("fake-1", pipeline.name)
        attempt = record.pop("attempt")
        assert record == before
        assert (attempt["status"], attempt["failed"]) == ("failed", f"{pipeline.name}.scale.one")
        assert "attempt" not in attempt
        assert history.failure("fake-1", pipeline.name)["failed_key"] == attempt["failed_key"] is not None
    pipeline.raw = own
    run(pipeline)
    assert "attempt" not in history.last_run("fake-1", pipeline.name)


def test_a_store_that_cannot_be_written_and_a_broken_record_are_no_error(store_folder):
    """Contract: the journal never stops a run, and reads only whole records."""
    store_folder.mkdir()
    (store_folder / "runs").write_text("a file where the folder would be")
    with history.recorded("flow", "event"):
        pass
    assert history.last_run("event", "flow") is None
    (store_folder / "runs").unlink()
    (store_folder / "runs").mkdir()
    (store_folder / "runs" / "event.flow.json").write_text("{")
    assert history.runs() == []
