"""How Sphinx builds the pages: from Markdown, without a request to anybody, neither now nor when they are read."""

from __future__ import annotations

import os
import re
import sys
import tomllib
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))

_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = str(_PROJECT["name"])
release = str(_PROJECT["version"])
html_title = f"{project} {release}"

extensions = ["myst_parser", "docs.mathml"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3  # links to headings are checked, as those to pages and files are
nitpicky = True
highlight_language = "none"  # what is not marked is output

html_theme = "furo"
html_static_path = ["style"]
html_css_files = ["pages.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_show_sourcelink = False

# Pages of the project's root, where readers of a repository look for them.
FROM_THE_ROOT = {"readme": "README.md", "contributing": "CONTRIBUTING.md", "changelog": "CHANGELOG.md"}


def setup(app: Sphinx) -> None:
    """Sphinx calls this."""
    app.connect("source-read", _take_from_the_root)


def _take_from_the_root(app: Sphinx, page: str, source: list[str]) -> None:
    """Put a file of the root in place of its page, with links as they are seen from here."""
    if page not in FROM_THE_ROOT:
        return
    pages = {file: f"{name}.md" for name, file in FROM_THE_ROOT.items()}
    app.env.note_dependency(str(ROOT / FROM_THE_ROOT[page]))
    source[0] = re.sub(
        r"\]\((?!\w+:|#)([^)#]+)",
        lambda link: "](" + pages.get(link[1], os.path.relpath(ROOT / link[1], DOCS)),
        (ROOT / FROM_THE_ROOT[page]).read_text(encoding="utf-8"),
    )
