"""A panel that is not quite what its scene says: springs, material, thickness and places off, from first principles.

- A spring k becomes f k, and whatever else is of the same spring (its rotation) with it; a clamp or a pin has none. Dashpots and loss factors stay.
- All material is f times as stiff: Young's and shear moduli of the surface, of every layer and of every patch, Poisson's ratios as they are. A
  laminate's stiffnesses are sums of moduli times moments of thickness, all of which then have the same factor.
- Everything is f times as thick, at its density: weight times f, and bending stiffness times f^3, as heights above a neutral plane are f times as large.
- Supports, masses and actuators are elsewhere; a bar has no y.
"""

from dataclasses import replace

# A place that is so near to a border, as a part of the side, is on it: thousandths of a metre and back are rounded.
ON_THE_BORDER = 1e-9


def off(scene, panel):
    """The scene with what `panel` names off: a table of factors and places (mm) as in `off` of `era plan --spread --json`."""
    springs = panel.get("springs", {})
    scaled = lambda kind, item, factor: replace(item, stiffness=item.stiffness * factor, **_rotation(item, factor))
    for kind in ("supports", "edges", "actuators"):
        items = getattr(scene, kind)
        if springs and items:
            scene = replace(scene, **{kind: tuple(scaled(kind, item, factor) for item, factor in zip(items, springs[kind], strict=True))})
    scene = _scaled(scene, panel.get("youngs_modulus", 1.0), panel.get("thickness", 1.0))
    places = panel.get("places_mm", {})
    for kind in ("supports", "masses", "actuators"):
        items = getattr(scene, kind)
        if places and items:
            moved = zip(items, places[kind], strict=True)
            scene = replace(scene, **{kind: tuple(replace(item, **_place(scene, place)) for item, place in moved)})
    return scene


def _rotation(item, factor):
    own = getattr(item, "rotational_stiffness", None)
    return {} if own is None else {"rotational_stiffness": own * factor}


def _place(scene, place_mm):
    """A place in m, on the border where it is meant to be."""
    at = []
    for mm, side in zip(place_mm, (scene.length, scene.width)):
        m = mm * 1e-3
        at.append(0.0 if abs(m) < ON_THE_BORDER * side else side if abs(m - side) < ON_THE_BORDER * side else m)
    return {"x": at[0], "y": scene.width / 2 if scene.is_bar else at[1]}


def _scaled(scene, stiffer, thicker):
    """The scene with all material so many times as stiff, and as thick."""
    material = lambda own: replace(own, youngs_modulus_pa=own.youngs_modulus_pa * stiffer)
    laminate = scene.laminate
    if laminate is not None:
        bending = tuple(own * stiffer * thicker**3 for own in laminate.bending)
        laminate = replace(laminate, thickness=laminate.thickness * thicker, weight=laminate.weight * thicker, bending=bending)
    patches = (replace(patch, thickness=patch.thickness * thicker, material=material(patch.material)) for patch in scene.patches)
    return replace(scene, thickness=scene.thickness * thicker, material=material(scene.material), patches=tuple(patches), laminate=laminate)
