# %% [markdown]
# # An image of a calf
# A label map, as 3D Slicer writes it, becomes a calf with its bones and its vein. `ngfsi new image` writes an
# example as rough as hand-made ones are; `ngfsi new image --file leg.seg.nrrd` takes yours.

# %%
from pathlib import Path

from ngfsi_geometry.pictures import draw_sections

from ngfsi.case import Case
from ngfsi.run import run
from ngfsi.run.new import new

new("image", Path("image.toml"))
case = Case.from_toml("image.toml").replace(
    **{"time.end_s": 0.2, "time.step_ms": 100, "loads.skin_pressure.duration_s": 0.2}
)

# %% [markdown]
# How far are the smooth surfaces from the labels, slice by slice?

# %%
rows = case.geometry.deviations()
for part in ("skin", "tibia", "fibula", "lumen"):
    worst = max((row for row in rows if row["part"] == part), key=lambda row: float(row["distance_max_m"]))
    print(f"{part}: at most {1e3 * float(worst['distance_max_m']):.2f} mm, in slice {worst['slice']}")
draw_sections(case.geometry, Path("own_image.png"))

# %%
stored = run(case, Path("runs/image"))
lost = 1 - stored.series["lumen_volume_m3"][-1] / stored.series["lumen_volume_m3"][0]
print(f"under 15 mmHg the vein loses {lost:.1%} of its volume")
