# %% [markdown]
# # A first run and its report
# A calf with its bones, a round vein and the blood in it, pressed by a stocking. The case file comes from `ngfsi
# new calf`; here its steps are made longer and the load shorter, so that it takes seconds.

# %%
from pathlib import Path

from ngfsi.case import Case
from ngfsi.report.html import report
from ngfsi.run import run
from ngfsi.run.new import new

new("calf", Path("calf.toml"))
case = Case.from_toml("calf.toml").replace(
    **{
        "name": "first",
        "discretisation.order": 2,
        "loads.skin_pressure.duration_s": 0.4,
        "time.end_s": 0.4,
        "time.step_ms": 50,
    }
)
stored = run(case, Path("runs/first"))

# %% [markdown]
# A run is a folder; its time series has one column for each quantity, with its unit (SI) in the name.

# %%
series = stored.series
lost = 1 - series["lumen_volume_m3"] / series["lumen_volume_m3"][0]
print(
    f"volume lost: {lost[-1]:.1%}, SAWSS: {series['sawss_Pa'][0]:.3f} Pa before, {series['sawss_Pa'][-1]:.3f} Pa after"
)

# %% [markdown]
# `report` makes one HTML file with charts to point at; the picture is drawn with matplotlib.

# %%
report([stored.path], Path("runs/first/report.html"))

import matplotlib.pyplot as plt  # noqa: E402

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
left.plot(series["time_s"], 100 * lost)
left.set(xlabel="time [s]", ylabel="volume lost [%]")
right.plot(series["time_s"], series["sawss_Pa"])
right.set(xlabel="time [s]", ylabel="SAWSS [Pa]")
figure.savefig("first_run.png", dpi=150)
