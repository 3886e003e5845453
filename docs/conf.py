"""The documentation as a site: `make docs` builds it into build/site and fails where a link leads nowhere."""

from __future__ import annotations

import sys
from pathlib import Path

import flashtemp

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project, author, release = "flashtemp", "the flashtemp developers", flashtemp.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["_build", "**.ipynb_checkpoints"]

html_theme, html_title = "furo", f"flashtemp {release}"
html_theme_options = {"sidebar_hide_name": False}

myst_enable_extensions = ["colon_fence", "dollarmath", "attrs_block"]
myst_heading_anchors = 3
copybutton_exclude = ".linenos, .gp, .go"

nb_execution_mode, nb_execution_timeout, nb_execution_raise_on_error = "force", 300, True

autodoc_typehints, autodoc_member_order, default_role = "description", "bysource", "code"
autodoc_typehints_description_target = "documented"


def setup(app) -> None:
    """What is made from the code is written before Sphinx looks for pages."""
    import reference_pages

    app.connect("config-inited", lambda *_: reference_pages.write(HERE))
