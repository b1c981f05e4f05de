# %% [markdown]
# # A panel's map
#
# What a touch does all over the example plate: strong where the finger is, weak elsewhere. And what could be had at every place.

# %%
import era
import matplotlib.pyplot as plt
import numpy as np

plate = era.Scene.example("plate")
touch_m = plate.point_m(480, 640)
field = era.field(plate, touch_m, intensity_g=0.3)
print(f"contrast {field.contrast_db:.1f} dB, model error at most {field.error_bound:.0e} of the largest peak")

# %%
reach = era.reach(plate)
weakest_g, weakest_m = reach.weakest()
print(f"weakest place: {weakest_g:.3f} g at {1e3 * weakest_m[0]:.0f}, {1e3 * weakest_m[1]:.0f} mm")

# %% [markdown]
# Maps are arrays of rows and columns from border to border; y counts downwards, as on a screen.

# %%
extent_mm = (0.0, 1e3 * plate.length_m, 1e3 * plate.width_m, 0.0)
figure, axes = plt.subplots(3, 1, figsize=(7, 12), layout="constrained")
maps = [
    (field.peak_g, "peak in g", "a touch of 0.3 g at the cross"),
    (reach.strongest_g, "peak in g", "the largest possible peak at every place; cross: the weakest place"),
    (reach.contrast_db, "contrast in dB", "the largest possible contrast at every place"),
]
for axis, (values, unit, title) in zip(axes, maps):
    # Points lie on the borders: interpolated between them.
    mesh = axis.pcolormesh(1e3 * field.x_m, 1e3 * field.y_m, values, shading="gouraud")
    figure.colorbar(mesh, ax=axis, label=unit)
    axis.plot(*(1e3 * plate.actuator_xy_m.T), "wo", fillstyle="none", markersize=12)
    axis.plot(*(1e3 * plate.support_xy_m.T), "r^", clip_on=False)
    axis.set(xlabel="x in mm", ylabel="y in mm", title=title, aspect="equal", xlim=extent_mm[:2], ylim=extent_mm[2:])
axes[0].plot(1e3 * touch_m[0], 1e3 * touch_m[1], "rx", markersize=10)
axes[1].plot(1e3 * weakest_m[0], 1e3 * weakest_m[1], "rx", markersize=10, clip_on=False)
plt.show()

# %% [markdown]
# The map's largest value need not be at the finger: elsewhere the plan asks for little on the whole, not everywhere.

# %%
row, column = np.unravel_index(np.nanargmax(field.peak_g), field.peak_g.shape)
largest_g = field.peak_g[row, column]
print(f"largest peak: {largest_g:.3f} g at {1e3 * field.x_m[column]:.0f}, {1e3 * field.y_m[row]:.0f} mm")
