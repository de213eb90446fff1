"""Site of the documentation: `make docs` builds it into build/docs, without network."""

import re
from importlib.metadata import version as _version
from pathlib import Path

project = "gravcal"
author = "the gravcal contributors"
project_copyright = "the gravcal contributors, MIT licence"
version = release = _version("gravcal")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
nb_execution_mode = "cache"  # a notebook is executed again when its text changed
nb_execution_cache_path = str(Path(__file__).parent.parent / "build" / "notebooks")
nb_execution_raise_on_error = True
nb_execution_timeout = 600
napoleon_use_param = napoleon_use_rtype = False  # shapes and units are no types that could be looked up
autodoc_member_order = "bysource"
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
nitpicky = True
nitpick_ignore_regex = [("py:.*", r".*")]  # names inside docstrings lead nowhere

html_theme = "furo"
html_title = "gravcal"
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
pygments_style = "friendly"


HERE = Path(__file__).parent
PAGES = {"overview": "README.md", "changes": "CHANGELOG.md"}  # of the project's first folder, shown in the site
ELSEWHERE = {"](../README.md": "](overview.md", "](CHANGELOG.md": "](changes.md", "](docs/": "]("}


def _source(_app, name, source):
    """Show README and changes as pages, and let links lead to them."""
    text = (HERE.parent / PAGES[name]).read_text() if name in PAGES else source[0]
    if name == "index":
        text = _listed(text)
    for before, after in ELSEWHERE.items():
        text = text.replace(before, after)
    source[0] = text


def _listed(text):
    """First page without pages still to be written, and with those that it does not name, in the last list."""
    pages = {path.stem for path in HERE.glob("*.md")} - {"index"}
    lines = [line for line in text.splitlines() if not re.fullmatch(r"\w+", line) or line in pages]
    rest = sorted(pages - set(re.findall(r"^(?:.*<)?(\w+)>?$", "\n".join(lines), re.MULTILINE)))
    last = len(lines) - 1 - lines[::-1].index("```")
    return "\n".join(lines[:last] + rest + lines[last:]) + "\n"


def setup(app):
    """Register the hook."""
    app.connect("source-read", _source)
