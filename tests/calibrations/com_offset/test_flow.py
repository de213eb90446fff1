"""The flow of com_offset on invented files: what is delivered where."""

import json

import pytest
from independent import make_event

from flows import com_offset as flow
from flows import engine
from gravcal.store import configurations


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with one pitch and one roll, and its truth."""
    folder = tmp_path_factory.mktemp("flow") / "files"
    return folder, make_event(folder, 5, manoeuvres=[("pitch", "high"), ("roll", "high")], field_generation=14)


def run(folder, **settings):
    """Report product of a folder."""
    chosen = configurations.chosen("com_offset", settings)
    return engine.run(flow.calibrate, flow.CALIBRATION.source(data=folder), chosen, engine="inline")


def test_a_repeat_by_the_published_method_leaves_the_latest_result_in_place(files, tmp_path, monkeypatch):
    """Contract: latest/<event>/com_offset.report is ours; the repeat is an experiment."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path))
    ours, printed = run(files[0]), run(files[0], method="published")
    latest = tmp_path / "latest" / ours.event
    assert (latest / "com_offset.report").resolve() == ours.folder.resolve()
    assert (latest / "as" / "method-published" / "com_offset.report").resolve() == printed.folder.resolve()
    assert json.loads((printed.folder / "result.json").read_text())["method"] == "published"
    assert flow.CALIBRATION.document(ours)["roll_response"] is None  # with a manoeuvre it means nothing
