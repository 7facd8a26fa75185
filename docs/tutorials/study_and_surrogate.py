# %% [markdown]
# # A parameter study with a surrogate
# How much of a vein's area is lost, over the stiffness of tissue and wall? Eight plane sections of the calf,
# spread evenly over both ranges, and a Gaussian process through them, which also says how sure it is.

# %%
from pathlib import Path

import numpy as np

from ngfsi.case import Case
from ngfsi.run.new import new
from ngfsi.study import Study, run_study
from ngfsi.study.design import sobol
from ngfsi.study.surrogate import Surrogate

new("section", Path("section.toml"))
case = Case.from_toml("section.toml").replace(**{"time.step_s": 1.0})
design = sobol({"materials.tissue.young_kPa": (8, 24), "materials.wall.young_kPa": (50, 300)}, 8)


def lost(run):
    """Return the part of the vein's area that is lost."""
    area = run.series["lumen_area_m2"]
    return 1 - area[-1] / area[0]


study = Study.of("stiffness", design, case, {"lost_1": lost})
results = run_study(study, Path("runs/stiffness"))
losses = [row["lost_1"] for row in results.table.values()]

# %% [markdown]
# The surrogate predicts each point from the others; the figure shows what it says between them.

# %%
surrogate = Surrogate.through(design, losses)
tissue, wall = np.meshgrid(np.linspace(8, 24, 40), np.linspace(50, 300, 40))
mean, deviation = surrogate(np.stack([tissue.ravel(), wall.ravel()], axis=1))
print(f"losses from {mean.min():.1%} to {mean.max():.1%}, known to {deviation.max():.1%}")

# %%
import matplotlib.pyplot as plt  # noqa: E402

figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
levels = axes.contourf(tissue, wall, 100 * mean.reshape(tissue.shape), 12, cmap="viridis")
axes.plot(*design.points.T, "k.")
axes.set(xlabel="Young's modulus of the tissue [kPa]", ylabel="of the wall [kPa]")
figure.colorbar(levels, label="area lost [%]")
figure.savefig("study_and_surrogate.png", dpi=150)
