"""Tables of the source study, as printed."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any


def tables(study: str) -> dict[str, Any]:
    """Return the printed tables that a study is held against."""
    with (Path(__file__).parent / "source_tables.toml").open("rb") as file:
        found: dict[str, Any] = tomllib.load(file)[study]
    return found
