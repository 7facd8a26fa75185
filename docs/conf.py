"""The site: `make docs`. Pages are Markdown; the reference of case files and that of Python are made from the code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import jupytext
from docutils import nodes
from latex2mathml.converter import convert
from sphinx.ext.napoleon import Config, GoogleDocstring

import ngfsi
from ngfsi.case import Case
from ngfsi.config.describe import json_schema
from ngfsi.config.model import ConfigModel
from ngfsi.config.reference import reference

ROOT = Path(__file__).parents[1]

project, author, release = "ngfsi", "The ngfsi developers", ngfsi.__version__
copyright = author
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton"]
source_suffix = {".md": "markdown"}
html_theme, html_title = "furo", "ngfsi"
html_show_sourcelink = False
html_math_renderer = "mathml"
myst_enable_extensions = ["attrs_block", "attrs_inline", "dollarmath"]
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "exclude-members": "model_config, model_post_init"}
default_role = "code"
BESIDE = {"contributing": "CONTRIBUTING.md", "changes": "CHANGELOG.md"}
"""Pages that are files beside docs/."""
PARTS = ("sensitivity/runs", "stocking_design/design", "stocking_design/compared", "stocking_design/confirmed")
"""Pages to which a report alone leads."""


def read(_: Any, page: str, source: list[str]) -> None:
    """Make the pages that are not in docs/, and mend the links to and from them."""
    text = source[0]
    if page in BESIDE:
        text = (ROOT / BESIDE[page]).read_text(encoding="utf-8").replace("](docs/", "](")
    if page.startswith("tutorials/"):
        text = tutorial(ROOT / "docs" / page)
    if page == "case_file":
        text += f"\n\n{reference(json_schema(Case))}"
    if page == "gallery":
        text += "".join(map(pictures, sorted((ROOT / "docs").rglob("*.md"))))
    if page in PARTS:
        text = f"---\norphan: true\n---\n{text}"
    for name, file in BESIDE.items():
        text = re.sub(rf"\]\((\.\./)?{re.escape(file)}", f"]({name}.md", text)
    source[0] = re.sub(r"\]\(((?:pyproject|CITATION)[\w.]+)\)", r"](../\1)", text)


def tutorial(path: Path) -> str:
    """Return the page of a tutorial, a script with cells: its text and code, what it prints and draws, its notebook."""
    notebook = jupytext.read(path.with_suffix(".py"))
    jupytext.write(notebook, path.with_suffix(".ipynb"))
    name, printed = path.name, path.with_suffix(".txt").read_text(encoding="utf-8")
    for cell in notebook.cells:
        cell.source = cell.source.replace("  # noqa: E402", "")
    cells = [f"```python\n{one.source}\n```" if one.cell_type == "code" else one.source for one in notebook.cells]
    files = f"As a script: {{download}}`{name}.py`, as a notebook: {{download}}`{name}.ipynb`."
    return "\n\n".join([*cells, f"It prints\n\n```text\n{printed}```\n\nand draws", f"![{name}]({name}.png)", files])


def pictures(path: Path) -> str:
    """Return the pictures of a page, small, with its title and what they show; each leads to the page."""
    text, page = path.read_text(encoding="utf-8"), path.relative_to(ROOT / "docs")
    found = re.findall(r"^!\[(.+?)\]\((.+?)\)", text, re.MULTILINE)
    if page.parts[0] == "tutorials":
        text, found = path.with_suffix(".py").read_text(encoding="utf-8"), [(page.stem, f"{page.stem}.png")]
    title = re.search(r"^(?:# )?# ([^%].*)$", text, re.MULTILINE)
    if not found or not title or page.name == "index.md":
        return ""
    small = [f'[![{said}]({page.parent / file}){{width="32%"}}]({page})' for said, file in found]
    return f"\n\n## [{title[1]}]({page})\n\n{' '.join(small)}"


def signature(_: Any, what: str, name: str, thing: Any, *__: Any) -> tuple[str, str] | None:  # noqa: ARG001
    """Leave out the signature of a part of a case: its keys follow, each with its meaning."""
    return ("", "") if what == "class" and issubclass(thing, ConfigModel) else None


def docstring(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Read docstrings after Google's style, but those of single values, in which a colon is a colon."""
    if what not in ("attribute", "property"):
        lines[:] = GoogleDocstring(lines, Config(napoleon_use_ivar=True), app, what, name, thing, options).lines()


def visit_math(self: Any, node: Any) -> None:
    """Write a formula as MathML, which browsers draw themselves, without a network."""
    self.body.append(convert(node.astext(), display="block" if isinstance(node, nodes.math_block) else "inline"))
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """Connect what is above."""
    app.connect("source-read", read)
    app.connect("autodoc-process-signature", signature)
    app.connect("autodoc-process-docstring", docstring)
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math, None))
