"""What the pages of all reports share."""

from gravcal.report.pages import traced


def test_tables_and_figures_name_their_products_with_the_digests():
    """Contract: each product of a source, those that the provenance does not list without a digest, none left alone."""
    sections = [{"title": "one", "tables": [{"source": "a.b, a.c"}, {"source": ""}], "figures": [{"source": "a.x"}]}]
    found = traced(sections, {"a.b": "0123", "a.c": "4567"})[0]
    assert [one["source"] for one in found["tables"] + found["figures"]] == ["a.b 0123, a.c 4567", "", "a.x"]
    assert found["title"] == "one"
