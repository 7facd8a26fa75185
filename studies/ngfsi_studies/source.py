"""What the source study prints, and what follows from it without a computation."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

TABLES = Path(__file__).with_name("source_tables.toml")


def everything() -> dict[str, Any]:
    """Return all that `source_tables.toml` holds."""
    return tomllib.loads(TABLES.read_text(encoding="utf-8"))


def tables(study: str) -> Any:
    """Return the printed tables that a study is held against."""
    return everything()[study]


def inferred_flow() -> float:
    """Return the inflow (ml/s) that chapter 6 most likely had; it prints none.

    It scales the flow of the images by the areas of model and images, and is of the one subject of chapter 5 whose loss
    of volume and rise of wall shear stress it quotes.
    """
    chapter = tables("compare_tissues")
    measured: float = tables("rigid_veins")["flow_ml_s"]["before"][chapter["subject"] - 1]
    return float(chapter["area_fsi_to_mri"]) * measured


def claims() -> dict[str, Any]:
    """Return the printed numbers of the fluid-structure interaction, and what must be known to hold runs against them.

    This is the entry point `ngfsi.claims`: numbers by claim and law (M, N), `citation`, and `remark`, sentences.
    """
    flow, subject = inferred_flow(), tables("compare_tissues")["subject"]
    remark = (
        "The source prints its formula of a rise, (compressed - uncompressed) / uncompressed. It prints no flow: "
        f"{flow:.3f} ml/s is inferred from subject {subject} of its measurements. How the pressure rises within 1 s, "
        "linearly or smoothly, is not said either: the linear ramp is a choice of this project (study ramp_shape)."
    )
    return {**tables("compare_tissues"), "remark": remark}
