# %% [markdown]
# # Your own mesh
# Any mesh of a vessel will do; here Netgen makes one of a trunk with a narrow branch at a sharp angle, whose
# faces have the names that somebody gave them. `names` says what they are.

# %%
from pathlib import Path

from netgen.occ import Cylinder, Dir, OCCGeometry, Pnt, X, Z

trunk = Cylinder(Pnt(0, 0, 0), Z, r=4, h=40)
branch = Cylinder(Pnt(0, 0, 14), Dir(1, 0, 0.8), r=2.5, h=22)
lumen = trunk + branch
lumen.mat("blood")
lumen.faces.name = "vein wall"
lumen.faces.Min(Z).name, lumen.faces.Max(Z).name, lumen.faces.Max(X).name = "in", "out", "branch"
OCCGeometry(lumen).GenerateMesh(maxh=2).Save("fork.vol")

Path("fork.toml").write_text("""
name = "fork"

[geometry]
type = "external_mesh"
file = "fork.vol"
unit = "mm"
smooth = ["interface"]
names = { "blood" = "fluid", "vein wall" = "interface", "in" = "inlet", "out" = "outlet", "branch" = "outlet_2" }

[materials]
fluid = { set = "blood" }

[loads]
inlet_flow = { kind = "constant", value_ml_s = 2.0 }
openings.outlet_2 = { kind = "pressure", pressure = { kind = "constant", value_mmHg = 10 } }

[time]
scheme = "static"
step_s = 1.0
end_s = 1.0
""")

# %% [markdown]
# `ngfsi check fork.toml` says what was read, and draws it; from Python:

# %%
from ngfsi.case import Case  # noqa: E402
from ngfsi.run.check import check  # noqa: E402

case = Case.from_toml("fork.toml")
found = check(case, Path("runs/check-fork"))
for opening in found.openings:
    print(f"{opening.name}: {1e6 * opening.area:.1f} mm2")

# %% [markdown]
# Only then is it run. The wall is rigid, since the mesh has no other region.

# %%
from ngfsi.run import run  # noqa: E402

stored = run(case, Path("runs/fork"))
series = stored.series
share = series["flow_outlet_2_m3_s"][-1] / series["flow_in_m3_s"][-1]
print(f"{share:.1%} of the blood leave through the branch; SAWSS is {series['sawss_Pa'][-1]:.3f} Pa")

# %%
import pyvista as pv  # noqa: E402

wall = stored.fields(1.0, "wall")
pv.OFF_SCREEN = True
plotter = pv.Plotter(window_size=(900, 600))
plotter.add_mesh(
    wall,
    scalars="wall_shear_magnitude_Pa",
    cmap="viridis",
    scalar_bar_args={"vertical": True, "title": "wall shear stress [Pa]"},
)
plotter.view_xz()
plotter.screenshot("own_mesh.png")
