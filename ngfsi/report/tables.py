"""Tables in Markdown, nested tables as one, and the table of estimated errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ngfsi.store.stored import StoredRun
from ngfsi.units import Shown, in_unit

ERRORS = {
    f"{name}_{when}_1": Shown(f"from {name}, {words}", "percent")
    for name in ("space", "time") for when, words in (("end", "at the end"), ("largest", "largest"))
}  # fmt: skip
"""Column of estimated errors -> how it is shown."""
ERRORS_HEAD = ["quantity", "at the end", *(shown.head for shown in ERRORS.values())]


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown, the first column aligned left, the others right.

    Raises:
        ValueError: a row has not a cell for each column.
    """
    lines = [_line(head), _line(["---", *(["---:"] * (len(head) - 1))])]
    for row in rows:
        if len(row) != len(head):
            raise ValueError(f"a row of {len(row)} cells below a head of {len(head)}: {[*head]}, {[*row]}")
        lines.append(_line(row))
    return "\n".join(lines) + "\n"


def flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables as one, the path as key; floats as text with six digits."""
    found: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            found |= flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = f"{value:.6g}" if isinstance(value, float) else value
    return found


def error_rows(run: StoredRun) -> list[list[str]]:
    """Return the estimated errors of a run below `ERRORS_HEAD`; "-" where there was no companion or it failed."""
    return [
        [str(row["quantity"]), error_value(row),
         *(f"{shown(float(row[name])):.2g}" if name in row else "-" for name, shown in ERRORS.items())]
        for row in run.errors
    ]  # fmt: skip


def error_value(row: Mapping[str, float | str]) -> str:
    """Return the value of a row of errors with its unit."""
    return in_unit(float(row["value"]), "percent" if row["unit"] in (1, "1") else str(row["unit"]), ".4g")


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
