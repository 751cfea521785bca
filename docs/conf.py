"""How the site is made from docs/, notebooks/, the docstrings and the command line.

Built by `sh scripts/docs`.

The root of the sources is the checkout, so that links between documents, notebooks and programs are
the same here and where code is hosted.
"""

import sys
import tomllib
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from reference_pages import FACES, MADE  # noqa: E402
from sphinx.pycode import ModuleAnalyzer  # noqa: E402

project = "bayes_toe"
version = release = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "version"
]
root_doc = "docs/index"
include_patterns = [
    "docs/*.md",
    "notebooks/*.ipynb",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "tests/reference/README.md",
]
exclude_patterns = [".*", "build", "results", "bayes_toe_results"]

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
default_role = "code"

# --- documents and notebooks ----------------------------------------------------------------------
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True
nb_render_image_options = {
    "width": "100%"
}  # what has a width is a link to its full size; site.css leaves small ones as they are

# --- docstrings -----------------------------------------------------------------------------------
autosummary_generate = False
autodoc_typehints = "none"  # docstrings say types, with shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_param = napoleon_use_rtype = False

# --- what it looks like ---------------------------------------------------------------------------
html_theme = "furo"
html_title = "bayes_toe"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["_root"]  # its index.html leads to docs/index.html
html_copy_source = False
html_show_sphinx = html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}

linkcheck_timeout = 20


def _filled(_app, docname, source):
    """What stands in a document for what is made from the code."""
    for place, make in MADE.items():
        if place in source[0]:
            source[0] = source[0].replace(place, make())


def _public(app, env, node, contnode):
    """Docstrings name things by where they are defined.

    The site has them under the names that a user types.
    """
    module, _, name = node.get("reftarget", "").rpartition(".")
    for face in FACES:
        package = import_module(face)
        if (
            name in package.__all__
            and getattr(getattr(package, name), "__module__", None) == module
        ):
            known = f"{face}.{name}"
            said = contnode.astext().replace(f"{module}.{name}", known)
            return env.get_domain("py").resolve_xref(
                env, node["refdoc"], app.builder, "obj", known, node, type(contnode)("", said)
            )
    return None


def _described(_app, what, name, _value, _options, lines):
    """A value has the comment of the module that defines it; its type's docstring says nothing."""
    if what != "data":
        return
    face, _, short = name.rpartition(".")
    for module in [module for module in sys.modules if module.startswith(f"{face}.")]:
        comment = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", short))
        if comment:
            lines[:] = comment
            return


def setup(app):
    """Called by Sphinx."""
    app.connect("source-read", _filled)
    app.connect("missing-reference", _public)
    app.connect("autodoc-process-docstring", _described)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
