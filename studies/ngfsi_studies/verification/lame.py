"""Lame's thick-walled cylinder."""

from __future__ import annotations

from ngfsi.materials import SaintVenantKirchhoff
from ngfsi.verify import Benchmark, Reference, Setting, Values
from ngfsi_studies.verification.radial import lame
from ngfsi_studies.verification.tube import inner_radius_change

INNER, OUTER, INSIDE, OUTSIDE = 5.55e-3, 16e-3, 0.5, 0.2
RATIOS = {0.3: "full", 0.45: "full", 0.499: "reduced", 0.4999: "reduced"}
"""Poisson's ratio -> how the resistance to changes of volume is integrated."""


def compute(setting: Setting) -> Values:
    """Return the inner displacement over that of the linear solution, for each Poisson ratio."""
    order, refinement = setting["order"], round(1 / setting["h"])
    found = {}
    for poisson, integration in RATIOS.items():
        law = SaintVenantKirchhoff(young=30e3, poisson=poisson, density=0.0)
        u = inner_radius_change(
            INNER, 2e-3, OUTER, (law, law), INSIDE, OUTSIDE, order=order, refinement=refinement,
            **{"discretisation.bulk_integration": integration},
        )  # fmt: skip
        found[f"nu {poisson}: u / u Lame"] = u / lame(INNER, OUTER, law.young, law.poisson, INSIDE, OUTSIDE)
    return found


CASE = Benchmark(
    title="Lame cylinder",
    solves="a ring of wall and tissue of one linear elastic law under pressure inside and outside, by the coupled "
    "system: blood at rest in the lumen, pressure on the skin, ends on rollers",
    exact="the displacement of the inner face in plane strain; strains of 1e-5, at which the law is linear to 1e-4. "
    "From nu = 0.499 with bulk_integration = 'reduced': the full one locks, at 0.4999 on the coarsest mesh by 26 % "
    "with k = 2 and by 0.45 % with k = 3",
    compute=compute,
)
LEVELS = {
    "ci": {"k = 3": ({"order": 3, "h": 1.0},)},
    "full": {f"k = {k}": tuple({"order": k, "h": h} for h in (1.0, 0.5)) for k in (2, 3, 4)},
}
REFERENCES = tuple(
    Reference(
        f"nu {poisson}: u / u Lame",
        1.0,
        "1",
        {"k = 2": 1e-2, "k = 3": 5e-4, "k = 4": 2e-4},
        "G. Lame, 1852; see radial.py",
    )
    for poisson in RATIOS
)
