"""The record of the last run of each event."""

import pytest

from flows import engine
from gravcal.store import history


def run(pipeline, **changes):
    """Run the invented flow through the engine, inline."""
    return engine.run(pipeline.module("flow").calibrate, pipeline.file(), pipeline.chosen | changes, engine="inline")


def states(pipeline):
    """State of each stage in the last run."""
    record = history.last_run("fake-1", pipeline.name)
    return {stage.removeprefix(f"{pipeline.name}."): one["state"] for stage, one in record["stages"].items()}


def test_a_run_says_what_it_made_and_what_it_reused(pipeline):
    """Contract: made at first; with another gain only what depends on it; then nothing."""
    run(pipeline)
    assert states(pipeline) == dict.fromkeys(("start", "scale.one", "scale.other", "join"), "made")
    run(pipeline, gain_one=2.0)
    assert states(pipeline) == {"start": "reused", "scale.one": "made", "scale.other": "reused", "join": "made"}
    run(pipeline, gain_one=2.0)
    assert set(states(pipeline).values()) == {"reused"}


def test_a_failed_run_is_recorded_with_its_reason(pipeline):
    """Contract: the stages that were done, status and error; the error goes on."""
    pipeline.replace("second.py", "return first.assign", "raise ValueError('no mean')\n    return first.assign")
    with pytest.raises(ValueError, match="no mean"):
        run(pipeline)
    record = history.last_run("fake-1", pipeline.name)
    assert (record["status"], record["error"]) == ("failed", "ValueError: no mean")
    assert "join" not in states(pipeline)
    assert record["failed"] == f"{pipeline.name}.join"
    assert [one["event"] for one in history.runs()] == ["fake-1"]


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
