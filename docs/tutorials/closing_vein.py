# %% [markdown]
# # An oval vein closes
# A round vein is stiff: it must be made shorter around. An oval one bends flat, under pressures that a stocking
# reaches, until its sides touch. `ngfsi new vein` writes such a case: blood comes from a pressure behind a
# resistance, so that a vein that closes stops it, and contact keeps the sides apart by a small gap.

# %%
from pathlib import Path

from ngfsi.case import Case
from ngfsi.run import run
from ngfsi.run.new import new

new("vein", Path("vein.toml"))
case = Case.from_toml("vein.toml").replace(
    **{"geometry.length_mm": 20, "geometry.mesh.axial_layers": 1, "time.step_ms": 50, "output.fields_every": 5}
)
stored = run(case, Path("runs/vein"))

# %% [markdown]
# What is left of its area, and what still flows:

# %%
series = stored.series
area = series["lumen_area_mean_m2"] / series["lumen_area_mean_m2"][0]
flow = series["flow_out_m3_s"] / series["flow_out_m3_s"][0]
print(f"under 60 mmHg: {area[-1]:.1%} of the area, {flow[-1]:.1%} of the flow")

# %%
import matplotlib.pyplot as plt  # noqa: E402

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for time in stored.field_times():
    _, rings = stored.outlines(time)
    x, y, _ = 1e3 * rings[5].T
    axes.fill(x, y, fill=False, edgecolor=plt.cm.viridis(time), label=f"{time:.2f} s")
axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
figure.legend(loc="outside right")
figure.savefig("closing_vein.png", dpi=150)
