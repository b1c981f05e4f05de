# %% [markdown]
# # A placement study
#
# Where should the two ERAs of the example plate be, so that its weakest place is as strong as can be? A scene is cheap to change:
# `with_` makes a copy, `reach` tells the strongest peak that can be had at every place.

# %%
import era
import matplotlib.pyplot as plt
import numpy as np

plate = era.Scene.example("plate")


def moved(x_mm: float, y_mm: float) -> era.Scene:
    """The left ERA at a place, the right one opposite, on the other side of the plate's middle."""
    length_mm, width_mm = 1e3 * plate.length_m, 1e3 * plate.width_m
    return plate.with_(
        actuator={"left": {"x_mm": x_mm, "y_mm": y_mm}, "right": {"x_mm": length_mm - x_mm, "y_mm": width_mm - y_mm}}
    )


def weakest_g(scene: era.Scene) -> float:
    return era.reach(scene, tolerance="fast").weakest()[0]


first_g = weakest_g(plate)
print(f"as it is: {first_g:.3f} g at the weakest place")

# %% [markdown]
# A coarse grid over a quarter of the plate: a look takes a second or two.

# %%
x_mm = np.array([25.0, 50.0, 75.0, 100.0])
y_mm = np.array([60.0, 100.0])
weakest = np.array([[weakest_g(moved(x, y)) for x in x_mm] for y in y_mm])
row, column = np.unravel_index(np.argmax(weakest), weakest.shape)
best = moved(x_mm[column], y_mm[row])
best_g = weakest[row, column]
print(f"best: {best_g:.3f} g with the left one at {x_mm[column]:.0f}, {y_mm[row]:.0f} mm, {best_g / first_g:.2f} times as much")

# %% [markdown]
# The study was made with a tolerance of 1e-2; the best one is computed again with 1e-3.

# %%
finally_g = era.reach(best).weakest()[0]
print(f"to 1e-3: {finally_g:.3f} g")

# %%
figure, axes = plt.subplots(3, 1, figsize=(7, 12), layout="constrained")
picture = axes[0].imshow(weakest, origin="upper", aspect="auto")
axes[0].set_xticks(range(len(x_mm)), [f"{x:.0f}" for x in x_mm])
axes[0].set_yticks(range(len(y_mm)), [f"{y:.0f}" for y in y_mm])
for (i, j), value in np.ndenumerate(weakest):
    axes[0].text(j, i, f"{value:.2f}", ha="center", va="center", color="white" if value < 0.7 * best_g else "black")
axes[0].set(xlabel="left ERA's x in mm", ylabel="left ERA's y in mm", title="Weakest place in g, by where the ERAs are")
figure.colorbar(picture, ax=axes[0], label="g")
maps = [(plate, "before"), (best, "after")]
reaches = [era.reach(scene) for scene, _ in maps]
most_g = max(np.nanmax(reach.strongest_g) for reach in reaches)
for axis, (scene, name), reach in zip(axes[1:], maps, reaches):
    mesh = axis.pcolormesh(1e3 * reach.x_m, 1e3 * reach.y_m, reach.strongest_g, shading="gouraud", vmin=0.0, vmax=most_g)
    axis.plot(*(1e3 * scene.actuator_xy_m.T), "wo", fillstyle="none", markersize=12)
    least_g, place_m = reach.weakest()
    axis.plot(1e3 * place_m[0], 1e3 * place_m[1], "rx", markersize=10, clip_on=False)
    axis.set(xlabel="x in mm", ylabel="y in mm", aspect="equal", title=f"{name}: weakest {least_g:.3f} g (cross)")
    axis.invert_yaxis()
    figure.colorbar(mesh, ax=axis, label="strongest peak in g")
plt.show()
