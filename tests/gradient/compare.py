"""`python -m tests.gradient.compare [CASE ...]`: the table of docs/gradients.md, of each gradient of the tests, or of
some, by each parameter.

Differences of whole runs are those of four runs, to fourth order.
"""

from __future__ import annotations

import sys

from ngfsi.report.tables import markdown_table
from tests.gradient.test_gradient import CASES, gradient, moved, value

FAR = 100
"""Distance of the runs from each other, over the steps in the differences of the residual."""


def main() -> None:
    """Print the table."""
    for name in sys.argv[1:] or CASES:
        case, quantity, window, by = CASES[name]
        found, rows = gradient(case, quantity, window, by), []
        for one in found.parameters:
            step = FAR * one.step
            near, far = (
                value(moved(case, [one], [k * step]), quantity, window)
                - value(moved(case, [one], [-k * step]), quantity, window)
                for k in (1, 2)
            )
            difference, derivative = (8 * near - far) / (12 * step), found.derivatives[one.name]
            rows.append([f"`{one.name}`", f"{found.elasticities()[one.name]:.4g}",
                         f"{abs(derivative / difference - 1) if difference else 0:.0e}"])  # fmt: skip
        print(f"{name}: `{found.name}`\n\n{markdown_table(['parameter', '% per %', 'difference'], rows)}", flush=True)


if __name__ == "__main__":
    main()
