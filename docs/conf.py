"""Configuration of Sphinx, which builds the site: `./wherry docs`."""

import ast
import importlib
import inspect
import re
from importlib.metadata import version as version_of
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

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

# Notebooks are run when the site is built; an error in one fails the build.
nb_execution_mode = "cache"
nb_execution_cache_path = "../site/.jupyter_cache"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

# The reference documents the names in the `__all__` of each package; optional dependencies are mocked.
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
suppress_warnings = [
    "ref.python",  # types that have the same name in two packages
    "config.cache",  # a function in autosummary_context cannot be pickled
]

# Docstrings are plain text, in which * and | are symbols of the paper and not markup.
SYMBOLS_OUTSIDE_CODE = re.compile(r"(``.*?``)|([*|])")


def constants_of(package: str) -> list[tuple[str, list[str]]]:
    """Name and docstring of each constant and type alias that a package exports, which autodoc does not list."""
    module = importlib.import_module(package)
    stub = Path(module.__file__ or "").with_suffix(".pyi")
    if not stub.exists():
        return []
    constants = []
    for statement in ast.parse(stub.read_text("utf-8")).body:
        if isinstance(statement, ast.ImportFrom):
            documented = ModuleAnalyzer.for_module(f"{package}.{statement.module}").find_attr_docs()
            for alias in statement.names:
                exported = getattr(module, alias.name)
                if not inspect.isclass(exported) and not inspect.isroutine(exported):
                    lines = documented.get(("", alias.name), [])
                    constants.append((alias.name, [escaped(line) for line in lines]))
    return sorted(constants)


autosummary_context = {"constants_of": constants_of}


def escaped(line: str) -> str:
    """The line with * and | escaped outside code."""
    return SYMBOLS_OUTSIDE_CODE.sub(lambda match: match[1] or "\\" + match[2], line)


def escape_symbols(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Escape * and | outside code."""
    lines[:] = [escaped(line) for line in lines]
    if what == "property":  # napoleon would read the part of a sentence before a colon as a type
        app.env.temp_data[name] = list(lines)


def restore_properties(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Restore the text of properties, which napoleon has parsed."""
    if what == "property":
        lines[:] = app.env.temp_data.pop(name)


def setup(app: Sphinx) -> None:
    """Connect the handlers; called by Sphinx."""
    app.connect("autodoc-process-docstring", escape_symbols, priority=100)  # before napoleon
    app.connect("autodoc-process-docstring", restore_properties, priority=900)  # after napoleon
