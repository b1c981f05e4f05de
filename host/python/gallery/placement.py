# %% [markdown]
# # A placement study
#
# Where should two ERAs of a plate be, so that its weakest place is as strong as can be? They begin on its axis. A study's text says what may
# change and what is wanted (`docs/src/studies.md`); `era.study.run` looks at all designs quickly, and computes the best ones anew.

# %%
import tempfile

import era
import era.study
import matplotlib.pyplot as plt
import numpy as np

on_axis = {"left": {"x_mm": 75.0, "y_mm": 100.0}, "right": {"x_mm": 225.0, "y_mm": 100.0}}
plate = era.Scene.example("plate").with_(actuator=on_axis)
text = """
version = 1
name = "two ERAs across from each other"
scene = "plate.toml"                  # of no account here: the scene is given beside the text

[[variable]]
place = "actuator.left"
within_mm = [25, 25, 275, 175]        # of centres: housings of 50 mm do not stand out over the edge

[[variable]]
place = "actuator.right"
mirror_of = "actuator.left"
mirrored = "both"

[[apart]]                             # nor do they touch
places = ["actuator.*"]
distance_mm = 52

[[wish]]
figure = "weakest_g"

[method]
way = "sobol"
designs = 64
seed = 1
finalists = 2
"""
study = era.Study(text, plate)

# %% [markdown]
# The study's folder has a report, and what has been computed so far: with a folder that stays the same call goes on where it was ended.


# %%
def tell(there: int, of: int) -> None:
    if 4 * there // of > 4 * (there - 1) // of:
        print(f"{there} of {of} designs are computed")


with tempfile.TemporaryDirectory() as folder:
    found = era.study.run(study, folder=folder, progress=tell)
first_g, best = found.base.figures["weakest_g"], found.best[0]
best_g = best.figures["weakest_g"]
print(f"unchanged scene: {first_g:.3f} g at the weakest place")
print(f"best: {best_g:.3f} g with the ERAs at {np.round(1e3 * best.scene.actuator_xy_m).tolist()} mm, {best_g / first_g:.2f} times as much")
print(f"(error at most {best.error_bound}; {found.failed} of {study.designs} designs failed)")

# %%
figure, axes = plt.subplots(3, 1, figsize=(7, 12), layout="constrained")
x_mm, y_mm, weakest = (found.table[name][1:] for name in ("actuator.left.x_mm", "actuator.left.y_mm", "weakest_g"))
points = axes[0].scatter(x_mm, y_mm, c=weakest, s=60)
failed = np.isnan(weakest)
axes[0].plot(x_mm[failed], y_mm[failed], "kx", label="ERAs too near to each other")
axes[0].plot(*(1e3 * best.scene.actuator_xy_m[0]), "ro", fillstyle="none", markersize=14, label="best")
axes[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)
axes[0].set(xlabel="left ERA's x in mm", ylabel="left ERA's y in mm", aspect="equal", title="Peak at the weakest place, by the position of the left ERA")
axes[0].set(xlim=(0.0, 1e3 * plate.length_m), ylim=(0.0, 1e3 * plate.width_m))
figure.colorbar(points, ax=axes[0], label="g")
maps = [(plate, "before"), (best.scene, "after")]
reaches = [era.reach(scene) for scene, _ in maps]
most_g = max(np.nanmax(reach.strongest_g) for reach in reaches)
for axis, (scene, name), reach in zip(axes[1:], maps, reaches):
    mesh = axis.pcolormesh(1e3 * reach.x_m, 1e3 * reach.y_m, reach.strongest_g, shading="gouraud", vmin=0.0, vmax=most_g)
    axis.plot(*(1e3 * scene.actuator_xy_m.T), "wo", fillstyle="none", markersize=12)
    least_g, place_m = reach.weakest()
    axis.plot(1e3 * place_m[0], 1e3 * place_m[1], "rx", markersize=10, clip_on=False)
    axis.set(xlabel="x in mm", ylabel="y in mm", aspect="equal", title=f"{name}: weakest place {least_g:.3f} g (cross)")
    figure.colorbar(mesh, ax=axis, label="strongest peak in g")
for axis in axes:
    axis.invert_yaxis()
plt.show()
