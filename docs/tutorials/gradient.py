# %% [markdown]
# # A gradient
# What would change the answer? A discrete adjoint of the whole run gives the derivative of a result by any number
# of parameters for about the price of two more runs. Here: the volume that a vein with its wall alone loses while
# the pressure around it rises.

# %%
from pathlib import Path

from ngfsi.case import Case
from ngfsi.gradient.command import gradient
from ngfsi.run.new import new

new("wall", Path("wall.toml"))
case = Case.from_toml("wall.toml").replace(**{"time.end_s": 0.5})
found = gradient(case, "lumen_volume_loss", "materials,loads", "", Path("runs/gradient"), lambda _: None)

# %% [markdown]
# Elasticities are percent per percent, the largest first: what matters here, of this run.

# %%
for name, elasticity in list(found.elasticities().items())[:6]:
    print(f"{name}: {elasticity:+.3f}")

# %% [markdown]
# The bar chart and the numbers are in the folder; `ngfsi gradient wall.toml --of lumen_volume_loss` does the same.

# %%
Path("gradient.png").write_bytes(Path("runs/gradient/gradient.png").read_bytes())
