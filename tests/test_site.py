"""The site that `make docs` builds: no broken link, no name without a text, and a search that finds, in a browser."""

from __future__ import annotations

import importlib
import inspect
import re
import shutil
import subprocess
import sys
import tomllib
from html import unescape
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

from ngfsi.config.describe import meaning
from ngfsi.config.model import ConfigModel
from tests.output.test_report import BROWSERS

ROOT = Path(__file__).parents[1]
LISTED = re.findall(
    r"^\.\. auto(?:class|function|module):: (\S+)$", (ROOT / "docs" / "api.md").read_text("utf-8"), re.M
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site; a warning, such as of a link that leads nowhere, fails."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", str(ROOT / "docs"), str(folder)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr[-2000:]
    return folder


def test_pages(site: Path) -> None:
    keys = (site / "case_file.html").read_text("utf-8")
    row = re.search(r"<tr[^>]*><td><p><code[^>]*><span class=\"pre\">step_s</span>.*?</tr>", keys, re.S)
    assert row
    cells = [unescape(re.sub("<[^>]+>", "", cell)).strip() for cell in re.findall("<td>(.*?)</td>", row[0], re.S)]
    assert cells == [
        "step_s, _ms, _min, _h", "number, > 0", "needed", "Nominal step, the distance of the rows of series.csv."
    ]  # fmt: skip
    assert "Return the case in a TOML file" in (site / "api.html").read_text("utf-8")
    # nothing is fetched from elsewhere
    for page in site.glob("*.html"):
        fetched = re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="(https?:[^"]*)"', page.read_text("utf-8"))
        assert fetched == []


def test_every_picture_is_in_the_gallery(site: Path) -> None:
    shown = set(re.findall(r'<img[^>]*src="_images/([^"]+)"', (site / "gallery.html").read_text("utf-8")))
    docs = ROOT / "docs"
    pages = [page for page in docs.rglob("*.md") if page != docs / "index.md"]
    there = {
        Path(name).name for page in pages for name in re.findall(r"^!\[.+?\]\((.+?)\)", page.read_text("utf-8"), re.M)
    } | {picture.name for picture in (docs / "tutorials").glob("*.png")}
    assert len(there) > 50
    # a picture whose name another has is numbered
    assert {re.sub(r"\d+(?=\.\w+$)", "", name) for name in shown} == {
        re.sub(r"\d+(?=\.\w+$)", "", name) for name in there
    }


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason="there is no Chrome or Chromium")
def test_search_finds_in_a_browser(site: Path) -> None:
    browser = next(filter(None, map(shutil.which, BROWSERS)))
    address = f"file://{site}/search.html?q=windkessel"
    command = [
        browser,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--virtual-time-budget=20000",
        "--dump-dom",
        address,
    ]
    page = subprocess.run(command, capture_output=True, text=True, check=True, timeout=240).stdout
    results = page.partition('id="search-results"')[2]
    assert 'href="case_file.html' in results


@pytest.mark.parametrize("name", LISTED)
def test_each_public_name_has_a_text(name: str) -> None:
    """It, its methods and properties, and its keys if it is a part of a case."""
    module, _, last = name.rpartition(".")
    thing = importlib.import_module(name) if name == "ngfsi.errors" else getattr(importlib.import_module(module), last)
    said = re.findall(r"^    (\w+): ", inspect.getdoc(thing) or "", re.M)
    silent = [key for key, member in _members(thing) if not inspect.getdoc(member) and key not in said]
    if isinstance(thing, type) and issubclass(thing, ConfigModel) and thing is not ConfigModel:
        silent += [key for key in thing.model_fields if not meaning(thing, key) and not _is_part(thing, key)]
    assert inspect.getdoc(thing)
    assert silent == []


def test_the_licence_of_each_package_is_listed() -> None:
    """Of those that a user installs, with extras or without."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = (needed for name, needed in project["optional-dependencies"].items() if name != "dev")
    needed = {re.match(r"[\w-]+", one)[0] for one in (*project["dependencies"], *chain(*extras))}  # type: ignore[index]
    rows = re.findall(r"^\| ([^|]+) \| [^|]+ \|", (ROOT / "docs" / "licences.md").read_text("utf-8"), re.M)
    assert {name for row in rows[1:] for name in row.removesuffix(", optional").split(", ")} == needed | {
        "netgen-mesher"
    }


def _members(thing: Any) -> list[tuple[str, Any]]:
    own = (type(None), staticmethod, classmethod, property)
    return [
        (key, value) for key, value in vars(thing).items()
        if not key.startswith("_") and (callable(value) or isinstance(value, own[1:]))
        and getattr(value, "__module__", "ngfsi").startswith("ngfsi")
    ]  # fmt: skip


def _is_part(model: type[ConfigModel], key: str) -> bool:
    """Return whether a field is a table, whose own text tells what it is."""
    return isinstance(model.model_fields[key].annotation, type) and issubclass(
        model.model_fields[key].annotation, ConfigModel  # type: ignore[arg-type]
    )  # fmt: skip
