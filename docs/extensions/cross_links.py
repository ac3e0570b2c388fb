"""Links from Python names of other libraries to their own documentation, without fetching its inventory."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from docutils import nodes

if TYPE_CHECKING:
    from sphinx.addnodes import pending_xref
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

PAGES = {
    "numpy.typing": "https://numpy.org/doc/stable/reference/typing.html#{name}",
    "numpy": "https://numpy.org/doc/stable/reference/generated/{name}.html",
    "scipy": "https://docs.scipy.org/doc/scipy/reference/generated/{name}.html",
    "xarray": "https://docs.xarray.dev/en/stable/generated/{name}.html",
    "pandas": "https://pandas.pydata.org/docs/reference/api/{name}.html",
    "pathlib": "https://docs.python.org/3/library/pathlib.html#{name}",
    "collections.abc": "https://docs.python.org/3/library/collections.abc.html#{name}",
}
"""Page of a name by its package, or by the module that is documented on one page."""
SHORT = {
    "ArrayLike": "numpy.typing.ArrayLike",
    "NDArray": "numpy.typing.NDArray",
    "Path": "pathlib.Path",
}
"""Names that modules import without their package."""
ALIASES = {"np": "numpy", "pd": "pandas", "xr": "xarray"}
"""Packages by the name under which they are imported."""


def link(
    _app: Sphinx, _env: BuildEnvironment, node: pending_xref, content: nodes.TextElement
) -> nodes.Node | None:
    """Return a link for a name that these pages lack; None if no listed library has it."""
    page = find_page(node.get("reftarget", ""))
    return page and nodes.reference("", "", content, refuri=page, internal=False)


def find_page(name: str) -> str | None:
    """Return the address of a name's page in its library's documentation; None if unknown."""
    package, dot, rest = SHORT.get(name, name).partition(".")
    name = ALIASES.get(package, package) + dot + rest
    home = next((package for package in PAGES if name.startswith(package + ".")), None)
    return PAGES[home].format(name=name) if home and _exists(name) else None


def _exists(name: str) -> bool:
    module, _, word = name.rpartition(".")
    try:
        return hasattr(import_module(module), word)
    except ImportError:
        return False


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the links."""
    app.connect("missing-reference", link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
