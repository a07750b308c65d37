"""How Sphinx builds the site: `./wherry docs`."""

import re
from importlib.metadata import version as version_of

from sphinx.application import Sphinx

project = "wherry"
author = "The wherry developers"
copyright = "The wherry developers"  # noqa: A001 - Sphinx's name for it
version = release = version_of("wherry")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
templates_path = ["_templates"]
exclude_patterns = ["examples", "site"]

html_theme = "furo"
html_title = "wherry"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

# Notebooks are run when the site is built; one that fails fails the build.
nb_execution_mode = "cache"
nb_execution_cache_path = "../site/.jupyter_cache"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

# The reference is made from the docstrings; what only a robot or a desktop has is not needed for that.
autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
python_maximum_signature_line_length = 100
autodoc_mock_imports = ["rospy", "cyclonedds", "rosbags", "minigrid", "unified_planning", "yag_slam", "efficient_rl"]
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_custom_sections = [("Beyond amcl", "Attributes")]
suppress_warnings = ["ref.python"]  # a type of the same name in two modules: the page shows the right one

# The docstrings are plain text: the paper's * and | are signs there, not markup.
SIGNS_OUTSIDE_CODE = re.compile(r"(``.*?``)|([*|])")


def escape_signs(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Escape * and | wherever they are not code."""
    lines[:] = [SIGNS_OUTSIDE_CODE.sub(lambda match: match[1] or "\\" + match[2], line) for line in lines]
    if (
        what == "property"
    ):  # "Never: it is sure" is a sentence here; napoleon takes what stands before the colon for a type
        app.env.temp_data[name] = list(lines)


def keep_sentences(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Give properties their text back as it was."""
    if what == "property":
        lines[:] = app.env.temp_data.pop(name)


def setup(app: Sphinx) -> None:
    """Sphinx calls this when it starts."""
    app.connect("autodoc-process-docstring", escape_signs, priority=100)  # before the sections are read
    app.connect("autodoc-process-docstring", keep_sentences, priority=900)
