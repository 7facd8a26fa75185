"""The page of verification: tables and convergence plots of stored benchmark results, and the terminal's table."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import groupby
from operator import attrgetter
from pathlib import Path

from rich.table import Table

from ngfsi.report.figures import Convergence, convergence, signals_over_time
from ngfsi.report.tables import markdown_table
from ngfsi.store.disk import explained
from ngfsi.store.provenance import versions
from ngfsi.verify.engine import Result, Row, not_verified

HEAD = ("quantity", "computed", "reference", "error", "allowed", "observed order", "expected", "")
PAGE, FOLDER = "verification.md", "verification"


def write_page(folder: Path) -> Path:
    """Write the page and its figures from all results stored in `folder`/verification, and return its path.

    Raises:
        OutputError: the folder cannot be written.
    """
    results = [Result.read(path) for path in sorted((folder / FOLDER).glob("*.json"))]
    page = folder / PAGE
    with explained(page):
        for result in results:
            _draw(result, folder / FOLDER)
        page.write_text(_text(results), encoding="utf-8")
    return page


def _text(results: Sequence[Result]) -> str:
    passed = sum(result.passed for result in results)
    return "\n".join(
        (
            "# Verification\n",
            "What ngfsi computes, held against exact solutions and published values. `ngfsi verify` computes the "
            "benchmarks again, `ngfsi verify --level full` on more and finer levels. Errors are relative unless the "
            "reference is 0. An observed order is that of the two finest levels.\n",
            f"{passed} of {len(results)} benchmarks pass.\n",
            markdown_table(("benchmark", "level", "seconds", "passes"), [
                (f"[{r.title}](#{_anchor(r.title)})", r.level, f"{r.seconds:.0f}", "yes" if r.passed else "**no**")
                for r in results
            ]),
            "**Not verified:** " + not_verified() + "\n",
            *(_section(result) for result in results),
            "## Computed with\n",
            ", ".join(f"{name} {version}" for name, version in versions().items()) + "\n",
        )
    )  # fmt: skip


def _anchor(title: str) -> str:
    return "".join(c for c in title.lower() if c.isalnum() or c in " -").replace(" ", "-")


def _section(result: Result) -> str:
    tables = [
        f"{series}\n\n{markdown_table(HEAD, map(_cells, rows))}"
        for series, rows in groupby(result.rows, attrgetter("series"))
    ]
    sources = dict.fromkeys(row.source for row in result.rows)
    figures = [f"![Convergence]({FOLDER}/{result.name}.png)\n"] if _curves(result) else []
    for series in result.signals:
        picture, values = (result.file(Path(FOLDER), series, ending).as_posix() for ending in ("png", "csv"))
        figures.append(f"![{series} over time]({picture})\n\n[Values of {series} over time]({values})\n")
    head = f"## {result.title}\n\n**Solved:** {result.solves}\n\n**Held against:** {result.exact}\n"
    return "\n".join([head, *tables, *figures, f"Sources: {'; '.join(sources)}\n"])


def _cells(row: Row) -> tuple[str, ...]:
    unit = "" if row.unit == "1" else f" {row.unit}"
    return (
        row.quantity,
        f"{row.computed:.6g}{unit}",
        f"{row.reference:.6g}{unit}",
        f"{row.error:.1e}",
        f"{row.tolerance:.1e}",
        "-" if row.order is None else f"{row.order:.2f}",
        "-" if row.expected_order is None else f"{row.expected_order:g}",
        "pass" if row.passed else "**fail**",
    )


def _curves(result: Result) -> dict[str, list[Convergence]]:
    """Return the panels of a result: quantities whose order is asked for and that have an error to plot."""
    panels: dict[str, list[Convergence]] = defaultdict(list)
    for row in result.rows:
        if row.expected_order is not None and len(row.sizes) > 1 and min(row.errors) > 0:
            panels[row.quantity].append(Convergence(row.series, row.sizes, row.errors, row.expected_order))
    return panels


def _draw(result: Result, folder: Path) -> None:
    if panels := _curves(result):
        convergence(panels, folder / f"{result.name}.png")
    for series, signals in result.signals.items():
        signals_over_time(signals.columns, signals.rows, result.file(folder, series, "png"))


def terminal_table(results: Iterable[Result]) -> Table:
    """Return all rows for the terminal."""
    table = Table("benchmark", "series", *HEAD)
    for result in results:
        for row in result.rows:
            table.add_row(result.name, row.series, *_cells(row), style="" if row.passed else "red")
    return table
